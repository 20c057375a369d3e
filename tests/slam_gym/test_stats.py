import math

import numpy as np
import pytest
from scipy import stats as scipy_stats
from scipy.stats import chi2

from slam_gym import stats


def test_row_statistics_skip_what_is_undefined():
    values = [[1.0, np.nan, 3.0], [np.nan, np.nan, np.nan], [1.0, 1.0, np.inf]]
    np.testing.assert_array_equal(stats.row_mean(values), [2.0, np.nan, np.inf])
    np.testing.assert_array_equal(stats.row_rms(values), [np.sqrt(5.0), np.nan, np.inf])
    np.testing.assert_array_equal(stats.row_median(values), [2.0, np.nan, 1.0])
    np.testing.assert_array_equal(stats.column_mean(values), [1.0, 1.0, np.inf])


def test_a_row_does_not_depend_on_the_others():
    values = np.random.default_rng(0).standard_normal((50, 333))
    alone = np.array([stats.row_mean(row)[0] for row in values])
    assert (stats.row_mean(values) == alone).all()


def test_means_and_spreads_over_runs():
    assert stats.mean_sd([1.0, 3.0, np.nan]) == (2.0, pytest.approx(np.sqrt(2.0)))
    mean, spread = stats.mean_sd([1.0])
    assert (mean, math.isnan(spread)) == (1.0, True)
    assert stats.mean_sd([1.0, np.inf])[0] == math.inf
    assert math.isnan(stats.mean_sd([np.nan])[0])
    assert stats.pooled_rms([3.0, 4.0])[0] == pytest.approx(np.sqrt(12.5))
    assert math.isnan(stats.pooled_rms([])[0])


def test_ages_split_the_steps_between_them():
    age = np.array([[0.0, 1.9, 2.0, 14.0, 15.0, np.inf]])
    split = stats.split_by_age(np.arange(6.0)[None], age)
    kept = {name: list(values[~np.isnan(values)]) for name, values in split.items()}
    assert kept == {"lt2": [0.0, 1.0], "2_15": [2.0, 3.0], "gt15": [4.0, 5.0]}


def test_consistency_of_honest_numbers():
    found = stats.consistency(chi2.rvs(2, size=(90, 300), random_state=0), 2)
    assert found.mean == pytest.approx(2.0, abs=0.05)
    assert found.median == pytest.approx(chi2.median(2), abs=0.05)
    assert found.in95_run == pytest.approx(0.95, abs=0.01)
    assert found.batch == 45
    assert stats.consistency([[np.nan]], 2).batch == 0


def test_the_t_interval_is_scipys():
    rng = np.random.default_rng(3)
    a, b = rng.standard_normal(30), rng.standard_normal(30)
    found = stats.paired_difference(a, b)
    expected = scipy_stats.ttest_rel(a, b).confidence_interval(0.95)
    assert (found.low, found.high) == (pytest.approx(expected.low), pytest.approx(expected.high))
    assert found.difference == pytest.approx((a - b).mean())


@pytest.mark.parametrize("method", ["t", "bootstrap"])
def test_intervals_hold_the_truth_about_as_often_as_they_say(method):
    rng = np.random.default_rng(4)
    inside = 0
    for trial in range(200):
        common = rng.standard_normal(40)  # paired: this part cancels
        a, b = common + 0.5 + 0.1 * rng.standard_normal(40), common + 0.1 * rng.standard_normal(40)
        found = stats.paired_difference(a, b, method=method, seed=trial)
        inside += found.low <= 0.5 <= found.high
        assert found.clear
    assert 0.88 <= inside / 200 <= 0.99


def test_pairs_with_a_broken_run_are_counted_out():
    found = stats.paired_difference([1.0, 2.0, np.inf], [0.0, 1.0, 1.0])
    assert (found.difference, found.n) == (1.0, 2)
    one = stats.paired_difference([1.0], [0.0])
    assert (one.difference, one.low, one.high, one.clear) == (1.0, -math.inf, math.inf, False)
    assert stats.paired_difference([np.nan], [1.0]).n == 0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        ({"a": [1.0], "b": [1.0, 2.0]}, "equal numbers; got 1 and 2"),
        ({"a": [1.0], "b": [1.0], "method": "bayes"}, "method must be 't' or 'bootstrap'; got 'bayes'"),
        ({"a": [1.0], "b": [1.0], "probability": 95}, "probability must lie between 0 and 1; got 95"),
    ],
)
def test_wrong_calls_are_explained(call, message):
    with pytest.raises(ValueError, match=message):
        stats.paired_difference(**call)


@pytest.mark.parametrize(("seed_std", "world_std"), [(0.3, 0.0), (0.3, 2.0), (0.0, 2.0)])
def test_intervals_over_seeds_and_worlds_hold_the_truth(seed_std, world_std):
    """Whether the seeds, the worlds or both make the spread; pairs alone would miss the seeds' share."""
    rng = np.random.default_rng(1)
    inside, trials = 0, 300
    for _ in range(trials):
        x = 0.5 + seed_std * rng.standard_normal((5, 1)) + world_std * rng.standard_normal((1, 60))
        found = stats.crossed_difference(x + 0.5 * rng.standard_normal((5, 60)))
        inside += found.low <= 0.5 <= found.high
    assert 0.92 <= inside / trials <= 1.0
    assert (found.seeds, found.worlds) == (5, 60)


def test_an_interval_over_seeds_leaves_out_worlds_with_a_broken_run():
    found = stats.crossed_difference([[1.0, 2.0, np.inf], [1.0, 2.0, 3.0]])
    assert (found.difference, found.worlds) == (1.5, 2)
    assert stats.crossed_difference([[1.0, np.nan], [1.0, 2.0]]).high == math.inf
    with pytest.raises(ValueError, match="at least two; got 1"):
        stats.crossed_difference([[1.0, 2.0]])


def test_the_gap_closed_is_the_share_of_means_and_its_interval_holds_the_truth():
    rng = np.random.default_rng(5)
    inside = 0
    for trial in range(150):
        world = rng.exponential(1.0, 80)  # skewed, and common to all three
        base, x, best = (level + world + 0.5 * rng.standard_normal(80) for level in (2.0, 1.25, 1.0))
        found = stats.gap_closed(base, x, best, seed=trial)
        assert found.closed == pytest.approx((base - x).mean() / (base - best).mean())
        inside += found.low <= 0.75 <= found.high
    assert 0.88 <= inside / 150 <= 0.99
    assert (stats.gap_closed(base, base, best).closed, stats.gap_closed(base, best, best).closed) == (0.0, 1.0)


def test_a_gap_that_is_not_there_has_no_bounds():
    rng = np.random.default_rng(6)
    base, x = rng.standard_normal((2, 40))
    found = stats.gap_closed(base, x, base[::-1])
    assert (found.low, found.high, found.n) == (-math.inf, math.inf, 40)
    assert stats.gap_closed([np.nan, np.inf], [1.0, 1.0], [0.0, 0.0]).n == 0
    assert math.isnan(stats.gap_closed([1.0, 1.0], [0.5, 0.5], [1.0, 1.0]).closed)
    with pytest.raises(ValueError, match="equal numbers; got"):
        stats.gap_closed([1.0], [1.0], [1.0, 2.0])
