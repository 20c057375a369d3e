"""Points, vectors and headings seen from a body of the state, with their joint covariance.

Each new row depends on at most five old ones: `at` [n, 5] are their numbers, `coef` [n, 5] its derivatives by them.
"""

import math

from estimators.kernels.angles import wrap
from estimators.kernels.jit import inline
from estimators.kernels.rounding import lifted_if_shrunk

ORIGIN = -1  # in the place of a row: the origin of the axes the state is written in, known exactly


@inline
def _set(at, coef, row, src, body, first, second, by_x, by_y, by_turn):
    at[row, 0], at[row, 1] = max(src, 0), max(src, 0) + 1
    at[row, 2], at[row, 3], at[row, 4] = body, body + 1, body + 2
    coef[row, 0], coef[row, 1] = first, second
    coef[row, 2], coef[row, 3], coef[row, 4] = by_x, by_y, by_turn


@inline
def see_nothing(out, lane, at, coef, row, size):
    """Rows that stay empty."""
    for i in range(row, row + size):
        out[lane, i] = 0.0
        _set(at, coef, i, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0)


@inline
def see_point(x, out, lane, at, coef, row, src, body):
    """The point at row `src`: q = R(-phi)(l - p), p and phi the body's; `out` is another array than `x`."""
    c, s = math.cos(x[lane, body + 2]), math.sin(x[lane, body + 2])
    own = 0.0 if src == ORIGIN else 1.0
    at_x = own * x[lane, max(src, 0)] - x[lane, body]
    at_y = own * x[lane, max(src, 0) + 1] - x[lane, body + 1]
    qx, qy = c * at_x + s * at_y, c * at_y - s * at_x
    out[lane, row], out[lane, row + 1] = qx, qy
    _set(at, coef, row, src, body, own * c, own * s, -c, -s, qy)
    _set(at, coef, row + 1, src, body, -own * s, own * c, s, -c, -qx)


@inline
def see_vector(x, out, lane, at, coef, row, src, body):
    """R(-phi) v of the vector at row `src`."""
    c, s = math.cos(x[lane, body + 2]), math.sin(x[lane, body + 2])
    vx, vy = c * x[lane, src] + s * x[lane, src + 1], c * x[lane, src + 1] - s * x[lane, src]
    out[lane, row], out[lane, row + 1] = vx, vy
    _set(at, coef, row, src, body, c, s, 0.0, 0.0, vy)
    _set(at, coef, row + 1, src, body, -s, c, 0.0, 0.0, -vx)


@inline
def see_heading(x, out, lane, at, coef, row, src, body):
    """The heading at row `src` against the body's."""
    own = 0.0 if src == ORIGIN else 1.0
    out[lane, row] = wrap(own * x[lane, max(src, 0)] - x[lane, body + 2])
    _set(at, coef, row, src, body, own, 0.0, 0.0, 0.0, -1.0)


@inline
def carry_covariance(P, out, half, lane, n_in, n_out, at, coef):
    """Out <- G P G', G by `at` and `coef`; `half` [n_out, n_in] is scratch, so `out` may be P."""
    for i in range(n_out):
        for c in range(n_in):
            total = 0.0
            for k in range(5):
                total += coef[i, k] * P[lane, at[i, k], c]
            half[i, c] = total
    for i in range(n_out):
        for j in range(i + 1):
            total = 0.0
            for k in range(5):
                total += coef[j, k] * half[i, at[j, k]]
            out[lane, i, j] = total
            out[lane, j, i] = total


@inline
def lift_shrunk(P, out, lane, n_out, at, coef):
    """Lift the variances of `out` that `carry_covariance` wrote as small differences of terms of P, another array."""
    for i in range(n_out):
        made_of = 0.0
        for k in range(5):
            made_of += coef[i, k] * coef[i, k] * P[lane, at[i, k], at[i, k]]
        out[lane, i, i] = lifted_if_shrunk(out[lane, i, i], made_of)
