import gc
import json
import os
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pandas as pd
import pytest
from numba.core.dispatcher import Dispatcher

from slam_gym.evaluation import compare, merge
from slam_gym.evaluation_plan import make_plan, run_seeds
from slam_gym.evaluation_unit import simulate, warm_up
from slam_gym.evaluation_work import chunk_size
from slam_gym.results import Results

ESTIMATORS = ("ekf", "dead-reckoning")
TIMES = ("predict_us", "update_us")  # measured, so never twice the same
SMALL = {"runs": 5, "steps": 30, "jobs": 1, "seed": 3}


def small(**options):
    return compare("default", ESTIMATORS, **{**SMALL, **options})


def assert_same_numbers(a, b):
    for name in ("runs", "paired", "series", "tracks", "landmarks"):
        pd.testing.assert_frame_equal(getattr(a, name), getattr(b, name), check_exact=True, obj=name)
    pd.testing.assert_frame_equal(
        a.summary.drop(columns=list(TIMES)), b.summary.drop(columns=list(TIMES)), check_exact=True
    )


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return small(out=tmp_path_factory.mktemp("results") / "whole")


def test_every_run_of_every_estimator_is_there_once(whole):
    assert list(whole.runs.groupby("estimator").size()) == [5, 5]
    assert list(whole.summary["estimator"]) == list(ESTIMATORS)
    ekf, floor = (whole.runs[whole.runs["estimator"] == name] for name in ESTIMATORS)
    assert list(ekf["seed"]) == list(floor["seed"]) == list(run_seeds(3, 101, range(5)))
    assert ekf["lost_share"].to_numpy() == pytest.approx(floor["lost_share"].to_numpy())  # the same data
    assert whole.series.groupby("estimator").size().eq(30).all()
    assert set(whole.tracks["run"]) == {0}
    assert (whole.summary[["predict_us"]] > 0).all(axis=None)
    assert whole.summary["robot_error_rmse"].iloc[0] < 1.0
    assert set(whole.paired["baseline"]) == {"ekf"}


def test_the_folder_holds_everything(whole):
    names = {path.name for path in whole.path.iterdir()}
    assert names >= {"config.json", "runs.parquet", "runs.csv", "summary.csv", "paired.csv", "series.parquet", "parts"}
    again = Results.load(whole.path)
    assert_same_numbers(again, whole)
    assert again.config["settings"]["seed"] == 3
    assert again.config["driver"] == "ekf"


@pytest.mark.parametrize("chunk", [1, 2])
def test_how_the_work_is_cut_changes_no_number(whole, chunk):
    assert_same_numbers(small(chunk=chunk), whole)


def test_processes_change_no_number(whole):
    assert_same_numbers(small(jobs=2, chunk=2), whole)


def test_shards_merge_to_the_whole(whole, tmp_path):
    parts = [tmp_path / "a", tmp_path / "b"]
    for i, part in enumerate(parts):
        small(out=part, shard=(i + 1, 2))
    assert len(Results.load(parts[0]).runs) == 2 * 3
    assert_same_numbers(merge(parts, tmp_path / "all"), whole)
    with pytest.raises(FileExistsError, match="not empty"):
        merge(parts, tmp_path / "all")
    with pytest.raises(ValueError, match=r"run 0 of .* comes twice"):
        merge([parts[0], parts[0]], tmp_path / "twice")
    with pytest.raises(ValueError, match=r"run\(s\) 0, 2 are missing"):
        merge(parts[1:], tmp_path / "half")
    with pytest.raises(FileNotFoundError, match="holds no parts"):
        merge([tmp_path / "none"], tmp_path / "other")


def test_a_shard_without_runs_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"shard 3/3 holds none of 2 run\(s\)"):
        small(runs=2, shard=(3, 3), out=tmp_path / "none")
    assert not (tmp_path / "none").exists()


