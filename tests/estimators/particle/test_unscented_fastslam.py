"""Sigma points in NumPy, as the textbook has them: weights 1 / (2 n), none in the centre."""

import numpy as np
import pytest

from estimators.interface import TARGET
from estimators.kernels.motion import displacement
from estimators.models import MotionModel, SensorModel
from estimators.particle.fastslam import FastSLAM2
from estimators.particle.unscented import (
    assimilate_unscented,
    condition_unscented,
    first_sighting_unscented,
    predict_poses_unscented,
)
from estimators.particle.unscented_fastslam import UnscentedFastSLAM
from estimators.registry import make as make_estimator
from estimators.testing import checks

COV = np.array([[0.05, 0.01, 0.004], [0.01, 0.03, -0.005], [0.004, -0.005, 0.02]])
POINT_COV = np.array([[0.4, 0.1], [0.1, 0.3]])
POSE, POINT = np.array([0.2, -0.1, 3.1]), np.array([-1.6, 0.9])
STD = np.array([0.1, 0.3])


@pytest.mark.parametrize("check", checks("unscented-fastslam"), ids=str)
def test_contract(check):
    check()


@pytest.mark.parametrize("check", checks("unscented-fastslam", association="nearest")[:6], ids=str)
def test_contract_unlabelled(check):
    check()


def transform(f, mean, cov, angle=None):
    """Mean, covariance and Cov(x, f) of f(x); `angle`: the coordinate of f that is averaged about f(mean)."""
    n = len(mean)
    L = np.linalg.cholesky(cov + 1e-14 * np.eye(n))
    points = np.concatenate([mean + np.sqrt(n) * L.T, mean - np.sqrt(n) * L.T])
    centre = f(mean)
    d = np.array([f(x) for x in points]) - centre
    if angle is not None:
        d[:, angle] = (d[:, angle] + np.pi) % (2.0 * np.pi) - np.pi
    e = d.mean(axis=0)
    return centre + e, (d - e).T @ (d - e) / (2 * n), (points - mean).T @ (d - e) / (2 * n)


def ray(x):
    """Range and bearing of the point (x[3], x[4]) from the pose x[:3]."""
    d = x[3:5] - x[:2]
    return np.array([np.hypot(*d), np.arctan2(d[1], d[0]) - x[2]])


def wrap(angle):
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


@pytest.mark.parametrize("kind", ["unicycle", "bicycle"])
def test_prediction(kind):
    from estimators.models import pack_models

    model = pack_models(MotionModel(kind=kind, speed_std=1.5, turn_std=0.4, wheelbase=2.0), SensorModel(), None)[()]
    pose, rows = POSE[:, None].copy(), COV[np.triu_indices(3)][:, None].copy()
    predict_poses_unscented(pose, rows, model, 1.2, 0.3, 0.5, np.zeros((12, 3)))
    joint = np.zeros((5, 5))
    joint[:3, :3], joint[3, 3], joint[4, 4] = COV, 1.5**2, 0.4**2
    mean, cov, _ = transform(
        lambda x: x[:3] + np.array(displacement(model, x[3], x[4], 0.5, x[2])), np.array([*POSE, 1.2, 0.3]), joint
    )
    np.testing.assert_allclose(pose[:2, 0], mean[:2], atol=1e-6)
    assert wrap(pose[2, 0] - mean[2]) == pytest.approx(0.0, abs=1e-6)
    np.testing.assert_allclose(rows[:, 0], cov[np.triu_indices(3)], atol=1e-6)


def test_a_pose_conditioned_on_a_return():
    z = np.array([2.3, -0.4])
    joint = np.zeros((5, 5))
    joint[:3, :3], joint[3:, 3:] = COV, POINT_COV
    mean, S, cross = transform(ray, np.array([*POSE, *POINT]), joint, angle=1)
    S = S + np.diag(STD**2)
    K = cross[:3] @ np.linalg.inv(S)
    nu = z - mean
    nu[1] = wrap(nu[1])
    pose, rows = POSE[:, None].copy(), COV[np.triu_indices(3)][:, None].copy()
    look = np.array([[*POINT, 0.4, 0.1, 0.3, z[0], np.cos(z[1]), np.sin(z[1]), *STD**2]])
    log_likelihood = condition_unscented(pose, rows, 0, look, 1, np.zeros((12, 3)))
    expected = POSE + K @ nu
    np.testing.assert_allclose(pose[:2, 0], expected[:2], atol=1e-6)
    assert wrap(pose[2, 0] - expected[2]) == pytest.approx(0.0, abs=1e-6)
    np.testing.assert_allclose(rows[:, 0], (COV - K @ S @ K.T)[np.triu_indices(3)], atol=1e-6)
    assert log_likelihood == pytest.approx(-0.5 * (nu @ np.linalg.solve(S, nu) + np.log(np.linalg.det(S))), abs=1e-6)


