"""Returns from no distance at all, and outliers that are believed: no filter of the family may run away."""

import numpy as np
import pytest

from estimators import registry
from estimators._recording import DT, MOTION, SENSOR, TARGET_MODEL, feed, record, start
from estimators.gaussian.anchor import ROUGH_NIS
from estimators.gaussian.ekf import EKF
from estimators.gaussian.fej import FEJEKF
from estimators.interface import TARGET, Scan
from estimators.models import MotionModel, SensorModel, TargetModel
from estimators.testing import checks

NAMES = [
    "ekf",
    "fej-ekf",
    "oc-ekf",
    "robocentric-ekf",
    "ri-ekf",
    "cdkf",
    "ukf",
    "ri-cdkf",
    "taylor-ekf",
    "ri-taylor-ekf",
]


def wrap(angle):
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("distance", [1e-9, 1e-6, 1e-3])
def test_a_landmark_first_met_at_the_robot_itself(name, distance):
    """Driven over, left behind and seen from a distance: the pose stays near the truth, the belief sane."""
    rng = np.random.default_rng(3)
    estimator = registry.make(name, MOTION, SENSOR, None, num_lanes=4, max_landmarks=2)
    pose = np.zeros((4, 3))
    estimator.reset(pose, np.diag([1e-4, 1e-4, 1e-4]), seeds=np.arange(4))
    for k in range(30):
        scan = Scan.empty(4, 1)
        gap = np.array([distance, 0.0]) - pose[:, :2]
        r = np.hypot(*gap.T) + (SENSOR.range_std * rng.standard_normal(4) if k else 0.0)
        bearing = np.arctan2(gap[:, 1], gap[:, 0]) - pose[:, 2] + SENSOR.bearing_std * rng.standard_normal(4)
        scan.ranges[:, 0], scan.bearings[:, 0], scan.labels[:], scan.count[:] = np.abs(r), wrap(bearing), 0, 1
        estimator.update(scan)
        speed, turn = 1.0 + MOTION.speed_std * rng.standard_normal(4), MOTION.turn_std * rng.standard_normal(4)
        pose[:, 2] += turn * DT
        pose[:, :2] += DT * speed[:, None] * np.column_stack([np.cos(pose[:, 2]), np.sin(pose[:, 2])])
        estimator.predict(np.tile([1.0, 0.0], (4, 1)), DT)
    belief = estimator.belief
    assert np.linalg.norm(belief.pose[:, :2] - pose[:, :2], axis=1).max() < 0.5
    assert np.abs(wrap(belief.pose[:, 2] - pose[:, 2])).max() < 0.2
    assert np.linalg.eigvalsh(belief.pose_cov).min() > 0.0


@pytest.mark.parametrize("name", ["ekf", "ri-ekf", "robocentric-ekf", "cdkf", "compressed-ekf"])
def test_what_is_seen_far_better_than_the_robot_is_known_has_a_covariance(name):
    """Metres of doubt about the robot, nanometres about what is beside it: less than rounding is left between them."""
    rng, lanes = np.random.default_rng(4), 32
    sensor = SensorModel(range_std=1e-7, bearing_std=1e-3)
    estimator = registry.make(name, MOTION, sensor, TARGET_MODEL, num_lanes=lanes, max_landmarks=1)
    pose = np.column_stack([rng.uniform(-5.0, 5.0, (lanes, 2)), rng.uniform(-3.0, 3.0, lanes)])
    estimator.reset(pose, np.diag([1.0, 2.0, 0.5]), seeds=np.arange(lanes))
    scan = Scan.empty(lanes, 2)
    scan.count[:], scan.labels[:] = 2, [0, TARGET]
    scan.ranges[:], scan.bearings[:] = 1e-6, rng.uniform(-3.0, 3.0, (lanes, 2))
    estimator.update(scan)
    for cov in (estimator.belief.landmark_rel_cov[:, 0], estimator.belief.target_rel_cov):
        smallest, largest = np.linalg.eigvalsh(cov).T
        assert (smallest >= -1e-12 * largest).all()


