"""SLAM and tracking apart: the SLAM half is the SLAM filter's own, the target half believes its pose."""

import numpy as np
import pytest

from estimators._checks import edited, without
from estimators._recording import MOTION, SENSOR, TARGET_MODEL, feed, record, start
from estimators.independent import Independent
from estimators.interface import TARGET
from estimators.models import MotionModel
from estimators.registry import make
from estimators.testing import checks


def textbook_target(recording, poses):
    """A target EKF of a known pose, in NumPy."""
    mu = P = None
    dt, q = 0.1, TARGET_MODEL.acceleration_density**2
    F = np.eye(4) + dt * np.eye(4, k=2)
    Q = np.kron(q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]), np.eye(2))
    R = np.diag([SENSOR.range_std**2, SENSOR.bearing_std**2])
    for step, pose in zip(recording.steps, poses, strict=True):
        if mu is not None:
            mu, P = F @ mu, F @ P @ F.T + Q
        for k in np.flatnonzero(step.scan.labels[0, : step.scan.count[0]] == TARGET):
            r, b = step.scan.ranges[0, k], step.scan.bearings[0, k]
            if mu is None:
                c, s = np.cos(pose[2] + b), np.sin(pose[2] + b)
                G = np.array([[c, -r * s], [s, r * c]])
                mu, P = np.array([pose[0] + r * c, pose[1] + r * s, 0.0, 0.0]), np.zeros((4, 4))
                P[:2, :2], P[2:, 2:] = G @ R @ G.T, TARGET_MODEL.initial_speed_std**2 * np.eye(2)
                continue
            d = mu[:2] - pose[:2]
            D = np.linalg.norm(d)
            H = np.array([[d[0] / D, d[1] / D, 0.0, 0.0], [-d[1] / D**2, d[0] / D**2, 0.0, 0.0]])
            turn = (b - np.arctan2(d[1], d[0]) + pose[2] + np.pi) % (2 * np.pi) - np.pi
            K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
            mu, P = mu + K @ [r - D, turn], P - K @ H @ P
    return mu, P


@pytest.mark.parametrize("slam", ["ekf", "cdkf", "dead-reckoning"])
def test_the_slam_half_is_untouched_and_the_target_half_is_the_textbooks(slam):
    recording = record(1, 30, seed=4)
    both = Independent(MOTION, SENSOR, TARGET_MODEL, max_landmarks=10, slam=slam)
    alone = make(slam, MOTION, SENSOR, None, max_landmarks=10)
    start(both, recording)
    start(alone, recording)
    targetless = edited(recording, lambda _, step: without(step.scan, TARGET))
    poses = []
    for i in range(len(recording.steps)):
        feed(both, recording, i, i + 1)
        feed(alone, targetless, i, i + 1)
        poses.append(both.belief.pose[0].copy())
    for name in ("pose", "pose_cov", "landmark_id", "landmark_mean", "landmark_rel_cov"):
        assert np.array_equal(getattr(both.belief, name), getattr(alone.belief, name)), name
    mu, P = textbook_target(recording, poses)
    assert both.belief.target_mean[0] == pytest.approx(mu, abs=1e-9)
    assert both.belief.target_cov[0] == pytest.approx(P, abs=1e-9)


def test_it_believes_the_pose_so_that_it_is_surer_than_the_joint_filter():
    recording = record(1, 30, seed=4)
    beliefs = []
    for name in ("independent", "ekf"):
        estimator = make(name, MOTION, SENSOR, TARGET_MODEL, max_landmarks=10)
        start(estimator, recording, pose_cov=np.diag([0.2, 0.2, 0.05]))
        feed(estimator, recording)
        beliefs.append(estimator.belief)
    assert np.trace(beliefs[0].target_position_cov[0]) < 0.5 * np.trace(beliefs[1].target_position_cov[0])
    turn = beliefs[0].pose[0, 2]
    C = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    assert beliefs[0].target_rel_cov[0] == pytest.approx(C.T @ beliefs[0].target_position_cov[0] @ C, abs=1e-12)


def test_counts_of_both_halves_are_told_apart():
    estimator = Independent(MOTION, SENSOR, TARGET_MODEL, max_landmarks=2, gate=1e-6)
    recording = record(1, 5)
    start(estimator, recording)
    feed(estimator, recording)
    assert estimator.counts["overflow"][0] > 0
    assert estimator.counts["target_gate_rejected"][0] > 0


def test_options_reach_the_slam_filter():
    recording = record(2, 10)
    estimator = Independent(
        MOTION, SENSOR, TARGET_MODEL, num_lanes=2, max_landmarks=10, slam="cdkf", slam_options={"budget": 3}
    )
    start(estimator, recording)
    feed(estimator, recording)
    assert estimator.counts["budget_widened"].all()
    estimator.set_models(1, MotionModel(speed_std=0.5), SENSOR, TARGET_MODEL)
    assert estimator.slam.models["speed_std"].tolist() == [MOTION.speed_std, 0.5]
    assert estimator.tracker.models["speed_std"].tolist() == [MOTION.speed_std, 0.5]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"slam": "ekff"}, "Did you mean 'ekf'"),
        ({"slam": "ideal-ekf"}, "is handed the truth and cannot run inside `independent`"),
        ({"slam_options": {"budgte": 3}}, "budgte"),
        ({"association": "by-eye"}, "association must be one of 'known', 'nearest', 'jcbb'; got 'by-eye'"),
    ],
)
def test_wrong_options_are_explained(options, message):
    with pytest.raises(ValueError, match=message):
        Independent(MOTION, SENSOR, TARGET_MODEL, max_landmarks=10, **options)


def test_particles_are_the_slam_filters():
    with pytest.raises(NotImplementedError, match="keeps no particles"):
        Independent(MOTION, SENSOR, TARGET_MODEL, max_landmarks=4).particles(0)
    estimator = make("independent", MOTION, SENSOR, TARGET_MODEL, max_landmarks=4, slam="slamto")
    estimator.reset(np.zeros(3), np.zeros((3, 3)), seeds=0)
    poses, weights = estimator.particles(0)
    assert poses.shape == (len(weights), 3)


@pytest.mark.parametrize("check", checks("independent"), ids=str)
def test_the_contract_holds(check):
    check()


def test_the_contract_holds_around_particles():
    for check in checks("independent", slam="slamto", slam_options={"particles": 20}):
        check()
