"""Lazy columns against plain arrays, bit for bit; what they cost against the size of the map."""

import time

import numpy as np
import pytest

from estimators.interface import Scan
from estimators.models import MotionModel, SensorModel
from estimators.particle import map_storage as store
from estimators.registry import make as make_estimator

N, M = 12, 40


def resampling(rng, n):
    """Moves as `moves` makes them: survivors stay, their copies go to the places of the dead."""
    dead = rng.choice(n, rng.integers(0, n), replace=False)
    survivors = np.setdiff1d(np.arange(n), dead)
    source = np.zeros(n, dtype=np.int64)
    destination = np.zeros(n, dtype=np.int64)
    source[: len(dead)], destination[: len(dead)] = rng.choice(survivors, len(dead)), dead
    return source, destination, len(dead)


@pytest.mark.parametrize("epochs", [4, M + 1])
def test_any_sequence_of_touches_and_resamplings(epochs):
    """Few rows of ancestors force the store to free one; few buffers force it to grow."""
    rng = np.random.default_rng(epochs)
    columns, points, ancestors, index = store.allocate(1, M, N, True)
    columns, ancestors = columns[:, :5].copy(), ancestors[:, :epochs].copy()
    store.clear(index, 5, True)
    plain, work, known = np.zeros((M, 5, N)), np.zeros((5, N)), 0
    for _ in range(400):
        if index[0, store.SIZES, 0] < 4 and columns.shape[1] <= M:
            columns = store.grown(columns, index, 4, M)
        for j in {*rng.integers(0, min(known + 1, M), 3).tolist()}:
            known = max(known, j + 1)
            column = store.open_column(j, columns[0], points[0], ancestors[0], index[0])
            np.testing.assert_array_equal(column, plain[j])
            column[:] = plain[j] = rng.normal(size=(5, N))
        source, destination, count = resampling(rng, N)
        store.move_particles(known, columns[0], points[0], ancestors[0], index[0], source, destination, count)
        plain[:, :, destination[:count]] = plain[:, :, source[:count]]
        for j in range(known):
            read = store.read_column(j, columns[0], points[0], ancestors[0], index[0], work)
            np.testing.assert_array_equal(read, plain[j])
    assert known > 0.8 * M
    assert (index[0, store.BUFFER, :M] == store.COLLAPSED).any()
    assert len(np.unique(index[0, store.FREE, : index[0, store.SIZES, 0]])) == index[0, store.SIZES, 0]


MOTION = MotionModel(speed_std=0.3, turn_std=0.1)
CONTROL = np.array([[1.0, 0.0]])
SENSOR = SensorModel(max_range=6.0, range_std=0.1, bearing_std=0.02)


def drive(filters, landmarks, steps, seen=10, seed=0):
    """A robot along the x axis past a line of landmarks, ten seen after each step; yields the seconds of a step."""
    rng, scan = np.random.default_rng(seed), Scan.empty(1, seen)
    for step in range(steps):
        first = (step // 2) % (landmarks - seen)
        ids = np.arange(first, first + seen)
        away = np.column_stack([0.2 * ids - 0.1 * (2 * first) - 1.0, np.where(ids % 2, 2.0, -2.0)])
        scan.ranges[0] = np.hypot(*away.T) + 0.1 * rng.standard_normal(seen)
        scan.bearings[0] = np.arctan2(away[:, 1], away[:, 0]) + 0.02 * rng.standard_normal(seen)
        scan.labels[0], scan.count[0] = ids, seen
        began = time.perf_counter()
        for f in filters:
            f.predict(CONTROL, 0.1)
            f.update(scan)
        yield time.perf_counter() - began


@pytest.mark.parametrize("name", ["slamto", "fastslam2"])
def test_filters_are_the_same_bit_for_bit(name):
    options = {"max_landmarks": 200, "particles": 25, "resample_threshold": 0.9}
    lazy, dense = (
        make_estimator(name, MOTION, SENSOR, None, map_storage=kind, **options) for kind in ("lazy", "dense")
    )
    for step, _ in enumerate(drive((lazy, dense), 200, 370)):
        if step % 40 == 39:
            for field in ("pose", "pose_cov", "landmark_mean", "landmark_cov", "landmark_rel", "landmark_rel_cov"):
                np.testing.assert_array_equal(getattr(lazy.belief, field), getattr(dense.belief, field))
    assert lazy.belief.landmark_count[0] > 150
    assert lazy.get_state()["maps"].nbytes < dense.get_state()["maps"].nbytes


def cost(kind, landmarks, steps=3000):
    """Microseconds per predict, update and resampling, and megabytes, once the map is full."""
    f = make_estimator(
        "slamto", MOTION, SENSOR, None, max_landmarks=landmarks, particles=200, resample_threshold=1.0,
        map_storage=kind,
    )  # fmt: skip
    times = list(drive((f,), landmarks, 2 * landmarks + steps))
    state = f.get_state()
    size = sum(state[name].nbytes for name in ("maps", "points", "ancestors", "index", "ids", "used"))
    return 1e6 * np.median(times[-steps:]), size / 1e6


@pytest.mark.benchmark
def test_time_and_memory_do_not_depend_on_the_size_of_the_map():
    """Printed with -s: the table of the storage against the number of landmarks."""
    table = {
        (kind, n): cost(kind, n) for n in (100, 800, 6400) for kind in ("lazy", "dense") if kind == "lazy" or n < 1000
    }
    for (kind, n), (microseconds, megabytes) in table.items():
        print(f"{kind:6} {n:5} landmarks {microseconds:7.1f} us {megabytes:6.1f} MB")
    assert table["lazy", 6400][0] < 3.0 * table["lazy", 100][0]  # 64 times the landmarks; the caches notice
    assert table["lazy", 6400][0] < 0.5 * table["dense", 800][0]
    assert table["lazy", 800][0] < table["dense", 800][0]
    assert table["lazy", 6400][1] < 10.0
