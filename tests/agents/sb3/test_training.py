"""A training of test size: what it leaves behind, the same weights again, interrupted or not."""

import csv
import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from agents.sb3.evaluation import evaluate
from agents.sb3.policy_file import load_policy, read_settings
from agents.sb3.tensors import read_tensors
from agents.sb3.train import Train, describe, stopped
from agents.sb3.training import (
    EVALUATION_SEEDS,
    TEACHER_SEEDS,
    TRAINING_SEEDS,
    build,
    check_numbers,
    check_reward,
    load_scenario,
    make_environment,
    read_hyperparameters,
    train,
)
from estimators.kernels.random import lane_key
from slam_gym import cli
from slam_gym.evaluation_plan import POLICY_SEEDS, WORLD_SEEDS, run_seeds
from slam_gym.scenario import Scenario

PPO = Train(
    steps=4096, num_envs=16, seed=3, evaluate_every=1500, evaluation_runs=6, set=("max_steps=120",),
    estimator="ekf", hyperparams=("n_steps=32", "batch_size=256", "policy_kwargs=dict(net_arch=[16])"),
)  # fmt: skip
SAC = replace(
    PPO, algo="sac", steps=1400, num_envs=8, evaluate_every=600, evaluation_runs=2, set=("max_steps=40",),
    hyperparams=("learning_starts=200", "gradient_steps=1", "batch_size=32", "buffer_size=1000",
                 "policy_kwargs=dict(net_arch=[16])"),
)  # fmt: skip
TAUGHT = replace(PPO, teacher="pursuit", teacher_decisions=1024, steps=2048, evaluate_every=1024)


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    out = tmp_path_factory.mktemp("ppo") / "run"
    told = []
    return train(PPO, out, command="slam-gym train", report=lambda *what: told.append(what)), told


