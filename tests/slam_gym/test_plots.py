"""Pictures that a few odd numbers must not spoil."""

import itertools

import numpy as np
import pandas as pd
import pytest

from slam_gym import plots


def series_of(**curves):
    """NEES over 400 instants by estimator."""
    parts = [
        pd.DataFrame({"estimator": name, "time": 0.1 * np.arange(400), "runs": 20, "pose_nees": curve})
        for name, curve in curves.items()
    ]
    return pd.concat(parts, ignore_index=True)


@pytest.fixture
def honest():
    return np.random.default_rng(0).chisquare(60, 400) / 20


def picture(series):
    axis = plots.nees_over_time(series, ("pose_nees",)).axes[0]
    return axis.get_ylim()[1], axis.get_title(loc="right")


def test_the_first_instant_does_not_set_the_scale_of_nees(honest):
    spiked = honest.copy()
    spiked[0] = 7e4
    top, said = picture(series_of(ekf=honest, spiked=spiked))
    assert top < 10.0
    assert said == "1 of 800 points lie above, up to 70000"


def test_a_filter_that_goes_wrong_stays_in_sight(honest):
    wrong = honest.copy()
    wrong[300:] *= 1000.0
    top, said = picture(series_of(ekf=honest, wrong=wrong))
    assert top > wrong.max()
    assert not said


def test_nothing_to_show():
    assert picture(series_of(none=np.full(400, np.nan)))[1] == ""


@pytest.mark.parametrize("apart", [1.0, 1.02, 1.3, 300.0])
def test_names_of_the_cost_picture_keep_off_each_other(apart):
    names = ["ekf", "independent", "ri-taylor-ekf", "fej-ekf"]
    cost = 3.0 * apart ** np.arange(4.0)
    summary = pd.DataFrame({"estimator": names, "predict_us": cost, "update_us": cost, "robot_error_rmse": 0.3,
                            "pose_nees_mean": 3.0})  # fmt: skip
    figure = plots.cost_against_accuracy(summary)
    figure.draw_without_rendering()
    labels = [text.get_window_extent() for text in figure.axes[0].texts]
    assert [text.get_text() for text in figure.axes[0].texts] == names
    assert all(one.count_overlaps(labels[:i]) == 0 for i, one in enumerate(labels))
    dots = figure.axes[0].transData.transform(np.column_stack([2.0 * cost, np.full(4, 0.3)]))
    assert apart == 1.0 or not any(label.contains(*dot) for label in labels for dot in dots)
    ticks = [tick.get_window_extent() for tick in figure.axes[0].get_xticklabels() if tick.get_text()]
    assert all(not one.overlaps(other) for one, other in itertools.pairwise(ticks))


def test_names_of_the_default_comparison_keep_off_each_other():
    """As it came out once: three filters of nearly the same error, as close as their names are wide."""
    costs = {
        "ekf": 1.33,
        "fej-ekf": 2.026,
        "ri-ekf": 1.218,
        "cdkf": 2.892,
        "slamto": 7.193,
        "independent": 2.359,
        "dead-reckoning": 0.991,
        "ideal-ekf": 1.789,
    }
    errors = [0.3307, 0.2613, 0.2585, 0.331, 0.2843, 0.2589, 0.7122, 0.2103]
    summary = pd.DataFrame({"estimator": list(costs), "predict_us": 0.0, "update_us": list(costs.values()),
                            "robot_error_rmse": errors, "pose_nees_mean": 3.0})  # fmt: skip
    figure = plots.cost_against_accuracy(summary)
    figure.draw_without_rendering()
    labels = [text.get_window_extent() for text in figure.axes[0].texts]
    assert all(one.count_overlaps(labels[:i]) == 0 for i, one in enumerate(labels))


def test_only_what_has_bounds_is_drawn_with_them(honest):
    """A map's mean over landmarks that share the pose's error has none."""
    series = series_of(ekf=honest)
    series["landmark_nees"] = series["pose_nees"]
    bands = [len(axis.patches) for axis in plots.nees_over_time(series, ("pose_nees", "landmark_nees")).axes]
    assert bands == [1, 0]
