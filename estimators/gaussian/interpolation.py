"""Stirling's interpolation of a joint Gaussian through a function of a few of its variables, in O(n).

Eqs. (9)-(12), Tian et al. 2010. With s_p the columns of a Cholesky factor L of the variables that f depends on,

    D1_p = (f(x + h s_p) - f(x - h s_p)) / 2          D2_p = (f(x + h s_p) + f(x - h s_p) - 2 f(x)) / 2
    mean f(x) + sum D2_p / h^2                         covariance sum D1_p D1_p' / h^2 + (h^2 - 1) / h^4 sum D2_p D2_p'

Every other variable enters f nowhere: with the few put first, its columns of the full factor change nothing, and its
covariance with f is that with the few times E', where E = D1 L^-1 / h: a slope taken over the spread of the belief.
The unscented transform shares mean and E; with e = mean - f(x), a filter's `rule` (h, c, d) says what both do:

    covariance sum D1_p D1_p' / h^2 + c sum D2_p D2_p' + d e e'

The first sum is taken as E P E', the same where P = L L' to the last digit. Where the Cholesky factor has a weak pivot,
another root takes its place (`factor`). Bearings are taken relative to the centre's before they are averaged. Here f is
a displacement of the robot, of the target, or from the robot to a point first seen (a pose and two noisy numbers), or a
return of a point (pose and point).
"""

import math

from estimators.kernels.angles import wrap
from estimators.kernels.gaussian import ROBOT
from estimators.kernels.jit import inline, subroutine
from estimators.kernels.linalg import pivoted_cholesky, semidefinite_cholesky, solve_transposed
from estimators.kernels.motion import displacement, unicycle
from estimators.kernels.range_bearing import measure, offset

ROBOT_MOVES, TARGET_MOVES, SIGHTING = 0, 1, 2
WEAK = 1e-5  # a pivot, of the variance that it is what is left of


@inline
def carry(kind, model, a, b, dt, heading):
    """Displacement (dx, dy, dheading) from a pose: by a control (a, b) over dt, or along a return (a, b)."""
    if kind == SIGHTING:
        dx, dy = offset(a, b, heading)
        return dx, dy, 0.0
    if kind == TARGET_MOVES:
        return unicycle(a, b, dt, heading)
    return displacement(model, a, b, dt, heading)


@inline
def input_differences(kind, model, a, b, da, db, dt, heading, base, D1, D2, column):
    """D1 and D2 of a displacement for one column: inputs off by (da, db)."""
    up = carry(kind, model, a + da, b + db, dt, heading)
    down = carry(kind, model, a - da, b - db, dt, heading)
    for i in range(3):
        D1[i, column] = 0.5 * (up[i] - down[i])
        D2[i, column] = 0.5 * (up[i] + down[i] - 2.0 * base[i])


@inline
def turn_differences(turned, base, D1, D2, column):
    """The same for a heading off by +-`turned`: the displacement d turns rigidly with it.

    Half the difference of the two is sin(turned) J d, half their sum less d is (cos(turned) - 1) d.
    """
    s, c = math.sin(0.5 * turned), math.cos(0.5 * turned)
    D1[0, column] = -2.0 * s * c * base[1]
    D1[1, column] = 2.0 * s * c * base[0]
    D1[2, column] = 0.0
    D2[0, column] = -2.0 * s * s * base[0]
    D2[1, column] = -2.0 * s * s * base[1]
    D2[2, column] = 0.0


@inline
def row_of(p, body, j):
    """The p-th of the rows that a return depends on: the three of the body, then the point's at j."""
    return body + p if p < ROBOT else j + p - ROBOT


@subroutine
def factor(P, lane, body, j, n, C, A, order):
    """A root C of the covariance of the first n of those rows: its Cholesky factor, by pivots where one is weak.

    A slope by a weak pivot is a quotient of small numbers, thousands of times what it should be.

    Args:
        A: scratch, [5, 5]. order: [5] filled with the order of the pivots.
    """
    for p in range(n):
        order[p] = p
        for q in range(p + 1):
            C[p, q] = P[lane, row_of(p, body, j), row_of(q, body, j)]
    semidefinite_cholesky(C, n)
    weak = False
    for p in range(n):
        pivot = C[p, p] * C[p, p]
        weak |= 0.0 < pivot < WEAK * P[lane, row_of(p, body, j), row_of(p, body, j)]
    if weak:
        for p in range(n):
            for q in range(n):
                A[p, q] = P[lane, row_of(p, body, j), row_of(q, body, j)]
        pivoted_cholesky(A, n, C, order)