def test_what_a_training_leaves_behind(trained):
    run, told = trained
    assert [row["steps"] for row in run.rows] == [0, 1536, 3072, 4096]
    assert told[-1][:2] == (4096, 4096)
    with (run.out / "evaluations.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["return"]) for row in rows] == pytest.approx([row["return"] for row in run.rows], rel=1e-6)
    config = json.loads((run.out / "config.json").read_text())
    assert config["command"] == "slam-gym train"
    assert config["settings"]["seed"] == 3
    assert config["hyperparameters"]["gamma"] == 0.98
    assert "torch" in config["versions"]
    best, latest = read_settings(run.out / "best"), read_settings(run.out / "latest")
    assert best["training"]["evaluation"] == run.best
    assert latest["sha256"] == run.digest
    assert latest["decision_dt"] == pytest.approx(0.4)
    assert list((run.out / "tensorboard").iterdir())


def test_it_learns(tmp_path):
    """A minute of robot time in 32 worlds is enough to turn towards the target."""
    chosen = ("n_steps=16", "batch_size=128", "policy_kwargs=dict(net_arch=[32])", "learning_rate=3e-3")
    settings = Train(
        steps=8192, num_envs=32, evaluate_every=8192, evaluation_runs=16, estimator="ekf", hyperparams=chosen
    )
    first, last = train(settings, tmp_path).rows
    assert last["return"] > first["return"] + 30.0  # seeds 0, 1, 2: 98, 80, 47
    assert last["lost"] < first["lost"] - 0.15
    assert "target error" in describe(last)


def test_the_policy_file_earns_what_the_evaluation_says(trained):
    run = trained[0]
    network = load_policy(run.out / "best")[1]
    envs = make_environment(PPO, load_scenario(PPO), PPO.evaluation_runs, "NextStep")

    def act(observations):
        action = np.zeros((len(observations), 2))
        network.act(observations, np.arange(len(observations)), action)
        return action

    seeds = run_seeds(PPO.seed, EVALUATION_SEEDS, range(PPO.evaluation_runs)).tolist()
    assert evaluate(act, envs, seeds)["return"] == pytest.approx(run.best["return"], abs=0.5)


def test_the_same_command_gives_the_same_weights(trained, tmp_path):
    again, first = train(PPO, tmp_path), trained[0]
    assert again.digest == first.digest
    assert again.rows == first.rows
    for name in ("best", "latest"):  # the tensors themselves, not only what the file says of them
        one, other = (read_tensors(run.out / name / "weights.safetensors") for run in (first, again))
        assert list(one) == list(other)
        assert all(np.array_equal(one[key], other[key]) for key in one)
    assert train(replace(PPO, seed=4, steps=512), tmp_path / "other").digest != first.digest


class StopError(Exception):
    pass


@pytest.mark.parametrize("settings", [PPO, SAC, TAUGHT], ids=["ppo", "sac", "taught"])
def test_an_interrupted_training_ends_with_the_same_weights(settings, trained, tmp_path):
    whole = trained[0] if settings is PPO else train(settings, tmp_path / "whole")

    def interrupt(done, total, row):
        if done > 0.8 * total:
            raise StopError

    with pytest.raises(StopError):
        train(settings, tmp_path / "parts", report=interrupt)
    resumed = train(replace(settings, resume=True), tmp_path / "parts")
    assert resumed.digest == whole.digest
    assert resumed.rows == whole.rows


def test_a_taught_policy_begins_where_its_teacher_is(tmp_path):
    """Few decisions of a teacher are worth more than as many trials; then only the critic learns."""
    settings = replace(TAUGHT, teacher_decisions=8192, num_envs=64, steps=4096, evaluation_runs=16)
    begun = train(settings, tmp_path / "taught")
    alone = train(replace(settings, teacher="", steps=1), tmp_path / "alone")
    assert begun.rows[0]["lost"] < alone.rows[0]["lost"] - 0.1
    assert begun.rows[0]["return"] > alone.rows[0]["return"] + 10.0
    assert begun.rows[1]["return"] == pytest.approx(begun.rows[0]["return"], abs=2.0)  # the moments move a little


def test_a_policy_is_shown_the_cloud_that_its_teacher_reads(tmp_path):
    settings = replace(
        TAUGHT, scenario="evasive", teacher="pursuit-hunt", teacher_decisions=160, target_cloud=16, steps=16,
        target_cloud_options=("evasive=true",),
    )  # fmt: skip
    shown = read_settings(train(settings, tmp_path).out / "latest")["observation"]
    assert shown["target_cloud_options"] == {"evasive": True}


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"algo": "sac", "hyperparams": ()}, "works with --algo ppo"),
        ({"teacher": "persuit"}, "unknown policy"),
        ({"teacher": "pursuit-search"}, "add --target-cloud 256"),
        ({"teacher": "oracle"}, "is told the truth"),
    ],
)
def test_not_everybody_can_teach(wrong, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        train(replace(TAUGHT, **wrong), tmp_path)


def test_a_taught_training_has_hyperparameters_of_its_own():
    scenario = Scenario.load("default")
    taught, plain = (read_hyperparameters(Train(teacher=name), scenario).values for name in ("pursuit", ""))
    assert taught["policy_kwargs"]["log_std_init"] < plain["policy_kwargs"]["log_std_init"]
    assert taught["n_timesteps"] < plain["n_timesteps"]
    changed = read_hyperparameters(Train(teacher="pursuit", hyperparams=("gamma=0.9",), steps=5.0), scenario)
    assert (changed.values["gamma"], changed.n_timesteps) == (0.9, 5)


def test_a_finished_training_can_get_longer(trained, tmp_path):
    short = train(replace(PPO, steps=2048, evaluate_every=1500), tmp_path)
    longer = train(replace(PPO, resume=True), tmp_path)
    assert longer.digest == trained[0].digest != short.digest
    assert train(replace(PPO, resume=True), tmp_path).digest == longer.digest  # nothing left to do


def test_a_folder_is_not_overwritten_and_other_settings_are_not_resumed(trained, tmp_path):
    out = trained[0].out
    with pytest.raises(ValueError, match=r"holds a training already: go on with --resume"):
        train(PPO, out)
    with pytest.raises(ValueError, match=r"seed was 3, not 4. The command was: slam-gym train"):
        train(replace(PPO, seed=4, resume=True), out)
    with pytest.raises(ValueError, match=r"gamma was 0.98, not 0.9"):
        train(replace(PPO, hyperparams=(*PPO.hyperparams, "gamma=0.9"), resume=True), out)
    with pytest.raises(ValueError, match=r"nothing to resume: there is no checkpoint.pt in '[^']*'$"):
        train(replace(PPO, resume=True), tmp_path / "alone")
    with pytest.raises(ValueError, match=rf"nothing to resume.* Trainings beside it, for --out: .*{out}"):
        train(replace(PPO, resume=True), out.with_name("mistyped"))


def test_worlds_of_training_evaluation_and_comparison_never_overlap():
    """Whatever the seeds: a policy is not selected in worlds that it was trained in, nor judged in either."""
    purposes = (TRAINING_SEEDS, EVALUATION_SEEDS, TEACHER_SEEDS, WORLD_SEEDS, POLICY_SEEDS)
    seeds = [run_seeds(seed, purpose, range(300)) for seed in range(5) for purpose in purposes]
    assert len(np.unique(np.concatenate(seeds))) == 5 * len(purposes) * 300


def test_training_and_selection_happen_in_the_worlds_of_their_purpose():
    scenario = load_scenario(PPO)
    model = build(PPO, scenario, read_hyperparameters(PPO, scenario))
    model.env.reset()
    world = model.env.unwrapped.envs.unwrapped.simulation.world
    expected = [lane_key(int(seed)) for seed in run_seeds(PPO.seed, TRAINING_SEEDS, range(PPO.num_envs))]
    assert list(world.key) == expected
    judged = run_seeds(PPO.seed, WORLD_SEEDS, range(1000)).tolist()
    assert not set(expected) & {lane_key(seed) for seed in judged}


def test_how_long_an_action_lasts():
    assert load_scenario(Train()).hold == 4
    assert load_scenario(Train(hold=2)).hold == 2
    assert load_scenario(Train(set=("hold=3",))).hold == 3
    dt = Scenario.load("default").dt
    assert load_scenario(Train(set=("dt=0.9",))).hold == 1 != 4 * dt


def test_wrong_numbers_are_named(capsys, tmp_path):
    counts = ({"steps": 0}, {"num_envs": 0}, {"evaluate_every": 0}, {"evaluation_runs": 0}, {"threads": 0})
    for wrong in (*counts, {"seed": -1}):
        with pytest.raises(ValueError, match=next(iter(wrong)).replace("_", "-")):
            check_numbers(Train(**wrong))
    assert cli.main(["train", "--hyperparams", "gama=0.9", "--out", str(tmp_path)]) == 2
    assert "PPO: unknown hyperparameter 'gama'. Did you mean 'gamma'?" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("wrong", "message"),
    [("batch_size=1", "PPO does not accept these hyperparameters: `batch_size` must be greater than 1"),
     ("policy_kwargs=dict(foo=1)", "PPO does not accept these hyperparameters: .*'foo'"),
     ("seed=3", "unknown hyperparameter 'seed'")],
)  # fmt: skip
def test_what_the_algorithm_does_not_accept(wrong, message):
    settings = replace(PPO, hyperparams=(*PPO.hyperparams, wrong))
    scenario = load_scenario(settings)
    with pytest.raises(ValueError, match=message):
        build(settings, scenario, read_hyperparameters(settings, scenario))


