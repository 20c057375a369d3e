"""A simulated world in plain NumPy, for consistency by Monte Carlo without any environment."""

import math

import numpy as np
import pytest

from estimators import registry
from estimators.interface import TARGET, Scan
from estimators.models import MotionModel, SensorModel, TargetModel

SPEED, TURN, DRIFT = 0.5, 0.075, 0.005  # [m/s], [rad/s], the target's acceleration density


def wrap(angle):
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def nees_of(error, cov):
    return np.einsum("li,li->l", error, np.linalg.solve(cov, error[..., None])[..., 0])


def run_ring(name, runs, steps=660, seed=1, with_target=False, **options):
    """Geng's setting: a circle of 6.7 m, 20 landmarks within 4 m of it, a new map each run; wheels 2 %, 0.1 m, 1 deg.

    With a target: one that drifts with nearly constant velocity and is always seen.

    Returns:
        Per run: the pose's NEES averaged over steps, the root of the mean squared position error, and with a target
        its NEES (4 dof) averaged.
    """
    rng = np.random.default_rng(seed)
    count, bearing_std, wheel = 20, math.radians(1.0), 0.02 * SPEED
    motion = MotionModel(speed_std=wheel / math.sqrt(2.0), turn_std=math.sqrt(2.0) * wheel / 0.5)
    sensor = SensorModel(max_range=5.0, range_std=0.1, bearing_std=bearing_std)
    model = TargetModel(acceleration_density=DRIFT, initial_speed_std=0.1) if with_target else None
    angle, radius = rng.uniform(-np.pi, np.pi, (runs, count)), SPEED / TURN + rng.uniform(-4.0, 4.0, (runs, count))
    landmarks = np.stack([radius * np.cos(angle), SPEED / TURN + radius * np.sin(angle)], axis=-1)
    target = np.column_stack([rng.uniform(-3.0, 3.0, (runs, 2)), 0.02 * rng.standard_normal((runs, 2))])
    estimator = registry.make(name, motion, sensor, model, num_lanes=runs, max_landmarks=count, **options)
    pose, control = np.zeros((runs, 3)), np.tile([SPEED, TURN], (runs, 1))
    scan = Scan.empty(runs, count + 1 if with_target else count)
    estimator.reset(pose, np.zeros((3, 3)), seeds=np.arange(runs))
    scores = []
    for k in range(steps):
        speed = SPEED + motion.speed_std * rng.standard_normal(runs)
        end = pose[:, 2] + TURN + motion.turn_std * rng.standard_normal(runs)
        pose = np.column_stack([pose[:, 0] + speed * np.cos(end), pose[:, 1] + speed * np.sin(end), end])
        if with_target:
            shake = rng.standard_normal((2, runs, 2))
            target[:, :2] += target[:, 2:] + DRIFT * (0.5 * shake[0] + shake[1] / math.sqrt(12.0))
            target[:, 2:] += DRIFT * shake[0]
        sense(scan, pose, landmarks, target, with_target, rng)
        estimator.predict(control, 1.0)
        estimator.update(scan)
        if k >= 10:
            belief = estimator.belief
            error = belief.pose - pose
            error[:, 2] = wrap(error[:, 2])
            row = [nees_of(error, belief.pose_cov), (error[:, :2] ** 2).sum(axis=1)]
            if with_target:
                row.append(nees_of(belief.target_mean - target, belief.target_cov))
            scores.append(row)
    mean = np.mean(scores, axis=0)
    return (mean[0], np.sqrt(mean[1]), *mean[2:])


def sense(scan, pose, landmarks, target, with_target, rng):
    """Fill the sweep in place: landmarks between 0.5 and 5 m, the target always."""
    points = np.concatenate([landmarks, target[:, None, :2]], axis=1) if with_target else landmarks
    gap = points - pose[:, None, :2]
    distance = np.hypot(gap[..., 0], gap[..., 1])
    bearing = np.arctan2(gap[..., 1], gap[..., 0]) - pose[:, 2:]
    bearing = wrap(bearing + math.radians(1.0) * rng.standard_normal(distance.shape))
    noisy = np.abs(distance + 0.1 * rng.standard_normal(distance.shape))
    seen = (distance < 5.0) & (distance > 0.5)
    if with_target:
        seen[:, -1] = True
    order = np.argsort(~seen, axis=1, kind="stable")
    labels = np.where(order == landmarks.shape[1], TARGET, order)
    scan.ranges[:] = np.take_along_axis(noisy, order, axis=1)
    scan.bearings[:] = np.take_along_axis(bearing, order, axis=1)
    scan.labels[:], scan.count[:] = labels, seen.sum(axis=1)


@pytest.fixture(scope="session")
def ring_world():
    """See `run_ring`: a test directory's modules cannot be imported."""
    return run_ring
