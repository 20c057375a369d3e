import numpy as np
import pytest

from estimators.kernels.jit import jit
from estimators.kernels.simd import CACHE_LINE, add_outer, aligned_zeros, subtract_rows


@jit
def _add(P, lane, n, W, sign_0, sign_1):
    add_outer(P, lane, n, W, sign_0, sign_1)


@jit
def _subtract(P, lane, n, W, minus, plus):
    subtract_rows(P, lane, n, W, minus, plus)


@pytest.mark.parametrize("n", [8, 16, 24, 40])
@pytest.mark.parametrize("signs", [(-1.0, -1.0), (1.0, -1.0)])
def test_rank_two_change(n, signs):
    rng = np.random.default_rng(n)
    P = aligned_zeros(3, 40, 40)
    P[:] = rng.standard_normal(P.shape)
    P += np.swapaxes(P, 1, 2).copy()
    W, expected = rng.standard_normal((3, 48)), P.copy()
    expected[1, :n, :n] += sum(s * np.outer(w, w) for s, w in zip(signs, W[:2, :n], strict=True))
    _add(P, 1, n, W, *signs)
    np.testing.assert_allclose(P, expected, atol=1e-12)
    np.testing.assert_array_equal(P, np.swapaxes(P, 1, 2))


@pytest.mark.parametrize("n", [8, 16, 24, 40])
@pytest.mark.parametrize(("minus", "plus"), [(0, 0), (2, 0), (18, 0), (5, 1), (0, 3)])
def test_many_products_at_once(n, minus, plus):
    rng = np.random.default_rng(n)
    P = aligned_zeros(3, 40, 40)
    P[:] = rng.standard_normal(P.shape)
    P += np.swapaxes(P, 1, 2).copy()
    W, expected = rng.standard_normal((20, 48)), P.copy()
    down, up = W[:minus, :n], W[minus : minus + plus, :n]
    expected[1, :n, :n] += up.T @ up - down.T @ down
    _subtract(P, 1, n, W, minus, plus)
    np.testing.assert_allclose(P, expected, atol=1e-12)
    np.testing.assert_array_equal(P, np.swapaxes(P, 1, 2))


def test_aligned_zeros():
    for shape in ((3,), (2, 5), (4, 8, 8)):
        array = aligned_zeros(*shape)
        assert array.shape == shape
        assert array.ctypes.data % CACHE_LINE == 0
        assert array.flags.c_contiguous
        assert not array.any()
