"""One estimator over one recording: predict, update, measure, in the order in which things happened."""

import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np

from estimators import registry
from estimators.interface import TARGET, UNKNOWN, Estimator, Floats, Ints, Scan, TruthAware
from slam_gym.metrics import Meter
from slam_gym.recording import Recording
from slam_gym.records import FIELDS, LANDMARK, TRACK, Records
from slam_gym.replay_models import ReplayModels
from slam_gym.schedule import NONE, Schedule

SPARE_LANDMARKS = 64  # least map capacity where landmarks have no ids
_TARGET_FIELDS = [i for i, name in enumerate(FIELDS) if name.startswith("target")]


@dataclass(frozen=True, slots=True)
class Labels:
    """Landmarks counted 0, 1, ...: the surveyed ones first, then others that were sensed."""

    ids: Ints  # [N + others]
    surveyed: int  # N
    of_return: Ints  # [Z]


class Run:
    """One estimator over one recording.

    Args:
        recording: of one robot.
        schedule: of the same recording.
        models: what the estimator believes.
        name: of the estimator.
        options: its own; they win over `gate` and `association`.
        association: "known" or "nearest" (landmark ids are hidden).
        gate: NIS of mis-read labels, for filters with one Gaussian.

    Raises:
        ValueError: unknown name or option, or an estimator that wants the truth.
    """

    def __init__(
        self,
        recording: Recording,
        schedule: Schedule,
        models: ReplayModels,
        name: str,
        options: Mapping[str, Any],
        association: str,
        gate: float,
    ) -> None:
        self.recording, self.schedule = recording, schedule
        self.labels = count_landmarks(recording)
        capacity = max(1, len(self.labels.ids))
        if association != "known" or (recording.labels == UNKNOWN).any():
            capacity = max(2 * capacity, SPARE_LANDMARKS)
        self.labelled = association == "known"
        own = _shared_options(registry.get(name), models, gate, association) | dict(options)
        self.estimator: Estimator = registry.make(
            name, models.motion, models.sensor, models.target, max_landmarks=capacity, **own
        )
        if isinstance(self.estimator, TruthAware):
            raise ValueError(f"{name!r} needs the truth at every step; a replay does not give it. Choose another")
        self.meter = Meter(1, capacity)
        self._start(models)
        self.scan = Scan.empty(1, recording.widest_sweep)
        self.scan.complete[:] = recording.complete
        self.timing = np.zeros(4)
        self.called = [False] * 4
        self._truth()

    @property
    def target_dof(self) -> int:
        """Size of the target's state, as NEES needs it."""
        return len(self.estimator.target_names) or 4

    def _start(self, models: ReplayModels) -> None:
        """The robot starts where it truly was; the target is not known before it is seen."""
        truth = self.recording.truth
        pose = np.zeros(3) if truth is None else truth.at([self.schedule.start])[0]
        position, heading = models.start_std
        cov = np.diag([position**2, position**2, heading**2])
        self.estimator.reset(pose[None], cov[None], seeds=np.zeros(1, dtype=np.int64))

    def _truth(self) -> None:
        """The truth at every sample: pose [T, 3], target [T, 4] and its heading [T]; NaN where not recorded."""
        when, truth, target = self.schedule.sample_times, self.recording.truth, self.recording.target
        none = np.full((len(when), 3), np.nan)
        self.pose = none if truth is None else truth.at(when)
        poses = none if target is None else target.at(when)
        velocity = none[:, :2] if target is None else target.velocity_at(when)
        self.target = np.concatenate([poses[:, :2], velocity], axis=1)
        course = np.arctan2(velocity[:, 1], velocity[:, 0])
        self.target_heading = np.where(np.isnan(poses[:, 2]), course, poses[:, 2])
        self.map = self.recording.landmarks[None] if len(self.recording.landmarks) else None

    def run(self) -> Records:
        """From start to end."""
        schedule, estimator = self.schedule, self.estimator
        num = len(schedule.sample_times)
        values, age = np.full((1, num, len(FIELDS)), np.nan), np.full((1, num), np.nan)
        tracks = np.full((num, len(TRACK)), np.nan)
        sweeps, samples, steps = schedule.sweep.tolist(), schedule.sample.tolist(), schedule.dt.tolist()
        controls, ends = schedule.controls, schedule.times.tolist()
        last_seen = -np.inf
        for i in range(len(steps)):
            if steps[i] > 0.0:
                begin = perf_counter()
                estimator.predict(controls[i : i + 1], steps[i])
                self._clock(0, begin)
            if sweeps[i] != NONE and self._sweep(sweeps[i]):
                last_seen = ends[i]
            k = samples[i]
            if k != NONE:
                values[0, k] = self._measure(k)
                unseen = ends[i] - last_seen
                tracks[k] = self._track_row(k, unseen)
                if not np.isnan(self.target[k]).any():  # no target, nothing lost
                    age[0, k] = unseen
        return Records(
            run=np.zeros(1, dtype=np.int64),
            seed=np.zeros(1, dtype=np.int64),
            steps=np.full(1, num, dtype=np.int64),
            values=values,
            age=age,
            time=schedule.sample_times - schedule.start,
            collisions=np.zeros(1, dtype=np.int64),
            effort=np.full(1, np.nan),  # a recorded robot was driven by somebody else
            counts=estimator.counts,
            timing=self.timing,
            tracks=tracks,
            landmarks=self._map_rows(),
        )

    def _clock(self, what: int, begin: float) -> None:
        """Add a call to predict (0) or update (2); the first of each may have compiled and is left out."""
        if self.called[what]:
            self.timing[what] += perf_counter() - begin
            self.timing[what + 1] += 1
        self.called[what] = True

    def _sweep(self, index: int) -> bool:
        """Take in one sweep; whether the target was in it."""
        first, end = self.recording.sweep_first[index : index + 2]
        n, scan, rows = end - first, self.scan, slice(first, end)
        scan.count[0] = n
        scan.ranges[0, :n] = self.recording.ranges[rows]
        scan.bearings[0, :n] = self.recording.bearings[rows]
        labels = self.labels.of_return[rows]
        scan.labels[0, :n] = labels if self.labelled else np.where(labels == TARGET, TARGET, UNKNOWN)
        begin = perf_counter()
        self.estimator.update(scan)
        self._clock(2, begin)
        return bool((labels == TARGET).any())

    def _measure(self, k: int) -> Floats:
        """One sample of `METRIC`, [F]; NaN where the truth is not recorded."""
        record = self.meter.measure(
            self.estimator.belief, self.pose[k : k + 1], self.target[k : k + 1], self.map,
            labelled=self.labelled, target_heading=self.target_heading[k : k + 1],
        )  # fmt: skip
        values = np.array(record.view(np.float64), dtype=np.float64)
        if np.isnan(self.pose[k]).any():
            values[: FIELDS.index("landmark_count")] = np.nan
        if np.isnan(self.target[k]).any():
            values[_TARGET_FIELDS] = np.nan
        return values

    def _track_row(self, k: int, age: float) -> Floats:
        belief = self.estimator.belief
        pose_cov, known = belief.pose_cov[0], bool(belief.target_known[0])
        target_cov = belief.target_position_cov[0] if known else np.full((2, 2), np.nan)
        target = belief.target_position[0] if known else np.full(2, np.nan)
        seen = age <= self.schedule.sample_times[k] - (self.schedule.sample_times[k - 1] if k else self.schedule.start)
        covs = [m[i, j] for m in (pose_cov, target_cov) for i, j in ((0, 0), (0, 1), (1, 1))]
        time = self.schedule.sample_times[k] - self.schedule.start
        poses = [*self.pose[k], *belief.pose[0], *covs[:3]]
        return np.array([0, k + 1, time, *poses, *self.target[k, :2], *target, *covs[3:], seen])

    def _map_rows(self) -> Floats:
        """The surveyed landmarks and their estimates, then what else is in the map."""
        belief, labels = self.estimator.belief, self.labels
        rows = np.full((labels.surveyed, len(LANDMARK)), np.nan)
        rows[:, 0], rows[:, 4], rows[:, 1] = 0, 0, labels.ids[: labels.surveyed]
        rows[:, 2:4] = self.recording.landmarks
        extra = []
        for slot in np.flatnonzero(belief.landmark_mapped[0]):
            cov = belief.landmark_cov[0, slot]
            estimate = [*belief.landmark_mean[0, slot], cov[0, 0], cov[0, 1], cov[1, 1]]
            j = int(belief.landmark_id[0, slot])
            if self.labelled and 0 <= j < labels.surveyed:
                rows[j, 5:] = estimate
            else:
                name = labels.ids[j] if self.labelled and j < len(labels.ids) else -1
                extra.append([0, name, np.nan, np.nan, 0, *estimate])
        return np.concatenate([rows, np.array(extra).reshape(-1, len(LANDMARK))])


def _shared_options(cls: type[Estimator], models: ReplayModels, gate: float, association: str) -> dict[str, Any]:
    """The replay's options that a filter knows; the gate only without particles.

    Particles judge a return by a single path's small covariances: once they have collapsed, a gate turns away the true
    returns that would weigh them (MRCLAM set 7, robot 5: 1.3 m with it, 0.3 m without).
    """
    known = {name for base in cls.__mro__ for name in inspect.signature(base).parameters}
    offered: dict[str, Any] = {"association": association, "errors": models.errors}
    if "particles" not in known:
        offered |= {"gate": gate, "slam_options": {"gate": gate}}
    return {key: value for key, value in offered.items() if key in known}


def count_landmarks(recording: Recording) -> Labels:
    """Number the landmarks of a recording."""
    sensed = np.unique(recording.labels[recording.labels >= 0])
    ids = np.concatenate([recording.landmark_ids, np.setdiff1d(sensed, recording.landmark_ids)]).astype(np.int64)
    number_of = {int(name): number for number, name in enumerate(ids)}
    counted = np.array([number_of.get(int(label), label) for label in recording.labels], dtype=np.int64)
    return Labels(ids, len(recording.landmark_ids), counted)
