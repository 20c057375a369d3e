"""Particle filters' updates against the same work in vectorised NumPy, interleaved in one process.

`pytest -m benchmark -s tests/benchmarks/test_particle_speed.py` prints nanoseconds per landmark and particle; those
depend on the machine and are not asserted. The map's storage has its own benchmark, `test_map_storage.py`.
"""

from time import perf_counter

import numpy as np
import pytest

from estimators.interface import Scan
from estimators.models import MotionModel, SensorModel
from estimators.registry import make

pytestmark = pytest.mark.benchmark

PARTICLES, LANDMARKS, ROUNDS, CALLS = 200, 10, 400, 4
FILTERS = ("slamto", "fastslam1", "fastslam2")
VAR_R, VAR_B = 0.1**2, 0.008**2


def numpy_update(maps, pose, log_w, returns):
    """Each landmark's EKF in all particles at once, as one writes it in NumPy: S, K, (I - K H) P, the likelihood."""
    for j, (r, b) in enumerate(returns):
        mx, my, pxx, pxy, pyy = maps[j]
        dx, dy = mx - pose[0], my - pose[1]
        q = dx * dx + dy * dy
        d = np.sqrt(q)
        nu0 = r - d
        nu1 = b + pose[2] - np.arctan2(dy, dx)
        nu1 -= 2.0 * np.pi * np.round(nu1 / (2.0 * np.pi))
        h00, h01, h10, h11 = dx / d, dy / d, -dy / q, dx / q
        f00, f01 = pxx * h00 + pxy * h01, pxx * h10 + pxy * h11
        f10, f11 = pxy * h00 + pyy * h01, pxy * h10 + pyy * h11
        s00, s01, s11 = h00 * f00 + h01 * f10 + VAR_R, h00 * f01 + h01 * f11, h10 * f01 + h11 * f11 + VAR_B
        det = s00 * s11 - s01 * s01
        k00, k01 = (f00 * s11 - f01 * s01) / det, (f01 * s00 - f00 * s01) / det
        k10, k11 = (f10 * s11 - f11 * s01) / det, (f11 * s00 - f10 * s01) / det
        maps[j, 0] = mx + k00 * nu0 + k01 * nu1
        maps[j, 1] = my + k10 * nu0 + k11 * nu1
        maps[j, 2] = pxx - k00 * f00 - k01 * f01
        maps[j, 3] = pxy - k00 * f10 - k01 * f11
        maps[j, 4] = pyy - k10 * f10 - k11 * f11
        log_w -= 0.5 * ((s11 * nu0 * nu0 - 2.0 * s01 * nu0 * nu1 + s00 * nu1 * nu1) / det + np.log(det))


@pytest.fixture(scope="module")
def seconds():
    """The least seconds per landmark and particle: by NumPy, and by each filter, of one more return in a sweep."""
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(2.0, 6.0, 30), rng.uniform(-1.2, 1.2, 30)])  # range, bearing
    pose = 0.01 * rng.normal(size=(3, PARTICLES))
    start = np.zeros((LANDMARKS, 5, PARTICLES))
    start[:, 0] = (points[:LANDMARKS, 0] * np.cos(points[:LANDMARKS, 1]))[:, None]
    start[:, 1] = (points[:LANDMARKS, 0] * np.sin(points[:LANDMARKS, 1]))[:, None]
    start[:, 2] = start[:, 4] = 0.01
    maps, log_w = start.copy(), np.zeros(PARTICLES)
    calls = {"numpy": lambda: numpy_update(maps, pose, log_w, points[:LANDMARKS])}
    calls |= {(name, count): update_of(name, points[:count]) for name in FILTERS for count in (10, 30)}
    best = dict.fromkeys(calls, np.inf)
    for _ in range(ROUNDS):
        maps[:] = start
        for name, call in calls.items():
            began = perf_counter()
            for _ in range(CALLS):
                call()
            best[name] = min(best[name], (perf_counter() - began) / CALLS)
    found = {name: (best[name, 30] - best[name, 10]) / 20 / PARTICLES for name in FILTERS}
    found["numpy"] = best["numpy"] / LANDMARKS / PARTICLES
    print(*(f"\n{name} {1e9 * second:.2f} ns per landmark and particle" for name, second in found.items()), end="")
    return found


def update_of(name, returns):
    """A filter's update by the same returns (range, bearing) of known landmarks again and again."""
    scan = Scan.empty(1, len(returns))
    scan.count[:], scan.labels[0] = len(returns), np.arange(len(returns))
    scan.ranges[0], scan.bearings[0] = returns.T
    estimator = make(name, MotionModel(), SensorModel(), None, max_landmarks=40, particles=PARTICLES)
    estimator.update(scan)
    return lambda: estimator.update(scan)


@pytest.mark.parametrize("name", ["slamto", "fastslam1"])
def test_a_landmark_costs_a_thirtieth_of_what_numpy_needs(seconds, name):
    assert seconds[name] < seconds["numpy"] / 30


def test_looking_before_drawing_costs_five_times_an_update(seconds):
    assert seconds["fastslam2"] < seconds["numpy"] / 10
    assert seconds["fastslam2"] < 5.0 * seconds["slamto"]
