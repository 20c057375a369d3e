import math

import numpy as np
import pytest

from estimators._recording import DT, MOTION, SENSOR, TARGET_MODEL, feed, record, start
from estimators.gaussian.ekf import EKF
from estimators.gaussian.layout import GaussianEstimator
from estimators.interface import Scan
from estimators.models import TargetModel

TWIST = TargetModel(kind="twist", speed=0.3, turn_rate=0.1, speed_std=0.1, turn_std=0.1)


@pytest.fixture(scope="module", params=[TARGET_MODEL, TWIST], ids=["constant-velocity", "twist"])
def run(request):
    recording = record(2, 25)
    estimator = EKF(MOTION, SENSOR, request.param, num_lanes=2, max_landmarks=10)
    start(estimator, recording)
    feed(estimator, recording)
    assert estimator.target_known.all()
    return estimator


def relative_jacobian(mu, j):
    """C'[-I, -J D, I] over position, heading and the point at row j."""
    D = mu[j : j + 2] - mu[:2]
    c, s = np.cos(mu[2]), np.sin(mu[2])
    turn = np.array([[c, s], [-s, c]])
    H = np.zeros((2, len(mu)))
    H[:, :2], H[:, 2], H[:, j : j + 2] = -turn, -turn @ [-D[1], D[0]], turn
    return turn @ D, H


def test_relative_position_has_the_cross_terms(run):
    belief = run.belief
    for lane in range(2):
        mu, P = run.mu[lane], run.P[lane]
        rel, H = relative_jacobian(mu, 3)
        np.testing.assert_allclose(belief.target_rel[lane], rel, atol=1e-12)
        np.testing.assert_allclose(belief.target_rel_cov[lane], H @ P @ H.T, atol=1e-12)
        for slot in range(run.count[lane]):
            rel, H = relative_jacobian(mu, 3 + run.n_t + 2 * slot)
            np.testing.assert_allclose(belief.landmark_rel[lane, slot], rel, atol=1e-12)
            np.testing.assert_allclose(belief.landmark_rel_cov[lane, slot], H @ P @ H.T, atol=1e-12)


def test_derived_velocity_and_heading(run):
    belief = run.belief
    for lane in range(2):
        state, cov = run.mu[lane, 3 : 3 + run.n_t], run.P[lane, 3 : 3 + run.n_t, 3 : 3 + run.n_t]
        if run.n_t == 3:
            velocity = 0.3 * np.array([np.cos(state[2]), np.sin(state[2])])
            across = 0.3 * np.array([-np.sin(state[2]), np.cos(state[2])])
            velocity_cov, heading, variance = cov[2, 2] * np.outer(across, across), state[2], cov[2, 2]
        else:
            velocity, velocity_cov = state[2:], cov[2:, 2:]
            heading = np.arctan2(state[3], state[2])
            u = np.array([-state[3], state[2]]) / (state[2:] @ state[2:])
            variance = min(u @ velocity_cov @ u, math.pi**2 / 3)
        np.testing.assert_allclose(belief.target_velocity[lane], velocity, atol=1e-12)
        np.testing.assert_allclose(belief.target_velocity_cov[lane], velocity_cov, atol=1e-12)
        assert belief.target_heading[lane] == pytest.approx(heading)
        assert belief.target_heading_var[lane] == pytest.approx(variance)
        c, s = np.cos(run.mu[lane, 2]), np.sin(run.mu[lane, 2])
        np.testing.assert_allclose(belief.target_rel_velocity[lane], np.array([[c, s], [-s, c]]) @ velocity, atol=1e-12)


def test_joint_leaves_out_what_is_not_known():
    recording = record(1, 3)
    estimator = EKF(MOTION, SENSOR, TWIST, max_landmarks=10, first_heading="two-sightings")
    start(estimator, recording)
    feed(estimator, recording, 0, 1)
    assert not estimator.target_known[0]
    mean, cov = estimator.joint(0)
    assert mean.shape == (3 + 2 * estimator.count[0],)
    np.testing.assert_array_equal(mean[3:], estimator.belief.landmark_mean[0, : estimator.count[0]].ravel())
    np.testing.assert_array_equal(cov, cov.T)


def test_a_prior_makes_the_target_known():
    estimator = EKF(MOTION, SENSOR, TWIST, max_landmarks=2)
    estimator.reset(np.zeros(3), np.zeros((3, 3)), seeds=[0], target=[1.0, 2.0, 4.0], target_cov=np.eye(3))
    np.testing.assert_allclose(estimator.belief.target_mean[0], [1.0, 2.0, 4.0 - 2 * np.pi])
    np.testing.assert_allclose(estimator.joint(0)[1], np.diag([0, 0, 0, 1, 1, 1]))


def test_models_of_one_lane():
    estimator = EKF(MOTION, SENSOR, TARGET_MODEL, num_lanes=2, max_landmarks=2)
    estimator.set_models(1, type(MOTION)(speed_std=0.5, turn_std=0.0), SENSOR, TARGET_MODEL)
    estimator.reset(np.zeros(3), np.zeros((3, 3)), seeds=0)
    estimator.predict(np.tile([1.0, 0.0], (2, 1)), DT)
    np.testing.assert_allclose(estimator.belief.pose_cov[:, 0, 0], [(0.1 * DT) ** 2, (0.5 * DT) ** 2])


def test_a_step_of_no_time_changes_nothing():
    estimator = EKF(MOTION, SENSOR, TARGET_MODEL, num_lanes=2, max_landmarks=2)
    estimator.reset(np.ones(3), np.eye(3), seeds=0)
    before = estimator.get_state()
    estimator.predict(np.ones((2, 2)), 0.0)
    for name, values in estimator.get_state().items():
        np.testing.assert_array_equal(values, before[name])


def test_wide_sweeps_after_narrow_ones():
    estimator = EKF(MOTION, SENSOR, TARGET_MODEL, max_landmarks=2)
    estimator.reset(np.ones(3), np.eye(3), seeds=0)
    for width in (1, 7, 3):
        estimator.update(Scan.empty(1, width))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"association": "nearst"}, "association must be one of 'known', 'nearest', 'jcbb'"),
        ({"gate": 0.0}, "gate must be a positive NIS"),
        ({"match_gate": float("nan")}, "match_gate must be a positive NIS"),
        ({"match_gate": 16.0, "new_gate": 9.0}, "new_gate must be at least match_gate"),
        ({"budget": 0}, "budget"),
        ({"max_landmarks": 0}, "max_landmarks"),
    ],
)
def test_impossible_options(options, message):
    with pytest.raises(ValueError, match=message):
        EKF(MOTION, SENSOR, TARGET_MODEL, **{"max_landmarks": 3, **options})


def test_control_of_the_wrong_shape():
    estimator = EKF(MOTION, SENSOR, TARGET_MODEL, num_lanes=2, max_landmarks=2)
    estimator.reset(np.ones(3), np.eye(3), seeds=0)
    with pytest.raises(ValueError, match=r"control must have shape \[2, 2\]; got \[2\]"):
        estimator.predict(np.ones(2), DT)


def test_the_base_alone_is_no_filter():
    base = GaussianEstimator(MOTION, SENSOR, TARGET_MODEL, max_landmarks=2)
    base.reset(np.zeros(3), np.eye(3), seeds=0)
    with pytest.raises(NotImplementedError):
        base.predict(np.zeros((1, 2)), DT)
    with pytest.raises(NotImplementedError):
        base.update(Scan.empty(1, 1))