@inline
def spread_displacement(P, lane, j, kind, model, a, b, std_a, std_b, dt, heading, rule, C, D1, D2, E, order):
    """Sigma points of a displacement over the body (x, y, heading) at rows j, j + 1, j + 2 and inputs (a, b).

    Args:
        C: scratch (all [5, 5]; order [5]), filled with a root of the body's covariance.
        D1: with D2, rows 0-2 filled; D1 without the body's own spread.
        E: filled with the displacement's slope by the body in [:2, :3] and with e in row 3.

    Returns:
        The mean displacement (dx, dy, dheading). Eq. (9).
    """
    h = rule[0]
    factor(P, lane, j, j, 3, C, D1, order)
    base = carry(kind, model, a, b, dt, heading)
    for p in range(3):
        turn_differences(h * C[2, p], base, D1, D2, p)
    for p in range(3, 5):
        da, db = (h * std_a, 0.0) if p == 3 else (0.0, h * std_b)
        input_differences(kind, model, a, b, da, db, dt, heading, base, D1, D2, p)
    for i in range(2):
        solve_transposed(C, 3, D1, i, E, order)
        for p in range(3):
            E[i, p] /= h
    for i in range(3):
        E[3, i] = (D2[i, 0] + D2[i, 1] + D2[i, 2] + D2[i, 3] + D2[i, 4]) / (h * h)
    return base[0] + E[3, 0], base[1] + E[3, 1], base[2] + E[3, 2]


@inline
def carried_cov(P, lane, row, body, E, k):
    """Entry (row, k) of G P G', G = I + E over the body at row `body`; P holds G P in that row.

    Taken from P, of which its factor is only nearly the root: the joint covariance is one whatever slopes E there are.
    """
    if k == 2:
        return P[lane, row, body + 2]  # no displacement turns by more for a body that stands elsewhere
    x, y, heading = P[lane, row, body], P[lane, row, body + 1], P[lane, row, body + 2]
    return P[lane, row, body + k] + E[k, 0] * x + E[k, 1] * y + E[k, 2] * heading


@inline
def added_cov(D1, D2, E, rule, i, k):
    """What the inputs and all curvature add to it. Eq. (11), with outer products."""
    first = D1[i, 3] * D1[k, 3] + D1[i, 4] * D1[k, 4]
    second = 0.0
    for p in range(5):
        second += D2[i, p] * D2[k, p]
    return first / (rule[0] * rule[0]) + rule[1] * second + rule[2] * E[3, i] * E[3, k]


@subroutine
def move_body(mu, P, lane, n, j, kind, model, a, b, std_a, std_b, dt, rule, C, D1, D2, E, order):
    """Predict the body at rows j, j + 1, j + 2 under the control (a, b) with deviations. Eqs. (15)-(18)."""
    dx, dy, turn = spread_displacement(
        P, lane, j, kind, model, a, b, std_a, std_b, dt, mu[lane, j + 2], rule, C, D1, D2, E, order
    )
    mu[lane, j] += dx
    mu[lane, j + 1] += dy
    mu[lane, j + 2] = wrap(mu[lane, j + 2] + turn)
    for i in range(n):
        x, y, heading = P[lane, j, i], P[lane, j + 1, i], P[lane, j + 2, i]
        P[lane, j, i] = x + E[0, 0] * x + E[0, 1] * y + E[0, 2] * heading
        P[lane, j + 1, i] = y + E[1, 0] * x + E[1, 1] * y + E[1, 2] * heading
    for i in range(3):
        for k in range(i, 3):
            C[i, k] = carried_cov(P, lane, j + i, j, E, k) + added_cov(D1, D2, E, rule, i, k)
    for i in range(n):
        P[lane, i, j] = P[lane, j, i]
        P[lane, i, j + 1] = P[lane, j + 1, i]
    for i in range(3):
        for k in range(i, 3):
            P[lane, j + i, j + k] = P[lane, j + k, j + i] = C[i, k]


