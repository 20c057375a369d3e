"""One robot's recording in memory: what it was commanded, what it sensed, and where everything truly was.

`slam_gym.mrclam` reads it from the MRCLAM data sets, `slam_gym.log_format` from plain CSV or NPZ files, and
`slam_gym.replay` passes it through the estimators. Every reader goes through `Recording.from_tables`, which checks.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimators.interface import TARGET, UNKNOWN

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

VELOCITY_WINDOW = 0.5  # [s], half the span over which a recorded track's velocity is taken
LARGEST_GAP = 1.0  # [s], truth is not interpolated across a longer silence
DISORDER_LIMIT = 0.01  # share of rows out of order that are sorted and counted; more is an error
TURNED_LIMIT = 0.1  # share of bearings beyond a whole turn that are dropped as stray; more are no radians
SLOW_COMMANDS = 10.0  # [s] apart, which no robot's are that were logged in seconds

COLUMNS = {
    "odometry": ("time", "speed", "turn_rate"),
    "measurements": ("time", "label", "range", "bearing"),
    "sweeps": ("time",),
    "truth": ("time", "x", "y", "heading"),
    "target": ("time", "x", "y", "heading"),
    "landmarks": ("id", "x", "y"),
}
"""The tables of a recording and their columns: seconds, metres, radians (left positive), m/s, rad/s."""
REQUIRED = ("odometry", "measurements")


def wrap(angle: Floats) -> Floats:
    """Angles in [-pi, pi)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def _unwrapped(heading: Floats) -> Floats:
    """Headings without jumps; those that were not recorded stay NaN and touch no other."""
    found, there = heading.copy(), ~np.isnan(heading)
    found[there] = np.unwrap(heading[there])
    return found


