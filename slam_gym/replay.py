"""Pass a recorded robot through estimators and score them against the recorded truth.

The same estimators, metrics and tables as in simulation; see `slam_gym.mrclam` and `slam_gym.log_format` for where a
`Recording` comes from and `slam_gym.replay_models` for what the filters are told.
"""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any, Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from estimators import registry
from estimators.interface import TARGET, UNKNOWN, Estimator, Floats, Ints, Scan, TruthAware
from slam_gym.metrics import METRIC, Meter
from slam_gym.recording import Recording
from slam_gym.records import FIELDS, LANDMARK, TRACK, Records
from slam_gym.replay_models import ReplayModels
from slam_gym.results import Results
from slam_gym.schedule import NONE, Schedule, make_schedule
from slam_gym.tables import landmark_table, paired_table, run_table, series_table, summary_row, track_table

POLICY = "recorded"
GATE = 13.8  # NIS, 99.9 % of chi-square with 2 degrees of freedom: mis-read labels
SPARE_LANDMARKS = 64  # least map capacity where landmarks have no ids
_TARGET_FIELDS = [i for i, name in enumerate(FIELDS) if name.startswith("target")]


@dataclass(frozen=True, slots=True)
class _Labels:
    """Landmarks counted 0, 1, ...: the surveyed ones first, then others that were sensed."""

    ids: Ints  # [N + others]
    surveyed: int  # N
    of_return: Ints  # [Z]


def replay(
    recording: Recording,
    estimators: Sequence[tuple[str, Mapping[str, Any]]],
    models: ReplayModels,
    *,
    inflations: Sequence[float] = (1.0,),
    association: Literal["known", "nearest"] = "known",
    gate: float = GATE,
    sample_rate: float = 1.0,
    out: str | Path = "results/replay",
    progress: Callable[[str], Any] | None = None,
) -> Results:
    """Every estimator over the whole recording, once with each inflation of the sensor's noise.

    Args:
        recording: of one robot.
        estimators: names and options; `gate` and `association` are passed to those that know them.
        models: what they believe.
        inflations: factors on the sensor's variances; 1 is white noise as the models say.
        association: "known" uses landmark ids, "nearest" hides them (the target's returns stay labelled).
        gate: NIS above which a labelled return is taken for a mis-read label.
        sample_rate: [Hz] of the metrics.
        out: the results' folder; written only by `Results.save`.
        progress: called with each row's name before it starts.

    Returns:
        Results with policy "recorded", run 0; not yet saved.

    Raises:
        ValueError: unknown names or options, numbers out of range, no overlap in time.
    """
    if not estimators or not inflations:
        raise ValueError("replay needs at least one estimator and one noise inflation")
    schedule = make_schedule(recording, command_delay=models.command_delay, sample_rate=sample_rate)
    frames: list[dict[str, Any]] = []
    for name, options in estimators:
        for inflation in inflations:
            row = name if inflation == 1.0 else f"{name}, R x{inflation:g}"
            if progress is not None:
                progress(row)
            run = _Run(recording, schedule, models.inflated(inflation), name, options, association, gate)
            frames.append(_frames((recording.name, POLICY, row), run.run(), run.target_dof, recording.truth is None))
    runs = pd.concat([f["runs"] for f in frames], ignore_index=True)
    return Results(
        path=Path(out),
        config={"recording": recording.name, "inflations": list(inflations), "association": association, "gate": gate,
                "sample_rate": sample_rate, "models": str(models), "counted in the files": recording.warnings},
        runs=runs,
        summary=pd.DataFrame([f["summary"] for f in frames]),
        paired=paired_table(runs),
        series=pd.concat([f["series"] for f in frames], ignore_index=True),
        tracks=pd.concat([f["tracks"] for f in frames], ignore_index=True),
        landmarks=pd.concat([f["landmarks"] for f in frames], ignore_index=True),
        warnings=[f"{what}: {number}" for what, number in recording.warnings.items()],
    )  # fmt: skip


def _frames(key: tuple[str, str, str], records: Records, target_dof: int, unscored: bool) -> dict[str, Any]:
    runs = run_table(key, records, target_dof=target_dof)
    if unscored:
        runs["diverged"] = False
    summary = summary_row(key, records, runs, target_dof=target_dof)
    tables = {"series": series_table, "tracks": track_table, "landmarks": landmark_table}
    return {"runs": runs, "summary": summary} | {name: make(key, records) for name, make in tables.items()}


class _Run:
    """One estimator over one recording."""

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
        self.labels = _count_landmarks(recording)
        capacity = max(1, len(self.labels.ids))
        if association != "known" or (recording.labels == UNKNOWN).any():
            capacity = max(2 * capacity, SPARE_LANDMARKS)
        self.labelled = association == "known"
        offered = {"gate": gate, "association": association}
        known = inspect.signature(registry.get(name).__init__).parameters
        own = {key: value for key, value in offered.items() if key in known} | dict(options)
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
        values, age = np.full((1, num, len(METRIC)), np.nan), np.full((1, num), np.inf)
        tracks = np.full((num, len(TRACK)), np.nan)
        sweeps, samples, steps = schedule.sweep.tolist(), schedule.sample.tolist(), schedule.dt.tolist()
        controls, ends = schedule.controls, schedule.times.tolist()
        last_seen = -np.inf
        for i in range(len(steps)):
            begin = perf_counter()
            estimator.predict(controls[i : i + 1], steps[i])
            self.timing[0] += perf_counter() - begin
            if sweeps[i] != NONE and self._sweep(sweeps[i]):
                last_seen = ends[i]
            k = samples[i]
            if k != NONE:
                values[0, k] = self._measure(k)
                age[0, k] = ends[i] - last_seen
                tracks[k] = self._track_row(k, age[0, k])
        self.timing[1] = len(steps)
        return Records(
            run=np.zeros(1, dtype=np.int64),
            seed=np.zeros(1, dtype=np.int64),
            steps=np.full(1, num, dtype=np.int64),
            values=values,
            age=age,
            time=schedule.sample_times - schedule.start,
            collisions=np.zeros(1, dtype=np.int64),
            counts=estimator.counts,
            timing=self.timing,
            tracks=tracks,
            landmarks=self._map_rows(),
        )

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
        self.timing[2] += perf_counter() - begin
        self.timing[3] += 1
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
        P, known = belief.pose_cov[0], bool(belief.target_known[0])
        T = belief.target_position_cov[0] if known else np.full((2, 2), np.nan)
        target = belief.target_position[0] if known else np.full(2, np.nan)
        seen = age <= self.schedule.sample_times[k] - (self.schedule.sample_times[k - 1] if k else self.schedule.start)
        return np.array(
            [0, k + 1, self.schedule.sample_times[k] - self.schedule.start, *self.pose[k], *belief.pose[0],
             P[0, 0], P[0, 1], P[1, 1], *self.target[k, :2], *target, T[0, 0], T[0, 1], T[1, 1], seen]
        )  # fmt: skip

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


def _count_landmarks(recording: Recording) -> _Labels:
    sensed = np.unique(recording.labels[recording.labels >= 0])
    ids = np.concatenate([recording.landmark_ids, np.setdiff1d(sensed, recording.landmark_ids)]).astype(np.int64)
    number_of = {int(name): number for number, name in enumerate(ids)}
    counted = np.array([number_of.get(int(label), label) for label in recording.labels], dtype=np.int64)
    return _Labels(ids, len(recording.landmark_ids), counted)
