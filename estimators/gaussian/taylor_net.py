"""The two-dimensional Taylor net of a return: a polynomial over the whole spread of D = point - robot.

Geng 2024, section 5, Eq. (3), made precise. With D = D^ + L eps, eps ~ N(0, I), the net of degree 2 in the Hermite
basis has the coefficients theta_zeta = E[h He_zeta(eps)] / zeta!, taken at 5 x 5 Gauss-Hermite nodes. theta_00 is the
mean return, [theta_10 theta_01] L^-1 are its slopes G, and R_2 = sum over |zeta| = 2 of zeta! theta theta' is what
curvature adds to its covariance. All is done in the axes of the beam (along D^, and across to the left), where bearings
need no wrapping and nothing depends on how the world's axes lie.
"""

import math

import numpy as np

from estimators.kernels.jit import inline, subroutine

NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(5)
WEIGHTS = _WEIGHTS / math.sqrt(2.0 * math.pi)  # of a standard normal
MIN_SPREAD = 1e-6  # of D, as a share of |D|: slopes over less would be rounding noise
SMALL_TURN = 1e-4  # [rad] below which the series of V is exact to rounding


@inline
def to_beam(ux, uy, e00, e01, e11):
    """A covariance in the axes of the beam, whose direction is (ux, uy)."""
    return (
        ux * ux * e00 + 2.0 * ux * uy * e01 + uy * uy * e11,
        ux * uy * (e11 - e00) + (ux * ux - uy * uy) * e01,
        uy * uy * e00 - 2.0 * ux * uy * e01 + ux * ux * e11,
    )


@inline
def from_beam(ux, uy, g00, g01, g10, g11):
    """Slopes by a vector in the axes of the beam as slopes by one in the world's axes."""
    return g00 * ux - g01 * uy, g00 * uy + g01 * ux, g10 * ux - g11 * uy, g10 * uy + g11 * ux


@inline
def root_of(e00, e01, e11, distance):
    """Cholesky factor (l00, l10, l11) of a covariance of D, floored."""
    floor = (MIN_SPREAD * distance) ** 2
    l00 = math.sqrt(max(e00, floor))
    l10 = e01 / l00
    return l00, l10, math.sqrt(max(e11 - l10 * l10, floor))


@inline
def seen(x, y):
    """Range of a point, and its bearing against the beam."""
    return math.sqrt(x * x + y * y), math.atan2(y, x)


@inline
def turned(x, y, turn):
    """V(-turn) (x, y): what a displacement becomes for an observer that turns by `turn` along it."""
    if abs(turn) < SMALL_TURN:
        a, b = 1.0 - turn * turn / 6.0, -0.5 * turn
    else:
        a, b = math.sin(turn) / turn, (math.cos(turn) - 1.0) / turn
    return a * x - b * y, b * x + a * y


@inline
def slopes(l00, l10, l11, ur, ub, vr, vb):
    """G of G L = [u v], as (g00, g01, g10, g11): rows range and bearing."""
    g01, g11 = vr / l11, vb / l11
    return (ur - g01 * l10) / l00, g01, (ub - g11 * l10) / l00, g11


@subroutine
def fit_net(r0, l00, l10, l11, t0, t1):
    """Fit the net at range r0 over the spread L, seen by an observer that turns by t0 eps_0 + t1 eps_1 on the way.

    Returns:
        (range, bearing) by which theta_00 differs from the return at D; slopes (g00, g01, g10, g11) by D in the beam's
        axes; R_2 as (c00, c01, c11).
    """
    mr = mb = ur = ub = vr = vb = pr = pb = qr = qb = xr = xb = 0.0
    for i in range(5):
        for k in range(5):
            e0, e1 = NODES[i], NODES[k]
            ox, oy = turned(l00 * e0, l10 * e0 + l11 * e1, t0 * e0 + t1 * e1)
            r, b = seen(r0 + ox, oy)
            w = WEIGHTS[i] * WEIGHTS[k]
            r, b = w * (r - r0), w * b
            mr, mb = mr + r, mb + b
            ur, ub = ur + e0 * r, ub + e0 * b
            vr, vb = vr + e1 * r, vb + e1 * b
            pr, pb = pr + (e0 * e0 - 1.0) * r, pb + (e0 * e0 - 1.0) * b
            qr, qb = qr + (e1 * e1 - 1.0) * r, qb + (e1 * e1 - 1.0) * b
            xr, xb = xr + e0 * e1 * r, xb + e0 * e1 * b
    g00, g01, g10, g11 = slopes(l00, l10, l11, ur, ub, vr, vb)
    c00 = 0.5 * (pr * pr + qr * qr) + xr * xr
    c01 = 0.5 * (pr * pb + qr * qb) + xr * xb
    return mr, mb, g00, g01, g10, g11, c00, c01, 0.5 * (pb * pb + qb * qb) + xb * xb
