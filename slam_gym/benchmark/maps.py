"""A particle filter's update: what a return costs per particle, and what the size of the map costs."""

from collections.abc import Iterator, Sequence
from itertools import islice
from time import perf_counter
from typing import Any

import numpy as np

from estimators.interface import Estimator, Scan
from estimators.models import MotionModel, SensorModel
from estimators.registry import make
from slam_gym.benchmark.drives import YARDSTICK
from slam_gym.benchmark.floors import dsyrk_work
from slam_gym.benchmark.timing import least_seconds

PARTICLES = 200
FEW, MANY = 10, 30  # returns of the sweeps whose difference is the price of one
MOTION = MotionModel(speed_std=0.3, turn_std=0.1)
SENSOR = SensorModel(max_range=6.0, range_std=0.1, bearing_std=0.02)
CONTROL = np.array([[1.0, 0.0]])
SEEN, SETTLED, SLICE = 10, 1500, 50
QUIET = 0.1  # of the steps are faster than what is said


def return_rows(names: Sequence[str], rounds: int = 20) -> list[dict[str, Any]]:
    """Rows (name, microseconds of an update by ten returns, nanoseconds per further return and particle, times_dsyrk).

    times_dsyrk: of a further return in all particles.
    """
    rng = np.random.default_rng(0)
    returns = np.column_stack([rng.uniform(2.0, 6.0, MANY), rng.uniform(-1.2, 1.2, MANY)])
    works: dict[str, Any] = {"yardstick": dsyrk_work(*YARDSTICK)}
    for name in names:
        for count in (FEW, MANY):
            works[f"{name} {count}"] = _update_work(name, returns[:count])
    seconds = least_seconds(works, rounds=rounds)
    rows = []
    for name in names:
        few, many = seconds[f"{name} {FEW}"], seconds[f"{name} {MANY}"]
        one = (many - few) / (MANY - FEW)
        rows.append({"name": name, "microseconds": 1e6 * few, "nanoseconds": 1e9 * one / PARTICLES,
                     "times_dsyrk": one / seconds["yardstick"]})  # fmt: skip
    return rows


def _update_work(name: str, returns: np.ndarray[Any, np.dtype[np.float64]]) -> Any:
    """An update by the same sweep again and again: the map is known, the arithmetic is the same."""
    scan = Scan.empty(1, len(returns))
    scan.count[:], scan.labels[0] = len(returns), np.arange(len(returns))
    scan.ranges[0], scan.bearings[0] = returns.T
    estimator = make(name, MotionModel(), SensorModel(), None, max_landmarks=MANY + 10, particles=PARTICLES)
    estimator.update(scan)
    return lambda: estimator.update(scan)


def sweeps(landmarks: int, count: int, seed: int = 0) -> Iterator[Scan]:
    """A robot along the x axis past a line of landmarks, ten seen after each step."""
    rng, scan = np.random.default_rng(seed), Scan.empty(1, SEEN)
    for step in range(count):
        first = (step // 2) % (landmarks - SEEN)
        ids = np.arange(first, first + SEEN)
        away = np.column_stack([0.2 * ids - 0.1 * (2 * first) - 1.0, np.where(ids % 2, 2.0, -2.0)])
        scan.ranges[0] = np.hypot(*away.T) + 0.1 * rng.standard_normal(SEEN)
        scan.bearings[0] = np.arctan2(away[:, 1], away[:, 0]) + 0.02 * rng.standard_normal(SEEN)
        scan.labels[0], scan.count[0] = ids, SEEN
        yield scan


def map_rows(
    cases: Sequence[tuple[str, int]], settled: int = SETTLED, slice_steps: int = SLICE
) -> list[dict[str, Any]]:
    """Rows of (storage, landmarks): microseconds per update and resampling, the latter's share, times dsyrk, MB.

    The cases take turns of `slice_steps` steps, `settled` each once their maps are full, a resampling in each. A tenth
    of a case's steps are faster than what is said. In turn they all meet the same loads: ratios between them hold.
    megabytes: set aside for the maps; used: of them, in use.
    """
    drives = [_MapDrive(storage, landmarks, settled) for storage, landmarks in cases]
    unit_work = dsyrk_work(*YARDSTICK)
    units: list[float] = []
    for _ in range(0, settled, slice_steps):
        for drive in drives:
            drive.advance(slice_steps)
        for _ in range(slice_steps):
            began = perf_counter()
            unit_work()
            units.append(perf_counter() - began)
    unit = float(np.quantile(units, QUIET))
    return [drive.row(unit) for drive in drives]


class _MapDrive:
    """A filter whose map is full, driven on for some timed steps now and then."""

    def __init__(self, storage: str, landmarks: int, settled: int) -> None:
        self.storage, self.landmarks = storage, landmarks
        self.estimator: Any = make(
            "slamto", MOTION, SENSOR, None, max_landmarks=landmarks, particles=PARTICLES, resample_threshold=1.0,
            map_storage=storage,
        )  # fmt: skip
        self.scans = sweeps(landmarks, 2 * landmarks + settled)
        self.seconds: list[float] = []
        self.resampling: list[float] = []
        self.advance(2 * landmarks)
        self.seconds.clear()
        self.resampling.clear()

    def advance(self, steps: int) -> None:
        """Predict, update and resample, and note the times of the last two."""
        for scan in islice(self.scans, steps):
            self.estimator.predict(CONTROL, 0.1)
            began = perf_counter()
            self.estimator.update(scan)
            updated = perf_counter()
            self.estimator._resample(self.estimator.all_lanes)
            moved = perf_counter()
            self.resampling.append(moved - updated)
            self.seconds.append(moved - began)

    def row(self, unit: float) -> dict[str, Any]:
        """What the steps took, and in units of `unit` seconds."""
        second, share = (float(np.quantile(times, QUIET)) for times in (self.seconds, self.resampling))
        return {"storage": self.storage, "landmarks": self.landmarks, "microseconds": 1e6 * second,
                "resampling": share / second, "times_dsyrk": second / unit,
                "megabytes": reserved_bytes(self.estimator) / 1e6,
                "used": int(self.estimator.map_bytes()[0]) / 1e6}  # fmt: skip


def reserved_bytes(estimator: Estimator) -> int:
    """What an estimator has set aside for its particles' maps."""
    state = estimator.get_state()
    return sum(int(state[name].nbytes) for name in ("maps", "points", "ancestors", "index"))
