"""Names of the world's random draws.

NumPy integers, not Python's: numba compiles a helper anew for each plain constant that it is given.
"""

import numpy as np

# Purposes: streams that never mix.
DRAW_RANGES, DRAW_LAYOUT, DRAW_START, DRAW_ROBOT, DRAW_TARGET, DRAW_SENSOR, DRAW_CLUTTER = map(np.int64, range(7))
# Items within a purpose; a landmark's is its index.
FIRST = np.int64(0)
TARGET_ITEM = np.int64(1 << 20)
CLUSTER_ITEM = np.int64(1 << 21)
NOBODY = np.int64(-1)  # instead of an index
