"""A sweep's returns taken in one after the other, but P touched once: the left-looking form of the sequential update.

Each return needs only two rows of H P. They are formed from P as it was before the sweep, and what the earlier returns
took off is subtracted from them (they are projected against the rows W already collected). The rows of all returns
leave P together in one symmetric pass, P -= W W'. Every return is still linearised at the mean that the ones before it
left: the result is that of `gaussian.downdate` after each, to rounding, at a part of its cost.

The scratch `work` holds the rows collected (and room for two more), then rows of other use, each [n].
"""

import math

from estimators.kernels.jit import inline
from estimators.kernels.simd import aligned_zeros, project, subtract_rows

ROWS = 32  # collected before P must be settled: sixteen returns
CORRECTION, SHIFT = ROWS + 2, ROWS + 3  # for filters that move their mean after the sweep
_GAIN = ROWS + 4  # with the next one: what the rows collected have in common with a new one
_HEIGHT = ROWS + 6


def scratch(n_max):
    """`work` for states of up to n_max rows."""
    return aligned_zeros(_HEIGHT, max(n_max, ROWS))


@inline
def spread(P, work, lane, n, rows, j, a00, a01, a10, a11, c0, c1):
    """H P into the rows `rows` and rows + 1 of `work`, for a return of the point at row j; H P H' as (s00, s01, s11).

    H = [-A, c, A] over robot position, heading and the point; `rows` rows have been collected, at most ROWS - 2.
    """
    for i in range(n):
        dx = P[lane, j, i] - P[lane, 0, i]
        dy = P[lane, j + 1, i] - P[lane, 1, i]
        turn = P[lane, 2, i]
        work[rows, i] = a00 * dx + a01 * dy + c0 * turn
        work[rows + 1, i] = a10 * dx + a11 * dy + c1 * turn
    for k in range(rows):
        dx, dy, turn = work[k, j] - work[k, 0], work[k, j + 1] - work[k, 1], work[k, 2]
        work[_GAIN, k] = a00 * dx + a01 * dy + c0 * turn
        work[_GAIN + 1, k] = a10 * dx + a11 * dy + c1 * turn
    project(work, rows, n, rows, _GAIN)
    dx, dy = work[rows, j] - work[rows, 0], work[rows, j + 1] - work[rows, 1]
    s00 = a00 * dx + a01 * dy + c0 * work[rows, 2]
    s01 = a10 * dx + a11 * dy + c1 * work[rows, 2]
    dx, dy = work[rows + 1, j] - work[rows + 1, 0], work[rows + 1, j + 1] - work[rows + 1, 1]
    return s00, s01, a10 * dx + a11 * dy + c1 * work[rows + 1, 2]


@inline
def collect(x, x_lane, work, n, rows, y0, y1, s00, s01, s11):
    """Turn the rows that `spread` left into W = P H' chol(S)^-T, and correct x += K y; S must be positive definite.

    `x` is the mean, or where a filter collects its correction.
    """
    l00 = math.sqrt(s00)
    l10 = s01 / l00
    l11 = math.sqrt(s11 - l10 * l10)
    e0 = y0 / l00
    e1 = (y1 - l10 * e0) / l11
    for i in range(n):
        w0 = work[rows, i] / l00
        w1 = (work[rows + 1, i] - l10 * w0) / l11
        work[rows, i] = w0
        work[rows + 1, i] = w1
        x[x_lane, i] += w0 * e0 + w1 * e1


@inline
def current_row(P, work, lane, n, rows, row):
    """A row of P as it is after the rows collected, into row `rows` of `work`."""
    for i in range(n):
        work[rows, i] = P[lane, row, i]
        work[rows + 1, i] = 0.0
    for k in range(rows):
        work[_GAIN, k] = work[k, row]
        work[_GAIN + 1, k] = 0.0
    project(work, rows, n, rows, _GAIN)


@inline
def settle(P, work, lane, n, rows):
    """P -= W W' of the rows collected; to be called before anything else looks at P."""
    if rows > 0:
        subtract_rows(P, lane, n, work, rows, 0)
