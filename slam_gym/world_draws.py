"""Names of the world's random draws, and normals from uniforms.

NumPy integers, not Python's: numba compiles a helper anew for each plain constant that it is given.
"""

import math

import numpy as np

from estimators.kernels.elementary import log, sincos_turn
from estimators.kernels.jit import inline

# Purposes: streams that never mix.
DRAW_RANGES, DRAW_LAYOUT, DRAW_START, DRAW_ROBOT, DRAW_TARGET, DRAW_SENSOR, DRAW_CLUTTER = map(np.int64, range(7))
# Items within a purpose; a landmark's is its index.
FIRST = np.int64(0)
TARGET_ITEM = np.int64(1 << 20)
CLUSTER_ITEM = np.int64(1 << 21)
NOBODY = np.int64(-1)  # instead of an index


@inline
def normal_pair(u0, u1):
    """Two independent standard normals from uniforms in (0, 1), by Box and Muller.

    Half of what `normal4` gives, so that one Philox block serves all that a source of returns needs.
    """
    s, c = sincos_turn(u1)
    r = math.sqrt(-2.0 * log(u0))
    return r * c, r * s
