"""The left-looking update against textbook updates, one return after the other, on dense matrices."""

import numpy as np
import pytest

from estimators.kernels import left_looking as ll
from estimators.kernels.jit import jit
from estimators.kernels.simd import aligned_zeros

N, USED = 48, 47


@jit
def take_in(mu, P, work, js, A, c, y, R):
    """Returns of the points at rows js, one after the other; the innovations y are given."""
    rows = 0
    for k in range(js.size):
        if rows == ll.ROWS:
            ll.settle(P, work, 0, P.shape[1], rows)
            rows = 0
        s00, s01, s11 = ll.spread(
            P, work, 0, P.shape[1], rows, js[k], A[k, 0, 0], A[k, 0, 1], A[k, 1, 0], A[k, 1, 1], c[k, 0], c[k, 1]
        )
        ll.collect(mu, 0, work, P.shape[1], rows, y[k, 0], y[k, 1], s00 + R[0], s01, s11 + R[1])
        rows += 2
    ll.settle(P, work, 0, P.shape[1], rows)


@jit
def heading_after(P, work, js, A, c, R):
    """The heading's row of P after the returns, without settling it."""
    none = np.zeros((1, P.shape[1]))
    for k in range(js.size):
        s00, s01, s11 = ll.spread(
            P, work, 0, P.shape[1], 2 * k, js[k], A[k, 0, 0], A[k, 0, 1], A[k, 1, 0], A[k, 1, 1], c[k, 0], c[k, 1]
        )
        ll.collect(none, 0, work, P.shape[1], 2 * k, 0.0, 0.0, s00 + R[0], s01, s11 + R[1])
    ll.keep_heading(P, work, 0, P.shape[1], 2 * js.size)
    return work[ll.TURN].copy()


def textbook(mu, P, j, A, c, y, R):
    """K = P H' S^-1, mu += K y, P -= K S K' with H = [-A, c, A]."""
    H = np.zeros((2, N))
    H[:, :2], H[:, 2], H[:, j : j + 2] = -A, c, A
    S = H @ P @ H.T + np.diag(R)
    K = P @ H.T @ np.linalg.inv(S)
    return mu + K @ y, P - K @ S @ K.T


@pytest.fixture
def joint():
    rng = np.random.default_rng(5)
    mu, P = np.zeros((1, N)), aligned_zeros(1, N, N)
    root = rng.standard_normal((USED, USED))
    P[0, :USED, :USED] = root @ root.T + np.eye(USED)
    P[0] = (P[0] + P[0].T) / 2
    mu[0, :USED] = rng.standard_normal(USED)
    return mu, P


def returns(count):
    rng = np.random.default_rng(count)
    js = 3 + 2 * rng.integers(0, (USED - 3) // 2, count)  # some points are seen again
    return js, rng.standard_normal((count, 2, 2)), rng.standard_normal((count, 2)), rng.standard_normal((count, 2))


@pytest.mark.parametrize("count", [1, 2, 9, 16, 17, 40])
def test_equals_one_update_after_the_other(joint, count):
    mu, P = joint
    js, A, c, y = returns(count)
    R = np.array([0.3, 0.2])
    expected_mu, expected_P = mu[0].copy(), P[0].copy()
    for k in range(count):
        expected_mu, expected_P = textbook(expected_mu, expected_P, js[k], A[k], c[k], y[k], R)
    take_in(mu, P, ll.scratch(N), js, A, c, y, R)
    np.testing.assert_allclose(mu[0], expected_mu, atol=1e-9)
    np.testing.assert_allclose(P[0], expected_P, atol=1e-9)
    np.testing.assert_array_equal(P[0], P[0].T)  # to the last bit
    assert not P[0, USED:].any()  # rows not in use stay zero


@pytest.mark.parametrize("count", [0, 5])
def test_the_heading_as_it_will_be(joint, count):
    _, P = joint
    js, A, c, _ = returns(count)
    R = np.array([0.3, 0.2])
    expected = P[0].copy()
    for k in range(count):
        _, expected = textbook(np.zeros(N), expected, js[k], A[k], c[k], np.zeros(2), R)
    found = heading_after(P, ll.scratch(N), js, A, c, R)
    np.testing.assert_allclose(found[:N], expected[2], atol=1e-9)
