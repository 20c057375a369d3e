"""The folder that a comparison works in: whose it is, which runs are done, what the parts hold.

parts/settings.json    everything that changes numbers; resuming and merging demand the same
parts/000/000012.npz   finished runs of the first scenario and policy, from run 12 on; `Records` of each estimator
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from slam_gym.evaluation_plan import Plan
from slam_gym.records import Records
from slam_gym.results import write_json

SETTINGS = "settings.json"


def open_folder(folder: Path, plan: Plan, resume: bool) -> None:
    """Make the folder ours, or see that what lies there belongs to the same comparison."""
    if folder.exists() and not folder.is_dir():
        raise FileExistsError(f"{str(folder)!r} is a file; name a folder with --out")
    occupied = folder.is_dir() and any(folder.iterdir())
    if occupied and not resume:
        raise FileExistsError(
            f"{str(folder)!r} is not empty, and results are never overwritten: "
            "go on there with --resume, name another folder with --out, or remove it"
        )
    settings = folder / "parts" / SETTINGS
    if occupied and settings.is_file():
        kept = json.loads(settings.read_text(encoding="utf-8"))
        same_settings(kept, json.loads(json.dumps(plan.to_dict())), str(folder))
    elif occupied:
        raise FileExistsError(f"{str(folder)!r} holds no comparison that could be resumed; name another --out")
    else:
        write_json(settings, plan.to_dict(), strict=False)
    for stray in (folder / "parts").glob("*/.*"):
        stray.unlink(missing_ok=True)  # a half-written part of a killed process


def same_settings(kept: Any, wanted: Any, where: str) -> None:
    """Raise a ValueError that names the first setting in which two comparisons differ."""
    difference = _difference(kept, wanted, "")
    if difference:
        raise ValueError(
            f"the results in {where!r} were made with other settings: {difference}. "
            "Repeat the settings, or name another folder with --out"
        )


def _difference(kept: Any, wanted: Any, name: str) -> str:
    """The first place where two JSON values differ, in words; empty if none."""
    if isinstance(kept, dict) and isinstance(wanted, dict):
        for key in dict.fromkeys([*kept, *wanted]):
            if found := _difference(kept.get(key), wanted.get(key), f"{name}.{key}".lstrip(".")):
                return found
        return ""
    if isinstance(kept, list) and isinstance(wanted, list) and len(kept) == len(wanted):
        pairs = enumerate(zip(kept, wanted, strict=True))
        return next((found for i, (a, b) in pairs if (found := _difference(a, b, f"{name}[{i}]"))), "")
    return "" if kept == wanted else f"{name} was {_brief(kept)}, now {_brief(wanted)}"


def _brief(value: Any) -> str:
    if isinstance(value, list) and value and all(isinstance(v, dict) and "label" in v for v in value):
        return ", ".join(v["label"] for v in value)
    text = str(value)
    return text if len(text) <= 80 else f"{text[:77]}..."


def part_files(folder: Path, combination: int) -> list[Path]:
    """Finished parts of one scenario and policy."""
    return sorted((folder / "parts" / f"{combination:03d}").glob("[0-9]*.npz"))


def finished_runs(folder: Path, combination: int) -> set[int]:
    """Indices of the runs in those parts."""
    done: set[int] = set()
    for path in part_files(folder, combination):
        with np.load(path) as arrays:
            done.update(int(run) for run in arrays["0/run"])
    return done


def read_parts(files: Sequence[Path], estimator: int, keep: set[int]) -> Records:
    """One estimator's records of the runs to keep, in order.

    Raises:
        ValueError: a run stands in two of the files; it would count twice.
    """
    parts = []
    for path in files:
        with np.load(path) as arrays:
            parts.append(Records.from_arrays(arrays, str(estimator)))
    records = Records.join(parts)
    twice = records.run[1:][np.diff(records.run) == 0]
    if twice.size:
        raise ValueError(
            f"run {twice[0]} comes twice in {str(files[0].parent)!r}: have two comparisons worked in that folder at "
            "once, or were parts copied into it? Remove one of the parts that hold it, then go on with --resume"
        )
    return records.select(keep)


def ensure_folder(folder: Path) -> Path:
    """The folder, made if need be."""
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def kept_settings(folder: Path) -> Any:
    """What a comparison's folder was made with."""
    path = folder / "parts" / SETTINGS
    if not path.is_file():
        raise FileNotFoundError(f"{str(folder)!r} holds no parts of a comparison (no {path}); nothing to merge")
    return json.loads(path.read_text(encoding="utf-8"))


def check_runs(plan: Plan, sources: Sequence[Path]) -> set[int]:
    """The runs in all sources together: each once, none missing, the same for every combination."""
    found: set[int] = set()
    for index, combination in enumerate(plan.combinations):
        done: set[int] = set()
        for source in sources:
            part = finished_runs(source, index)
            if twice := done & part:
                raise ValueError(f"run {min(twice)} of {combination.name} comes twice, the second time in {source}")
            done |= part
        if index and done != found:
            raise ValueError(f"{combination.name} has other runs than {plan.combinations[0].name}; finish the shards")
        found = done
    missing = sorted(set(range(max(found, default=0) + 1)) - found)
    if missing:
        raise ValueError(f"run(s) {', '.join(map(str, missing[:10]))} are missing; name every shard, and finish each")
    return found
