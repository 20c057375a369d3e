"""The UTIAS Multi-Robot Cooperative Localization and Mapping data sets (MRCLAM), read and written in their own layout.

A folder holds Barcodes.dat, Landmark_Groundtruth.dat and, for each robot N, RobotN_Odometry.dat,
RobotN_Measurement.dat and RobotN_Groundtruth.dat, plain or compressed (.gz). Subjects that are not landmarks are
robots. The second column of Measurement files is titled "Subject #" and holds BARCODE numbers.

Leung, Halpern, Barfoot and Liu, "The UTIAS multi-robot cooperative localization and mapping dataset", International
Journal of Robotics Research 30(8):969-974, 2011.
"""

import gzip
import warnings as python_warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from estimators.interface import TARGET
from slam_gym.recording import Recording

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FILES = {
    # file: (columns, how a row is written, the publisher's title of the columns)
    "Barcodes": (("subject", "barcode"), "%3d \t %3d", "Subject #    Barcode #"),
    "Landmark_Groundtruth": (
        ("subject", "x", "y", "x deviation", "y deviation"),
        "%3d \t %.8f \t %.8f \t %.8f \t %.8f",
        "Subject #    x [m]    y [m]    x std-dev [m]    y std-dev [m]",
    ),
    "Odometry": (
        ("time", "speed", "turn rate"),
        "%.3f \t %.6f \t %.6f",
        "Time [s]    forward velocity [m/s]    angular velocity[rad/s]",
    ),
    "Measurement": (
        ("time", "barcode", "range", "bearing"),
        "%.3f \t %3d \t %.6f \t %.6f",
        "Time [s]    Subject #    range [m]    bearing [rad]",
    ),
    "Groundtruth": (
        ("time", "x", "y", "heading"),
        "%.3f \t %.8f \t %.8f \t %.8f",
        "Time [s]    x [m]    y [m]    orientation [rad]",
    ),
}
SAME_SWEEP = 0.002  # [s]: returns of one image are stamped up to a millisecond apart
UNKNOWN_BARCODES_LIMIT = 0.5  # share of returns; above it the column cannot hold barcodes


def robots(folder: str | Path) -> list[int]:
    """The robots of a data set: subjects with a barcode that are not landmarks.

    Raises:
        FileNotFoundError, ValueError: as `load`.
    """
    root = Path(folder)
    landmarks = set(_read(root, "Landmark_Groundtruth")[:, 0].astype(int))
    return sorted(set(_read(root, "Barcodes")[:, 0].astype(int)) - landmarks)


def pairs(folder: str | Path, robot: int | Literal["all"], target: int | Literal["all"]) -> list[tuple[int, int]]:
    """The (robot, target) that are meant, "all" standing for every robot of the set but the other one.

    Raises:
        FileNotFoundError, ValueError: as `load`.
    """
    if robot != "all" and target != "all":
        return [(robot, target)]
    _need_folder(Path(folder))
    known = robots(folder)
    return [(r, t) for r in (known if robot == "all" else [robot]) for t in (known if target == "all" else [target])
            if r != t]  # fmt: skip


def load(folder: str | Path, robot: int, target: int | None) -> Recording:
    """Robot `robot` does SLAM, robot `target` is the moving target; sightings of other robots are left out, counted.

    Landmarks keep the subject numbers as ids.

    Args:
        folder: of the unpacked data set.
        robot: whose odometry and measurements are read.
        target: None: no target.

    Raises:
        FileNotFoundError: the folder or one of its files is missing.
        ValueError: a file has foreign columns or disordered times, or there is no such robot.
    """
    root = Path(folder)
    _need_folder(root)
    known = robots(root)
    for role, number in (("robot", robot), ("target", target)):
        if number is not None and number not in known:
            raise ValueError(f"no {role} {number} in {root.name}; its robots are {', '.join(map(str, known))}")
    if robot == target:
        raise ValueError(f"robot and target must differ; both are {robot}")
    landmarks = _read(root, "Landmark_Groundtruth")
    counted: dict[str, int] = {}
    measurements = _labelled(
        _read(root, f"Robot{robot}_Measurement"), _read(root, "Barcodes"), landmarks[:, 0], robot, target, counted
    )
    tables = {
        "odometry": _read(root, f"Robot{robot}_Odometry"),
        "measurements": measurements,
        "truth": _read(root, f"Robot{robot}_Groundtruth"),
        "landmarks": landmarks[:, :3],
    }
    sources = {"odometry": f"Robot{robot}_Odometry.dat", "measurements": f"Robot{robot}_Measurement.dat"}
    sources |= {"truth": f"Robot{robot}_Groundtruth.dat", "target": f"Robot{target}_Groundtruth.dat"}
    if target is not None:
        tables["target"] = _read(root, f"Robot{target}_Groundtruth")
    name = f"mrclam robot {robot}" + ("" if target is None else f" target {target}")
    return Recording.from_tables(name, tables, sources, counted)


