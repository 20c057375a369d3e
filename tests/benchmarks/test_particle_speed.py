"""A particle filter's update against the same work in vectorised NumPy, interleaved in one process.

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
    """The least seconds per update of ten landmarks: by NumPy; by the filter, whole updates of 10 and of 30 returns."""
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(2.0, 6.0, 30), rng.uniform(-1.2, 1.2, 30)])  # range, bearing
    pose = 0.01 * rng.normal(size=(3, PARTICLES))
    start = np.zeros((LANDMARKS, 5, PARTICLES))
    start[:, 0] = (points[:LANDMARKS, 0] * np.cos(points[:LANDMARKS, 1]))[:, None]
    start[:, 1] = (points[:LANDMARKS, 0] * np.sin(points[:LANDMARKS, 1]))[:, None]
    start[:, 2] = start[:, 4] = 0.01
    maps, log_w = start.copy(), np.zeros(PARTICLES)
    filters, scans = [], []
    for count in (10, 30):
        scan = Scan.empty(1, count)
        scan.count[:], scan.labels[0] = count, np.arange(count)
        scan.ranges[0], scan.bearings[0] = points[:count].T
        f = make("slamto", MotionModel(), SensorModel(), None, max_landmarks=40, particles=PARTICLES)
        f.update(scan)
        filters.append(f)
        scans.append(scan)
    best = dict.fromkeys(("numpy", 10, 30), np.inf)
    for _ in range(ROUNDS):
        maps[:] = start
        calls = {
            "numpy": lambda: numpy_update(maps, pose, log_w, points[:LANDMARKS]),
            10: lambda: filters[0].update(scans[0]),
            30: lambda: filters[1].update(scans[1]),
        }
        for name, call in calls.items():
            began = perf_counter()
            for _ in range(CALLS):
                call()
            best[name] = min(best[name], (perf_counter() - began) / CALLS)
    best["landmark"] = (best[30] - best[10]) / 20 / PARTICLES  # what one more return costs, per particle
    print(f"\nNumPy {1e6 * best['numpy']:.1f} us, filter {1e6 * best[10]:.1f} us per update of ten landmarks;", end=" ")
    print(f"one more landmark {1e9 * best['landmark']:.2f} ns per particle", end="")
    return best


def test_a_landmark_costs_a_twentieth_of_what_numpy_needs(seconds):
    assert seconds["landmark"] < 0.05 * seconds["numpy"] / LANDMARKS / PARTICLES
