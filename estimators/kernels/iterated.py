"""The iterated update of a point by one return: Gauss-Newton on where the point is, started at the return itself.

Where a point is uncertain against its distance, the derivative of (range, bearing) at its prior mean says little about
where the return puts it. Linearised at e instead, h(D) = h(e) + A (D - e), the innovation against the prior mean d is
nu = z - h(e) - A (d - e) and S = A P A' + R; the posterior mean d + P A' S^-1 nu is the next e. At the fixed point it
is the most likely place, prior and return together. Bell and Cathey, "The iterated Kalman filter update as a
Gauss-Newton method", 1993.

Everything is in one set of axes: the beam (beam_x, beam_y) is the unit vector in which the return came.
"""

import math

from estimators.kernels.jit import inline, subroutine

ITERATIONS = 10
CONVERGED = 1e-18  # square of the last step over the square of the distance


@inline
def linearised(ex, ey, dx, dy, p00, p01, p11, distance, beam_x, beam_y, var_r, var_b):
    """Everything an update needs, linearised at e.

    Returns:
        A's rows (ux, uy) of the range and (vx, vy) of the bearing, nu (range, bearing), S (s00, s01, s11).
    """
    square = ex * ex + ey * ey
    r = math.sqrt(square)
    ux, uy = ex / r, ey / r
    vx, vy = -ey / square, ex / square
    turn = math.atan2(ux * beam_y - uy * beam_x, ux * beam_x + uy * beam_y)
    nu_r = distance - r - (ux * (dx - ex) + uy * (dy - ey))
    nu_b = turn - (vx * (dx - ex) + vy * (dy - ey))
    f0, f1 = p00 * ux + p01 * uy, p01 * ux + p11 * uy
    g0, g1 = p00 * vx + p01 * vy, p01 * vx + p11 * vy
    return (
        ux, uy, vx, vy, nu_r, nu_b,
        ux * f0 + uy * f1 + var_r, ux * g0 + uy * g1, vx * g0 + vy * g1 + var_b,
    )  # fmt: skip


@subroutine
def refine(dx, dy, p00, p01, p11, distance, beam_x, beam_y, var_r, var_b):
    """The point e = (ex, ey) at which to linearise: the posterior mean of the iterated update.

    Args:
        dx: with dy, the point's prior mean from the sensor. p00: with p01, p11, its covariance as the sensor sees it.
        distance: the return's range [m]. beam_x: with beam_y, its direction. var_r, var_b: its variances.
    """
    ex, ey = distance * beam_x, distance * beam_y
    for _ in range(ITERATIONS):
        ux, uy, vx, vy, nu_r, nu_b, s00, s01, s11 = linearised(
            ex, ey, dx, dy, p00, p01, p11, distance, beam_x, beam_y, var_r, var_b
        )
        det = s00 * s11 - s01 * s01
        e0, e1 = (s11 * nu_r - s01 * nu_b) / det, (s00 * nu_b - s01 * nu_r) / det
        b0, b1 = ux * e0 + vx * e1, uy * e0 + vy * e1
        step_x, step_y = dx + p00 * b0 + p01 * b1 - ex, dy + p01 * b0 + p11 * b1 - ey
        ex, ey = ex + step_x, ey + step_y
        if step_x * step_x + step_y * step_y < CONVERGED * (ex * ex + ey * ey):
            break
    return ex, ey
