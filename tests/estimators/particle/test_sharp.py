"""A return far sharper than what was known of the target, against the textbook's update in more digits."""

import numpy as np
import pytest

from estimators.particle.sharp import factorise, multiply, sharpen

ROBOT = np.array([0.4, -0.3])
BEAM = np.array([np.cos(0.7), np.sin(0.7)])  # the return's direction in the world's axes
DISTANCE, SECTOR = 2.0, np.pi / 4


def prior(n_t, std):
    """A target of unknown heading a step after its first sighting: its place hangs on the heading, but for `std`."""
    way = np.array([-0.06, 0.08])
    cov = np.diag([std**2, std**2, SECTOR**2 / 12, 0.3][:n_t]).astype(np.longdouble)
    E = np.eye(n_t, dtype=np.longdouble)
    E[:2, 2] = way
    return E @ cov @ E.T


def textbook(mean, cov, z, R):
    """The EKF's update in 64 binary digits: mean, covariance, nu' S^-1 nu, det S."""
    d = mean[:2] - ROBOT
    r = np.sqrt(d @ d)
    H = np.zeros((2, len(mean)), dtype=np.longdouble)
    H[:, :2] = [[d[0] / r, d[1] / r], [-d[1] / r**2, d[0] / r**2]]
    nu = z - np.array([r, np.arctan2(d[1], d[0])])
    S = H @ cov @ H.T + R
    det = S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0]
    inverse = np.array([[S[1, 1], -S[0, 1]], [-S[1, 0], S[0, 0]]]) / det
    K = cov @ H.T @ inverse
    J = np.eye(len(mean), dtype=np.longdouble) - K @ H
    return mean + K @ nu, J @ cov @ J.T + K @ R @ K.T, nu @ inverse @ nu, det


def sharpened(mean, cov, stds, spread=np.inf):
    """The same by the kernel, in both of two particles; the terms as it leaves them."""
    n_t = len(mean)
    column = np.concatenate([mean, cov[np.triu_indices(n_t)]]).astype(float)
    rows, terms, work = np.tile(column[:, None], (1, 2)), np.ones((7, 2)), np.zeros((8, 2))
    one = np.ones(2)
    sharpen(
        rows, n_t, terms, work, ROBOT[0] * one, ROBOT[1] * one, one, 0.0 * one, DISTANCE, BEAM[0], BEAM[1],
        stds[0] ** 2, stds[1] ** 2, spread,
    )  # fmt: skip
    np.testing.assert_array_equal(rows[:, 0], rows[:, 1])
    P = np.zeros((n_t, n_t))
    P[np.triu_indices(n_t)] = rows[n_t:, 0]
    return rows[:n_t, 0], P + np.triu(P, 1).T, terms[:, 0]


@pytest.mark.parametrize("n_t", [3, 4])
@pytest.mark.parametrize("std", [1e-6, 1e-9])
def test_posterior_and_likelihood_to_the_last_digits(n_t, std):
    cov, stds = prior(n_t, std), (1e-6, 2e-7)
    mean = np.concatenate([ROBOT + DISTANCE * BEAM + [1e-3, -2e-3], [0.3, 0.1][: n_t - 2]]).astype(np.longdouble)
    got, P, terms = sharpened(mean, cov, stds)
    z = np.array([DISTANCE, np.arctan2(BEAM[1], BEAM[0])], dtype=np.longdouble)
    expected, posterior, nis, det = textbook(mean, cov, z, np.diag(np.square(stds)).astype(np.longdouble))
    scale = np.sqrt(np.diag(posterior)).astype(float)
    np.testing.assert_allclose((got - expected).astype(float) / scale, 0.0, atol=1e-2)
    np.testing.assert_allclose((P - posterior).astype(float) / np.outer(scale, scale), 0.0, atol=1e-2)
    assert np.linalg.eigvalsh(P / np.outer(scale, scale)).min() > -1e-12
    assert terms[5:].tolist() == pytest.approx([float(nis), float(det)], rel=1e-2)
    np.testing.assert_array_equal(terms[:5], 0.0)


def test_a_vague_one_is_iterated_to_where_the_return_is():
    mean = np.array([ROBOT[0] + 3.0, ROBOT[1], 0.3])
    got, P, _ = sharpened(mean, np.diag([4.0, 4.0, 0.1]), (1e-5, 1e-5), spread=0.2)
    np.testing.assert_allclose(got[:2], ROBOT + DISTANCE * BEAM, atol=1e-8)
    np.testing.assert_allclose(np.sqrt(np.linalg.eigvalsh(P)), [1e-5, 2e-5, np.sqrt(0.1)], rtol=1e-6)


def test_an_ordinary_return_is_left_to_the_plain_form():
    mean, cov = np.append(ROBOT + DISTANCE * BEAM, 0.3), prior(3, 0.1).astype(float)
    got, P, terms = sharpened(mean, cov, (0.05, 0.02))
    np.testing.assert_array_equal(got, mean)
    np.testing.assert_array_equal(P, cov)
    np.testing.assert_array_equal(terms, 1.0)


@pytest.mark.parametrize("rank", [1, 2, 4])
def test_factors_are_the_covariances_also_where_it_is_singular(rank):
    root = np.random.default_rng(rank).standard_normal((4, rank))
    cov = root @ root.T
    rows = np.concatenate([np.zeros(4), cov[np.triu_indices(4)]])[:, None]
    factorise(rows, 4, 0)
    assert (rows[[4, 8, 11, 13], 0] >= 0.0).all()
    multiply(rows, 4, 0)
    np.testing.assert_allclose(rows[4:, 0], cov[np.triu_indices(4)], atol=1e-12)
