"""One joint Gaussian, changed in place: the small operations every filter of the family is made of.

P is stored in full and stays exactly symmetric: rows are computed, columns are copies of them, and a downdate adds the
same products in the same order on both sides. Row order: robot (x, y, heading), target, landmarks. `n` is the number of
rows in use rounded up to a multiple of `BLOCK`; rows beyond the last landmark are zero, so the rounding is harmless
and keeps the inner loops whole. A motion touches two rows and columns, O(n); an update is a rank-2 downdate, O(n^2).
"""

import math

from estimators.kernels.jit import inline, subroutine
from estimators.kernels.motion import acceleration_noise
from estimators.kernels.simd import WIDTH, add_outer

ROBOT = 3  # coordinates of the robot
BLOCK = WIDTH  # rows are padded to a multiple of this


@inline
def rows_in_use(n_t, count):
    """Robot, target and `count` landmarks, rounded up to whole blocks."""
    return ((ROBOT + n_t + 2 * count + BLOCK - 1) // BLOCK) * BLOCK


@inline
def move_robot(P, lane, n, hx, hy, q00, q01, q02, q11, q12, q22):
    """P <- F P F' + Q; F is the identity but for the heading column (hx, hy) of the position."""
    p02, p12, p22 = P[lane, 0, 2], P[lane, 1, 2], P[lane, 2, 2]
    p00 = P[lane, 0, 0] + 2.0 * hx * p02 + hx * hx * p22 + q00
    p01 = P[lane, 0, 1] + hx * p12 + hy * p02 + hx * hy * p22 + q01
    p11 = P[lane, 1, 1] + 2.0 * hy * p12 + hy * hy * p22 + q11
    for i in range(ROBOT, n):
        turn = P[lane, 2, i]
        P[lane, 0, i] += hx * turn
        P[lane, 1, i] += hy * turn
    for i in range(ROBOT, n):
        P[lane, i, 0] = P[lane, 0, i]
        P[lane, i, 1] = P[lane, 1, i]
    p02 += hx * p22 + q02
    p12 += hy * p22 + q12
    P[lane, 0, 0], P[lane, 0, 1], P[lane, 1, 0], P[lane, 1, 1] = p00, p01, p01, p11
    P[lane, 0, 2], P[lane, 2, 0], P[lane, 1, 2], P[lane, 2, 1] = p02, p02, p12, p12
    P[lane, 2, 2] = p22 + q22


@inline
def shear(P, lane, n, row, by, factor):
    """P <- E P E' with E = I + factor e_row e_by': one elementary row and column addition."""
    diagonal = P[lane, row, row] + 2.0 * factor * P[lane, row, by] + factor * factor * P[lane, by, by]
    for i in range(n):
        P[lane, row, i] += factor * P[lane, by, i]
    P[lane, row, row] = diagonal
    for i in range(n):
        P[lane, i, row] = P[lane, row, i]


@inline
def add_symmetric(P, lane, i, j, value):
    """Add to one off-diagonal pair."""
    P[lane, i, j] += value
    P[lane, j, i] = P[lane, i, j]


@inline
def drift_velocity(mu, P, lane, n, density, dt):
    """Constant-velocity target over dt, mean and covariance, white acceleration; its own F and Q only."""
    mu[lane, 3] += dt * mu[lane, 5]
    mu[lane, 4] += dt * mu[lane, 6]
    shear(P, lane, n, 3, 5, dt)
    shear(P, lane, n, 4, 6, dt)
    position, cross, velocity = acceleration_noise(density, dt)
    P[lane, 3, 3] += position
    P[lane, 4, 4] += position
    P[lane, 5, 5] += velocity
    P[lane, 6, 6] += velocity
    add_symmetric(P, lane, 3, 5, cross)
    add_symmetric(P, lane, 4, 6, cross)


@inline
def move_heading_body(P, lane, n, j, hx, hy, q00, q01, q02, q11, q12, q22):
    """A body (x, y, heading) at rows j, j + 1, j + 2: heading column (hx, hy) of its position, then Q."""
    shear(P, lane, n, j, j + 2, hx)
    shear(P, lane, n, j + 1, j + 2, hy)
    P[lane, j, j] += q00
    P[lane, j + 1, j + 1] += q11
    P[lane, j + 2, j + 2] += q22
    add_symmetric(P, lane, j, j + 1, q01)
    add_symmetric(P, lane, j, j + 2, q02)
    add_symmetric(P, lane, j + 1, j + 2, q12)


@inline
def innovation_cov(P, lane, j, a00, a01, a10, a11, c0, c1, r00, r11):
    """S = H P H' + R as (s00, s01, s11), H = [-A, c, A] over robot position, heading and the point at row j."""
    e00 = P[lane, j, j] - 2.0 * P[lane, j, 0] + P[lane, 0, 0]
    e01 = P[lane, j, j + 1] - P[lane, j, 1] - P[lane, j + 1, 0] + P[lane, 0, 1]
    e11 = P[lane, j + 1, j + 1] - 2.0 * P[lane, j + 1, 1] + P[lane, 1, 1]
    f0 = P[lane, j, 2] - P[lane, 0, 2]
    f1 = P[lane, j + 1, 2] - P[lane, 1, 2]
    turn = P[lane, 2, 2]
    g0, g1 = a00 * f0 + a01 * f1, a10 * f0 + a11 * f1
    b00, b01 = a00 * e00 + a01 * e01, a00 * e01 + a01 * e11
    b10, b11 = a10 * e00 + a11 * e01, a10 * e01 + a11 * e11
    return (
        b00 * a00 + b01 * a01 + 2.0 * c0 * g0 + c0 * c0 * turn + r00,
        b00 * a10 + b01 * a11 + c0 * g1 + c1 * g0 + c0 * c1 * turn,
        b10 * a10 + b11 * a11 + 2.0 * c1 * g1 + c1 * c1 * turn + r11,
    )


@inline
def nis_and_log_det(s00, s01, s11, y0, y1):
    """NIS y' S^-1 y and log det S; (nan, nan) where S is not positive definite."""
    det = s00 * s11 - s01 * s01
    if not (s00 > 0.0 and det > 0.0):
        return math.nan, math.nan
    return (s11 * y0 * y0 - 2.0 * s01 * y0 * y1 + s00 * y1 * y1) / det, math.log(det)


@inline
def downdate(x, x_lane, P, W, lane, n, j, a00, a01, a10, a11, c0, c1, y0, y1, s00, s01, s11):
    """Kalman update by one return of the point at row j: x += K y, P -= W W', W = P H' chol(S)^-T.

    `x` is the mean, or where a filter collects its correction. S must be positive definite.
    """
    l00 = math.sqrt(s00)
    l10 = s01 / l00
    l11 = math.sqrt(s11 - l10 * l10)
    e0 = y0 / l00
    e1 = (y1 - l10 * e0) / l11
    for i in range(n):
        dx = P[lane, j, i] - P[lane, 0, i]
        dy = P[lane, j + 1, i] - P[lane, 1, i]
        turn = P[lane, 2, i]
        w0 = (a00 * dx + a01 * dy + c0 * turn) / l00
        w1 = (a10 * dx + a11 * dy + c1 * turn - l10 * w0) / l11
        W[0, i] = w0
        W[1, i] = w1
        x[x_lane, i] += w0 * e0 + w1 * e1
    add_outer(P, lane, n, W, -1.0, -1.0)


@inline
def append_point(mu, P, lane, n, j, x, y, g0, g1, n00, n01, n11):
    """A new point at rows j, j + 1, seen from the robot: Jacobian [I, (g0, g1)] of the pose, noise N of the return.

    Keeps the cross covariance with everything; rows j, j + 1 must be zero before.
    """
    mu[lane, j] = x
    mu[lane, j + 1] = y
    for i in range(n):
        P[lane, j, i] = P[lane, 0, i] + g0 * P[lane, 2, i]
        P[lane, j + 1, i] = P[lane, 1, i] + g1 * P[lane, 2, i]
    for i in range(n):
        P[lane, i, j] = P[lane, j, i]
        P[lane, i, j + 1] = P[lane, j + 1, i]
    P[lane, j, j] = P[lane, j, 0] + g0 * P[lane, j, 2] + n00
    P[lane, j + 1, j + 1] = P[lane, j + 1, 1] + g1 * P[lane, j + 1, 2] + n11
    cross = P[lane, j, 1] + g1 * P[lane, j, 2] + n01
    P[lane, j, j + 1] = cross
    P[lane, j + 1, j] = cross


@inline
def clear_rows(mu, P, lane, n, j, size):
    """Forget (marginalise) the coordinates j ... j + size - 1: their mean, rows and columns become zero."""
    for k in range(j, j + size):
        mu[lane, k] = 0.0
        for i in range(n):
            P[lane, k, i] = 0.0
        for i in range(n):
            P[lane, i, k] = 0.0


@subroutine
def remove_landmark(mu, P, count, ids, first, lane, slot, n_t):
    """Marginalise one landmark out; the last one moves into its slot, so slots stay dense."""
    last = count[lane] - 1
    n = rows_in_use(n_t, count[lane])
    j, k = ROBOT + n_t + 2 * slot, ROBOT + n_t + 2 * last
    if slot != last:
        for d in range(first.shape[2]):
            first[lane, slot, d] = first[lane, last, d]
        for d in range(2):
            mu[lane, j + d] = mu[lane, k + d]
            for i in range(n):
                P[lane, j + d, i] = P[lane, k + d, i]
            # The rows above still hold the old columns of j, j + 1: copy columns after rows.
        for d in range(2):
            for i in range(n):
                P[lane, i, j + d] = P[lane, i, k + d]
        ids[lane, slot] = ids[lane, last]
    clear_rows(mu, P, lane, n, k, 2)
    for d in range(first.shape[2]):
        first[lane, last, d] = 0.0
    ids[lane, last] = -1
    count[lane] = last
