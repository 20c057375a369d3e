"""How a map's storage costs: the same filter with three storages, once round a ring of landmarks, side by side."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slam_gym.reproduce.driving import clock, drive, seconds_per_step
from slam_gym.reproduce.rbpf_world import ring

Floats = NDArray[np.float64]

STORES = {"tree": "tree of the paper", "dense": "one array per particle", "lazy": "shared columns (the default)"}
FILTER = "fastslam2"  # the improved proposal in closed form: the least cost outside the map
LAST_PART = 0.25  # of a round: the map is nearly full


@dataclass(frozen=True, slots=True)
class Round:
    """One round. T steps; by storage.

    Attributes:
        mapped: [T] landmarks in the map.
        seconds: storage -> [T] of prediction, update and resampling.
        map_bytes: storage -> [T] that hold all particles' maps.
    """

    mapped: Floats
    seconds: dict[str, Floats]
    map_bytes: dict[str, Floats]

    def microseconds(self, storage: str) -> float:
        """A step's median time over the last part: what other processes delay does not count."""
        steps = self.seconds[storage]
        return 1e6 * float(np.median(steps[int((1.0 - LAST_PART) * len(steps)) :]))

    def megabytes(self, storage: str) -> float:
        """The maps' mean size over the last part."""
        steps = self.map_bytes[storage]
        return 1e-6 * float(np.mean(steps[int((1.0 - LAST_PART) * len(steps)) :]))


def drive_round(landmarks: int, particles: int, seed: int, stores: Sequence[str] = tuple(STORES)) -> Round:
    """Let `FILTER` go once round a ring, with each storage on the same data and the same draws."""
    specs = [(FILTER, {"particles": particles, "map_storage": storage}) for storage in stores]
    seen: set[int] = set()
    mapped, spent, size = [], [], []
    for simulation in drive(ring(landmarks), specs, seed):
        estimators: list[Any] = simulation.estimators
        scan = simulation.world.scan
        seen.update(scan.labels[0, : scan.count[0]].tolist())
        mapped.append(float(len(seen)))
        spent.append(clock(simulation))
        size.append([float(estimator.map_bytes()[0]) for estimator in estimators])
    seconds, sizes = seconds_per_step(spent), np.array(size)
    return Round(
        np.array(mapped),
        {storage: seconds[:, e] for e, storage in enumerate(stores)},
        {storage: sizes[:, e] for e, storage in enumerate(stores)},
    )
