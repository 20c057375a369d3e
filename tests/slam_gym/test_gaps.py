import io

import pandas as pd
import pytest
from rich.console import Console

from slam_gym.commands.summary import print_gaps
from slam_gym.evaluation import compare
from slam_gym.gaps import gap_table, share_text
from slam_gym.specs import parse_sweep


def runs(**lost):
    rows = [
        {"scenario": "s", "policy": policy, "estimator": "ekf", "run": run, "lost_share": share + 0.01 * run}
        for policy, share in lost.items()
        for run in range(6)
    ]
    return pd.DataFrame(rows)


def test_pursuit_is_nothing_closed_and_the_oracle_all():
    found = gap_table(runs(pursuit=0.5, mine=0.2, worse=0.6, oracle=0.1))
    assert list(found["policy"]) == ["mine", "worse"]
    assert list(found["closed"]) == pytest.approx([0.75, -0.25])
    assert list(found["low"]) == pytest.approx([0.75, -0.25])  # the worlds' difficulty is common to all
    assert share_text(found.iloc[0]) == "0.75 (0.75 to 0.75)"


@pytest.mark.parametrize("odd", [float("inf"), float("nan")])
def test_the_means_are_of_the_runs_that_count(odd):
    table = runs(pursuit=0.5, mine=0.2, oracle=0.1)
    table.loc[(table["policy"] == "mine") & (table["run"] == 5), "lost_share"] = odd
    row = gap_table(table).iloc[0]
    assert row["n"] == 5
    assert (row["baseline"] - row["value"]) / (row["baseline"] - row["reference"]) == pytest.approx(row["closed"])


@pytest.mark.parametrize("policies", [{"pursuit": 0.5, "mine": 0.2}, {"mine": 0.2, "oracle": 0.1}])
def test_no_gap_without_both_ends(policies):
    assert gap_table(runs(**policies)).empty


def test_policies_as_good_as_the_oracle_have_no_gap():
    found = gap_table(pd.concat([runs(pursuit=0.1), runs(mine=0.2), runs(oracle=0.1)]))
    assert share_text(found.iloc[0]) == "no clear gap"


def test_a_terminal_of_80_columns_has_a_line_per_policy_under_the_scenarios_whole_name():
    table = gap_table(runs(pursuit=0.5, mine=0.2, oracle=0.1))
    vague = pd.concat([runs(pursuit=0.1), runs(mine=0.2), runs(oracle=0.1)])
    name = "evasive-hard target.speed=0.4 sensor.max_range=4"
    page = Console(file=io.StringIO(), width=80)
    print_gaps(pd.concat([table.assign(scenario=name), gap_table(vague).assign(scenario="open")]), page)
    lines = [line.strip() for line in page.file.getvalue().splitlines()]
    assert name in lines
    assert lines[lines.index(name) + 1].split(maxsplit=1) == ["mine", "0.75 (0.75 to 0.75)"]
    assert lines[lines.index("open") + 1].split() == ["mine", "-"]


def test_the_oracle_is_told_the_truth_in_comparisons_and_loses_least(tmp_path):
    found = compare(
        "default", ["ekf"], ["pursuit", "stationary", "oracle"], runs=6, mode="closed-loop", jobs=1, out=tmp_path / "o"
    )
    lost = found.summary.set_index("policy")["lost_share"]
    assert lost["oracle"] < lost["stationary"]
    assert set(found.gaps["policy"]) == {"stationary"}
    assert len(pd.read_csv(tmp_path / "o" / "gaps.csv")) == len(found.gaps)


def test_a_sweep_runs_the_same_worlds_with_each_value():
    found = compare("default", ["dead-reckoning"], ["stationary"], runs=2, steps=30, jobs=1,
                    sweep=parse_sweep(["target.speed=0.2,[0.5,0.6]", "sensor.max_range=4,6"]))  # fmt: skip
    assert len(found.summary) == 4
    assert found.summary["scenario"].iloc[0] == "default target.speed=0.2 sensor.max_range=4"
    assert found.runs.groupby("run")["seed"].nunique().max() == 1


@pytest.mark.parametrize("text", ["target.speed", "=1,2", "target.speed="])
def test_a_sweep_without_key_or_values_is_explained(text):
    with pytest.raises(ValueError, match="key=v1,v2,v3"):
        parse_sweep([text])


def test_a_sweep_over_an_unknown_setting_is_explained():
    with pytest.raises(ValueError, match="target"):
        compare("default", ["ekf"], ["stationary"], runs=1, sweep={"target.sped": [1.0]})
