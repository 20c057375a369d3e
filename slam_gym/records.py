"""What one estimator did in a batch of runs, as arrays: the raw material of every table.

A simulated comparison fills `Records` in its workers and keeps them as files; a replay of a recorded robot fills one
with a single run. `slam_gym.tables` makes tidy frames of them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from slam_gym.metrics import METRIC

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FIELDS: tuple[str, ...] = METRIC.names or ()

TRACK = (
    "run", "step", "time", "true_x", "true_y", "true_heading", "x", "y", "heading", "pose_cov_xx", "pose_cov_xy",
    "pose_cov_yy", "target_true_x", "target_true_y", "target_x", "target_y", "target_cov_xx", "target_cov_xy",
    "target_cov_yy", "target_seen",
)  # fmt: skip
"""Columns of a track: truth and belief at each step; [m], [rad], [s]; NaN where there is no target or no belief."""

LANDMARK = ("run", "id", "true_x", "true_y", "radius", "x", "y", "cov_xx", "cov_xy", "cov_yy")
"""Columns of the map at a run's end: each true landmark and its estimate (NaN: not in the map)."""


@dataclass(slots=True)
class Records:
    """R runs of one estimator, T steps at most. NaN after a run's end and wherever a number is undefined.

    Attributes:
        run: [R] index of each run in the comparison.
        seed: [R] of its world.
        steps: [R] how many simulation steps it lasted.
        values: [R, T, F] what `METRIC` holds after each step, fields in its order.
        age: [R, T] seconds since the target's last return (before the first: since the start); NaN without a target.
        time: [T] seconds since the start, at the end of each step.
        collisions: [R] counted contacts with pillars.
        effort: [R] mean over steps of half the squared length of the action; NaN where nothing acted (a recording).
        counts: the estimator's own counters at the end, [R] each.
        timing: seconds in predict, lane-calls of predict, seconds in update, lane-calls of update.
        tracks: [n, TRACK] of the runs that are drawn.
        landmarks: [m, LANDMARK] of the same runs.
    """

    run: Ints
    seed: Ints
    steps: Ints
    values: Floats
    age: Floats
    time: Floats
    collisions: Ints
    effort: Floats
    counts: dict[str, Ints] = field(default_factory=dict)
    timing: Floats = field(default_factory=lambda: np.zeros(4))
    tracks: Floats = field(default_factory=lambda: np.empty((0, len(TRACK))))
    landmarks: Floats = field(default_factory=lambda: np.empty((0, len(LANDMARK))))

    def __getitem__(self, name: str) -> Floats:
        """One field of `METRIC` over runs and steps, [R, T]."""
        return np.ascontiguousarray(self.values[:, :, FIELDS.index(name)])

    def to_arrays(self, prefix: str) -> dict[str, NDArray[Any]]:
        """Flat names and arrays, for a file that holds several."""
        arrays = {f"{prefix}/{f.name}": getattr(self, f.name) for f in fields(self) if f.name != "counts"}
        arrays.update({f"{prefix}/counts/{name}": values for name, values in self.counts.items()})
        return arrays

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]], prefix: str) -> Self:
        """What `to_arrays` wrote."""
        plain = {f.name: arrays[f"{prefix}/{f.name}"] for f in fields(cls) if f.name != "counts"}
        start = f"{prefix}/counts/"
        counts = {name[len(start) :]: arrays[name] for name in arrays if name.startswith(start)}
        return cls(**plain, counts=counts)

    def select(self, runs: set[int]) -> Self:
        """Only the runs with these indices."""
        chosen = np.array([int(run) in runs for run in self.run], dtype=np.bool_)
        if chosen.all():
            return self
        last = max(1, int(self.steps[chosen].max(initial=1)))
        return replace(
            self,
            run=self.run[chosen],
            seed=self.seed[chosen],
            steps=self.steps[chosen],
            values=self.values[chosen, :last],
            age=self.age[chosen, :last],
            time=self.time[:last],
            collisions=self.collisions[chosen],
            effort=self.effort[chosen],
            counts={name: values[chosen] for name, values in self.counts.items()},
            tracks=self.tracks[np.isin(self.tracks[:, 0], list(runs))],
            landmarks=self.landmarks[np.isin(self.landmarks[:, 0], list(runs))],
        )

    @classmethod
    def join(cls, parts: Sequence[Self]) -> Self:
        """All runs of several batches, in the order of their index; shorter ones are padded with NaN."""
        longest = max(parts, key=lambda part: len(part.time))
        order = np.argsort(np.concatenate([part.run for part in parts]), kind="stable")
        steps = len(longest.time)
        names = list(dict.fromkeys(name for part in parts for name in part.counts))
        none = [np.zeros(len(part.run), dtype=np.int64) for part in parts]
        tracks = np.concatenate([part.tracks for part in parts])
        landmarks = np.concatenate([part.landmarks for part in parts])
        return cls(
            run=np.concatenate([part.run for part in parts])[order],
            seed=np.concatenate([part.seed for part in parts])[order],
            steps=np.concatenate([part.steps for part in parts])[order],
            values=np.concatenate([_pad(part.values, steps) for part in parts])[order],
            age=np.concatenate([_pad(part.age, steps) for part in parts])[order],
            time=longest.time,
            collisions=np.concatenate([part.collisions for part in parts])[order],
            effort=np.concatenate([part.effort for part in parts])[order],
            counts={
                name: np.concatenate([p.counts.get(name, zero) for p, zero in zip(parts, none, strict=True)])[order]
                for name in names
            },
            timing=np.sum([part.timing for part in parts], axis=0),
            tracks=tracks[np.argsort(tracks[:, 0], kind="stable")],
            landmarks=landmarks[np.argsort(landmarks[:, 0], kind="stable")],
        )


def _pad(values: Floats, steps: int) -> Floats:
    missing = steps - values.shape[1]
    if missing == 0:
        return values
    return np.pad(values, [(0, 0), (0, missing)] + [(0, 0)] * (values.ndim - 2), constant_values=np.nan)