def test_few_lanes_make_one_batch_without_a_warning():
    settings = replace(PPO, num_envs=2, hyperparams=("n_steps=8", "batch_size=4096"))
    scenario = load_scenario(settings)
    assert build(settings, scenario, read_hyperparameters(settings, scenario)).batch_size == 16


def test_nobody_trains_for_nothing():
    for settings, why in (
        (Train(scenario="geng-l1"), "'geng-l1' has no target"),
        (Train(reward=("track=0", "pursue=0")), "^with these weights every reward would be zero"),
    ):
        with pytest.raises(ValueError, match=why):
            check_reward(settings, load_scenario(settings))
    paid = Train(scenario="geng-l1", reward=("localise=1",))
    check_reward(paid, load_scenario(paid))


def test_the_command_prints_where_the_policy_is(capsys, tmp_path):
    words = ["train", "--steps", "256", "--num-envs", "4", "--evaluation-runs", "2", "--set", "max_steps=40"]
    words += ["--estimator", "ekf", "--hyperparams", "n_steps=32", "batch_size=64", "--out", str(tmp_path / "run")]
    assert cli.main(words) == 0
    said = capsys.readouterr()
    assert f"slam-gym evaluate {tmp_path / 'run'}" in said.out
    assert "256 decisions: return" in said.err


def test_nothing_heavy_is_imported_before_it_is_needed():
    heavy = "('torch', 'stable_baselines3')"
    code = f"import sys, agents.sb3.train, agents.sb3.policy; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_an_interrupted_training_says_whether_it_can_go_on(tmp_path):
    assert "nothing to go on from" in stopped(tmp_path / "none")
    folder = tmp_path / "sweep" / "seed-3"
    folder.mkdir(parents=True)
    (folder / "checkpoint.pt").write_bytes(b"")
    assert "--resume goes on" in stopped(tmp_path / "sweep")
