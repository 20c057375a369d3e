"""Dead reckoning: the pose is odometry's, the target is filtered relative to it with the pose considered."""

from dataclasses import replace

import numpy as np
import pytest

from estimators._recording import DT, MOTION, SENSOR, TARGET_MODEL, feed, record, start
from estimators.dead_reckoning import DeadReckoning
from estimators.interface import TARGET, UNKNOWN, Scan
from estimators.models import TargetModel
from estimators.testing import checks


def target_return(distance, bearing, label=TARGET):
    scan = Scan.empty(1, 1)
    scan.count[0] = 1
    scan.ranges[0, 0], scan.bearings[0, 0], scan.labels[0, 0] = distance, bearing, label
    return scan


def odometry(recording):
    """Mean and covariance of the pose by the textbook recursion."""
    mu, P = recording.start[0].copy(), np.zeros((3, 3))
    for step in recording.steps:
        v, w = step.control[0]
        c, s = np.cos(mu[2] + w * DT), np.sin(mu[2] + w * DT)
        F = np.eye(3)
        F[:2, 2] = [-v * DT * s, v * DT * c]
        G = DT * np.array([[c, -v * DT * s], [s, v * DT * c], [0.0, 1.0]])
        P = F @ P @ F.T + G @ np.diag([MOTION.speed_std**2, MOTION.turn_std**2]) @ G.T
        mu += DT * np.array([v * c, v * s, w])
    return mu, P


def test_the_pose_is_odometrys_whatever_is_seen():
    recording = record(1, 30)
    estimator = DeadReckoning(MOTION, SENSOR, TARGET_MODEL, max_landmarks=10)
    start(estimator, recording)
    feed(estimator, recording)
    mu, P = odometry(recording)
    assert estimator.belief.pose[0] == pytest.approx(mu, abs=1e-12)
    assert estimator.belief.pose_cov[0] == pytest.approx(P, abs=1e-14)
    assert estimator.belief.landmark_count.tolist() == [0]


def test_the_targets_update_is_schmidts():
    """The pose's gain is zero: (I - K H) P (I - K H)' + K R K' with that gain, in Joseph's form."""
    at_once = replace(TARGET_MODEL, iterate_spread=np.inf)
    estimator = DeadReckoning(MOTION, SENSOR, at_once, max_landmarks=1)
    prior, cov = np.array([2.0, 1.0, 0.3, -0.1]), np.diag([0.3, 0.2, 0.1, 0.1])
    estimator.reset(np.zeros(3), np.diag([0.04, 0.09, 0.01]), seeds=0, target=prior, target_cov=cov)
    mean, P = estimator.joint(0)
    d = mean[3:5] - mean[:2]
    q = d @ d
    A = np.array([[d[0] / np.sqrt(q), d[1] / np.sqrt(q)], [-d[1] / q, d[0] / q]])
    H = np.hstack([-A, [[0.0], [-1.0]], A, np.zeros((2, 2))])
    R = np.diag([SENSOR.range_std**2, SENSOR.bearing_std**2])
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    K[:3] = 0.0
    y = np.array([2.5 - np.sqrt(q), 0.4 - np.arctan2(d[1], d[0])])
    joseph = (np.eye(7) - K @ H) @ P @ (np.eye(7) - K @ H).T + K @ R @ K.T
    estimator.update(target_return(2.5, 0.4))
    updated, cov = estimator.joint(0)
    assert updated == pytest.approx(mean + K @ y, abs=1e-12)
    assert cov == pytest.approx(joseph, abs=1e-12)


def test_the_target_is_predicted_between_sightings():
    model = TargetModel(kind="twist", speed=1.0, turn_rate=0.5, speed_std=0.1, turn_std=0.1)
    estimator = DeadReckoning(MOTION, SENSOR, model, max_landmarks=1)
    estimator.reset(np.zeros(3), np.zeros((3, 3)), seeds=0, target=[1.0, 2.0, 0.0], target_cov=0.01 * np.eye(3))
    estimator.predict(np.zeros((1, 2)), 0.2)
    assert estimator.belief.target_mean[0] == pytest.approx([1.0 + 0.2 * np.cos(0.1), 2.0 + 0.2 * np.sin(0.1), 0.1])


def test_an_unlabelled_return_can_be_the_targets_when_asked_for():
    for association, moved in (("known", False), ("nearest", True)):
        estimator = DeadReckoning(MOTION, SENSOR, TARGET_MODEL, max_landmarks=1, association=association)
        prior = np.array([2.0, 0.0, 0.0, 0.0])
        estimator.reset(np.zeros(3), np.zeros((3, 3)), seeds=0, target=prior, target_cov=0.1 * np.eye(4))
        estimator.update(target_return(2.2, 0.0, UNKNOWN))
        assert (estimator.belief.target_mean[0, 0] > 2.1) == moved


def test_a_gate_rejects_and_a_far_return_starts_the_target_anew():
    prior = {"target": np.array([2.0, 0.0, 0.0, 0.0]), "target_cov": 0.01 * np.eye(4)}
    estimator = DeadReckoning(MOTION, SENSOR, TARGET_MODEL, max_landmarks=1, gate=10.0)
    estimator.reset(np.zeros(3), np.zeros((3, 3)), seeds=0, **prior)
    estimator.update(target_return(5.0, 1.0))
    assert estimator.counts["gate_rejected"].tolist() == [1]
    assert estimator.belief.target_position[0] == pytest.approx([2.0, 0.0])
    model = TargetModel(reinitialise_nis=20.0)
    estimator = DeadReckoning(MOTION, SENSOR, model, max_landmarks=1)
    estimator.reset(np.zeros(3), np.zeros((3, 3)), seeds=0, **prior)
    estimator.update(target_return(5.0, 0.0))
    assert estimator.counts["reinitialised"].tolist() == [1]
    assert estimator.belief.target_position[0] == pytest.approx([5.0, 0.0])


@pytest.mark.parametrize("check", checks("dead-reckoning"), ids=str)
def test_the_contract_holds(check):
    check()
