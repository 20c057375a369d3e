"""One recorded stretch of driving, for filters that are to do the same work: controls, sweeps, a whole map to start."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators import registry
from estimators.interface import TARGET, Estimator, Floats, Scan
from estimators.models import MotionModel, SensorModel, TargetModel

BEFORE, STEPS = 20, 40  # sweeps that make the map, and that are replayed
DT = 0.1  # [s]
SEEN = 8  # landmarks in a sweep, beside the target

MOTION = MotionModel(speed_std=0.02, speed_std_per_speed=0.1, turn_std=0.02, turn_std_per_turn=0.1)
SENSOR = SensorModel(max_range=1e3, range_std=0.05, range_std_per_range=0.02, bearing_std=0.03)
TARGET_MODEL = TargetModel(acceleration_density=0.3)


@dataclass(frozen=True)
class Sweep:
    """What one step brings. control: (speed, turn rate); returns [k, 2] (range, bearing); labels [k]."""

    control: tuple[float, float]
    returns: Floats
    labels: NDArray[np.int64]

    def scan(self, num_lanes: int = 1) -> Scan:
        """The same sweep in every lane."""
        scan = Scan.empty(num_lanes, len(self.labels))
        scan.ranges[:], scan.bearings[:] = self.returns[:, 0], self.returns[:, 1]
        scan.labels[:], scan.count[:] = self.labels, len(self.labels)
        return scan


@dataclass(frozen=True)
class Stream:
    """N landmarks, some sweeps of all of them, then some of the `SEEN` nearest; the target is in each."""

    landmarks: int
    first: list[Sweep]
    rest: list[Sweep]


def make_stream(landmarks: int, seed: int = 0, before: int = BEFORE, steps: int = STEPS) -> Stream:
    """A robot on a slow circle among landmarks, a target that crosses; `before` sweeps of all, then `steps`."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-10.0, 10.0, (landmarks, 2))
    pose, target = np.zeros(3), np.array([4.0, 1.0])
    sweeps = []
    for step in range(before + steps):
        control = (0.5, 0.2)
        pose[2] += control[1] * DT
        pose[:2] += control[0] * DT * np.array([np.cos(pose[2]), np.sin(pose[2])])
        target = target + DT * np.array([0.3, 0.2])
        offsets = points - pose[:2]
        chosen = np.arange(landmarks)
        if step >= before:
            chosen = np.argsort(np.hypot(*offsets.T))[:SEEN]
        seen = np.vstack([offsets[chosen], target - pose[:2]])
        r = np.hypot(*seen.T)
        b = np.arctan2(seen[:, 1], seen[:, 0]) - pose[2]
        noise = rng.standard_normal((len(r), 2)) * np.column_stack([0.05 + 0.02 * r, np.full(len(r), 0.03)])
        returns = np.column_stack([r, b]) + noise
        returns[:, 1] = (returns[:, 1] + np.pi) % (2.0 * np.pi) - np.pi
        sweeps.append(Sweep(control, returns, np.append(chosen, TARGET)))
    return Stream(landmarks, sweeps[:before], sweeps[before:])


def settled(name: str, stream: Stream, num_lanes: int = 1, **options: Any) -> Estimator:
    """An estimator that has taken in the stream's first sweeps: its map is whole."""
    estimator = registry.make(
        name, MOTION, SENSOR, TARGET_MODEL, num_lanes=num_lanes, max_landmarks=stream.landmarks, **options
    )
    estimator.reset(np.zeros(3), np.zeros((3, 3)), seeds=0)
    for sweep in stream.first:
        estimator.predict(np.tile(sweep.control, (num_lanes, 1)), DT)
        estimator.update(sweep.scan(num_lanes))
    return estimator