@dataclass(frozen=True, slots=True)
class Track:
    """A recorded path.

    Attributes:
        times: [T] seconds, increasing.
        poses: [T, 3] x, y [m] and heading [rad]; a heading that was not recorded is NaN.
    """

    times: Floats
    poses: Floats

    def at(self, times: ArrayLike) -> Floats:
        """Poses [n, 3] at the times [n], headings along the shorter arc; NaN outside the track and in long gaps."""
        when = np.asarray(times, dtype=np.float64)
        columns = (self.poses[:, 0], self.poses[:, 1], _unwrapped(self.poses[:, 2]))
        found = np.stack([np.interp(when, self.times, column, np.nan, np.nan) for column in columns], axis=-1)
        found[:, 2] = wrap(found[:, 2])
        right = np.clip(np.searchsorted(self.times, when), 1, max(len(self.times) - 1, 1))
        if len(self.times) > 1:
            found[self.times[right] - self.times[right - 1] > LARGEST_GAP] = np.nan
        return found

    def velocity_at(self, times: ArrayLike) -> Floats:
        """World velocity [n, 2] as the mean over `VELOCITY_WINDOW` to either side (cut at the track's ends)."""
        when = np.asarray(times, dtype=np.float64)
        before = np.maximum(when - VELOCITY_WINDOW, self.times[0])
        after = np.minimum(when + VELOCITY_WINDOW, self.times[-1])
        span = np.where(after > before, after - before, np.nan)
        return np.asarray((self.at(after)[:, :2] - self.at(before)[:, :2]) / span[:, None])


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """What one robot did and saw. Times in seconds since `time_origin`.

    Attributes:
        name: for tables and figures.
        command_times: [C] increasing; each command holds until the next.
        commands: [C, 2] speed [m/s], turn rate [rad/s], as the robot reports them.
        sweep_times: [S] increasing.
        sweep_first: [S + 1] the returns of sweep k are sweep_first[k] to sweep_first[k + 1] - 1.
        ranges, bearings, labels: [Z] metres; radians, left positive; a landmark's id (>= 0), TARGET or UNKNOWN.
        complete: whether sweeps without a return are recorded too, so that a missing return is evidence.
        truth, target: the recorded paths; None where there is none.
        landmark_ids, landmarks: [N], [N, 2] the surveyed landmarks; empty where they are not known.
        warnings: what was odd in the files, with the number of rows concerned.
        time_origin: [s] of the files' clock.
    """

    name: str
    command_times: Floats
    commands: Floats
    sweep_times: Floats
    sweep_first: Ints
    ranges: Floats
    bearings: Floats
    labels: Ints
    complete: bool = False
    truth: Track | None = None
    target: Track | None = None
    landmark_ids: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    landmarks: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    warnings: dict[str, int] = field(default_factory=dict)
    time_origin: float = 0.0

    @classmethod
    def from_tables(
        cls,
        name: str,
        tables: Mapping[str, ArrayLike],
        sources: Mapping[str, str] | None = None,
        warnings: Mapping[str, int] | None = None,
    ) -> Self:
        """Check and assemble.

        Args:
            name: for tables and figures.
            tables: by the names of `COLUMNS`, rows of numbers in that order; odometry and measurements are needed.
                "target" and "truth" may lack the heading; labels are `TARGET` (-2), `UNKNOWN` (-1) or an id.
            sources: what each table is called in messages (a file's name).
            warnings: counts to add to.

        Raises:
            ValueError: a table is missing, has the wrong columns, numbers that are not finite, bearings that are no
                radians, or times that run backwards in more than a few rows.
        """
        sources = sources or {}
        counted = dict(warnings or {})
        for table in REQUIRED:
            if table not in tables:
                raise ValueError(f"a recording needs the tables {' and '.join(REQUIRED)}; {table} is missing")
        checked: dict[str, Floats] = {}
        for table, rows in tables.items():
            if table not in COLUMNS:
                raise ValueError(f"unknown table {table!r}; a recording has {', '.join(COLUMNS)}")
            where = sources.get(table, table)
            checked[table] = _numbers(table, rows, where)
            if "time" in COLUMNS[table]:
                once = table != "measurements"
                checked[table] = _in_order(checked[table], where, counted, once=once)
        odometry = checked["odometry"]
        if len(odometry) == 0:
            raise ValueError(f"{sources.get('odometry', 'odometry')} holds no commands; at least one row is needed")
        if len(odometry) > 1 and np.median(np.diff(odometry[:, 0])) > SLOW_COMMANDS:
            where = sources.get("odometry", "odometry")
            counted[f"{where}: rows over {SLOW_COMMANDS:g} s apart (times are in seconds)"] = len(odometry) - 1
        measurements = _plausible(checked["measurements"], sources.get("measurements", "measurements"), counted)
        origin = float(min([odometry[0, 0], *measurements[:1, 0]]))
        sweep_times = np.unique(np.concatenate([measurements[:, 0], checked.get("sweeps", np.zeros((0, 1)))[:, 0]]))
        landmarks = checked.get("landmarks", np.zeros((0, 3)))
        return cls(
            name=name,
            command_times=odometry[:, 0] - origin,
            commands=odometry[:, 1:],
            sweep_times=sweep_times - origin,
            sweep_first=np.searchsorted(measurements[:, 0], np.append(sweep_times, np.inf)),
            ranges=measurements[:, 2],
            bearings=wrap(measurements[:, 3]),
            labels=measurements[:, 1].astype(np.int64),
            complete="sweeps" in checked,
            truth=_track(checked.get("truth"), origin),
            target=_track(checked.get("target"), origin),
            landmark_ids=landmarks[:, 0].astype(np.int64),
            landmarks=landmarks[:, 1:],
            warnings=counted,
            time_origin=origin,
        )

    @property
    def widest_sweep(self) -> int:
        """Most returns in one sweep; at least 1."""
        return int(max(1, np.diff(self.sweep_first).max(initial=1)))

    def distance_and_turn(self, times: ArrayLike, delay: float = 0.0) -> Floats:
        """Integrals [n, 2] of the held commands up to each time [n]: distance [m], angle turned [rad].

        Before the first command the robot stands. A command acts `delay` seconds after its time.
        """
        steps = np.diff(self.command_times)[:, None] * self.commands[:-1]
        total = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
        when = np.asarray(times, dtype=np.float64) - delay
        held = np.searchsorted(self.command_times, when, side="right") - 1
        since = when - self.command_times[np.maximum(held, 0)]
        return np.asarray(np.where(held[:, None] < 0, 0.0, total[held] + since[:, None] * self.commands[held]))


