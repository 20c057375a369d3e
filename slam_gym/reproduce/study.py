"""Where an experiment works: sizes, progress, and measurements that a killed run finds again."""

import hashlib
import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from estimators import registry
from slam_gym.evaluation import compare
from slam_gym.evaluation_folder import part_files, read_parts
from slam_gym.records import LANDMARK, TRACK
from slam_gym.results import file_stem, write_atomic
from slam_gym.scenario import Scenario
from slam_gym.specs import Spec
from slam_gym.stats import column_mean, row_mean

Floats = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

ERRORS = ("robot_error", "target_error", "target_heading_error", "pose_nees", "target_nees")
UNSCORED = 1  # first steps without a NEES: after one step from an exactly known start P has not its full rank


@dataclass(frozen=True, slots=True)
class Sample:
    """R runs of one scenario, T steps, by estimator's label.

    Attributes:
        time: [T] seconds.
        values: label -> field of `METRIC` -> [R, T]; NaN where undefined.
        events: label -> counter -> [R].
        seconds: label -> [4]: in predict, lane-calls of it, in update, lane-calls of it.
        tracks, landmarks: label -> rows of `records.TRACK` and `records.LANDMARK` of the runs kept in full.
    """

    time: Floats
    values: dict[str, dict[str, Floats]]
    events: dict[str, dict[str, Floats]]
    seconds: dict[str, Floats]
    tracks: dict[str, Floats]
    landmarks: dict[str, Floats]

    @property
    def labels(self) -> list[str]:
        """The estimators, in order."""
        return list(self.values)

    def of_runs(self, label: str, name: str) -> Floats:
        """[R] each run's mean over its scored steps."""
        return row_mean(self.values[label][name][:, UNSCORED:])

    def over_time(self, label: str, name: str) -> Floats:
        """[T] each step's mean over runs."""
        return column_mean(self.values[label][name])

    def microseconds(self, label: str) -> float:
        """Filter time per run and simulation step, predictions and updates."""
        predict, steps, update, _ = self.seconds[label]
        return float(1e6 * (predict + update) / steps)

    def drawn(self, labels: Sequence[str]) -> tuple[pd.DataFrame, pd.DataFrame]:
        """Tracks and maps of some estimators as `slam_gym.plots.trajectories` wants them."""
        frames = []
        for rows, names in ((self.tracks, TRACK), (self.landmarks, LANDMARK)):
            parts = [pd.DataFrame(rows[label], columns=list(names)).assign(estimator=label) for label in labels]
            frames.append(pd.concat(parts, ignore_index=True))
        return frames[0], frames[1]

    def save(self, path: Path) -> None:
        """One file; `load` reads it."""
        arrays: dict[str, Any] = {"time": self.time, "labels": np.array(self.labels)}
        for i, label in enumerate(self.labels):
            arrays.update({f"{i}/value/{name}": array for name, array in self.values[label].items()})
            arrays.update({f"{i}/event/{name}": array for name, array in self.events[label].items()})
            arrays[f"{i}/seconds"] = self.seconds[label]
            arrays[f"{i}/tracks"], arrays[f"{i}/landmarks"] = self.tracks[label], self.landmarks[label]
        write_atomic(path, partial(np.savez, **arrays))

    @classmethod
    def load(cls, path: Path) -> "Sample":
        """What `save` wrote."""
        with np.load(path) as file:
            labels = [str(label) for label in file["labels"]]

            def group(i: int, kind: str) -> dict[str, Floats]:
                start = f"{i}/{kind}/"
                return {name[len(start) :]: file[name] for name in file if name.startswith(start)}

            def each(name: str) -> dict[str, Floats]:
                return {label: file[f"{i}/{name}"] for i, label in enumerate(labels)}

            return cls(
                file["time"],
                {label: group(i, "value") for i, label in enumerate(labels)},
                {label: group(i, "event") for i, label in enumerate(labels)},
                each("seconds"), each("tracks"), each("landmarks"),
            )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Study:
    """What an experiment is given.

    Attributes:
        folder: its own; measurements are kept under `work/`.
        quick: only a look.
        most_runs: no measurement takes more runs than this.
        batches: of the CDKF's loops; None: as many as the size says.
        jobs: processes; None: one per CPU.
        webmap: folder with the published map of Tian et al. 2010; None: the preset's own, generated one.
        mrclam: folder of an MRCLAM data set; None: not there.
        progress: called with what is being done, and how much of it is.
    """

    folder: Path
    quick: bool = False
    most_runs: int = 1_000_000
    batches: int | None = None
    jobs: int | None = None
    webmap: Path | None = None
    mrclam: Path | None = None
    progress: Progress = lambda what, done, total: None

    def size(self, full: int, quick: int) -> int:
        """How many runs."""
        return max(2, min(quick if self.quick else full, self.most_runs))

    def measure(
        self,
        name: str,
        scenario: Scenario,
        estimators: Sequence[str | Spec],
        *,
        runs: int,
        seed: int = 0,
        driver: str | None = None,
        fields: Sequence[str] = ERRORS,
        tracks: int = 0,
    ) -> Sample:
        """Compare estimators on the same data, or find what an earlier, killed run has measured.

        Args:
            name: of the measurement, for people.
            scenario: see `compare`.
            estimators: likewise.
            runs: likewise.
            seed: likewise.
            driver: likewise.
            fields: of `METRIC`, kept for every run and step; without those of landmarks the map is not scored.
            tracks: see `compare`.
        """
        specs = [Spec.parse(estimator) for estimator in estimators]
        settings = [scenario.to_dict(), [s.to_dict() for s in specs], runs, seed, driver, list(fields), tracks]
        key = hashlib.sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest()[:12]
        path = self.folder / "work" / f"{file_stem(name)}-{key}.npz"
        if path.is_file():
            return Sample.load(path)
        scratch = path.with_suffix("")
        compare(
            [scenario], specs, runs=runs, seed=seed, driver=driver, tracks=tracks, out=scratch, resume=True,
            score_map=any(name.startswith("landmark") for name in fields),
            jobs=self.jobs, progress=lambda _, done, total: self.progress(name, done, total),
        )  # fmt: skip
        sample = _read(scratch, [spec.label for spec in specs], runs, fields)
        sample.save(path)
        shutil.rmtree(scratch)
        return sample


def _read(folder: Path, labels: Sequence[str], runs: int, fields: Sequence[str]) -> Sample:
    """The finished parts of a comparison of one scenario."""
    records = {label: read_parts(part_files(folder, 0), e, set(range(runs))) for e, label in enumerate(labels)}
    return Sample(
        time=records[labels[0]].time,
        values={label: {name: found[name] for name in fields} for label, found in records.items()},
        events={label: {name: n.astype(float) for name, n in found.counts.items()} for label, found in records.items()},
        seconds={label: found.timing for label, found in records.items()},
        tracks={label: found.tracks for label, found in records.items()},
        landmarks={label: found.landmarks for label, found in records.items()},
    )


def available(*names: str) -> list[str]:
    """Those estimators that are installed: extras that an experiment shows beside the paper's."""
    known = registry.names()
    return [name for name in names if name.partition(":")[0] in known]
