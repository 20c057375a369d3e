import math

import numpy as np
import pytest

from slam_gym.reproduce.verdict import (
    FAILS,
    HOLDS,
    IN_PART,
    NOT,
    NOT_RUN,
    REPRODUCES,
    TIE,
    Claim,
    faster,
    mean_interval,
    printed,
    smaller,
    verdict,
)


def claims(*outcomes):
    return [Claim("", "", "", outcome, "") for outcome in outcomes]


@pytest.mark.parametrize(
    ("outcomes", "expected"),
    [
        ((), NOT_RUN),
        ((HOLDS, HOLDS), REPRODUCES),
        ((HOLDS, FAILS), IN_PART),
        ((HOLDS, TIE), IN_PART),
        ((TIE, FAILS), NOT),
    ],
)
def test_the_verdict_counts_what_holds(outcomes, expected):
    assert verdict(claims(*outcomes)) == expected


def test_the_interval_of_a_repetition_holds_95_percent_of_repetitions():
    rng = np.random.default_rng(1)
    inside = 0
    for _ in range(2000):
        ours, theirs = rng.normal(5.0, 2.0, 60), rng.normal(5.0, 2.0, 20).mean()
        _, low, high = mean_interval(ours, future_runs=20)
        inside += low <= theirs <= high
    assert abs(inside / 2000 - 0.95) < 4.0 * math.sqrt(0.95 * 0.05 / 2000)


def test_a_mean_interval_is_students():
    mean, low, high = mean_interval([1.0, 2.0, 3.0])
    half = 4.302652729911275 / math.sqrt(3.0)  # t of 2 degrees of freedom
    assert (mean, low, high) == pytest.approx((2.0, 2.0 - half, 2.0 + half))
    assert mean_interval([1.0])[1:] == (-math.inf, math.inf)


def test_a_printed_number_holds_within_what_so_many_runs_give():
    ours = np.random.default_rng(2).normal(0.040, 0.014, 400)
    assert printed("", "0.0393", ours, paper_runs=20).outcome == HOLDS
    assert printed("", "0.060", ours, paper_runs=20).outcome == FAILS
    assert printed("", "0.060", ours, paper_runs=1).outcome == HOLDS  # one run may well be as bad


def test_a_printed_number_is_as_exact_as_its_last_digit():
    ours = np.full(10, 0.002)
    assert printed("", "0", ours, paper_runs=1, scale=100.0).outcome == HOLDS  # 0.2 %, printed as 0 %
    assert printed("", "0.0", ours, paper_runs=1, scale=100.0).outcome == FAILS


def test_an_order_holds_fails_or_is_not_shown():
    rng = np.random.default_rng(3)
    common, noise = rng.normal(10.0, 5.0, 100), rng.normal(0.0, 0.1, 100)
    for skewed in (False, True):
        assert smaller("", common, common + 0.1 + noise, skewed=skewed).outcome == HOLDS
        assert smaller("", common + 0.1 + noise, common, skewed=skewed).outcome == FAILS
        assert smaller("", common, common + noise - noise.mean(), skewed=skewed).outcome == TIE
    assert smaller("", [1.0], [2.0]).outcome == TIE


def test_ratios_are_of_pairs():
    claim = faster("", [1.0, 2.0, 4.0], [2.0, 4.2, 7.6])
    assert claim.outcome == HOLDS
    assert claim.ours.startswith("ratio 2.00 [")
    assert faster("", [2.0, 4.2, 7.6], [1.0, 2.0, 4.0]).outcome == FAILS
    assert faster("", [1.0], [2.0]).outcome == TIE
