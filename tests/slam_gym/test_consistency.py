import math

import numpy as np
import pytest
from scipy.stats import chi2

from slam_gym.consistency import anees, diverged, in95_mean, in95_run, nees, nees_bounds, nis


def test_nees_is_the_quadratic_form_with_wrapped_angles():
    rng = np.random.default_rng(0)
    root = rng.standard_normal((4, 3, 3))
    cov = root @ root.transpose(0, 2, 1) + 0.1 * np.eye(3)
    error = rng.standard_normal((4, 3))
    expected = [e @ np.linalg.inv(c) @ e for e, c in zip(error, cov, strict=True)]
    np.testing.assert_allclose(nees(error, cov), expected, rtol=1e-10)
    turned = error + np.array([0.0, 0.0, 2.0 * np.pi])
    wrapped = error.copy()
    wrapped[:, 2] = (wrapped[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
    np.testing.assert_allclose(nees(turned, cov, angles=(2,)), nees(wrapped, cov), rtol=1e-9)


def test_nees_of_a_singular_covariance_is_infinite_for_that_one_alone():
    cov = np.stack([np.eye(2), np.zeros((2, 2))])
    np.testing.assert_array_equal(nees(np.ones((2, 2)), cov), [2.0, np.inf])
    np.testing.assert_array_equal(nees(np.ones(2), cov), [2.0, np.inf])  # one error, several covariances


def test_nis_wraps_the_bearing():
    assert nis([0.0, 2.0 * np.pi - 0.1], np.eye(2)) == pytest.approx(0.01)


def test_bounds_are_the_papers_for_45_runs():
    assert nees_bounds(3, 45) == (pytest.approx(2.32, abs=0.01), pytest.approx(3.75, abs=0.01))


@pytest.mark.parametrize("wrong", [(0, 1, 0.95), (3, 0, 0.95), (3, 1, 1.0)])
def test_bounds_refuse_impossible_numbers(wrong):
    with pytest.raises(ValueError, match="nees_bounds needs dof >= 1"):
        nees_bounds(*wrong)


def test_an_honest_filter_is_inside_in_95_percent():
    values = chi2.rvs(3, size=(450, 200), random_state=1)
    assert anees(values) == pytest.approx(3.0, abs=0.03)
    assert in95_run(values, 3) == pytest.approx(0.95, abs=0.005)
    share, batch = in95_mean(values, 3)
    assert share == pytest.approx(0.95, abs=0.015)
    assert batch == 45


def test_the_two_shares_differ_for_an_overconfident_filter():
    values = 1.3 * chi2.rvs(3, size=(90, 100), random_state=2)
    assert in95_run(values, 3) > 0.85  # each run alone hardly shows it
    assert in95_mean(values, 3)[0] < 0.5  # the mean over runs does


def test_undefined_steps_are_left_out_and_infinite_ones_counted():
    values = np.array([[np.nan, 2.0], [np.nan, np.inf]])
    assert anees(values) == math.inf
    assert in95_run(values, 2) == 0.5
    assert in95_mean(values, 2) == (0.0, 2)
    assert math.isnan(anees([np.nan]))
    assert math.isnan(in95_run([np.nan], 2))
    assert math.isnan(in95_mean([[np.nan]], 2)[0])


def test_a_batch_is_never_smaller_than_asked_unless_there_are_fewer_runs():
    assert in95_mean(np.ones((100, 3)), 2, batch=45)[1] == 50
    assert in95_mean(np.ones((10, 3)), 2, batch=45)[1] == 10


def test_diverged_looks_at_the_last_tenth_at_broken_numbers_and_at_the_limit():
    fine = np.full(100, 3.0)
    recovered = fine.copy()
    recovered[:95] = 1000.0
    lost = fine.copy()
    lost[89:] = 1000.0
    broken_error = np.ones(100)
    broken_error[50] = np.nan
    nees_of_runs = np.stack([fine, recovered, lost, fine, fine])
    errors = np.stack([np.ones(100)] * 3 + [broken_error, np.full(100, 50.0)])
    np.testing.assert_array_equal(diverged(nees_of_runs, errors, error_limit=30.0), [False, False, True, True, True])
    assert not diverged(np.empty((1, 0)), np.empty((1, 0)))[0]
