"""A folder of results: tidy tables as Parquet and CSV, trajectories in TUM format, and how they were made.

config.json         command, versions, seeds, settings
runs, summary       .parquet and .csv: one row per run; one per scenario, policy and estimator
paired.csv          differences run by run with 95 % intervals
gaps.csv            where pursuit and an oracle drove: how much of the gap between them each policy closes
series.parquet      means over runs at each step
tracks, landmarks   .parquet: truth and belief along the first run, and its map at the end
trajectories/*.tum  the same tracks, "time x y z qx qy qz qw", for evo and other tools
figures/, report.html
parts/              finished pieces of work, what --resume and merge read
"""

import json
import math
import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from slam_gym.gaps import gap_table

PARQUET = ("runs", "summary", "series", "tracks", "landmarks")
CSV = ("runs", "summary", "paired", "gaps")
CONFIG = "config.json"


@dataclass(slots=True)
class Results:
    """The tables of a comparison or a replay; see the module's docstring and `slam_gym.tables`."""

    path: Path
    config: dict[str, Any]
    runs: pd.DataFrame
    summary: pd.DataFrame
    paired: pd.DataFrame
    series: pd.DataFrame
    tracks: pd.DataFrame
    landmarks: pd.DataFrame
    warnings: list[str] = field(default_factory=list)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a folder that `save` wrote.

        Raises:
            FileNotFoundError: the folder, or one of its tables, is missing.
        """
        folder = Path(path)
        if not folder.is_dir():
            raise FileNotFoundError(f"no results folder {str(folder)!r}; `slam-gym compare --out {folder}` makes one")
        missing = [name for name in (CONFIG, *(f"{n}.parquet" for n in PARQUET), "paired.csv")
                   if not (folder / name).is_file()]  # fmt: skip
        if missing:
            raise FileNotFoundError(
                f"{str(folder)!r} holds no finished results ({', '.join(missing)} missing); "
                "if a comparison was interrupted there, repeat its command with --resume"
            )
        config = json.loads((folder / CONFIG).read_text(encoding="utf-8"))
        tables: dict[str, Any] = {name: pd.read_parquet(folder / f"{name}.parquet") for name in PARQUET}
        return cls(path=folder, config=config, paired=pd.read_csv(folder / "paired.csv"), **tables)

    @property
    def gaps(self) -> pd.DataFrame:
        """See `slam_gym.gaps.gap_table`; empty unless pursuit and an oracle are among the policies."""
        return gap_table(self.runs)

    def save(self) -> None:
        """Write every table and trajectory into `path`; each file appears whole or not at all."""
        self.path.mkdir(parents=True, exist_ok=True)
        write_json(self.path / CONFIG, self.config)
        for name in PARQUET:
            write_atomic(self.path / f"{name}.parquet", getattr(self, name).to_parquet)
        for name in CSV:
            table = getattr(self, name)
            if len(table) or name != "gaps":
                write_atomic(self.path / f"{name}.csv", partial(table.to_csv, index=False))
        self._save_trajectories()

    def _save_trajectories(self) -> None:
        folder = self.path / "trajectories"
        folder.mkdir(exist_ok=True)
        for (scenario, policy, estimator, run), track in self.tracks.groupby(
            ["scenario", "policy", "estimator", "run"], sort=False
        ):
            stem = file_stem(scenario, policy, f"run {run:04}", estimator)
            for suffix, columns in _TRAJECTORIES.items():
                poses = track[["time", *columns]].replace([np.inf, -np.inf], np.nan).dropna()
                if len(poses):
                    write_atomic(folder / f"{stem}{suffix}.tum", partial(_write_tum, poses.to_numpy()))


_TRAJECTORIES = {
    "": ("x", "y", "heading"),
    "-truth": ("true_x", "true_y", "true_heading"),
    "-target": ("target_x", "target_y"),
    "-target-truth": ("target_true_x", "target_true_y"),
}


def _write_tum(poses: NDArray[np.float64], file: Path) -> None:
    """Poses [n, 3 or 4]: time [s], x, y [m] and perhaps the heading [rad] (a quaternion about z; else none)."""
    heading = poses[:, 3] if poses.shape[1] > 3 else np.zeros(len(poses))
    zero = np.zeros(len(poses))
    table = [*poses[:, :3].T, zero, zero, zero, np.sin(0.5 * heading), np.cos(0.5 * heading)]
    np.savetxt(file, np.column_stack(table), fmt=["%.6f"] + ["%.9g"] * 7)


def file_stem(*words: Any) -> str:
    """A file name of letters, digits, dots and dashes."""
    text = "-".join(str(word) for word in words)
    return "-".join("".join(c if c.isalnum() or c in "._=" else " " for c in text).split())


def write_json(path: Path, data: dict[str, Any], *, strict: bool = True) -> None:
    """Write JSON whole or not at all; strict: numbers that are not finite as strings, as the standard wants."""
    text = json.dumps(_plain(data) if strict else data, indent=2, allow_nan=not strict) + "\n"
    write_atomic(path, lambda file: file.write_text(text, encoding="utf-8"))


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value


def write_atomic(path: Path, write: Callable[[Path], Any]) -> None:
    """Let `write` fill a temporary file beside `path`, then rename it: a kill leaves the old file or the new one.

    Raises:
        OSError: nothing can be written there; the message says what and why.
    """
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}-", suffix=path.suffix)
        temporary = Path(name)
        os.close(handle)
        write(temporary)
        temporary.chmod(0o644)
        temporary.replace(path)
    except OSError as error:
        reason = error.strerror or str(error)
        raise OSError(
            error.errno, f"cannot write {str(path)!r}: {reason}. What was written before is kept; make room or choose "
            "another --out, then repeat the command with --resume"
        ) from error  # fmt: skip
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
