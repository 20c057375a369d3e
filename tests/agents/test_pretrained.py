"""The policies that come with slam-gym: they load, they drive in their scenario, and they are worth having."""

import tomllib
from fnmatch import fnmatch
from pathlib import Path

import numpy as np
import pytest

from agents.pretrained.policy import FOLDER, zones
from agents.sb3.policy_file import load_policy
from slam_gym import policies
from slam_gym.episode import Episode
from slam_gym.evaluation import compare
from slam_gym.policies import PolicyContext
from slam_gym.scenario import Scenario

ROOT = Path(__file__).parents[2]


def make(scenario, **options):
    return policies.make("ppo", PolicyContext.from_scenario(Scenario.load(scenario)), **options)


def test_each_says_how_it_was_trained_and_what_it_reached():
    readme = (FOLDER / "README.md").read_text()
    assert "default" in zones()
    for zone in zones():
        settings, _ = load_policy(FOLDER / zone)
        told = settings["training"]
        assert told["settings"]["scenario"] == zone
        assert told["command"].startswith("slam-gym train")
        assert told["command"] in readme
        assert settings["sha256"][:12] in readme
        assert (FOLDER / zone / "weights.safetensors").stat().st_size < 400_000


def test_the_scenario_chooses_and_the_default_stands_in():
    for zone in zones():
        assert make(zone).path == FOLDER / zone
        swept = Scenario.load(zone).replace("name", f"{zone} target.speed=1.2")
        assert policies.make("ppo", PolicyContext.from_scenario(swept)).path == FOLDER / zone
    assert make("open").path == FOLDER / "default"
    assert make("open", zone=zones()[-1]).path == FOLDER / zones()[-1]
    with pytest.raises(ValueError, match=r"unknown zone 'defualt'\. Did you mean 'default'\?"):
        make("default", zone="defualt")
    with pytest.raises(ValueError, match="trained to give 'twist' actions"):
        make("tian-sparse")


def test_it_drives_where_there_is_no_target():
    episode = Episode(Scenario.load("geng-hu", max_steps=8), ["ekf"], policy="ppo")
    episode.step()
    assert np.isfinite(episode.simulation.world.pose).all()


@pytest.mark.parametrize("zone", zones())
def test_each_loses_the_target_less_than_those_that_do_not_look(zone):
    runs = compare(zone, ["ri-ekf"], ["ppo", "stationary", "random"], runs=12, jobs=1, seed=7).runs
    means = runs.groupby("policy")[["lost_share", "target_error_capped"]].mean()
    for other in ("stationary", "random"):
        assert (means.loc["ppo"] < 0.8 * means.loc[other]).all(), means


def test_they_are_part_of_the_package():
    setuptools = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    assert "agents.pretrained" in setuptools["packages"]
    patterns = setuptools["package-data"]["agents.pretrained"]
    for file in FOLDER.rglob("*"):
        if file.is_file() and file.suffix not in (".py", ".pyc"):
            assert any(fnmatch(str(file.relative_to(FOLDER)), pattern) for pattern in patterns), file
