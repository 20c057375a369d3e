"""Angles in radians, wrapped to [-pi, pi)."""

import math

from estimators.kernels.jit import inline

TWO_PI = 2.0 * math.pi


@inline
def wrap(angle: float) -> float:
    """The same direction in [-pi, pi); 0 for angles so large that a float no longer tells their direction."""
    if -math.pi <= angle < math.pi:
        return angle
    wrapped = angle - TWO_PI * math.floor((angle + math.pi) / TWO_PI)
    # Rounding can land exactly on +pi for angles a hair below -pi.
    if wrapped >= math.pi:
        wrapped -= TWO_PI
    return 0.0 if abs(wrapped) > math.pi else wrapped
