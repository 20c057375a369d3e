import numpy as np
import pytest

from slam_gym.records import FIELDS, Records
from slam_gym.replay_pooled import pooled_table


def records(pose_nees, target_nees, age):
    steps = len(pose_nees)
    values = np.full((1, steps, len(FIELDS)), np.nan)
    for name, numbers in (("pose_nees", pose_nees), ("target_nees", target_nees), ("robot_error", pose_nees)):
        values[0, :, FIELDS.index(name)] = numbers
    one = np.zeros(1, dtype=np.int64)
    return Records(
        run=one, seed=one, steps=one + steps, values=values, age=np.array([age]), time=np.arange(steps) + 1.0,
        collisions=one, effort=np.zeros(1),
    )  # fmt: skip


def test_samples_are_pooled_and_observers_kept_apart():
    long = records([3.0, 3.0, 9.0], [2.0, 4.0, np.nan], [0.0, 5.0, 20.0])
    short = records([24.0], [6.0], [1.0])
    row = (
        pooled_table([("ekf", "a", long), ("ekf", "b", short), ("other", "a", short)]).set_index("estimator").loc["ekf"]
    )
    assert row["recordings"] == 2
    assert row["pose_nees"] == pytest.approx(39.0 / 4 / 3)
    assert (row["pose_nees_least"], row["pose_nees_most"]) == pytest.approx((15.0 / 9, 8.0))
    assert row["pose_inside"] == pytest.approx(0.5)  # 7.81 is the bound
    assert row["robot_error"] == pytest.approx(np.sqrt((9 + 9 + 81 + 576) / 4))
    assert row["target_nees_lt2"] == pytest.approx(2.0)  # (2 + 6) / 2 over its 2 degrees of freedom
    assert row["target_nees_median_lt2"] == pytest.approx(4.0 / (2.0 * np.log(2.0)))
    assert np.isnan(row["target_nees_gt15"]) and np.isnan(row["target_error_lt2"])