def test_a_run_that_two_parts_hold_does_not_count_twice(whole, tmp_path):
    shutil.copytree(whole.path, tmp_path / "out")
    part = next((tmp_path / "out" / "parts" / "000").glob("*.npz"))
    shutil.copy(part, part.with_name("000009.npz"))
    with pytest.raises(ValueError, match=r"run 0 comes twice in .*000"):
        small(out=tmp_path / "out", resume=True)


def test_resuming_does_only_what_is_missing_and_may_add_runs(whole, tmp_path):
    small(out=tmp_path / "out", runs=3)
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "out" / "parts" / "000").iterdir()}
    seen = []
    grown = small(out=tmp_path / "out", resume=True, progress=lambda *what: seen.append(what))
    assert_same_numbers(grown, whole)
    assert seen[0][1:] == (3, 5) and seen[-1][1:] == (5, 5)
    assert all(path.stat().st_mtime_ns == stamp for path, stamp in before.items())


def test_results_are_never_overwritten_or_mixed(whole, tmp_path):
    with pytest.raises(FileExistsError, match=r"is not empty, and results are never overwritten: .*--resume"):
        small(out=whole.path)
    with pytest.raises(ValueError, match=r"other settings: seed was 3, now 4. Repeat the settings"):
        small(out=whole.path, resume=True, seed=4)
    with pytest.raises(ValueError, match=r"combinations\[0\].estimators was ekf, dead-reckoning, now ekf"):
        compare("default", ["ekf"], **SMALL, out=whole.path, resume=True)
    (tmp_path / "note.txt").write_text("mine")
    with pytest.raises(FileExistsError, match="holds no comparison that could be resumed"):
        small(out=tmp_path, resume=True)
    with pytest.raises(FileExistsError, match="is a file"):
        small(out=tmp_path / "note.txt")


def test_a_killed_comparison_resumes_with_the_same_numbers(whole, tmp_path):
    out = tmp_path / "out"
    code = (
        "from slam_gym.evaluation import compare\n"
        f"compare('default', {ESTIMATORS!r}, runs=5, steps=30, jobs=1, seed=3, chunk=1, out={str(out)!r},\n"
        "        progress=lambda what, done, total: __import__('time').sleep(0.3 if done else 0))"
    )
    process = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 240.0
    while not list(out.glob("parts/000/0*.npz")) and time.monotonic() < deadline and process.poll() is None:
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert not (out / "config.json").exists()
    assert 1 <= len(list(out.glob("parts/000/0*.npz"))) < 5
    with pytest.raises(FileNotFoundError, match=r"repeat its command with --resume"):
        Results.load(out)
    assert_same_numbers(small(out=out, resume=True), whole)
    assert Results.load(out).config["runs"] == 5


def test_in_closed_loop_each_estimator_drives_its_own_policy(whole):
    closed = small(mode="closed-loop")
    one = closed.tracks[closed.tracks["estimator"] == "ekf"]
    other = closed.tracks[closed.tracks["estimator"] == "dead-reckoning"]
    assert not np.allclose(one["true_x"], other["true_x"])
    shared = whole.tracks[whole.tracks["estimator"] == "ekf"]
    pd.testing.assert_frame_equal(one.reset_index(drop=True), shared.reset_index(drop=True))  # ekf drove there too
    assert json.dumps(closed.config["settings"]["combinations"][0]["driver"]) == "null"


def test_an_estimators_company_changes_nothing_for_it(whole):
    alone = compare("default", ["ekf"], **SMALL)
    among = whole.runs[whole.runs["estimator"] == "ekf"]
    pd.testing.assert_frame_equal(alone.runs, among[alone.runs.columns], check_dtype=False)


