"""What estimators take in: one sweep of the sensor per lane."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

UNKNOWN = -1  # a return whose source the sensor does not tell
TARGET = -2  # a return that the sensor knows to be the target's


@dataclass(slots=True)
class Scan:
    """One sweep per lane: every return in one list.

    Attributes:
        ranges: [L, K] metres; entries from `count` on are meaningless.
        bearings: [L, K] radians from the heading, left positive, in [-pi, pi).
        labels: [L, K] a landmark's id (>= 0), `TARGET` or `UNKNOWN`.
        count: [L] number of returns, at most K.
        complete: [L] whether the absence of a return is evidence (a recording that omits empty sweeps says no).
    """

    ranges: Floats
    bearings: Floats
    labels: Ints
    count: Ints
    complete: Bools

    @classmethod
    def empty(cls, num_lanes: int, width: int) -> Self:
        """A scan without returns, to be filled in place."""
        return cls(
            np.zeros((num_lanes, width)),
            np.zeros((num_lanes, width)),
            np.full((num_lanes, width), UNKNOWN, dtype=np.int64),
            np.zeros(num_lanes, dtype=np.int64),
            np.ones(num_lanes, dtype=np.bool_),
        )
