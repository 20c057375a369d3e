"""The loops of the left-looking update against NumPy's matrix products."""

import numpy as np
import pytest

from estimators.kernels import simd_rows as rows_of
from estimators.kernels.jit import jit
from estimators.kernels.simd import aligned_zeros

N, ROOM, TURN = 48, 56, 14  # columns in use and in all, the row of the scratch where the heading's stands


@jit
def _copy(P, lane, i, W, row, n):
    rows_of.copy_row(P, lane, i, W, row, n)


@jit
def _offset(P, lane, j, W, rows, n):
    rows_of.offset_rows(P, lane, j, W, rows, n)


@jit
def _measured(W, rows, turn, n, A, c):
    rows_of.measured_rows(W, rows, turn, n, A[0, 0], A[0, 1], A[1, 0], A[1, 1], c[0], c[1])


@jit
def _whitened(x, lane, W, rows, turn, n, t0, t1, l10, e0, e1):
    rows_of.whitened_rows(x, lane, W, rows, turn, n, t0, t1, l10, e0, e1)


@pytest.fixture
def arrays():
    rng = np.random.default_rng(3)
    P, W, x = aligned_zeros(2, ROOM, ROOM), aligned_zeros(20, ROOM), aligned_zeros(2, ROOM)
    for array in (P, W, x):
        array[:] = rng.standard_normal(array.shape)
    return P, W, x


def test_copy_row(arrays):
    P, W, _ = arrays
    expected = W.copy()
    expected[TURN, :N] = P[1, 2, :N]
    _copy(P, 1, 2, W, TURN, N)
    np.testing.assert_array_equal(W, expected)


@pytest.mark.parametrize("n", [8, 16, 32, N])
@pytest.mark.parametrize("rows", [0, 2, 10])
def test_offset_rows(arrays, n, rows):
    P, W, _ = arrays
    j, expected = 5, W.copy()
    P[1] -= W[:rows].T @ W[:rows]
    expected[rows : rows + 2, :n] = (P[1, j : j + 2] - P[1, :2])[:, :n]
    P[1] += W[:rows].T @ W[:rows]
    _offset(P, 1, j, W, rows, n)
    np.testing.assert_allclose(W, expected, atol=1e-12)


def test_measured_rows(arrays):
    _, W, _ = arrays
    A, c, rows = np.array([[0.6, 0.8], [-0.2, 0.15]]), np.array([0.3, -1.0]), 4
    expected = W.copy()
    expected[rows : rows + 2, :N] = A @ W[rows : rows + 2, :N] + np.outer(c, W[TURN, :N])
    _measured(W, rows, TURN, N, A, c)
    np.testing.assert_allclose(W, expected, atol=1e-12)


def test_whitened_rows(arrays):
    _, W, x = arrays
    S, y, rows = np.array([[0.5, 0.1], [0.1, 0.3]]), np.array([0.2, -0.4]), 4
    L = np.linalg.cholesky(S)
    e = np.linalg.solve(L, y)
    w = np.linalg.solve(L, W[rows : rows + 2, :N])
    expected, mean = W.copy(), x.copy()
    expected[rows : rows + 2, :N] = w
    expected[TURN, :N] -= w[:, 2] @ w
    mean[1, :N] += w.T @ e
    _whitened(x, 1, W, rows, TURN, N, 1.0 / L[0, 0], 1.0 / L[1, 1], L[1, 0], *e)
    np.testing.assert_allclose(W, expected, atol=1e-12)
    np.testing.assert_allclose(x, mean, atol=1e-12)
