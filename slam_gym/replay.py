"""Pass a recorded robot through estimators and score them against the recorded truth.

The same estimators, metrics and tables as in simulation; see `slam_gym.mrclam` and `slam_gym.log_format` for where a
`Recording` comes from and `slam_gym.replay_models` for what the filters are told.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import pandas as pd

from slam_gym.recording import Recording
from slam_gym.records import Records
from slam_gym.replay_models import ReplayModels
from slam_gym.replay_pooled import pooled_table
from slam_gym.replay_run import Run
from slam_gym.results import Results
from slam_gym.schedule import make_schedule
from slam_gym.specs import Spec
from slam_gym.tables import landmark_table, paired_table, run_table, series_table, summary_row, track_table

POLICY = "recorded"
GATE = 13.8  # NIS, 99.9 % of chi-square with 2 degrees of freedom: mis-read labels


def replay(
    recording: Recording,
    estimators: Sequence[str | Spec | tuple[str, Mapping[str, Any]]],
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
        estimators: "name", "name:key=value,..." or (name, options); `gate` and `association` are passed to those that
            know them.
        models: what they believe.
        inflations: factors on the sensor's variances; 1 is white noise as the models say.
        association: "known" uses landmark ids, "nearest" hides them (the target's returns stay labelled).
        gate: NIS above which a labelled return is taken for a mis-read label; for filters with one Gaussian (particle
            filters take theirs as an option of their own).
        sample_rate: [Hz] of the metrics.
        out: the results' folder; written only by `Results.save`.
        progress: called with each row's name before it starts.

    Returns:
        Results with policy "recorded", run 0; not yet saved.

    Raises:
        ValueError: unknown names or options, numbers out of range, no overlap in time.
    """
    return replay_many(
        [recording], estimators, models, inflations=inflations, association=association, gate=gate,
        sample_rate=sample_rate, out=out, progress=progress,
    )[0]  # fmt: skip


def replay_many(
    recordings: Sequence[Recording],
    estimators: Sequence[str | Spec | tuple[str, Mapping[str, Any]]],
    models: ReplayModels,
    *,
    inflations: Sequence[float] = (1.0,),
    association: Literal["known", "nearest"] = "known",
    gate: float = GATE,
    sample_rate: float = 1.0,
    out: str | Path = "results/replay",
    progress: Callable[[str], Any] | None = None,
) -> tuple[Results, pd.DataFrame]:
    """Several recordings of one kind of robot: `replay` of each, and the pooled table (`slam_gym.replay_pooled`).

    Each recording is a scenario of the results. Its observer, for the pooled table, is what its name begins with
    before " target".

    Raises:
        ValueError: as `replay`, or no recording.
    """
    if not estimators or not inflations or not recordings:
        raise ValueError("replay needs at least one estimator, one recording and one noise inflation")
    frames: list[dict[str, Any]] = []
    pooled: list[tuple[str, str, Records]] = []
    for recording in recordings:
        schedule = make_schedule(recording, command_delay=models.command_delay, sample_rate=sample_rate)
        observer = recording.name.partition(" target")[0]
        for spec in map(Spec.parse, estimators):
            for inflation in inflations:
                row = spec.label if inflation == 1.0 else f"{spec.label} (R x{inflation:g})"
                if progress is not None:
                    progress(row if len(recordings) == 1 else f"{recording.name}: {row}")
                run = Run(recording, schedule, models.inflated(inflation), spec.name, spec.options, association, gate)
                records, key = run.run(), (recording.name, POLICY, row)
                pooled.append((row, observer, records))
                frames.append(_frames(key, records, run.target_dof, recording.truth is None))
    runs = pd.concat([f["runs"] for f in frames], ignore_index=True)
    odd: dict[str, int] = {}
    for recording in recordings:
        odd |= recording.warnings
    results = Results(
        path=Path(out),
        config={"recording": ", ".join(r.name for r in recordings), "inflations": list(inflations),
                "association": association, "gate": gate, "sample_rate": sample_rate, "models": str(models),
                "counted in the files": odd},
        runs=runs,
        summary=pd.DataFrame([f["summary"] for f in frames]),
        paired=paired_table(runs),
        series=pd.concat([f["series"] for f in frames], ignore_index=True),
        tracks=pd.concat([f["tracks"] for f in frames], ignore_index=True),
        landmarks=pd.concat([f["landmarks"] for f in frames], ignore_index=True),
        warnings=[f"{what}: {number}" for what, number in odd.items()],
    )  # fmt: skip
    return results, pooled_table(pooled)


def _frames(key: tuple[str, str, str], records: Records, target_dof: int, unscored: bool) -> dict[str, Any]:
    runs = run_table(key, records, target_dof=target_dof)
    if unscored:
        runs["diverged"] = False
    summary = summary_row(key, records, runs, target_dof=target_dof)
    tables = {"series": series_table, "tracks": track_table, "landmarks": landmark_table}
    return {"runs": runs, "summary": summary} | {name: make(key, records) for name, make in tables.items()}
