"""`slam-gym evaluate` and run folders where a policy is named."""

import shutil

import pandas as pd
import pytest

from agents.evaluate import training_settings
from slam_gym import cli, policies
from slam_gym.episode import Episode
from slam_gym.evaluation import compare
from slam_gym.scenario import Scenario

SHORT = ["--runs", "3", "--steps", "40", "--jobs", "1"]


def evaluate(*words):
    return cli.main(["evaluate", *map(str, words)])


def test_a_name_against_a_name(tmp_path, capsys):
    out = tmp_path / "out"
    assert evaluate("stationary", "--against", "pursuit", "random", *SHORT, "--out", out) == 0
    said = capsys.readouterr().out
    assert "default, ri-ekf: 3 worlds, against pursuit" in said
    assert "against random" in said
    assert "effort" in said
    table = pd.read_csv(out / "evaluation.csv", keep_default_na=False)
    effort = table[(table["metric"] == "effort") & (table["baseline"] == "pursuit")]
    assert effort["policy_value"].item() == 0.0
    assert effort["verdict"].item() == "win"
    assert (out / "runs.parquet").is_file()


def test_a_run_folder_is_evaluated_where_it_was_trained(write_policy, tmp_path, capsys):
    run = write_policy(tmp_path / "run" / "best", set=["sensor.max_range=4.5"]).removesuffix("/best")
    assert evaluate(run, "--against", "stationary", *SHORT, "--out", tmp_path / "out") == 0
    assert "default, ekf: 3 worlds" in capsys.readouterr().out
    plan = (tmp_path / "out" / "parts" / "settings.json").read_text()
    assert '"max_range": 4.5' in plan
    assert evaluate(run, "--scenarios", "open", *SHORT, "--out", tmp_path / "other") == 0
    assert '"max_range": 4.5' not in (tmp_path / "other" / "parts" / "settings.json").read_text()


def test_of_several_run_folders_the_seed_is_the_unit(write_policy, tmp_path, capsys):
    runs = [write_policy(tmp_path / f"run{seed}", seed) for seed in (1, 2, 3)]
    assert evaluate(*runs, "--against", "pursuit", "oracle", *SHORT, "--out", tmp_path / "out") == 0
    said = capsys.readouterr().out
    assert "oracle" in said.partition("3 training seeds")[2]
    assert "3 training seeds in 3 worlds" in said
    assert "The training seed is the unit" in said


def test_only_seeds_of_one_configuration_are_put_together(write_policy, tmp_path):
    def settings(*names):
        return training_settings([policies.parse(str(name)) for name in names])

    one = write_policy(tmp_path / "one", 1)
    with pytest.raises(ValueError, match=r"not the same training .*: num_envs is 8, not None"):
        settings(one, write_policy(tmp_path / "two", 2, num_envs=8))
    with pytest.raises(ValueError, match="trainings with the same seed"):
        settings(one, write_policy(tmp_path / "again", 1))
    with pytest.raises(ValueError, match="name the others with --against"):
        settings(one, "pursuit")
    assert settings("pursuit") == {}
    assert settings(one)["estimator"] == "ekf"


def test_a_folder_drives_wherever_a_policy_is_named(write_policy, tmp_path, monkeypatch):
    folder = write_policy(tmp_path / "runs" / "mine")
    episode = Episode(Scenario.load("default", max_steps=8), ["ekf"], policy=folder)
    episode.step()
    assert episode.policy.weights
    results = compare("default", ["ekf"], [folder, "stationary"], runs=2, steps=20, jobs=1)
    assert list(results.summary["policy"]) == [folder, "stationary"]
    assert results.config["settings"]["combinations"][0]["weights"] == episode.policy.weights
    monkeypatch.chdir(tmp_path / "runs")
    assert policies.parse("mine").options == {"path": "mine"}
    assert policies.parse("pursuit:stand_off=2").name == "pursuit"
    (tmp_path / "runs" / "random").mkdir()
    assert policies.parse("random").name == "random"  # a name goes first
    assert policies.parse("./random").name == "learned"


def test_a_comparison_is_not_resumed_with_other_weights(write_policy, tmp_path):
    folder = write_policy(tmp_path / "mine", 1)
    compare("default", ["ekf"], [folder], runs=1, steps=20, jobs=1, out=tmp_path / "out")
    shutil.rmtree(folder)
    write_policy(tmp_path / "mine", 2)
    with pytest.raises(ValueError, match=r"made with other settings: combinations\[0\]\.weights was"):
        compare("default", ["ekf"], [folder], runs=2, steps=20, jobs=1, out=tmp_path / "out", resume=True)


def test_a_foreign_pickle_is_refused_with_a_reason(tmp_path, capsys):
    (tmp_path / "model.zip").write_bytes(b"PK\x03\x04")
    assert evaluate(tmp_path / "model.zip", *SHORT) == 2
    assert "can run any code when it is loaded" in capsys.readouterr().err
    assert evaluate(tmp_path / "nothing", *SHORT) == 2
    assert "no policy in" in capsys.readouterr().err
