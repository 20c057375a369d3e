"""A small recording for the conformance suite: robots on circles, landmarks around them, a target that walks by.

Plain NumPy, no environment: estimators and their checks work without one.
"""

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from estimators.interface import TARGET, UNKNOWN, Floats, Scan, TruthAware
from estimators.models import MotionModel, SensorModel, TargetModel

DT = 0.1  # [s]
MOTION = MotionModel(speed_std=0.1, turn_std=0.1)
SENSOR = SensorModel(max_range=6.0, range_std=0.05, bearing_std=0.02)
TARGET_MODEL = TargetModel(acceleration_density=0.3, initial_speed_std=0.5)
SPEED, TURN = 0.6, 0.3  # [m/s], [rad/s]: what odometry reports; a circle of 2 m


@dataclass(frozen=True, slots=True)
class Step:
    """One step of all lanes: the reported control, the sweep at its end, and the truth then."""

    control: Floats  # [L, 2]
    scan: Scan
    pose: Floats  # [L, 3]
    target: Floats  # [L, 4] x, y, velocity_x, velocity_y


@dataclass(frozen=True, slots=True)
class Recording:
    """What L robots did, reported and sensed, with the truth."""

    start: Floats  # [L, 3]
    target_start: Floats  # [L, 4]
    landmarks: Floats  # [L, N, 2]
    seeds: list[int]
    steps: list[Step]

    def lane(self, index: int) -> Self:
        """The same recording with one lane only."""
        one = slice(index, index + 1)
        steps = [Step(s.control[one], _slice(s.scan, one), s.pose[one], s.target[one]) for s in self.steps]
        return replace(
            self,
            start=self.start[one],
            target_start=self.target_start[one],
            landmarks=self.landmarks[one],
            seeds=self.seeds[one],
            steps=steps,
        )


def _slice(scan: Scan, lanes: slice) -> Scan:
    return Scan(scan.ranges[lanes], scan.bearings[lanes], scan.labels[lanes], scan.count[lanes], scan.complete[lanes])


def record(
    num_lanes: int, num_steps: int, *, num_landmarks: int = 8, seed: int = 0, labelled: bool = True
) -> Recording:
    """Simulate `MOTION`, `SENSOR` and a smooth target for a few steps."""
    rng = np.random.default_rng(seed)
    angle = rng.uniform(-np.pi, np.pi, (num_lanes, num_landmarks))
    radius = rng.uniform(3.0, 5.0, (num_lanes, num_landmarks))
    landmarks = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
    pose = np.column_stack([np.full(num_lanes, 2.0), np.zeros(num_lanes), np.full(num_lanes, np.pi / 2)])
    target = np.column_stack([rng.uniform(-1.5, 1.5, (num_lanes, 2)), rng.uniform(-0.4, 0.4, (num_lanes, 2))])
    start, target_start = pose.copy(), target.copy()
    steps = []
    for _ in range(num_steps):
        v = SPEED + MOTION.speed_std * rng.standard_normal(num_lanes)
        w = TURN + MOTION.turn_std * rng.standard_normal(num_lanes)
        end = pose[:, 2] + w * DT
        pose = np.column_stack([pose[:, 0] + v * DT * np.cos(end), pose[:, 1] + v * DT * np.sin(end), _wrap(end)])
        target = target.copy()
        target[:, :2] += DT * target[:, 2:]
        target[:, 2:] += TARGET_MODEL.acceleration_density * np.sqrt(DT) * rng.standard_normal((num_lanes, 2))
        control = np.tile([SPEED, TURN], (num_lanes, 1))
        steps.append(Step(control, _sweep(pose, target, landmarks, labelled, rng), pose, target))
    return Recording(start, target_start, landmarks, list(range(seed, seed + num_lanes)), steps)


def _wrap(angle: Floats) -> Floats:
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def _sweep(pose: Floats, target: Floats, landmarks: Floats, labelled: bool, rng: np.random.Generator) -> Scan:
    points = np.concatenate([landmarks, target[:, None, :2]], axis=1)  # [L, N + 1, 2]
    difference = points - pose[:, None, :2]
    ranges = np.hypot(difference[..., 0], difference[..., 1]) + SENSOR.range_std * rng.standard_normal(points.shape[:2])
    bearings = np.arctan2(difference[..., 1], difference[..., 0]) - pose[:, 2:]
    bearings = _wrap(bearings + SENSOR.bearing_std * rng.standard_normal(bearings.shape))
    labels = np.append(np.arange(landmarks.shape[1]), TARGET) if labelled else np.full(points.shape[1], UNKNOWN)
    scan = Scan.empty(len(pose), points.shape[1])
    for lane in range(len(pose)):
        seen = np.flatnonzero((ranges[lane] < SENSOR.max_range) & (ranges[lane] > 0.05))
        scan.count[lane] = n = len(seen)
        scan.ranges[lane, :n] = ranges[lane, seen]
        scan.bearings[lane, :n] = bearings[lane, seen]
        scan.labels[lane, :n] = labels[seen]
    return scan


def start(estimator: Any, recording: Recording, lanes: Any = None, pose_cov: Any = None) -> None:
    """Reset the estimator to the recording's start, known exactly unless `pose_cov` is given."""
    chosen = slice(None) if lanes is None else lanes
    seeds = np.asarray(recording.seeds)[chosen]
    cov = np.zeros((3, 3)) if pose_cov is None else pose_cov
    estimator.reset(recording.start[chosen], np.tile(cov, (len(seeds), 1, 1)), seeds=seeds, lanes=lanes)


def feed(estimator: Any, recording: Recording, first: int = 0, last: int | None = None, lanes: Any = None) -> None:
    """Predict and update through steps [first, last), telling a `TruthAware` filter the truth."""
    for step in recording.steps[first:last]:
        tell_truth(estimator, recording, step)
        estimator.predict(step.control, DT, lanes=lanes)
        tell_truth(estimator, recording, step)
        estimator.update(step.scan, lanes=lanes)


def tell_truth(estimator: Any, recording: Recording, step: Step) -> None:
    """`set_truth`, where the estimator wants it."""
    if isinstance(estimator, TruthAware):
        estimator.set_truth(step.pose, step.target, recording.landmarks)