@subroutine
def append_by_points(mu, P, lane, n, j, distance, bearing, std_r, std_b, model, rule, C, D1, D2, E, order):
    """A new point at rows j, j + 1 from a return, with all its cross covariances; the rows must be zero before."""
    dx, dy, _ = spread_displacement(
        P, lane, 0, SIGHTING, model, distance, bearing, std_r, std_b, 0.0, mu[lane, 2], rule, C, D1, D2, E, order
    )
    mu[lane, j] = mu[lane, 0] + dx
    mu[lane, j + 1] = mu[lane, 1] + dy
    for i in range(n):
        x, y, heading = P[lane, 0, i], P[lane, 1, i], P[lane, 2, i]
        P[lane, j, i] = x + E[0, 0] * x + E[0, 1] * y + E[0, 2] * heading
        P[lane, j + 1, i] = y + E[1, 0] * x + E[1, 1] * y + E[1, 2] * heading
    for i in range(n):
        P[lane, i, j] = P[lane, j, i]
        P[lane, i, j + 1] = P[lane, j + 1, i]
    for i in range(2):
        for k in range(i, 2):
            value = carried_cov(P, lane, j + i, 0, E, k) + added_cov(D1, D2, E, rule, i, k)
            P[lane, j + i, j + k] = P[lane, j + k, j + i] = value


@inline
def spread_return(mu, P, lane, j, rule, C, D1, E, order):
    """Sigma points of a return of the point at rows j, j + 1. Eqs. (19), (23)-(26).

    Args:
        C, D1: scratch, [5, 5]; order: scratch, [5].
        E: filled with the slope of (range, bearing) by pose and point in [:2].

    Returns:
        The range at the centre, mean (range, bearing) and covariance (s00, s01, s11) without the sensor's noise.
    """
    h, curved, shifted = rule[0], rule[1], rule[2]
    factor(P, lane, 0, j, 5, C, D1, order)
    px, py, heading = mu[lane, j] - mu[lane, 0], mu[lane, j + 1] - mu[lane, 1], mu[lane, 2]
    r0, b0 = measure(px, py, heading)
    mean_r = mean_b = s00 = s01 = s11 = 0.0
    square = h * h
    for p in range(5):
        ox, oy, turned = h * (C[3, p] - C[0, p]), h * (C[4, p] - C[1, p]), h * C[2, p]
        r_up, b_up = measure(px + ox, py + oy, heading + turned)
        r_down, b_down = measure(px - ox, py - oy, heading - turned)
        up, down = wrap(b_up - b0), wrap(b_down - b0)
        d1r, d1b = 0.5 * (r_up - r_down), 0.5 * (up - down)
        d2r, d2b = 0.5 * (r_up + r_down - 2.0 * r0), 0.5 * (up + down)
        D1[0, p] = d1r
        D1[1, p] = d1b
        mean_r += d2r
        mean_b += d2b
        s00 += curved * d2r * d2r
        s01 += curved * d2r * d2b
        s11 += curved * d2b * d2b
    for i in range(2):
        solve_transposed(C, 5, D1, i, E, order)
        for p in range(5):
            E[i, p] /= h
    for q in range(5):  # E P E' and not D1 D1' / h^2: see `carried_cov`
        w0 = w1 = 0.0
        for p in range(5):
            value = P[lane, row_of(p, 0, j), row_of(q, 0, j)]
            w0, w1 = w0 + E[0, p] * value, w1 + E[1, p] * value
        s00, s01, s11 = s00 + w0 * E[0, q], s01 + w0 * E[1, q], s11 + w1 * E[1, q]
    mean_r, mean_b = mean_r / square, mean_b / square
    s00 += shifted * mean_r * mean_r
    s01 += shifted * mean_r * mean_b
    s11 += shifted * mean_b * mean_b
    return r0, r0 + mean_r, wrap(b0 + mean_b), s00, s01, s11


@subroutine
def downdate_by_points(mu, P, W, lane, n, j, E, y0, y1, s00, s01, s11):
    """Kalman update by one return of the point at row j. Eqs. (12), (29)-(31): W = P_xz chol(S)^-T, P -= W W'."""
    l00 = math.sqrt(s00)
    l10 = s01 / l00
    l11 = math.sqrt(s11 - l10 * l10)
    e0 = y0 / l00
    e1 = (y1 - l10 * e0) / l11
    for i in range(n):
        x, y, turn, u, v = P[lane, 0, i], P[lane, 1, i], P[lane, 2, i], P[lane, j, i], P[lane, j + 1, i]
        w0 = (E[0, 0] * x + E[0, 1] * y + E[0, 2] * turn + E[0, 3] * u + E[0, 4] * v) / l00
        w1 = (E[1, 0] * x + E[1, 1] * y + E[1, 2] * turn + E[1, 3] * u + E[1, 4] * v - l10 * w0) / l11
        W[0, i] = w0
        W[1, i] = w1
        mu[lane, i] += w0 * e0 + w1 * e1
    for i in range(n):
        w0, w1 = W[0, i], W[1, i]
        for k in range(n):
            P[lane, i, k] -= w0 * W[0, k] + w1 * W[1, k]
