"""How a lane's particles lie in memory, and the draws' purposes.

The particle is the innermost axis everywhere, so that one loop over particles is one vectorised pass:

    pose    [L, 3, N]        x, y, heading
    pose_cov [L, 6 or 0, N]  the pose's own covariance (filters whose proposal waits for the sweep; else no rows)
    maps    [L, M, 5, N]     per landmark: x, y, and the covariance's xx, xy, yy
    target  [L, G, F, N]     per heading hypothesis: the mean, then the covariance's upper triangle row by row
    belief_in_hypothesis [L, G, N]   log weights of the hypotheses within a particle (largest sum normalised to one)
    log_w, w [L, N]          particle weights
    exists  [L, M or 0, N]   log odds of existence of each particle's landmarks (per-particle association only)
    used    [L, N]           landmarks in each particle's map (they differ under per-particle association only)
"""

import numpy as np

HEADINGS = 8  # hypotheses at the first sighting of a target whose heading matters
TWIST_ROWS = 9  # 3 + 6
VELOCITY_ROWS = 14  # 4 + 10
MAP_ROWS = 5

DRAW_START, DRAW_MOTION, DRAW_RESAMPLE, DRAW_POSE, DRAW_SAMPLES = 0, 1, 2, 3, 4  # purposes of `kernels.random`

OPEN, USED, REFUSED = 0, 1, 2
"""A return before the update: not looked at; already in the pose and the weight; refused by the gate."""

EVENTS = (
    "overflow",  # a new landmark found no room
    "dropped",  # a return that could not be used: unusable numbers, no label, ambiguous
    "gated",  # a labelled return too unlikely to be what its label says
    "target_restarts",  # the target started anew from a return that it could not have caused
    "collapsed_weights",  # updates that left no particle a finite weight
    "bad_weights",  # particles whose weight was not a number
    "removed",  # landmarks of a particle's map that should have been seen and were not (weighted mean per sweep)
    "resampled",
)

LANE = np.dtype(
    [
        ("key", np.uint64),
        ("step", np.int64),  # predictions since reset: the draws' counter
        ("count", np.int64),  # map columns in use
        ("hypotheses", np.int64),  # 0: target unknown; 1: settled; HEADINGS: heading open
        ("due", np.int64),  # to be resampled at the next call: a bit for each island
        *((name, np.int64) for name in EVENTS),
    ]
)
"""One lane's scalars."""
