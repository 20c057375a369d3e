"""A landmark's update in all particles against the textbook's EKF, one particle after the other."""

import numpy as np
import pytest

from estimators.kernels.jit import jit
from estimators.particle.columns import assimilate, fit, sight_column, update_column

N = 203  # not a whole number of vectors
DISTANCE, BEARING, VAR_R, VAR_B = 3.0, 0.4, 0.1**2, 0.02**2


def textbook(mean, P, pose):
    """The new mean and covariance, nu' S^-1 nu and det S, and the terms b = A' S^-1 nu and A' S^-1 A."""
    dx, dy = mean - pose[:2]
    r = np.hypot(dx, dy)
    nu = np.array([DISTANCE - r, BEARING - (np.arctan2(dy, dx) - pose[2])])
    nu[1] = (nu[1] + np.pi) % (2.0 * np.pi) - np.pi
    A = np.array([[dx / r, dy / r], [-dy / r**2, dx / r**2]])
    S = A @ P @ A.T + np.diag([VAR_R, VAR_B])
    K = P @ A.T @ np.linalg.inv(S)
    inverse = np.linalg.inv(S)
    new = (np.eye(2) - K @ A) @ P
    return mean + K @ nu, new, nu @ inverse @ nu, np.linalg.det(S), A.T @ inverse @ nu, A.T @ inverse @ A


@pytest.fixture(scope="module")
def particles():
    """Poses all around a landmark, so that returns fit well, badly and not at all; covariances round and long."""
    rng = np.random.default_rng(0)
    pose = np.stack([rng.uniform(-4.0, 4.0, N), rng.uniform(-4.0, 4.0, N), rng.uniform(-np.pi, np.pi, N)])
    mean = rng.normal(size=(2, N))
    mean[:, 0] = pose[:2, 0] + [1e-3, -2e-3]  # the robot stands on it
    factor = rng.normal(size=(N, 2, 2)) * 10.0 ** rng.uniform(-3.0, 0.0, (N, 1, 1))
    factor[:50, :, 1] *= 1e-3
    return pose, mean, factor @ factor.transpose(0, 2, 1)


def test_update_of_a_column(particles):
    pose, mean, P = particles
    column = np.stack([mean[0], mean[1], P[:, 0, 0], P[:, 0, 1], P[:, 1, 1]])
    r, nu_b, nis, det = np.empty(N), np.empty(N), np.full(N, 2.0), np.full(N, 3.0)
    cosine, sine = np.cos(pose[2]), np.sin(pose[2])
    sight_column(*column[:2], pose[0], pose[1], cosine, sine, np.cos(BEARING), np.sin(BEARING), r, nu_b)
    update_column(*column, pose[0], pose[1], r, nu_b, nis, det, DISTANCE, VAR_R, VAR_B)
    for p in range(N):
        new_mean, new_P, expected_nis, expected_det, _, _ = textbook(mean[:, p], P[p], pose[:, p])
        np.testing.assert_allclose(column[:2, p], new_mean, rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(column[2:, p], new_P[[0, 0, 1], [0, 1, 1]], rtol=1e-7, atol=1e-12 * P[p].max())
        np.testing.assert_allclose([nis[p] - 2.0, det[p] / 3.0], [expected_nis, expected_det], rtol=1e-9)


def test_terms_of_a_return(particles):
    @jit
    def terms(dx, dy, p00, p01, p11, c, s):
        return fit(dx, dy, p00, p01, p11, DISTANCE, c, s, VAR_R, VAR_B)

    pose, mean, P = particles
    for p in range(N):
        beam = pose[2, p] + BEARING
        d = mean[:, p] - pose[:2, p]
        b0, b1, a00, a01, a11, nis, det = terms(*d, P[p, 0, 0], P[p, 0, 1], P[p, 1, 1], np.cos(beam), np.sin(beam))
        _, _, expected_nis, expected_det, b, A2 = textbook(mean[:, p], P[p], pose[:, p])
        np.testing.assert_allclose([b0, b1], b, rtol=1e-9, atol=1e-9 * abs(b).max())
        np.testing.assert_allclose([[a00, a01], [a01, a11]], A2, rtol=1e-9, atol=1e-9 * A2.max())
        np.testing.assert_allclose([nis, det], [expected_nis, expected_det], rtol=1e-9)


@pytest.mark.parametrize("size", [1e-30, 1e-6, 1.0, 1e6])
def test_a_posterior_is_positive_whatever_the_scale(size):
    @jit
    def update(dx, dy, p00, p01, p11, c, s):
        return assimilate(dx, dy, p00, p01, p11, DISTANCE, c, s, VAR_R, VAR_B)

    for dx, dy in ((0.0, 0.0), (1e-9, 0.0), (3.0, 1e-3), (-2.0, 2.0)):
        *step, xx, xy, yy, nis, det = update(dx, dy, size, 0.0, size, 1.0, 0.0)
        assert np.isfinite([*step, nis, det]).all()
        assert xx > 0.0 and yy > 0.0 and xx * yy > xy * xy and xx + yy <= 2.0 * size * (1.0 + 1e-12)
