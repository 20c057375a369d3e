"""Compare estimators and policies on the same random draws: parallel, resumable, mergeable.

>>> from slam_gym.evaluation import compare
>>> results = compare("default", ["ekf", "ri-ekf"], runs=100, out="results/mine")
>>> results.summary[["estimator", "robot_error_rmse", "pose_nees_mean"]]

Work is cut into units: a few runs of one scenario and policy, side by side in lanes, every estimator on them. Each is
written whole to `parts/` when done, so that an interrupted comparison goes on from there, and comparisons split over
machines merge. A run's numbers depend on (settings, seed, its index) alone, never on how the work is cut.
"""

import shutil
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import pandas as pd

from slam_gym import tables
from slam_gym.evaluation_backend import Backend, workers
from slam_gym.evaluation_folder import (
    SETTINGS,
    check_runs,
    ensure_folder,
    kept_settings,
    open_folder,
    part_files,
    read_parts,
    same_settings,
)  # fmt: skip
from slam_gym.evaluation_plan import Mode, Plan, make_plan, plan_from_dict
from slam_gym.evaluation_work import Progress, do_work, own_classes
from slam_gym.results import Results, write_json
from slam_gym.scenario import Scenario

__all__ = ["Progress", "collect", "compare", "merge", "versions"]


def compare(
    scenarios: str | Scenario | Sequence[str | Scenario] = "default",
    estimators: Sequence[Any] | None = None,
    policies: Sequence[Any] | None = None,
    *,
    runs: int = 40,
    seed: int = 0,
    mode: Mode = "shared",
    driver: str | None = None,
    steps: int | None = None,
    burn_in: int | None = None,
    overrides: Mapping[str, Any] | None = None,
    sweep: Mapping[str, Sequence[Any]] | None = None,
    estimator_options: Mapping[str, Mapping[str, Any]] | None = None,
    noise_inflation: float | None = None,
    tracks: int = 1,
    score_map: bool = True,
    out: str | Path | None = None,
    resume: bool = False,
    shard: tuple[int, int] = (1, 1),
    jobs: int | None = None,
    backend: Backend = "processes",
    address: str | None = None,
    chunk: int | None = None,
    command: str = "",
    progress: Progress | None = None,
) -> Results:
    """Run every estimator under every policy in every scenario, on the same seeds.

    Args:
        scenarios: names, paths or `Scenario`s.
        estimators: names ("ekf"), with options ("slamto:particles=500") or as pairs (name, options); None: the
            scenario's own list. The first is what the others are compared with.
        policies: likewise, or the folder of a training; None: the scenario's own.
        runs: worlds per scenario and policy, numbered from 0; world i is the same for everybody.
        seed: of the comparison.
        mode: "shared": one policy drives, on the belief of `driver`, and every estimator processes the same data;
            "closed-loop": each estimator drives a policy of its own.
        driver: label of an estimator; None: "ri-ekf", else "fej-ekf", else the first.
        steps: simulation steps of a run; None: the scenario's.
        burn_in: first steps that are not scored; None: the scenario's, and at least the first.
        overrides: dotted scenario settings, {"sensor.max_range": 5.0}, for all scenarios.
        sweep: values by dotted setting, {"target.speed": [0.8, 1.0, 1.2]}; each (and each combination) is a scenario
            of its own with the same random draws.
        estimator_options: options by estimator name.
        noise_inflation: factor on the measurement covariance that the filters assume ("filter.noise_inflation").
        tracks: first runs whose trajectories are kept.
        score_map: whether landmarks are scored; without them a comparison is much quicker, most of all of particles.
        out: folder for the results; None: nothing stays on disk.
        resume: go on in `out`; settings must be the same, `runs` may have grown.
        shard: (i, n): only every n-th run, from the i-th; `merge` puts the n folders together.
        jobs: workers at once; None: one per CPU, of this machine or of the cluster.
        backend: "processes" of this machine, or "ray": tasks on a Ray cluster whose machines share the disk of `out`.
        address: of the cluster, "auto" for the one that this machine belongs to; None: Ray is started here.
        chunk: runs in a unit; None: chosen. Changes no number.
        command: recorded with the results.
        progress: called as work goes on.

    Raises:
        ValueError: a wrong name, option or number.
        FileExistsError: `out` holds something and `resume` is not set.
        OSError: nothing can be written to `out`.
    """
    started = time.time()
    wanted = _wanted(runs, shard, chunk)
    settings = dict(overrides or {})
    if noise_inflation is not None:
        settings["filter.noise_inflation"] = noise_inflation
    plan = make_plan(
        [scenarios] if isinstance(scenarios, (str, Path, Scenario)) else scenarios, estimators, policies,
        seed=seed, mode=mode, driver=driver, steps=steps, burn_in=burn_in, tracks=tracks, overrides=settings,
        estimator_options=estimator_options or {}, sweep=sweep, score_map=score_map,
    )  # fmt: skip
    # The folder is opened after all that may be wrong: it stands in the next call's way.
    with workers(jobs, backend, address) as crew, _folder(out, plan, resume) as folder:
        do_work(plan, wanted, folder, replace(crew, own=own_classes(plan)), chunk, progress or _silent)
        seconds = round(time.time() - started, 1)
        how = {"command": command, "runs": runs, "shard": f"{shard[0]}/{shard[1]}", "jobs": crew.jobs}
        results = collect(plan, folder, wanted, {**how, "backend": crew.backend, "seconds": seconds})
        if out is not None:
            results.save()
    return results


