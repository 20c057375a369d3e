"""Run experiments one after the other and keep what each found; a killed run finds what is done.

OUT/NAME/result.json    what one experiment found: texts only, the verdict computed from its claims
OUT/NAME/figures/*.png
OUT/NAME/work           finished measurements, removed with the last one
OUT/results.json        all of them together
OUT/report.html
"""

import json
import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from slam_gym.evaluation import versions
from slam_gym.report import save_png
from slam_gym.reproduce import catalogue
from slam_gym.reproduce.experiment import Experiment, Outcome
from slam_gym.reproduce.study import Study
from slam_gym.reproduce.verdict import verdict
from slam_gym.results import write_json

RESULT, RESULTS = "result.json", "results.json"
Report = Callable[[dict[str, Any]], None]


def run_all(
    names: Sequence[str], study: Study, *, resume: bool = False, report: Report | None = None
) -> dict[str, Any]:
    """Run experiments in `study.folder` and put their results together.

    Args:
        names: of experiments; checked before any work starts.
        study: its folder holds one folder per experiment.
        resume: go on in a folder that holds something.
        report: called with each result as it comes.

    Returns:
        What OUT/results.json holds.

    Raises:
        ValueError: no such experiment.
        FileExistsError: the folder holds something and `resume` is not set.
    """
    experiments = [catalogue.get(name) for name in names]
    if not resume and study.folder.exists() and (not study.folder.is_dir() or any(study.folder.iterdir())):
        raise FileExistsError(
            f"{str(study.folder)!r} is not empty, and results are never overwritten: go on there with --resume, name "
            "another folder with --out, or remove it"
        )
    found = []
    for i, experiment in enumerate(experiments):
        found.append(run_one(experiment, _named(study, experiment.name, i, len(experiments))))
        if report is not None:
            report(found[-1])
    results = {"versions": versions(), "experiments": found}
    write_json(study.folder / RESULTS, results)
    return results


def _named(study: Study, name: str, index: int, number: int) -> Study:
    """The experiment's own folder, and progress that says which of how many it is."""
    before = study.progress

    def progress(what: str, done: int, total: int) -> None:
        before(f"{index + 1}/{number} {name}: {what}", done, total)

    return replace(study, folder=study.folder / name, progress=progress)


def run_one(experiment: Experiment, study: Study) -> dict[str, Any]:
    """One experiment's result, found or made."""
    path = study.folder / RESULT
    settings = {
        "quick": study.quick, "most_runs": study.most_runs, "batches": study.batches,
        "webmap": study.webmap is not None,
        "mrclam": study.mrclam is not None,
    }  # fmt: skip
    if path.is_file() and (kept := _read(path))["settings"] == settings:
        return kept
    started = time.perf_counter()
    outcome = experiment.run(study)
    result = as_json(experiment, outcome, study.folder) | {
        "settings": settings, "seconds": round(time.perf_counter() - started, 1),
    }  # fmt: skip
    write_json(path, result)
    shutil.rmtree(study.folder / "work", ignore_errors=True)
    return _read(path)


def _read(path: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


def as_json(experiment: Experiment, outcome: Outcome, folder: Path) -> dict[str, Any]:
    """Texts of an outcome, its figures drawn into files."""
    figures = []
    for drawing in outcome.drawings:
        name = f"{experiment.name}-{drawing.name}.png"
        save_png(drawing.figure, folder / "figures" / name)
        figures.append({"file": name, "caption": drawing.caption})
    return {
        "name": experiment.name,
        "paper": experiment.paper,
        "source": experiment.source,
        "summary": experiment.summary,
        "verdict": verdict(outcome.claims),
        "missing": outcome.missing,
        "claims": [asdict(claim) for claim in outcome.claims],
        "choices": [asdict(choice) for choice in outcome.choices],
        "grids": [asdict(grid) for grid in outcome.grids],
        "remarks": list(outcome.remarks),
        "figures": figures,
    }


def load(folder: Path) -> dict[str, Any]:
    """What `run_all` left in a folder.

    Raises:
        FileNotFoundError: nothing.
    """
    path = folder / RESULTS
    if not path.is_file():
        raise FileNotFoundError(
            f"{str(folder)!r} holds no reproduction; `slam-gym reproduce all --out {folder}` makes one"
        )
    return _read(path)
