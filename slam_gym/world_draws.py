"""Two normals from two uniforms: half of what `normal4` gives, so that one Philox block serves a whole source."""

import math

from estimators.kernels.elementary import log, sincos_turn
from estimators.kernels.jit import inline


@inline
def normal_pair(u0, u1):
    """Two independent standard normals from uniforms in (0, 1), by Box and Muller."""
    s, c = sincos_turn(u1)
    r = math.sqrt(-2.0 * log(u0))
    return r * c, r * s
