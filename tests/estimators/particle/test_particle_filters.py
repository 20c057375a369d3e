"""Each particle's EKFs and weights against the textbook in NumPy, to 1e-9."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from estimators.interface import TARGET

KINDS = ("twist", "constant-velocity")


def noise(sensor, distance):
    return np.diag([(sensor.range_std + sensor.range_std_per_range * distance) ** 2, sensor.bearing_std**2])


@pytest.mark.parametrize("kind", KINDS)
def test_update_of_landmarks_and_target_and_their_weights(make, oracle, kind):
    f = make(kind)
    rng = np.random.default_rng(0)
    target = oracle.priors[kind][0][:2]
    f.update(oracle.scan_of(oracle.sweep(np.zeros(3), target, rng)))
    f.predict(np.array([[1.0, 0.4]]), 0.3)
    before, returns = f.get_state(), oracle.sweep(np.array([0.3, 0.0, 0.1]), target, rng)
    f.update(oracle.scan_of(returns))
    after = f.get_state()
    n_t = len(f.target_names)
    log_w = before["log_w"][0].copy()
    for p in range(f.num_particles):
        pose = before["pose"][0, :, p]
        for r, b, label in returns:
            mean, cov = (
                oracle.unpack(before["target"][0, 0, :, p], n_t)
                if label == TARGET
                else oracle.unpack(before["maps"][0, label, :, p], 2)
            )
            mean, cov, nu, S = oracle.ekf_update(pose, mean, cov, np.array([r, b]), noise(oracle.sensor, r))
            log_w[p] += multivariate_normal.logpdf(nu, cov=S)
            new = after["target"][0, 0, :, p] if label == TARGET else after["maps"][0, label, :, p]
            new_mean, new_cov = oracle.unpack(new, len(mean))
            np.testing.assert_allclose(new_mean, mean, atol=1e-9)
            np.testing.assert_allclose(new_cov, cov, atol=1e-9)
    np.testing.assert_allclose(after["log_w"][0], log_w - log_w.max(), atol=1e-9)
    expected = np.exp(log_w - log_w.max())
    np.testing.assert_allclose(f.belief.particles(0)[1], expected / expected.sum(), atol=1e-9)


def test_first_sighting_of_a_landmark(make, oracle):
    f = make(None)
    f.update(oracle.scan_of([(3.0, 0.5, 7)]))
    state = f.get_state()
    for p in range(f.num_particles):
        x, y, heading = state["pose"][0, :, p]
        c, s = np.cos(heading + 0.5), np.sin(heading + 0.5)
        J = np.array([[c, -3.0 * s], [s, 3.0 * c]])
        mean, cov = oracle.unpack(state["maps"][0, 0, :, p], 2)
        np.testing.assert_allclose(mean, [x + 3.0 * c, y + 3.0 * s], atol=1e-12)
        np.testing.assert_allclose(cov, J @ noise(oracle.sensor, 3.0) @ J.T, atol=1e-12)
    assert f.belief.landmark_id[0].tolist() == [7, -1, -1, -1, -1, -1]


def test_prediction_of_a_twist_target(make, oracle):
    f = make("twist")
    mean, cov = oracle.priors["twist"]
    model, dt = oracle.targets["twist"], 0.2
    f.predict(np.zeros((1, 2)), dt)
    end, v = mean[2] + model.turn_rate * dt, model.speed
    F = np.array([[1, 0, -v * dt * np.sin(end)], [0, 1, v * dt * np.cos(end)], [0, 0, 1]])
    G = dt * np.array([[np.cos(end), -v * dt * np.sin(end)], [np.sin(end), v * dt * np.cos(end)], [0, 1]])
    Q = np.diag([model.speed_std**2, model.turn_std**2])
    new_mean, new_cov = oracle.unpack(f.get_state()["target"][0, 0, :, 3], 3)
    np.testing.assert_allclose(new_mean, [mean[0] + v * dt * np.cos(end), mean[1] + v * dt * np.sin(end), end])
    np.testing.assert_allclose(new_cov, F @ cov @ F.T + G @ Q @ G.T, atol=1e-12)


def test_prediction_of_a_constant_velocity_target(make, oracle):
    f = make("constant-velocity")
    mean, cov = oracle.priors["constant-velocity"]
    q, dt = oracle.targets["constant-velocity"].acceleration_density ** 2, 0.2
    f.predict(np.zeros((1, 2)), dt)
    F = np.eye(4)
    F[0, 2] = F[1, 3] = dt
    Q = np.kron(q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]), np.eye(2))
    new_mean, new_cov = oracle.unpack(f.get_state()["target"][0, 0, :, 3], 4)
    np.testing.assert_allclose(new_mean, F @ mean, atol=1e-12)
    np.testing.assert_allclose(new_cov, F @ cov @ F.T + Q, atol=1e-12)


def test_a_lost_target_is_updated_to_the_mode_of_its_posterior(make, oracle):
    f = make("constant-velocity")
    mean, cov = np.array([3.0, 1.0, 0.0, 0.0]), np.diag([9.0, 4.0, 1.0, 1.0]) + 0.5
    f.reset(np.zeros(3), np.zeros((3, 3)), seeds=[1], target=mean, target_cov=cov)
    z = np.array([4.0, -0.7])
    f.update(oracle.scan_of([(*z, TARGET)]))
    got, got_cov = oracle.unpack(f.get_state()["target"][0, 0, :, 0], 4)
    h, H = oracle.measurement(np.zeros(3), got, 4)
    R_inverse = np.linalg.inv(noise(oracle.sensor, z[0]))
    gradient = H.T @ R_inverse @ (z - h) - np.linalg.solve(cov, got - mean)
    np.testing.assert_allclose(np.linalg.solve(np.linalg.inv(cov) + H.T @ R_inverse @ H, gradient), 0.0, atol=1e-8)
    np.testing.assert_allclose(np.linalg.inv(got_cov), np.linalg.inv(cov) + H.T @ R_inverse @ H, rtol=1e-6)


def test_particles_spread_as_the_motion_model_says(make, oracle):
    f = make(None, particles=20001)
    f.reset(np.array([1.0, 2.0, 3.0]), np.zeros((3, 3)), seeds=[3])
    f.predict(np.array([[1.0, 0.5]]), 0.1)
    pose, w = f.belief.particles(0)
    turn = oracle.wrap(pose[:, 2] - 3.0) / 0.1
    speed = ((pose[:, 0] - 1.0) * np.cos(pose[:, 2]) + (pose[:, 1] - 2.0) * np.sin(pose[:, 2])) / 0.1
    np.testing.assert_allclose([speed.mean(), turn.mean()], [1.0, 0.5], atol=0.012)
    np.testing.assert_allclose(np.cov(speed, turn), np.diag([0.16, 0.09]), atol=0.006)
    np.testing.assert_allclose(w, 1.0 / 20001)


def test_particles_of_a_bicycle(make, oracle):
    from estimators.models import MotionModel

    f = make(None, motion=MotionModel(kind="bicycle", speed_std=0.0, turn_std=0.0, wheelbase=2.0))
    f.reset(np.array([1.0, 2.0, 3.0]), np.zeros((3, 3)), seeds=[3])
    f.predict(np.array([[1.5, 0.3]]), 0.1)
    expected = [1.0 + 0.15 * np.cos(3.3), 2.0 + 0.15 * np.sin(3.3), 3.0 + 0.15 * np.sin(0.3) / 2.0]
    np.testing.assert_allclose(f.belief.pose[0], expected, atol=1e-12)


def test_the_prior_is_sampled(make):
    f = make(None, particles=20000)
    cov = np.array([[0.5, 0.2, 0.1], [0.2, 0.4, -0.1], [0.1, -0.1, 0.3]])
    f.reset(np.array([1.0, 2.0, 0.3]), cov, seeds=[3])
    np.testing.assert_allclose(f.belief.pose[0], [1.0, 2.0, 0.3], atol=0.02)
    np.testing.assert_allclose(f.belief.pose_cov[0], cov, atol=0.02)
