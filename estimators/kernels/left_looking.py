"""A sweep's returns taken in one after the other, but P touched once: the left-looking form of the sequential update.

Each return needs three rows: of its point's offset from the robot, D P, and of the heading. The heading's is kept up to
date beside P; the others are formed from P as it was before the sweep, less what the earlier returns took off. The rows
of all returns leave P together in one symmetric pass, P -= W W'. Every return is still linearised at the mean that the
ones before it left: the result is that of `gaussian.downdate` after each, to rounding, at a part of its cost.

The scratch `work` holds the rows W collected (and room for two more), then rows of other use, each [n].
"""

import math

from estimators.kernels.jit import inline
from estimators.kernels.simd import aligned_zeros, subtract_rows
from estimators.kernels.simd_rows import copy_row, measured_rows, offset_rows, whitened_rows

ROWS = 32  # collected before P must be settled: sixteen returns
CORRECTION, SHIFT = ROWS + 2, ROWS + 3  # for filters that move their mean after the sweep
TURN = ROWS + 4  # the heading's row of P, as it is after the rows collected
_HEIGHT = ROWS + 5


def scratch(n_max):
    """`work` for states of up to n_max rows."""
    return aligned_zeros(_HEIGHT, n_max)


@inline
def spread(P, work, lane, n, rows, j, a00, a01, a10, a11, c0, c1):
    """H P into the rows `rows` and rows + 1 of `work`, for a return of the point at row j; H P H' as (s00, s01, s11).

    H = [-A, c, A] over robot position, heading and the point; `rows` rows have been collected, at most ROWS - 2.
    D P comes first: it does not wait for A, which hangs on the mean that the last return left.
    """
    keep_heading(P, work, lane, n, rows)
    offset_rows(P, lane, j, work, rows, n)
    measured_rows(work, rows, TURN, n, a00, a01, a10, a11, c0, c1)
    dx, dy = work[rows, j] - work[rows, 0], work[rows, j + 1] - work[rows, 1]
    s00 = a00 * dx + a01 * dy + c0 * work[rows, 2]
    s01 = a10 * dx + a11 * dy + c1 * work[rows, 2]
    dx, dy = work[rows + 1, j] - work[rows + 1, 0], work[rows + 1, j + 1] - work[rows + 1, 1]
    return s00, s01, a10 * dx + a11 * dy + c1 * work[rows + 1, 2]


@inline
def keep_heading(P, work, lane, n, rows):
    """The heading's row as it is after the rows collected, in row TURN of `work`."""
    if rows == 0:
        copy_row(P, lane, 2, work, TURN, n)


@inline
def collect(x, x_lane, work, n, rows, y0, y1, s00, s01, s11):
    """Turn the rows that `spread` left into W = P H' chol(S)^-T, and correct x += K y; S must be positive definite.

    `x` is the mean, or where a filter collects its correction.
    """
    t0 = 1.0 / math.sqrt(s00)
    t1 = math.sqrt(s00) / math.sqrt(s00 * s11 - s01 * s01)  # both roots at once: none waits for the other
    l10 = s01 * t0
    e0 = y0 * t0
    e1 = (y1 - l10 * e0) * t1
    whitened_rows(x, x_lane, work, rows, TURN, n, t0, t1, l10, e0, e1)


@inline
def settle(P, work, lane, n, rows):
    """P -= W W' of the rows collected; to be called before anything else looks at P."""
    if rows > 0:
        subtract_rows(P, lane, n, work, rows, 0)
