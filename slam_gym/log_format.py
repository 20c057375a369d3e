"""A plain format for the recordings of users' own robots: a folder of CSV files, or one NPZ file.

Folder: one CSV file per table, with a line of column names first; the order of the columns is free.

| file             | columns                         | needed |                                                        |
|------------------|---------------------------------|--------|--------------------------------------------------------|
| odometry.csv     | time, speed, turn_rate          | yes    | s, m/s, rad/s; each row holds until the next           |
| measurements.csv | time, label, range, bearing     | yes    | s, -, m, rad (left positive); one time: one sweep |
| sweeps.csv       | time                            | no     | s of ALL sweeps, those without a return too            |
| truth.csv        | time, x, y, heading             | no     | s, m, m, rad: where the robot was                      |
| target.csv       | time, x, y and perhaps heading  | no     | where the target was                                   |
| landmarks.csv    | id, x, y                        | no     | the surveyed landmarks                                 |

A label is a landmark's id (0, 1, 2, ...), `target`, or `unknown`. With sweeps.csv a missing return counts as evidence.
Without truth.csv the replay starts at the origin and nothing is scored.
A car-like robot's turn_rate is its steering angle [rad]: replay such a log with its scenario, whose model takes it so.

NPZ: arrays of the same names without ".csv", columns in the order above; in labels -2 is the target, -1 unknown.
"""

import csv
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from estimators.interface import TARGET, UNKNOWN
from slam_gym.recording import COLUMNS, REQUIRED, Recording, Track

Floats = NDArray[np.float64]

WORDS = {"target": TARGET, "unknown": UNKNOWN}
OPTIONAL = {("target", "heading")}


def load(path: str | Path) -> Recording:
    """Read a folder of CSV files or an .npz file.

    Raises:
        FileNotFoundError: it is not there, or a needed table is missing.
        ValueError: foreign columns, values that are not numbers, disordered times.
    """
    source = Path(path)
    if source.is_dir():
        files = {table: source / f"{table}.csv" for table in COLUMNS}
        missing = [files[table].name for table in REQUIRED if not files[table].is_file()]
        if missing:
            raise FileNotFoundError(f"{source} lacks {' and '.join(missing)}; a log folder holds {_contents()}")
        tables = {table: _read_csv(table, file) for table, file in files.items() if file.is_file()}
        return Recording.from_tables(source.name, tables, {table: f"{table}.csv" for table in tables})
    if not source.is_file():
        raise FileNotFoundError(f"no log {str(source)!r}; expected a folder with {_contents()}, or an .npz file")
    try:
        with np.load(source, allow_pickle=False) as arrays:
            found = {name: arrays[name] for name in arrays.files}
    except (ValueError, BadZipFile, AttributeError) as error:
        raise ValueError(
            f"{source.name} is no NPZ file of plain arrays {', '.join(COLUMNS)}; CSV files stand in a folder, which is "
            f"what to name, with {_contents()}"
        ) from error
    return Recording.from_tables(source.stem, found, {table: f"{source.name}: {table}" for table in found})


def _contents() -> str:
    needed = " and ".join(f"{table}.csv" for table in REQUIRED)
    return f"{needed}, and perhaps {', '.join(f'{t}.csv' for t in COLUMNS if t not in REQUIRED)}"


def _read_csv(table: str, path: Path) -> Floats:
    """One file's rows [n, columns] in the order of `COLUMNS`."""
    expected = COLUMNS[table]
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = [row for row in csv.reader(file, skipinitialspace=True) if row and not row[0].startswith("#")]
    header = [name.strip() for name in rows[0]] if rows else []
    wanted = [name for name in expected if name in header or (table, name) not in OPTIONAL]
    if sorted(header) != sorted(wanted):
        found = ", ".join(header) or "nothing"
        commas = " (columns are separated by commas)" if len(header) == 1 and ";" in header[0] else ""
        raise ValueError(
            f"{path.name}: expected a first line with the columns {', '.join(expected)}; found {found}{commas}"
        )
    order = [header.index(name) for name in wanted]
    labels = f", or as a label {' or '.join(map(repr, WORDS))}" if "label" in header else ""
    values = np.empty((len(rows) - 1, len(wanted)))
    for i, row in enumerate(rows[1:]):
        try:
            values[i] = [_number(row[k]) for k in order]
        except (ValueError, IndexError) as error:
            raise ValueError(
                f"{path.name}: row {i + 1} must hold {len(header)} numbers ({', '.join(header)}){labels}; "
                f"got {', '.join(row)}"
            ) from error
    return values


def _number(text: str) -> float:
    word = text.strip()
    return float(WORDS[word]) if word in WORDS else float(word)


def tables_of(recording: Recording) -> dict[str, Any]:
    """A recording as tables, on its own clock (the inverse of `Recording.from_tables`)."""
    per_sweep = np.diff(recording.sweep_first)
    when = np.repeat(recording.sweep_times, per_sweep)
    tables: dict[str, Floats] = {
        "odometry": np.column_stack([recording.command_times, recording.commands]),
        "measurements": np.column_stack([when, recording.labels, recording.ranges, recording.bearings]),
        "landmarks": np.column_stack([recording.landmark_ids, recording.landmarks]),
    }
    if recording.complete:
        tables["sweeps"] = recording.sweep_times[:, None].copy()
    for table, track in (("truth", recording.truth), ("target", recording.target)):
        if track is not None:
            tables[table] = _rows(track)
    for table, rows in tables.items():
        if COLUMNS[table][0] == "time":
            rows[:, 0] += recording.time_origin
    return tables


def _rows(track: Track) -> Floats:
    poses = track.poses[:, :2] if np.isnan(track.poses[:, 2]).all() else track.poses
    return np.column_stack([track.times, poses])


def save(path: str | Path, recording: Recording) -> Path:
    """Write a recording as an .npz file (if `path` ends so) or as a folder of CSV files; returns the path."""
    target = Path(path)
    tables = tables_of(recording)
    if target.suffix == ".npz":
        target.parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(target, **tables)
        return target
    target.mkdir(parents=True, exist_ok=True)
    names = {code: word for word, code in WORDS.items()}
    for table, rows in tables.items():
        with (target / f"{table}.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            columns = COLUMNS[table][: rows.shape[1]]
            writer.writerow(columns)
            whole = [name in ("label", "id") for name in columns]
            for row in rows.tolist():
                shown = [int(value) if is_whole else repr(value) for value, is_whole in zip(row, whole, strict=True)]
                if table == "measurements":
                    shown[1] = names.get(int(row[1]), shown[1])
                writer.writerow(shown)
    return target
