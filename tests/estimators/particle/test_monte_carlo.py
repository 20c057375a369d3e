"""Experiment 1 of Wu and Sun 2013, simulated plainly in NumPy for many runs at once."""

import numpy as np
import pytest

from estimators.interface import TARGET, Scan
from estimators.models import MotionModel, SensorModel, TargetModel
from estimators.particle.slamto import SLAMTO

pytestmark = pytest.mark.slow

MOTION = MotionModel(speed_std=0.4, turn_std=0.0872)
SENSOR = SensorModel(max_range=7.0, field_of_view=np.pi, range_std=0.1, bearing_std=0.008)
TARGET_MODEL = TargetModel(kind="twist", speed=3.0, turn_rate=1.0, speed_std=0.8, turn_std=0.6)
DT, STEPS, EVERY, LANDMARKS = 0.02, 320, 8, 20


def wrap(angle):
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def move(state, v, w):
    heading = state[:, 2] + w * DT
    return np.column_stack([state[:, 0] + v * DT * np.cos(heading), state[:, 1] + v * DT * np.sin(heading), heading])


def on_the_circle(angle):
    """A circle of 3 m about the middle of the arena of 10 x 10 m, driven anticlockwise."""
    return np.column_stack([5.0 + 3.0 * np.cos(angle), 5.0 + 3.0 * np.sin(angle), wrap(angle + np.pi / 2)])


def follow(robot, target):
    """Towards the target, 1.5 m behind it."""
    away = target[:, :2] - robot[:, :2]
    bearing = wrap(np.arctan2(away[:, 1], away[:, 0]) - robot[:, 2])
    speed = 3.0 + 4.0 * (np.hypot(away[:, 0], away[:, 1]) - 1.5)
    return np.column_stack([np.clip(speed, 0.0, 4.0), np.clip(4.0 * bearing, -2.0, 2.0)])


def sweep(robot, target, landmarks, rng):
    points = np.concatenate([landmarks, target[:, None, :2]], axis=1)
    away = points - robot[:, None, :2]
    r = np.hypot(away[..., 0], away[..., 1])
    b = wrap(np.arctan2(away[..., 1], away[..., 0]) - robot[:, 2:])
    seen = (r < 7.0) & (abs(b) < np.pi / 2)
    order = np.argsort(~seen, axis=1, kind="stable")
    scan = Scan.empty(*r.shape)
    scan.count[:] = seen.sum(axis=1)
    scan.ranges[:] = np.take_along_axis(r + 0.1 * rng.standard_normal(r.shape), order, 1)
    scan.bearings[:] = np.take_along_axis(wrap(b + 0.008 * rng.standard_normal(r.shape)), order, 1)
    scan.labels[:] = np.append(np.arange(LANDMARKS), TARGET)[order]
    return scan


@pytest.fixture(scope="module")
def experiment():
    """Position errors [steps, runs] of robot and target, and the target's NEES."""
    runs, rng = 400, np.random.default_rng(0)
    landmarks = rng.uniform(0.0, 10.0, (runs, LANDMARKS, 2))
    angle = rng.uniform(-np.pi, np.pi, runs)
    target, robot = on_the_circle(angle), on_the_circle(angle - 4.0 / 3.0)
    f = SLAMTO(MOTION, SENSOR, TARGET_MODEL, num_lanes=runs, max_landmarks=LANDMARKS, particles=200)
    f.reset(robot, np.zeros((3, 3)), seeds=np.arange(runs), target=target, target_cov=np.zeros((3, 3)))
    errors = []
    for step in range(1, STEPS + 1):
        control = follow(robot, target)
        robot = move(robot, *(control + [0.4, 0.0872] * rng.standard_normal((runs, 2))).T)
        target = move(target, *([3.0, 1.0] + [0.8, 0.6] * rng.standard_normal((runs, 2))).T)
        f.predict(control, DT)
        if step % EVERY == 0:
            f.update(sweep(robot, target, landmarks, rng))
        d = f.belief.target_position - target[:, :2]
        nees = np.einsum("li,lij,lj->l", d, np.linalg.inv(f.belief.target_position_cov), d)
        errors.append([np.hypot(*(f.belief.pose - robot)[:, :2].T), np.hypot(*d.T), nees])
    return np.moveaxis(np.array(errors), 1, 0)


def test_errors_of_experiment_1(experiment):
    robot, target, _ = experiment
    assert 0.036 < robot.mean() < 0.044
    assert 0.063 < target.mean() < 0.073


def test_the_target_is_nearly_consistent_and_the_pose_known_to_be_overconfident(experiment):
    nees = experiment[2]
    inside = ((nees > 0.0506) & (nees < 7.378)).mean()
    assert 0.82 < inside < 0.93