def test_first_steps_can_be_left_unscored(whole):
    late = small(burn_in=20)
    assert (late.runs["robot_error_end"] == whole.runs["robot_error_end"]).all()
    assert not np.allclose(late.runs["robot_error_mean"], whole.runs["robot_error_mean"])
    series = whole.series[whole.series["estimator"] == "ekf"]
    expected = series["robot_error"].iloc[20:].mean()
    assert late.summary["robot_error_mean"].iloc[0] == pytest.approx(expected)


def test_landmarks_can_be_left_unscored(whole):
    without = small(score_map=False)
    assert without.summary["landmark_error_rmse"].isna().all()
    for name in ("robot_error_rmse", "pose_nees_mean", "target_nees_mean"):
        np.testing.assert_array_equal(without.runs[name], whole.runs[name])


def test_two_policies_and_scenarios_make_four_combinations():
    found = compare(["default", "open"], ["ekf"], ["pursuit", "stationary"], **{**SMALL, "runs": 2, "steps": 5})
    assert len(found.summary) == 4
    assert {b for b in found.paired["baseline"]} == {"policy pursuit"}


def test_options_reach_estimators_policies_and_scenarios():
    found = compare(
        "default", ["ekf"], ["pursuit:stand_off=3"], overrides={"sensor.max_range": 3.0}, noise_inflation=2.0,
        **{**SMALL, "runs": 1, "steps": 3},
    )  # fmt: skip
    combination = found.config["settings"]["combinations"][0]
    assert combination["scenario"]["sensor"]["max_range"] == 3.0
    assert combination["scenario"]["filter"]["noise_inflation"] == 2.0
    assert combination["policy"] == {"label": "pursuit:stand_off=3", "name": "pursuit", "options": {"stand_off": 3}}
    assert not found.path.exists()  # nothing asked to stay


@pytest.mark.parametrize("name", ["ri-ekf", "slamto:particles=30"])
def test_after_the_warm_up_a_run_compiles_nothing(name):
    """Compiling in the middle of a run would count as the filter's time, and stop the live view."""
    plan = make_plan(
        ["default"], [name], None, seed=0, mode="shared", driver=None, steps=150, burn_in=None, tracks=1, overrides={},
        estimator_options={},
    )  # fmt: skip
    combination = plan.combinations[0]
    warm_up(combination, combination.estimators)
    before = compiled_kernels()
    records = simulate(combination, 0, range(2), tracks=1)
    assert compiled_kernels() == before
    assert records[0].counts.get("resampled", np.ones(1)).sum() > 0


def compiled_kernels():
    found = [d for d in gc.get_objects() if issubclass(type(d), Dispatcher) and d.overloads]
    return {(d.py_func.__module__, d.py_func.__qualname__): len(d.overloads) for d in found}


def test_units_occupy_all_workers_and_are_large_enough():
    plan = make_plan(
        ["default"], ["ekf"], None, seed=0, mode="shared", driver=None, steps=100, burn_in=None, tracks=0, overrides={},
        estimator_options={},
    )  # fmt: skip
    sizes = {runs: chunk_size(plan.combinations[0], runs, 2, 1) for runs in (1, 3, 40, 45, 200, 10_000)}
    assert sizes == {1: 1, 3: 2, 40: 20, 45: 23, 200: 25, 10_000: 32}


OWN = """
import numpy as np
from estimators import registry
from estimators.dead_reckoning import DeadReckoning
from slam_gym import policies
from slam_gym.evaluation import compare


@registry.register("own-filter")
class OwnFilter(DeadReckoning):
    "A script's own."


@policies.register("own-policy")
class OwnPolicy(policies.Policy):
    def reset(self, lanes, seeds):
        "Nothing to forget."

    def act(self, observation, belief):
        return np.zeros((self.num_lanes, 2))


if __name__ == "__main__":
    print(len(compare("default", ["own-filter"], ["own-policy"], runs=2, steps=20, jobs=2).runs), "runs")
"""


def test_a_scripts_own_classes_reach_the_workers(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(OWN)
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=False)
    assert done.stdout == "2 runs\n", done.stderr
