"""The landmark budget: weights by hand, marginalisation exactly, and what the numbers of the paper say."""

import numpy as np
import pytest

from estimators._recording import MOTION, SENSOR, TARGET_MODEL, feed, record, start
from estimators.gaussian.ekf import EKF
from estimators.gaussian.fej import FEJEKF
from estimators.gaussian.landmark_budget import LandmarkBudget, numbers_stored, weight
from estimators.interface import Scan
from estimators.testing import checks


def sweep(*labels):
    """Each landmark at a fixed place around the robot, seen from the origin."""
    scan = Scan.empty(1, len(labels))
    scan.count[0] = len(labels)
    for k, label in enumerate(labels):
        scan.ranges[0, k], scan.bearings[0, k], scan.labels[0, k] = 2.0 + 0.3 * label, 0.5 * label - 1.5, label
    return scan


def filtered(*sweeps, cls=EKF, budget=3, target=None):
    estimator = cls(MOTION, SENSOR, target, max_landmarks=8, budget=budget)
    estimator.reset(np.zeros(3), np.diag([0.01, 0.01, 0.001]), seeds=0)
    for labels in sweeps:
        estimator.update(sweep(*labels))
    return estimator


def mapped(estimator):
    ids = estimator.belief.landmark_id[0]
    return sorted(int(label) for label in ids[ids >= 0])


def test_the_newest_sweep_weighs_ten_and_the_oldest_one():
    assert [weight(1 << k, 10) for k in range(11)] == [*range(10, 0, -1), 0]
    assert weight(0b11, 10) == 19
    assert weight((1 << 10) - 1, 10) == 55


def test_the_lightest_goes():
    estimator = filtered([0, 1], [0, 1], [0, 2], [0, 2, 3])  # weights 34, 15, 19, 10
    assert mapped(estimator) == [0, 1, 2]
    assert estimator.counts["marginalised"].tolist() == [1]
    estimator = filtered([0, 1], [0], [0, 2], [0, 2, 3])  # landmark 1 weighs 7
    assert mapped(estimator) == [0, 2, 3]


def test_of_equally_light_ones_the_longest_unseen_goes():
    # Landmark 1 was in sweeps 10 ... 1 sweeps ago of weights 1 and 9; landmark 2 in the newest only, of weight 10.
    sweeps = [[0, 1], *[[0]] * 7, [0, 1], [0, 2]]
    estimator = filtered(*sweeps, budget=2)
    assert mapped(estimator) == [0, 2]
    estimator = filtered([0], [1], *[[0]] * 20, [2], budget=2)  # 1 has not been in the window at all
    assert mapped(estimator) == [0, 2]


def test_a_landmark_seen_again_is_new():
    estimator = filtered([0, 1], [0], [0, 2], [0, 2, 3], *[[0, 2]] * 10, cls=FEJEKF)
    assert mapped(estimator) == [0, 2, 3]
    estimator.predict(np.array([[1.0, 0.0]]), 0.1)
    estimator.update(sweep(0, 1, 2))
    assert mapped(estimator) == [0, 1, 2]
    slot = estimator.ids[0].tolist().index(1)
    assert np.array_equal(estimator.first[0, slot, :2], estimator.belief.landmark_mean[0, slot])
    first = estimator.first[0, slot].copy()
    estimator.update(sweep(0, 1, 2))
    assert np.array_equal(estimator.first[0, slot], first)


def test_dropping_is_marginalising():
    kept = filtered([0, 1], [0], [0, 2], [0, 2], budget=None, target=TARGET_MODEL)
    dropped = filtered([0, 1], [0], [0, 2], [0, 2], budget=2, target=TARGET_MODEL)
    assert mapped(kept) == [0, 1, 2]
    assert mapped(dropped) == [0, 2]
    mean, cov = kept.belief.joint(0)
    rows = [0, 1, 2] + [
        row
        for label in dropped.ids[0, :2]
        for slot in [kept.ids[0].tolist().index(label)]
        for row in (3 + 2 * slot, 4 + 2 * slot)
    ]
    assert dropped.belief.joint(0)[0] == pytest.approx(mean[rows], abs=1e-12)
    assert dropped.belief.joint(0)[1] == pytest.approx(cov[np.ix_(rows, rows)], abs=1e-12)


def test_the_slots_left_are_clean():
    estimator = filtered([0, 1, 2], [0, 3, 4, 5], [6, 7], budget=2)
    end = 3 + 2 * int(estimator.count[0])
    assert not estimator.mu[0, end:].any()
    assert not estimator.P[0, end:].any()
    assert not estimator.P[0, :, end:].any()
    assert (estimator.ids[0, estimator.count[0] :] == -1).all()


def test_a_sweep_with_more_than_the_budget_is_kept_whole_and_counted():
    estimator = filtered([0, 1, 2], [1, 2, 3, 4, 5], budget=3)
    assert mapped(estimator) == [1, 2, 3, 4, 5]
    assert estimator.counts["budget_widened"].tolist() == [1]
    estimator.update(sweep(4, 5))
    assert len(mapped(estimator)) == 3
    assert {4, 5} <= set(mapped(estimator))


def test_a_wide_budget_changes_nothing():
    recording = record(2, 20)
    beliefs = []
    for budget in (None, 8):
        estimator = EKF(MOTION, SENSOR, TARGET_MODEL, num_lanes=2, max_landmarks=10, budget=budget)
        start(estimator, recording)
        feed(estimator, recording)
        beliefs.append((estimator.belief.pose.copy(), estimator.belief.landmark_cov.copy()))
    assert all(np.array_equal(a, b) for a, b in zip(*beliefs, strict=True))


@pytest.mark.parametrize("budget", [0, -1, 2.5, True, "10"])
def test_a_budget_is_a_whole_number(budget):
    with pytest.raises(ValueError, match="budget must be a whole number of landmarks, at least 1, or None; got"):
        EKF(MOTION, SENSOR, None, max_landmarks=8, budget=budget)


def test_a_window_fits_into_an_integer():
    owner = EKF(MOTION, SENSOR, None, max_landmarks=8)
    with pytest.raises(ValueError, match="window must be 1 to 62 sweeps; got 63"):
        LandmarkBudget(owner, 3, window=63)


@pytest.mark.parametrize(
    ("method", "sparse", "dense"), [("cdkf", 902, 1902), ("ekf", 5402, 74802), ("fastslam", 2220, 8220)]
)
def test_the_memory_formulas(method, sparse, dense):
    """Eqs. (40)-(42) at the paper's 35 and 135 landmarks."""
    assert (numbers_stored(method, 35), numbers_stored(method, 135)) == (sparse, dense)


def test_another_method_has_no_formula():
    with pytest.raises(ValueError, match="method must be 'cdkf', 'ekf' or 'fastslam'; got 'ukf'"):
        numbers_stored("ukf", 35)


def test_the_contract_holds_with_a_budget():
    for check in checks(EKF, budget=4):
        check()
