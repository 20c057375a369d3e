"""The range-bearing sensor as scalar helpers: h, its gradient, its inverse, its noise.

With D = point - robot, h = (|D|, atan2(D_y, D_x) - heading) and A = dh/dD. The Jacobian over
(robot position, heading, point) is H = [-A, c, A], c = (0, -1) where everything is linearised at one point.
"""

import math

from estimators.kernels.angles import wrap
from estimators.kernels.jit import inline
from estimators.models import QUADRATURE


@inline
def noise_std(model, distance):
    """Deviations (range [m], bearing [rad]) of a return from that distance."""
    grown = model.range_std_per_range * distance
    if model.range_law == QUADRATURE:
        return math.sqrt(model.range_std * model.range_std + grown * grown), model.bearing_std
    return model.range_std + grown, model.bearing_std


@inline
def measure(dx, dy, heading):
    """h: range and bearing of a point at (dx, dy) from the robot."""
    return math.sqrt(dx * dx + dy * dy), wrap(math.atan2(dy, dx) - heading)


@inline
def gradient(dx, dy):
    """A = dh/dD as (a00, a01, a10, a11); the caller sees to |D| > 0."""
    square = dx * dx + dy * dy
    distance = math.sqrt(square)
    return dx / distance, dy / distance, -dy / square, dx / square


@inline
def offset(distance, bearing, heading):
    """The inverse of h: D = (dx, dy) in the world's axes."""
    angle = heading + bearing
    return distance * math.cos(angle), distance * math.sin(angle)


@inline
def offset_noise(dx, dy, range_std, bearing_std):
    """Covariance (n00, n01, n11) of D from a return: A^-1 R A^-T; range along the beam, range x bearing across."""
    square = dx * dx + dy * dy
    along = range_std * range_std / square
    across = bearing_std * bearing_std
    return (
        along * dx * dx + across * dy * dy,
        (along - across) * dx * dy,
        along * dy * dy + across * dx * dx,
    )


@inline
def usable(distance, bearing):
    """Whether a return is a finite bearing at a finite positive distance."""
    return 0.0 < distance < math.inf and -math.inf < bearing < math.inf