def _wanted(runs: int, shard: tuple[int, int], chunk: int | None) -> list[int]:
    """The runs of this shard; ValueError where the numbers make no sense."""
    if runs < 1:
        raise ValueError(f"runs must be at least 1; got {runs}")
    if chunk is not None and chunk < 1:
        raise ValueError(f"chunk must be at least 1; got {chunk}")
    if not 1 <= shard[0] <= shard[1]:
        raise ValueError(f"shard i/n needs 1 <= i <= n; got {shard[0]}/{shard[1]}")
    wanted = [run for run in range(runs) if run % shard[1] == shard[0] - 1]
    if not wanted:
        raise ValueError(
            f"shard {shard[0]}/{shard[1]} holds none of {runs} run(s); make at most as many shards as runs"
        )
    return wanted


@contextmanager
def _folder(out: str | Path | None, plan: Plan, resume: bool) -> Iterator[Path]:
    """Where the parts go: `out`, or a folder that is gone afterwards."""
    if out is not None:
        open_folder(Path(out), plan, resume)
        yield Path(out)
        return
    folder = Path(tempfile.mkdtemp(prefix="slam-gym-"))
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _silent(what: str, done: int, total: int) -> None:
    """Progress that nobody watches."""


# ------------------------------------------------------------------------------------------------------ the tables


def collect(plan: Plan, folder: Path, wanted: Sequence[int], how: Mapping[str, Any]) -> Results:
    """Tables of all finished parts, one estimator in memory at a time."""
    runs, summary, series, tracks, landmarks = [], [], [], [], []
    keep = set(wanted)
    for index, combination in enumerate(plan.combinations):
        target = combination.scenario.models()[2]
        options = {"burn_in": combination.burn_in, "target_dof": len(target.coordinates) if target is not None else 2}
        for e, spec in enumerate(combination.estimators):
            key = (combination.scenario.name, combination.policy.label, spec.label)
            records = read_parts(part_files(folder, index), e, keep)
            table = tables.run_table(key, records, **options)
            runs.append(table)
            summary.append(tables.summary_row(key, records, table, **options))
            series.append(tables.series_table(key, records))
            tracks.append(tables.track_table(key, records))
            landmarks.append(tables.landmark_table(key, records))
    all_runs = pd.concat(runs, ignore_index=True)
    return Results(
        path=folder,
        config={**how, **_provenance(plan)},
        runs=all_runs,
        summary=pd.DataFrame(summary),
        paired=tables.paired_table(all_runs),
        series=pd.concat(series, ignore_index=True),
        tracks=pd.concat(tracks, ignore_index=True),
        landmarks=pd.concat(landmarks, ignore_index=True),
    )


def _provenance(plan: Plan) -> dict[str, Any]:
    first = plan.combinations[0]
    return {
        "seed": plan.seed,
        "mode": plan.mode,
        "driver": first.estimators[first.driver].label if plan.mode == "shared" else "each its own",
        "steps_not_scored": first.burn_in,
        "versions": versions(),
        "settings": plan.to_dict(),
    }


def versions() -> dict[str, str]:
    """What the numbers may depend on."""
    found = {}
    for name in ("slam-gym", "numpy", "numba", "scipy"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:  # run from a source tree
            found[name] = "not installed"
    return found


def merge(folders: Sequence[str | Path], out: str | Path, *, command: str = "") -> Results:
    """Put the shards of one comparison together.

    Args:
        folders: what `compare(..., shard=(i, n), out=...)` wrote, finished or not.
        out: a new folder.
        command: recorded with the results.

    Raises:
        ValueError: settings differ, the same run comes twice, or runs are missing in between.
        FileNotFoundError: a folder holds no parts.
        FileExistsError: `out` is not empty.
    """
    sources, target = [Path(folder) for folder in folders], Path(out)
    if not sources:
        raise ValueError("name at least one folder to merge")
    kept = [kept_settings(source) for source in sources]
    for source, settings in zip(sources[1:], kept[1:], strict=True):
        same_settings(kept[0], settings, str(source))
    if target.exists() and (not target.is_dir() or any(target.iterdir())):
        raise FileExistsError(f"{str(target)!r} is not empty; name a new folder for the merged results")
    plan = plan_from_dict(kept[0])
    done = check_runs(plan, sources)
    write_json(target / "parts" / SETTINGS, kept[0], strict=False)
    for index in range(len(plan.combinations)):
        for source in sources:
            for path in part_files(source, index):
                shutil.copy2(path, ensure_folder(target / "parts" / f"{index:03d}") / path.name)
    results = collect(plan, target, sorted(done), {"command": command, "runs": len(done),
                                                   "merged": [str(source) for source in sources]})  # fmt: skip
    results.save()
    return results