def test_a_landmark_seen_again():
    z = np.array([2.3, -0.4])
    mean, S, cross = transform(lambda x: ray(np.array([*POSE, *x])), POINT, POINT_COV, angle=1)
    S = S + np.diag(STD**2)
    K = cross @ np.linalg.inv(S)
    nu = z - mean
    nu[1] = wrap(nu[1])
    beam = z[1] + POSE[2]
    *step, xx, xy, yy, nis, det = assimilate_unscented(
        *(POINT - POSE[:2]), 0.4, 0.1, 0.3, z[0], np.cos(beam), np.sin(beam), *STD**2
    )
    np.testing.assert_allclose(step, K @ nu, atol=1e-6)
    np.testing.assert_allclose([[xx, xy], [xy, yy]], POINT_COV - K @ S @ K.T, atol=1e-6)
    np.testing.assert_allclose([nis, det], [nu @ np.linalg.solve(S, nu), np.linalg.det(S)], rtol=1e-6)


def test_a_first_sighting():
    z = np.array([2.3, 0.7])
    mean, cov, _ = transform(lambda x: x[0] * np.array([np.cos(x[1]), np.sin(x[1])]), z, np.diag(STD**2))
    x, y, xx, xy, yy = first_sighting_unscented(np.cos(0.7), np.sin(0.7), 2.3, *STD**2)
    np.testing.assert_allclose([x, y], mean, atol=1e-6)
    np.testing.assert_allclose([[xx, xy], [xy, yy]], cov, atol=1e-6)


def test_with_little_noise_it_is_fastslam2(make, oracle):
    motion = MotionModel(speed_std=0.02, turn_std=0.01)
    sensor = SensorModel(max_range=20.0, range_std=0.01, bearing_std=0.003)
    weights, poses = [], []
    for cls in (FastSLAM2, UnscentedFastSLAM):
        f = make("constant-velocity", cls=cls, motion=motion, sensor=sensor, particles=8)
        f.reset(np.zeros(3), np.zeros((3, 3)), seeds=[1], target=oracle.priors["constant-velocity"][0],
                target_cov=0.01 * np.eye(4))  # fmt: skip
        returns = [(*oracle.measurement(np.zeros(3), m, 2)[0], k) for k, m in enumerate(oracle.landmarks)]
        f.update(oracle.scan_of(returns))
        state = f.get_state()
        state["maps"][0, :4, :2] += 0.01 * np.random.default_rng(0).normal(size=(4, 2, 8))  # so that particles differ
        f.set_state(state)
        f.predict(np.array([[0.0, 0.0]]), 0.5)
        f.update(oracle.scan_of([*returns, (*oracle.measurement(np.zeros(3), np.array([3.0, 1.0]), 2)[0], TARGET)]))
        weights.append(f.get_state()["log_w"][0])
        poses.append(f.belief.particles(0)[0])
    assert np.ptp(weights[0]) > 1.0
    np.testing.assert_allclose(weights[1], weights[0], atol=0.05)
    np.testing.assert_allclose(poses[1], poses[0], atol=1e-3)


def test_labelled_returns_are_not_gated(oracle):
    with pytest.raises(ValueError, match="use 'fastslam2'"):
        make_estimator("unscented-fastslam", oracle.motion, oracle.sensor, None, max_landmarks=3, gate=9.21)


@pytest.mark.slow
def test_where_bearings_are_poor_it_is_more_consistent_than_fastslam2():
    """Paired runs: the 95 % intervals of the gain in consistency and in error exclude zero."""
    from slam_gym.scenario import Scenario
    from slam_gym.simulation import Simulation

    numbers = {"sensor.bearing_std": 0.3, "robot.turn_std": 1.0, "robot.speed_std": 1.0}
    names, runs = ("fastslam2", "unscented-fastslam"), 60
    sim = Simulation(Scenario.load("slamto", **numbers), [(name, {"particles": 50}) for name in names], runs)
    sim.reset(np.arange(runs))
    inside, error = np.zeros((2, runs)), np.zeros((2, runs))
    for step in range(1, 321):
        sim.advance(np.tile([3.0, 1.0], (runs, 1)))
        if step % 8 or step == 8:
            continue
        for i, f in enumerate(sim.estimators):
            d = f.belief.pose - sim.world.pose
            d[:, 2] = wrap(d[:, 2])
            nees = np.einsum(
                "li,li->l", d, np.linalg.solve(f.belief.pose_cov + 1e-12 * np.eye(3), d[..., None])[..., 0]
            )
            inside[i] += ((nees > 0.2158) & (nees < 9.348)) / 39
            error[i] += np.hypot(d[:, 0], d[:, 1]) / 39
    for gain in (inside[1] - inside[0], error[0] - error[1]):
        assert gain.mean() > 1.96 * gain.std(ddof=1) / np.sqrt(runs)
