"""Weights in the log domain and systematic resampling."""

import numpy as np
import pytest

from estimators.kernels.resampling import move_columns, moves, normalise, systematic


def weights(seed, n=50):
    w = np.random.default_rng(seed).exponential(size=n) ** 3
    return w / w.sum()


def test_normalise_is_softmax_with_the_effective_number():
    log_w = np.random.default_rng(1).normal(scale=5.0, size=100) + 4000.0  # exp would overflow
    expected = np.exp(log_w - log_w.max())
    expected /= expected.sum()
    w = np.empty(100)
    effective, bad, collapsed = normalise(log_w, w)
    np.testing.assert_allclose(w, expected, rtol=1e-12, atol=1e-300)
    assert effective == pytest.approx(1.0 / (expected**2).sum())
    assert (bad, collapsed) == (0, False)
    assert log_w.max() == 0.0


@pytest.mark.parametrize(
    ("values", "expected", "bad", "collapsed"),
    [
        ([0.0, np.nan, 0.0, -np.inf], [0.5, 0.0, 0.5, 0.0], 1, False),
        ([-np.inf] * 4, [0.25] * 4, 0, True),
        ([np.nan] * 4, [0.25] * 4, 4, True),
        ([np.inf, 0.0, 0.0, 0.0], [0.25] * 4, 0, True),
        ([-1e308, 0.0, 0.0, -1e308], [0.0, 0.5, 0.5, 0.0], 0, False),
    ],
)
def test_weights_that_are_no_numbers(values, expected, bad, collapsed):
    w = np.empty(4)
    result = normalise(np.array(values), w)
    np.testing.assert_allclose(w, expected)
    assert result[1:] == (bad, collapsed)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("u", [0.0, 0.3, 0.999999])
def test_systematic_draws_floor_or_one_more(seed, u):
    w = weights(seed)
    copies = np.empty(50, dtype=np.int64)
    systematic(w, u, copies)
    assert copies.sum() == 50
    assert (copies >= np.floor(50 * w - 1e-9)).all()
    assert (copies <= np.floor(50 * w + 1e-9) + 1).all()


def test_systematic_is_unbiased():
    w = weights(7)
    copies, total = np.empty(50, dtype=np.int64), np.zeros(50)
    steps = 2000
    for i in range(steps):
        systematic(w, (i + 0.5) / steps, copies)
        total += copies
    np.testing.assert_allclose(total / steps, 50 * w, atol=1.0 / steps)


def test_weights_that_fall_short_of_one_still_give_n_particles_of_positive_weight():
    w = np.array([0.5, 0.5 - 1e-10, 0.0])
    copies = np.empty(3, dtype=np.int64)
    systematic(w, 1.0 - 1e-12, copies)
    assert copies.sum() == 3
    assert copies[2] == 0


@pytest.mark.parametrize("seed", range(5))
def test_moves_realise_the_copies_and_leave_survivors(seed):
    w = weights(seed)
    copies, source, destination = np.empty((3, 50), dtype=np.int64)
    systematic(w, 0.4, copies)
    count = moves(copies, source, destination)
    rows = np.tile(np.arange(50.0), (2, 1))
    move_columns(rows, source, destination, count)
    np.testing.assert_array_equal(np.bincount(rows[0].astype(int), minlength=50), copies)
    survivors = copies > 0
    np.testing.assert_array_equal(rows[1][survivors], np.arange(50.0)[survivors])
    assert count == (copies == 0).sum()
