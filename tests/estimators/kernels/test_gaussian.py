"""Every operation on the joint Gaussian against dense matrices."""

import numpy as np
import pytest

from estimators.kernels import gaussian as g
from estimators.kernels.jit import jit

N_T, COUNT = 4, 5
N = 24  # 3 + 4 + 2 * 5 = 17, in whole blocks


@jit
def _move_robot(P, hx, hy, q):
    g.move_robot(P, 0, P.shape[1], hx, hy, q[0], q[1], q[2], q[3], q[4], q[5])


@jit
def _shear(P, row, by, factor):
    g.shear(P, 0, P.shape[1], row, by, factor)


@jit
def _drift(mu, P, density, dt):
    g.drift_velocity(mu, P, 0, P.shape[1], density, dt)


@jit
def _body(P, hx, hy, q):
    g.move_heading_body(P, 0, P.shape[1], 3, hx, hy, q[0], q[1], q[2], q[3], q[4], q[5])


@jit
def _update(mu, P, W, j, A, c, y, R):
    s00, s01, s11 = g.innovation_cov(P, 0, j, A[0], A[1], A[2], A[3], c[0], c[1], R[0], R[1])
    nis, log_det = g.nis_and_log_det(s00, s01, s11, y[0], y[1])
    g.downdate(mu, 0, P, W, 0, P.shape[1], j, A[0], A[1], A[2], A[3], c[0], c[1], y[0], y[1], s00, s01, s11)
    return nis, log_det


@jit
def _append(mu, P, j, x, y, g0, g1, noise):
    g.append_point(mu, P, 0, P.shape[1], j, x, y, g0, g1, noise[0], noise[1], noise[2])


@pytest.fixture
def joint():
    rng = np.random.default_rng(3)
    used = 3 + N_T + 2 * COUNT
    mu, P = np.zeros((1, N)), np.zeros((1, N, N))
    A = rng.standard_normal((used, used))
    mu[0, :used], P[0, :used, :used] = rng.standard_normal(used), A @ A.T
    P[0] = (P[0] + P[0].T) / 2
    return mu, P


def same(P, expected):
    np.testing.assert_array_equal(P[0], P[0].T)  # to the last bit
    np.testing.assert_allclose(P[0], expected, atol=1e-9)


def test_rows_in_use_are_whole_blocks():
    assert g.rows_in_use(4, 20) == 48
    assert g.rows_in_use(0, 0) == 8


def test_move_robot(joint):
    _, P = joint
    q = np.array([0.3, 0.1, 0.05, 0.4, 0.02, 0.2])
    F, Q = np.eye(N), np.zeros((N, N))
    F[0, 2], F[1, 2] = 0.7, -0.4
    Q[np.triu_indices(3)] = q
    Q[:3, :3] = np.triu(Q[:3, :3]) + np.triu(Q[:3, :3], 1).T
    expected = F @ P[0] @ F.T + Q
    _move_robot(P, 0.7, -0.4, q)
    same(P, expected)


def test_shear(joint):
    _, P = joint
    E = np.eye(N)
    E[4, 2] = 0.3
    expected = E @ P[0] @ E.T
    _shear(P, 4, 2, 0.3)
    same(P, expected)


def test_constant_velocity_target(joint):
    mu, P = joint
    dt, q = 0.2, 0.3**2
    F, Q = np.eye(N), np.zeros((N, N))
    F[3, 5] = F[4, 6] = dt
    for position, velocity in ((3, 5), (4, 6)):
        Q[position, position], Q[velocity, velocity] = q * dt**3 / 3, q * dt
        Q[position, velocity] = Q[velocity, position] = q * dt**2 / 2
    expected, mean = F @ P[0] @ F.T + Q, F @ mu[0]
    _drift(mu, P, 0.3, dt)
    same(P, expected)
    np.testing.assert_allclose(mu[0], mean, atol=1e-12)


def test_target_with_a_heading(joint):
    _, P = joint
    q = np.array([0.3, 0.1, 0.05, 0.4, 0.02, 0.2])
    F, Q = np.eye(N), np.zeros((N, N))
    F[3, 5], F[4, 5] = 0.7, -0.4
    block = np.zeros((3, 3))
    block[np.triu_indices(3)] = q
    Q[3:6, 3:6] = block + np.triu(block, 1).T
    expected = F @ P[0] @ F.T + Q
    _body(P, 0.7, -0.4, q)
    same(P, expected)


def test_update_by_one_return(joint):
    mu, P = joint
    j, A, c = 9, np.array([0.6, 0.8, -0.4, 0.3]), np.array([0.1, -0.9])
    y, R = np.array([0.3, -0.2]), np.array([0.04, 0.01])
    H = np.zeros((2, N))
    H[:, :2], H[:, 2], H[:, j : j + 2] = -A.reshape(2, 2), c, A.reshape(2, 2)
    S = H @ P[0] @ H.T + np.diag(R)
    K = P[0] @ H.T @ np.linalg.inv(S)
    expected, mean = P[0] - K @ S @ K.T, mu[0] + K @ y
    nis, log_det = _update(mu, P, np.zeros((2, N)), j, A, c, y, R)
    same(P, expected)
    np.testing.assert_allclose(mu[0], mean, atol=1e-9)
    assert nis == pytest.approx(y @ np.linalg.solve(S, y), rel=1e-9)
    assert log_det == pytest.approx(np.linalg.slogdet(S)[1], rel=1e-9)


def test_a_matrix_that_is_not_positive_gives_nan():
    assert np.isnan(g.nis_and_log_det(1.0, 2.0, 1.0, 0.1, 0.1)).all()
    assert np.isnan(g.nis_and_log_det(-1.0, 0.0, -1.0, 0.1, 0.1)).all()


def test_append_point(joint):
    mu, P = joint
    j = 3 + N_T + 2 * COUNT
    G = np.zeros((2, N))
    G[0, 0] = G[1, 1] = 1.0
    G[:, 2] = 0.5, -0.3
    grown = np.eye(N)
    grown[j : j + 2] = G
    expected = grown @ P[0] @ grown.T
    expected[j : j + 2, j : j + 2] += [[0.2, 0.1], [0.1, 0.3]]
    _append(mu, P, j, 1.5, 2.5, 0.5, -0.3, np.array([0.2, 0.1, 0.3]))
    same(P, expected)
    np.testing.assert_array_equal(mu[0, j : j + 2], [1.5, 2.5])


@pytest.mark.parametrize("slot", [0, 2, COUNT - 1])
def test_remove_landmark(joint, slot):
    mu, P = joint
    ids, first = np.arange(10, 16)[None].copy(), np.arange(12.0).reshape(1, 6, 2)
    count = np.array([COUNT])
    kept = [k for k in range(COUNT) if k != slot]
    if slot != COUNT - 1:
        kept.insert(slot, kept.pop())
    rows = [*range(3 + N_T), *(3 + N_T + 2 * k + d for k in kept for d in (0, 1))]
    mean, cov, names, points = mu[0, rows], P[0][np.ix_(rows, rows)], ids[0, kept], first[0, kept]
    g.remove_landmark(mu, P, count, ids, first, 0, slot, N_T)
    n = len(rows)
    assert count[0] == COUNT - 1
    np.testing.assert_array_equal(mu[0, :n], mean)
    np.testing.assert_array_equal(P[0, :n, :n], cov)
    np.testing.assert_array_equal(ids[0, : COUNT - 1], names)
    np.testing.assert_array_equal(first[0, : COUNT - 1], points)
    assert not P[0, n:].any()
    assert not P[0, :, n:].any()
    assert not mu[0, n:].any()
