"""Several trainings side by side are the same trainings one by one."""

from dataclasses import replace

import pytest

pytest.importorskip("stable_baselines3")

from agents.sb3.sweep import seed_folder, sweep
from agents.sb3.train import Train
from agents.sb3.training import train
from slam_gym import cli
from slam_gym.evaluation_backend import Workers, workers

TINY = Train(
    steps=512, num_envs=8, evaluate_every=256, evaluation_runs=2, set=("max_steps=40",), estimator="ekf",
    hyperparams=("n_steps=32", "batch_size=64", "policy_kwargs=dict(net_arch=[8])"),
)  # fmt: skip
SEEDS = (3, 4)
HERE = Workers(1)


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """The digests of the seeds' weights, each trained by itself."""
    out = tmp_path_factory.mktemp("alone")
    return [train(replace(TINY, seed=seed), out / str(seed)).digest for seed in SEEDS]


def test_one_after_the_other(tmp_path, alone):
    told = []
    trained = sweep(replace(TINY, seeds=SEEDS), tmp_path, HERE, report=lambda *what: told.append(what))
    assert [one.digest for one in trained] == alone
    assert [one.out for one in trained] == [tmp_path / "seed-3", tmp_path / "seed-4"]
    assert [(seed, done) for seed, done, _, row in told if row] == [(s, n) for s in SEEDS for n in (0, 256, 512)]


def test_resumed_it_goes_on_with_what_is_done_and_begins_the_rest(tmp_path, alone):
    sweep(replace(TINY, seeds=SEEDS[:1]), tmp_path, HERE)
    with pytest.raises(ValueError, match=r"seed-3' holds a training already"):
        sweep(replace(TINY, seeds=(4, 3)), tmp_path, HERE)
    assert not seed_folder(tmp_path, 4).exists()  # refused before anything is done
    trained = sweep(replace(TINY, seeds=SEEDS, resume=True), tmp_path, HERE)
    assert [one.digest for one in trained] == alone


def test_the_command(tmp_path, capsys):
    words = ["train", "--seeds", "0", "0", "--out", str(tmp_path)]
    assert cli.main(words) == 2
    assert "--seeds names a seed twice: 0 0" in capsys.readouterr().err
    words = ["train", "--steps", "256", "--num-envs", "4", "--evaluation-runs", "2", "--set", "max_steps=40"]
    words += ["--estimator", "ekf", "--hyperparams", "n_steps=32", "batch_size=64", "--out", str(tmp_path)]
    assert cli.main([*words, "--seeds", "0", "1", "--jobs", "1"]) == 0
    said = capsys.readouterr()
    assert f"slam-gym evaluate {tmp_path / 'seed-0'} {tmp_path / 'seed-1'}" in said.out
    assert "seed 1:         256 decisions: return" in said.err


@pytest.mark.slow
def test_in_processes(tmp_path, alone):
    told = []
    with workers(2) as crew:
        trained = sweep(replace(TINY, seeds=SEEDS), tmp_path, crew, report=lambda *what: told.append(what))
    assert [one.digest for one in trained] == alone
    assert sorted((seed, done, total) for seed, done, total, _ in told) == [
        (s, n, 512) for s in SEEDS for n in (0, 256, 512)
    ]


@pytest.mark.slow
def test_on_a_cluster(tmp_path, alone):
    ray = pytest.importorskip("ray")
    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    try:
        with workers(2, "ray") as crew:
            assert [one.digest for one in sweep(replace(TINY, seeds=SEEDS), tmp_path, crew)] == alone
    finally:
        ray.shutdown()