@pytest.mark.parametrize("name", [*NAMES, "recorded-ri-ekf"])
def test_a_filter_that_knows_kilometres_only_and_sees_micrometres_keeps_a_covariance(name):
    """Rounding of P is a hundred times a return's variance; whatever the filter makes of it, P stays a covariance."""
    rng, lanes, count = np.random.default_rng(5), 16, 6
    motion, sensor = MotionModel(speed_std=0.1, turn_std=0.05), SensorModel(range_std=1e-5, bearing_std=1e-5)
    estimator = registry.make(name, motion, sensor, TARGET_MODEL, num_lanes=lanes, max_landmarks=count)
    pose, marks = np.zeros((lanes, 3)), rng.uniform(-10.0, 10.0, (lanes, count + 1, 2))
    estimator.reset(pose, np.diag([1e8, 1e8, 1e-2]), seeds=np.arange(lanes))
    scan = Scan.empty(lanes, count + 1)
    scan.count[:], scan.labels[:] = count + 1, [*range(count), TARGET]
    for k in range(20):
        gap = marks - pose[:, None, :2]
        noise = 1e-5 * rng.standard_normal((2, lanes, count + 1))
        scan.ranges[:] = np.hypot(gap[..., 0], gap[..., 1]) + noise[0]
        scan.bearings[:] = wrap(np.arctan2(gap[..., 1], gap[..., 0]) - pose[:, 2:] + noise[1])
        estimator.update(scan)
        belief = estimator.belief
        for cov in (belief.pose_cov, belief.target_cov, belief.landmark_cov):
            root = np.sqrt(np.einsum("...ii->...i", cov))
            assert np.linalg.eigvalsh(cov / (root[..., :, None] * root[..., None, :])).min() > 0.0, k
        estimator.predict(np.tile([1.0, 0.3], (lanes, 1)), DT)
        speed, turn = 1.0 + 0.1 * rng.standard_normal(lanes), 0.3 + 0.05 * rng.standard_normal(lanes)
        pose[:, 2] = wrap(pose[:, 2] + turn * DT)
        pose[:, :2] += DT * speed[:, None] * np.column_stack([np.cos(pose[:, 2]), np.sin(pose[:, 2])])
    assert (estimator.counts["not_positive"] == 0).all()


@pytest.mark.parametrize("name", ["ekf", "fej-ekf", "oc-ekf", "ri-ekf", "taylor-ekf", "dead-reckoning"])
def test_a_target_of_which_rounding_has_left_no_covariance_starts_anew(name):
    estimator = registry.make(name, MOTION, SENSOR, TARGET_MODEL, num_lanes=2, max_landmarks=1)
    state = {"target": np.array([2.0, 1.0, 0.5, 0.0]), "target_cov": 0.1 * np.eye(4)}
    estimator.reset(np.zeros(3), np.diag([1e-4, 1e-4, 1e-4]), seeds=0, **state)
    estimator.P[1, 3:5, 3:5] = -1e8 * np.eye(2)
    scan = Scan.empty(2, 1)
    scan.count[:], scan.labels[:], scan.ranges[:], scan.bearings[:] = 1, TARGET, 2.0, 0.5
    for _ in range(3):
        estimator.predict(np.tile([0.0, 0.0], (2, 1)), DT)
        estimator.update(scan)
    belief = estimator.belief
    assert belief.target_known.all()
    assert np.linalg.eigvalsh(belief.target_cov).min() > 0.0
    np.testing.assert_allclose(
        belief.target_position, np.tile(2.0 * np.array([np.cos(0.5), np.sin(0.5)]), (2, 1)), atol=0.3
    )


@pytest.mark.parametrize("name", NAMES)
def test_rough_sweeps_under_a_tight_budget(name):
    for check in checks(name, budget=3):
        if check.name == "rough_sweeps":
            check()


def test_fej_linearises_anew_after_an_outlier():
    recording = record(1, 30)
    estimator = FEJEKF(MOTION, SENSOR, TARGET_MODEL, max_landmarks=8)
    start(estimator, recording)
    feed(estimator, recording, 0, 20)
    first = estimator.first.copy()
    scan = Scan.empty(1, 1)
    scan.count[0], scan.labels[0, 0] = 1, estimator.ids[0, 0]
    scan.ranges[0, 0] = 100.0
    estimator.update(scan)
    count = estimator.count[0]
    marks = estimator.mu[0, 7 : 7 + 2 * count].reshape(-1, 2)
    np.testing.assert_array_equal(estimator.anchor[0], estimator.mu[0, [0, 1, 3, 4, 5, 6]])
    np.testing.assert_array_equal(estimator.first[0, :count, :2], marks)
    assert np.abs(first[0, :count, :2] - marks).max() > 1e-2
    assert ROUGH_NIS > 25.0


@pytest.mark.parametrize("speed", [0.0, 1e-200, 1e-160, 1e-3, 1e3, 1e120])
def test_the_targets_heading_from_any_velocity(speed):
    """No overflow, no division by zero: from nothing known to known exactly."""
    estimator = EKF(MOTION, SENSOR, TargetModel(), max_landmarks=2)
    velocity = speed * np.array([0.6, -0.8])
    for variance in (0.0, 0.01):
        cov = variance * np.eye(4)
        estimator.reset(np.zeros(3), np.zeros((3, 3)), seeds=0, target=[1.0, 1.0, *velocity], target_cov=cov)
        belief = estimator.belief
        expected = min(variance / speed**2, np.pi**2 / 3.0) if speed > 1e-100 else np.pi**2 / 3.0
        if speed > 1e-100:
            assert belief.target_heading[0] == pytest.approx(np.arctan2(-0.8, 0.6))
        if variance > 0.0:
            assert belief.target_heading_var[0] == pytest.approx(expected)
        assert 0.0 <= belief.target_heading_var[0] <= np.pi**2 / 3.0