def _numbers(table: str, rows: ArrayLike, where: str) -> Floats:
    """The table as [n, columns] finite numbers; a missing heading becomes NaN."""
    columns = COLUMNS[table]
    values = np.asarray(rows, dtype=np.float64)
    if values.size == 0:
        return np.zeros((0, len(columns)))
    values = values.reshape(-1, 1) if values.ndim == 1 and len(columns) == 1 else values
    if table == "target" and values.ndim == 2 and values.shape[1] == 3:
        values = np.column_stack([values, np.full(len(values), np.nan)])
    if values.ndim != 2 or values.shape[1] != len(columns):
        found = values.shape[1] if values.ndim == 2 else f"an array of shape {values.shape}"
        raise ValueError(f"{where}: expected {len(columns)} columns ({', '.join(columns)}); found {found}")
    needed = values[:, :3] if table == "target" else values
    bad = np.flatnonzero(~np.isfinite(needed).all(axis=1))
    if len(bad):
        raise ValueError(f"{where}: row {bad[0] + 1} holds a number that is not finite: {_shown(values[bad[0]])}")
    return values


def _shown(row: Sequence[float] | Floats) -> str:
    return " ".join(f"{value:.12g}" for value in row)


def _in_order(rows: Floats, where: str, counted: dict[str, int], *, once: bool) -> Floats:
    """Rows by increasing time; a few stray ones are sorted in and counted. `once`: of equal times the last stays."""
    backwards = np.flatnonzero(np.diff(rows[:, 0]) < 0.0)
    if len(backwards) > DISORDER_LIMIT * len(rows):
        first = backwards[0]
        raise ValueError(
            f"{where}: times must not run backwards; row {first + 2} is at {rows[first + 1, 0]:.12g} s after "
            f"{rows[first, 0]:.12g} s, and so are {len(backwards)} rows. Sort the rows by time."
        )
    if len(backwards):
        counted[f"{where}: rows out of order, sorted"] = len(backwards)
        rows = rows[np.argsort(rows[:, 0], kind="stable")]
    if once and len(rows):
        last = np.append(np.diff(rows[:, 0]) > 0.0, True)
        if not last.all():
            counted[f"{where}: rows at the same time, the last kept"] = int((~last).sum())
            rows = rows[last]
    return rows


def _plausible(measurements: Floats, where: str, counted: dict[str, int]) -> Floats:
    """Without returns that no sensor gives, and with at most one return of each label in a sweep."""
    labels, turned = measurements[:, 1], np.abs(measurements[:, 3]) > 2.0 * np.pi
    if turned.sum() > TURNED_LIMIT * len(turned):
        raise ValueError(
            f"{where}: bearings are in radians, left positive; {int(turned.sum())} of {len(turned)} lie beyond a whole "
            f"turn, the largest at {np.abs(measurements[:, 3]).max():.4g}. Degrees?"
        )
    good = (measurements[:, 2] > 0.0) & ~turned
    good &= (labels == np.round(labels)) & (labels >= TARGET)
    if not good.all():
        counted["returns with an impossible range, bearing or label, dropped"] = int((~good).sum())
    kept = measurements[good]
    key = np.column_stack([kept[:, 0], kept[:, 1]])
    first = np.zeros(len(kept), dtype=bool)
    first[np.unique(key, axis=0, return_index=True)[1]] = True
    first |= kept[:, 1] == UNKNOWN
    if not first.all():
        counted["returns with the same label in one sweep, the first kept"] = int((~first).sum())
    return kept[first]


def _track(rows: Floats | None, origin: float) -> Track | None:
    return None if rows is None or len(rows) == 0 else Track(rows[:, 0] - origin, rows[:, 1:])