def _need_folder(root: Path) -> None:
    if not root.is_dir():
        raise FileNotFoundError(f"no folder {str(root)!r}; expected an unpacked MRCLAM data set with Barcodes.dat")


def _labelled(
    rows: Floats, barcodes: Floats, landmarks: Floats, robot: int, target: int | None, counted: dict[str, int]
) -> Floats:
    """Measurement rows with labels in place of barcodes, stamped alike within a sweep."""
    subject_of = {int(code): int(subject) for subject, code in barcodes}
    subjects = np.array([subject_of.get(int(code), 0) for code in rows[:, 1]], dtype=np.int64)
    unknown = subjects == 0
    if unknown.sum() > UNKNOWN_BARCODES_LIMIT * len(rows):
        codes = ", ".join(str(int(code)) for code in np.unique(rows[unknown, 1])[:5])
        raise ValueError(
            f"Robot{robot}_Measurement.dat: {unknown.sum()} of {len(rows)} barcodes are not in Barcodes.dat ({codes}, "
            "...); its second column must hold barcode numbers, not subjects"
        )
    labels = np.where(subjects == target, TARGET, subjects)
    other = ~unknown & (labels != TARGET) & ~np.isin(subjects, landmarks.astype(np.int64))
    for what, which in (("unknown barcodes, left out", unknown), ("sightings of other robots, left out", other)):
        if which.any():
            counted[f"Robot{robot}_Measurement.dat: {what}"] = int(which.sum())
    kept = np.column_stack([rows[:, 0], labels, rows[:, 2:]])[~unknown & ~other]
    kept[:, 0] = _same_times(kept[:, 0])
    return kept


def _same_times(times: Floats) -> Floats:
    """Each time within `SAME_SWEEP` of its sweep's first takes the first's."""
    found = times.copy()
    for i in range(1, len(found)):
        if 0.0 <= found[i] - found[i - 1] <= SAME_SWEEP:
            found[i] = found[i - 1]
    return found


def _read(root: Path, stem: str) -> Floats:
    """One file's rows [n, columns]; lines that begin with # are comments."""
    path = next((p for p in (root / f"{stem}.dat", root / f"{stem}.dat.gz") if p.is_file()), None)
    if path is None:
        raise FileNotFoundError(f"{root} lacks {stem}.dat (plain or .gz); an MRCLAM folder holds one")
    columns = FILES[stem.rsplit("_", maxsplit=1)[-1] if stem.startswith("Robot") else stem][0]
    shown = f"expected {len(columns)} columns of numbers ({', '.join(columns)})"
    try:
        with python_warnings.catch_warnings():
            python_warnings.simplefilter("ignore", UserWarning)  # a file without rows
            rows = np.loadtxt(path, ndmin=2)
    except (ValueError, UnicodeDecodeError, gzip.BadGzipFile, EOFError) as error:
        raise ValueError(f"{path.name}: {shown}; {error}") from error
    if rows.size == 0:
        return np.zeros((0, len(columns)))
    if rows.shape[1] != len(columns):
        raise ValueError(f"{path.name}: {shown}; found {rows.shape[1]}")
    return rows


def save(folder: str | Path, files: Mapping[str, Floats], *, compress: bool = False) -> Path:
    """Write a data set in the publisher's layout.

    Args:
        folder: made if missing.
        files: rows by file name without ending ("Barcodes", "Robot1_Odometry", ...), columns as `FILES`.
        compress: write .dat.gz.

    Returns:
        The folder.
    """
    root = Path(folder)
    root.mkdir(parents=True, exist_ok=True)
    for stem, rows in files.items():
        kind = stem.rsplit("_", maxsplit=1)[-1] if stem.startswith("Robot") else stem
        columns, form, title = FILES[kind]
        table = np.asarray(rows, dtype=np.float64).reshape(-1, len(columns))
        header = f"Simulated by slam-gym in the layout of the UTIAS MRCLAM data sets\n{title}"
        np.savetxt(root / (f"{stem}.dat.gz" if compress else f"{stem}.dat"), table, fmt=form, header=header)
    return root
