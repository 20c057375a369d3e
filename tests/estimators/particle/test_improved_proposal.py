"""Eqs. (9)-(13) of Wang et al. 2019, one particle at a time in NumPy."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import multivariate_normal

from estimators.interface import TARGET
from estimators.kernels.random import uniform4
from estimators.particle.improved_proposal import RBPF
from estimators.particle.layout import DRAW_SAMPLES
from estimators.particle.sampled import BOX_FLOOR, FARTHEST, improve
from estimators.registry import make as make_estimator
from estimators.testing import checks

COV = np.array([[0.02, 0.004, 0.001], [0.004, 0.01, -0.002], [0.001, -0.002, 0.003]])
POSE = np.array([0.2, -0.1, 3.1])
STD = np.array([0.1, 0.05])


@pytest.mark.parametrize("check", checks("rbpf"), ids=str)
def test_contract(check):
    check()


@pytest.fixture(scope="module")
def looks(oracle):
    """Returns of three uncertain landmarks: rows of point, covariance, range, beam and variances."""
    rng, rows = np.random.default_rng(3), []
    for point in oracle.landmarks[:3]:
        r, b = oracle.measurement(POSE + np.array([0.1, 0.05, -0.04]), point, 2)[0] + STD * rng.normal(size=2)
        rows.append([*point, 0.02, 0.005, 0.03, r, np.cos(b), np.sin(b), *STD**2])
    return np.array(rows)


def log_joint(x, looks, oracle, cov=COV):
    """log p(z | m, x) p(x | x_minus), the first up to a constant per return."""
    total = multivariate_normal.logpdf(x, POSE, cov)
    for row in looks:
        h, H = oracle.measurement(x, row[:2], 2)
        S = H @ np.array([[row[2], row[3]], [row[3], row[4]]]) @ H.T + np.diag(STD**2)
        nu = row[5] - h[0], oracle.wrap(np.arctan2(row[7], row[6]) - h[1])
        total += multivariate_normal.logpdf(nu, cov=S) + np.log(2 * np.pi)
    return total


def run(looks, cov, samples, box=(0.0, 0.0, 0.0)):
    """Mean, covariance and log eta of one particle's proposal."""
    pose, rows = POSE[:, None].copy(), cov[np.triu_indices(3)][:, None].copy()
    key = np.uint64(7)
    log_eta = improve(
        key, 3, 0, pose, rows, looks, len(looks), np.zeros((samples, 4)), np.zeros((12, 3)), np.array(box)
    )
    out = np.zeros((3, 3))
    out[np.triu_indices(3)] = rows[:, 0]
    return pose[:, 0], out + np.triu(out, 1).T, log_eta


def test_many_whitened_samples_are_the_posterior(looks, oracle):
    """Importance sampling of the same integral from a wide Gaussian in NumPy."""
    mean, cov, log_eta = run(looks, COV, 20000)
    rng = np.random.default_rng(0)
    mode = minimize(lambda x: -log_joint(x, looks, oracle), POSE).x
    wide = multivariate_normal(mode, 4.0 * cov)
    x = wide.rvs(6000, random_state=rng)
    log_a = np.array([log_joint(row, looks, oracle) for row in x]) - wide.logpdf(x)
    a = np.exp(log_a - log_a.max())
    spread = np.sqrt(np.diag(cov))
    expected = a @ x / a.sum()
    np.testing.assert_allclose(((mean - expected + np.pi) % (2 * np.pi) - np.pi) / spread, 0.0, atol=0.06)
    d = (x - expected) / spread
    np.testing.assert_allclose(cov / np.outer(spread, spread), (a / a.sum() * d.T) @ d, atol=0.08)
    assert log_eta == pytest.approx(log_a.max() + np.log(a.mean()), abs=0.05)


