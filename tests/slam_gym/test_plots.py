"""Pictures that a few odd numbers must not spoil."""

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
