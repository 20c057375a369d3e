"""The semidefinite Cholesky factor and its solve, against NumPy and on singular matrices; the nearest covariance."""

import numpy as np
import pytest

from estimators.kernels.linalg import nearest_covariance, pivoted_cholesky, semidefinite_cholesky, solve_transposed

RNG = np.random.default_rng(3)


def factor(matrix):
    C = np.array(matrix, dtype=float)
    semidefinite_cholesky(C, len(C))
    return C


@pytest.mark.parametrize("n", [1, 3, 5])
def test_a_definite_matrix_has_numpys_factor(n):
    root = RNG.standard_normal((n, n))
    matrix = root @ root.T
    assert factor(matrix) == pytest.approx(np.linalg.cholesky(matrix), abs=1e-12)


@pytest.mark.parametrize("rank", [0, 1, 2, 4])
def test_a_singular_matrix_is_the_square_of_its_factor(rank):
    root = RNG.standard_normal((5, rank))
    matrix = root @ root.T
    C = factor(matrix)
    assert C @ C.T == pytest.approx(matrix, abs=1e-7)
    assert (np.count_nonzero(np.diag(C)) == rank) and np.array_equal(C, np.tril(C))


def test_a_known_coordinate_gives_a_column_of_zeros():
    C = factor(np.diag([4.0, 0.0, 9.0]))
    assert np.array_equal(C, np.diag([2.0, 0.0, 3.0]))


def test_only_the_lower_triangle_of_the_leading_block_is_read():
    C = np.full((5, 5), np.nan)
    C[:2, :2] = [[4.0, np.nan], [2.0, 5.0]]
    semidefinite_cholesky(C, 2)
    assert np.array_equal(C[:2, :2], [[2.0, 0.0], [1.0, 2.0]])


def test_the_solve_is_numpys():
    root = RNG.standard_normal((5, 5))
    C, D, out = factor(root @ root.T), RNG.standard_normal((2, 5)), np.zeros((2, 5))
    for row in range(2):
        solve_transposed(C, 5, D, row, out, np.arange(5))
    assert out @ C == pytest.approx(D, abs=1e-10)


def test_the_solve_of_a_singular_factor_is_the_slope_over_what_varies():
    C, out = factor(np.diag([4.0, 0.0, 9.0])), np.full((1, 3), np.nan)
    solve_transposed(C, 3, np.array([[2.0, 5.0, 6.0]]), 0, out, np.arange(3))
    assert np.array_equal(out, [[1.0, 0.0, 2.0]])


def pivoted(matrix):
    n = len(matrix)
    C, order = np.full((n, n), np.nan), np.full(n, -1)
    pivoted_cholesky(np.array(matrix, dtype=float), n, C, order)
    return C, order


@pytest.mark.parametrize("rank", [0, 1, 2, 4, 5])
def test_pivots_give_a_root_to_rounding_whatever_the_rank(rank):
    for _ in range(100):
        root = RNG.standard_normal((5, rank)) * 10.0 ** RNG.uniform(-6.0, 1.0, rank)
        matrix = root @ root.T
        C, order = pivoted(matrix)
        assert np.abs(C @ C.T - matrix).max() <= 1e-14 * np.abs(matrix).max(initial=0.0)
        assert sorted(order) == list(range(5)) and np.array_equal(C[order], np.tril(C[order]))


def test_a_slope_by_pivots_is_no_larger_than_it_has_to_be():
    """Heading and y vary together, y by little more than x tells of it: by y the slope would be in the thousands."""
    root = np.array([[0.15, 0.0], [-0.02, 4e-5], [0.0, 0.05]])
    C, order = pivoted(root @ root.T)
    D, out = 3.0 * C[2:3], np.zeros((1, 3))  # what depends on the heading alone
    solve_transposed(C, 3, D, 0, out, order)
    assert out @ C == pytest.approx(D, abs=1e-12) and np.abs(out).max() < 3.1


def unpack(xx, xy, yy):
    return np.array([[xx, xy], [xy, yy]])


def test_the_nearest_covariance_is_the_positive_part():
    for xx, xy, yy in RNG.standard_normal((200, 3)):
        values, vectors = np.linalg.eigh(unpack(xx, xy, yy))
        positive = vectors * np.maximum(values, 0.0) @ vectors.T
        assert unpack(*nearest_covariance(xx, xy, yy)) == pytest.approx(positive, abs=1e-12)


@pytest.mark.parametrize("cov", [(2.0, 0.5, 1.0), (0.0, 0.0, 0.0), (4.0, 2.0, 1.0), (1e-300, 0.0, 0.0)])
def test_a_covariance_is_its_own_nearest_bit_for_bit(cov):
    assert nearest_covariance(*cov) == cov


def test_nothing_that_is_not_a_number_is_hidden():
    assert np.isnan(nearest_covariance(np.nan, 0.0, 1.0)).all()