def test_the_printed_box(looks, oracle):
    """Eqs. (10)-(13) as they stand, up to the constant of the box's density."""
    box, K = np.array([0.1, 0.08, 0.04]), 10
    mean, cov, log_eta = run(looks, COV, K, box)
    prior = COV + BOX_FLOOR * np.eye(3)
    u = np.array([uniform4(np.uint64(7), 0, 3, DRAW_SAMPLES, j)[:3] for j in range(K)])
    offsets = box * (2.0 * u - 1.0)
    # Gauss-Newton holds S fixed, so that its mode is off by some hundredths of the posterior's deviation.
    mode = minimize(lambda x: -log_joint(x, looks, oracle, prior), POSE).x
    x = mode + offsets
    log_a = np.array([log_joint(row, looks, oracle, prior) for row in x]) + 1.5 * np.log(2 * np.pi)
    a = np.exp(log_a - log_a.max())
    expected = a @ x / a.sum()
    np.testing.assert_allclose(mean, expected, atol=0.01)
    d = x - expected
    np.testing.assert_allclose(cov, (a / a.sum() * d.T) @ d, atol=0.1 * np.diag(cov).max())
    assert log_eta == pytest.approx(log_a.max() + np.log(a.mean()), abs=0.3)


@pytest.mark.parametrize("rank", [0, 1, 2])
def test_a_motion_without_full_rank(looks, rank):
    G = np.array([[0.1, 0.0], [0.05, 0.02], [0.0, 0.03]])[:, :rank]
    mean, cov, log_eta = run(looks, G @ G.T, 10)
    assert np.isfinite(log_eta)
    assert np.linalg.matrix_rank(cov, tol=1e-12) == rank
    outside = np.eye(3) - G @ np.linalg.pinv(G)
    np.testing.assert_allclose(outside @ (mean - POSE), 0.0, atol=1e-9)


def test_with_little_noise_the_weights_are_fastslam2s(make, oracle):
    """Where everything is linear, eta is the sweep's likelihood with the pose integrated out, whatever was sampled."""
    from estimators.models import MotionModel, SensorModel
    from estimators.particle.fastslam import FastSLAM2

    motion = MotionModel(speed_std=0.02, turn_std=0.01)
    sensor = SensorModel(max_range=20.0, range_std=0.01, bearing_std=0.003)
    weights = []
    for cls in (FastSLAM2, RBPF):
        f, rng = make("constant-velocity", cls=cls, motion=motion, sensor=sensor, particles=8), np.random.default_rng(0)
        f.reset(np.zeros(3), np.zeros((3, 3)), seeds=[1], target=oracle.priors["constant-velocity"][0],
                target_cov=0.01 * np.eye(4))  # fmt: skip
        returns = [(*oracle.measurement(np.zeros(3), m, 2)[0], k) for k, m in enumerate(oracle.landmarks)]
        f.update(oracle.scan_of(returns))
        state = f.get_state()
        state["maps"][0, :4, :2] += 0.01 * rng.normal(size=(4, 2, 8))  # so that the particles differ
        f.set_state(state)
        f.predict(np.array([[0.0, 0.0]]), 0.5)
        f.update(oracle.scan_of([*returns, (*oracle.measurement(np.zeros(3), np.array([3.0, 1.0]), 2)[0], TARGET)]))
        weights.append(f.get_state()["log_w"][0])
    assert np.ptp(weights[0]) > 1.0
    np.testing.assert_allclose(weights[1], weights[0], atol=0.05)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"samples": 3}, "samples must be at least 4"),
        ({"proposal": "optimal"}, "'whitened', 'literal'"),
        ({"box": (0.1, 0.0, 0.1)}, "three positive half widths"),
        ({"gate": 9.21}, "use 'fastslam2'"),
    ],
)
def test_wrong_options(options, message, oracle):
    with pytest.raises(ValueError, match=message):
        make_estimator("rbpf", oracle.motion, oracle.sensor, None, max_landmarks=3, **options)


def test_a_lost_particle_is_not_sent_beyond_all_numbers(looks):
    """Returns of micrometres of landmarks thought to be a million kilometres away: their mode is nowhere near."""
    lost = looks.copy()
    lost[:, :2] *= 1e9
    lost[:, 2:5] = 0.0
    lost[:, 8:] = 1e-12
    for _ in range(3):
        mean, cov, log_eta = run(lost, COV, 10)
        assert np.isfinite([*mean, *cov.ravel()]).all() and not np.isnan(log_eta)
        assert np.linalg.norm((mean - POSE)[:2]) < 1.01 * FARTHEST * np.sqrt(np.trace(COV))
        lost[:, :2] *= 10.0
