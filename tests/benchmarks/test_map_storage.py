"""Time and memory of the particles' maps against the number of landmarks, by storage.

`pytest -m benchmark -s tests/benchmarks/test_map_storage.py` prints the table. Times depend on the machine: only ratios
are asserted.
"""

from time import perf_counter

import numpy as np
import pytest

from estimators.interface import Scan
from estimators.models import MotionModel, SensorModel
from estimators.registry import make

pytestmark = pytest.mark.benchmark

MOTION = MotionModel(speed_std=0.3, turn_std=0.1)
SENSOR = SensorModel(max_range=6.0, range_std=0.1, bearing_std=0.02)
CONTROL = np.array([[1.0, 0.0]])
SEEN, SETTLED = 10, 1500


def sweeps(landmarks, count, seed=0):
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


def cost(kind, landmarks):
    """Microseconds per update and resampling, megabytes in use and set aside, once the map is full."""
    f = make(
        "slamto", MOTION, SENSOR, None, max_landmarks=landmarks, particles=200, resample_threshold=1.0,
        map_storage=kind,
    )  # fmt: skip
    seconds = []
    for scan in sweeps(landmarks, 2 * landmarks + SETTLED):
        f.predict(CONTROL, 0.1)
        began = perf_counter()
        f.update(scan)
        f._resample(f.all_lanes)
        seconds.append(perf_counter() - began)
    state = f.get_state()
    aside = sum(state[name].nbytes for name in ("maps", "points", "ancestors", "index"))
    return 1e6 * np.quantile(seconds[-SETTLED:], 0.1), f.map_bytes()[0] / 1e6, aside / 1e6


@pytest.fixture(scope="module")
def table():
    sizes = {"lazy": (100, 800, 6400), "tree": (100, 800, 6400), "dense": (100, 800)}
    found = {(kind, n): cost(kind, n) for kind, all_n in sizes.items() for n in all_n}
    for (kind, n), (microseconds, used, aside) in found.items():
        print(
            f"\n{kind:5} {n:5} landmarks {microseconds:7.1f} us {used:6.2f} MB in use, {aside:6.2f} MB set aside",
            end="",
        )
    return found


def test_lazy_columns_do_not_notice_the_size_of_the_map(table):
    assert table["lazy", 6400][0] < 2.0 * table["lazy", 100][0]  # 64 times the landmarks; the caches notice
    assert table["lazy", 6400][0] < 0.5 * table["dense", 800][0]
    assert table["lazy", 6400][2] < 3.0


def test_the_tree_saves_memory_and_pays_with_time_that_grows_as_the_logarithm(table):
    assert table["tree", 6400][1] < 1.0
    assert table["tree", 800][1] < 0.05 * table["dense", 800][1]
    assert table["tree", 6400][0] < 3.0 * table["tree", 100][0]
