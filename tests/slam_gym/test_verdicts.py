import numpy as np
import pandas as pd
import pytest

from slam_gym.verdicts import METRICS, judge, pool

WORLDS = 40


def runs(**shifts):
    """One row per policy and world: everybody has the world's own difficulty, and its shift with a little noise."""
    rng = np.random.default_rng(0)
    world = 2.0 + rng.standard_normal(WORLDS)
    rows = []
    for name, shift in shifts.items():
        values = world + shift + 0.05 * rng.standard_normal(WORLDS)
        rows.append(pd.DataFrame({metric.column: values for metric in METRICS}))
        rows[-1].insert(0, "run", np.arange(WORLDS))
        rows[-1] = rows[-1].assign(scenario="field", estimator="ekf", policy=name)
    return pd.concat(rows, ignore_index=True)


def verdicts(table):
    return dict(zip(table["metric"], table["verdict"], strict=True))


def test_a_win_a_tie_and_a_loss_are_what_the_interval_says():
    table = runs(base=0.0, better=-0.3, same=0.0, worse=0.3)
    for name, expected in (("better", "win"), ("same", "tie"), ("worse", "loss")):
        found = judge(table, [name], "base")
        assert set(found["verdict"]) == {expected, ""}
        assert found["verdict"][found["metric"] == "target NEES (honest: 2)"].item() == ""  # shown, not judged
        assert ((found["low"] < found["difference"]) & (found["difference"] < found["high"])).all()
        assert set(found["worlds"]) == {WORLDS}
        assert set(found["seeds"]) == {1}
    lost = judge(table, ["better"], "base").set_index("metric").loc["track lost"]
    assert lost["difference"] == pytest.approx(-30.0, abs=3.0)  # per cent
    assert lost["policy_value"] - lost["baseline_value"] == pytest.approx(lost["difference"])


def test_not_worse_needs_an_interval_below_the_margin():
    table = runs(base=0.0, bit=0.1)
    error = judge(table, ["bit"], "base", margin=0.1).iloc[0]
    assert (error["verdict"], error["not_worse"]) == ("loss", True)  # worse, but by less than a tenth of about 2
    assert not judge(table, ["bit"], "base", margin=0.02).iloc[0]["not_worse"]


def test_of_several_seeds_the_seed_is_the_unit():
    """Each seed beats the baseline by far in its worlds; seeds differ so much that the next one may not."""
    table = runs(base=0.0, one=-0.9, two=0.2, three=-0.1)
    assert verdicts(judge(table, ["one"], "base"))["robot error"] == "win"
    found = judge(table, ["one", "two", "three"], "base").set_index("metric").loc["robot error"]
    assert (found["verdict"], found["seeds"]) == ("tie", 3)
    assert found["difference"] == pytest.approx(-0.8 / 3, abs=0.05)
    steady = runs(base=0.0, one=-0.5, two=-0.55, three=-0.45)
    assert verdicts(judge(steady, ["one", "two", "three"], "base"))["robot error"] == "win"


def test_pooled_seeds_are_their_mean_in_each_world():
    table = runs(base=0.0, one=-0.9, two=0.2)
    pooled = pool(table, ["one", "two"], "both").set_index(["policy", "run"])["effort"]
    by_policy = table.pivot(index="run", columns="policy", values="effort")
    np.testing.assert_allclose(pooled["both"], by_policy[["one", "two"]].mean(axis=1))
    np.testing.assert_array_equal(pooled["base"], by_policy["base"])


def test_what_is_undefined_is_left_out():
    table = runs(base=0.0, other=-0.3)
    table.loc[table["run"] < 5, "robot_error_mean"] = np.nan
    table["target_error_capped"] = np.nan
    found = judge(table, ["other"], "base").set_index("metric")
    assert "target error" not in found.index
    assert found.loc["robot error", "worlds"] == WORLDS - 5
    with pytest.raises(ValueError, match=r"no runs of policy 'nobody'; there are 'base', 'other'"):
        judge(table, ["nobody"], "base")
