"""The textbook's filters in NumPy, one particle at a time, and a small world to run them in."""

from types import SimpleNamespace

import numpy as np
import pytest

from estimators.interface import TARGET, Scan
from estimators.models import MotionModel, SensorModel, TargetModel
from estimators.particle.slamto import SLAMTO


def wrap(angle):
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def measurement(pose, point, n):
    """h and its Jacobian by a state of n coordinates that begins with the point. Eq. (12), Wu and Sun 2013."""
    dx, dy = point[0] - pose[0], point[1] - pose[1]
    q = dx * dx + dy * dy
    r = np.sqrt(q)
    H = np.zeros((2, n))
    H[:, :2] = [[dx / r, dy / r], [-dy / q, dx / q]]
    return np.array([r, wrap(np.arctan2(dy, dx) - pose[2])]), H


def ekf_update(pose, mean, cov, z, R):
    """Eqs. (14) and (18): posterior mean and covariance, innovation and S."""
    h, H = measurement(pose, mean, len(mean))
    nu = z - h
    nu[1] = wrap(nu[1])
    S = H @ cov @ H.T + R
    K = cov @ H.T @ np.linalg.inv(S)
    return mean + K @ nu, (np.eye(len(mean)) - K @ H) @ cov, nu, S


def unpack(column, n):
    """Mean and covariance from a particle's column: the mean, then the upper triangle row by row."""
    cov = np.zeros((n, n))
    cov[np.triu_indices(n)] = column[n:]
    return column[:n].copy(), cov + np.triu(cov, 1).T


def scan_of(returns, lanes=1, width=None):
    """The same returns (range, bearing, label) in every lane."""
    scan = Scan.empty(lanes, width or max(len(returns), 1))
    scan.count[:] = len(returns)
    for k, (r, b, label) in enumerate(returns):
        scan.ranges[:, k], scan.bearings[:, k], scan.labels[:, k] = r, b, label
    return scan


MOTION = MotionModel(speed_std=0.4, turn_std=0.3)
SENSOR = SensorModel(max_range=20.0, range_std=0.1, range_std_per_range=0.02, bearing_std=0.05)
TARGETS = {
    "twist": TargetModel(kind="twist", speed=2.0, turn_rate=0.5, speed_std=0.8, turn_std=0.6),
    "constant-velocity": TargetModel(kind="constant-velocity", acceleration_density=0.5),
}
PRIORS = {
    "twist": (np.array([3.0, 1.0, 0.4]), np.diag([0.04, 0.05, 0.1]) + 0.01),
    "constant-velocity": (np.array([3.0, 1.0, 0.3, -0.2]), np.diag([0.04, 0.05, 0.1, 0.2]) + 0.01),
}
LANDMARKS = np.array([[2.0, 2.0], [4.0, -1.0], [-2.0, 3.0], [1.0, -3.0]])


def sweep(pose, target, rng, landmarks=LANDMARKS):
    """Returns of all landmarks and the target."""
    points = [*enumerate(landmarks), (TARGET, target)]
    returns = []
    for label, point in points:
        h = measurement(pose, point, 2)[0]
        returns.append((h[0] + 0.1 * rng.standard_normal(), wrap(h[1] + 0.05 * rng.standard_normal()), label))
    return returns


@pytest.fixture(scope="session")
def oracle():
    return SimpleNamespace(
        wrap=wrap, measurement=measurement, ekf_update=ekf_update, unpack=unpack, scan_of=scan_of, sweep=sweep,
        motion=MOTION, sensor=SENSOR, targets=TARGETS, priors=PRIORS, landmarks=LANDMARKS,
    )  # fmt: skip


@pytest.fixture
def make():
    """A filter (SLAMTO unless `cls` says otherwise) in that world; `kind`: the target model, None for no target."""

    def build(kind="twist", prior=True, **options):
        options = {"particles": 30, "max_landmarks": 6, "resample_threshold": 0.0, "map_storage": "dense", **options}
        motion, sensor = options.pop("motion", MOTION), options.pop("sensor", SENSOR)
        target = options.pop("target", TARGETS[kind] if kind else None)
        filter_ = options.pop("cls", SLAMTO)(motion, sensor, target, **options)
        lanes = filter_.num_lanes
        mean, cov = PRIORS[kind] if kind and prior else (None, None)
        filter_.reset(
            np.zeros(3), np.diag([0.01, 0.01, 0.002]), seeds=np.arange(lanes) + 5, target=mean, target_cov=cov
        )
        return filter_

    return build
