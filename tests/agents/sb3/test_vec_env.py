"""The adapter is DummyVecEnv of the single environments, bit for bit."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import VectorWrapper

import slam_gym  # noqa: F401

pytest.importorskip("stable_baselines3")

from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor, VecNormalize

from agents.sb3.vec_env import SlamTargetVecEnv

LANES, STEPS = 3, 30
SHORT = {"scenario_options": {"max_steps": 8, "hold": 1}}


def native(infos="ends", **settings):
    return SlamTargetVecEnv(gym.make_vec("SlamTarget-v0", num_envs=LANES, **{**SHORT, **settings}), infos)


def dummy(**settings):
    return DummyVecEnv([lambda: gym.make("SlamTarget-v0", **{**SHORT, **settings})] * LANES)


def same(a, b):
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and a.dtype == b.dtype and np.array_equal(a, b)
    return type(a) is type(b) and a == b


ENDS = [
    {},  # truncation only
    {"terminate_on_capture": 1.0, "scenario_options": {"max_steps": 12, "target.start_distance": 1.5}},
]


@pytest.mark.parametrize("observation", ["box", "dict"])
@pytest.mark.parametrize("settings", ENDS, ids=["truncated", "terminated"])
def test_equals_dummy_vec_env(observation, settings):
    ours, theirs = native("all", observation=observation, **settings), dummy(observation=observation, **settings)
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    ours.seed(7)
    theirs.seed(7)
    assert same(ours.reset(), theirs.reset())
    assert all(map(same, ours.reset_infos, theirs.reset_infos))
    rng = np.random.default_rng(0)
    cut, final = 0, 0
    for _ in range(STEPS):
        actions = rng.uniform(-1.0, 1.0, (LANES, 2)).astype(np.float32)
        actions[:, 0] = 1.0  # forwards, so that captures happen
        obs, rewards, dones, infos = ours.step(actions)
        their_obs, their_rewards, their_dones, their_infos = theirs.step(actions)
        assert same(obs, their_obs)
        assert same(rewards, their_rewards)
        assert same(dones, their_dones)
        for info, expected in zip(infos, their_infos, strict=True):
            assert same(info, expected)
        assert all(map(same, ours.reset_infos, theirs.reset_infos))
        cut += sum(info["TimeLimit.truncated"] for info in infos)
        final += int(dones.sum()) - sum(info["TimeLimit.truncated"] for info in infos)
    assert cut
    assert bool(final) == bool(settings)


def test_infos_only_at_the_ends():
    ours = native("ends")
    ours.seed(3)
    first = ours.reset()
    for _ in range(8):
        obs, _, dones, infos = ours.step(np.zeros((LANES, 2), dtype=np.float32))
        if not dones.any():
            assert infos == [{}] * LANES
    assert dones.all()
    assert all(info["TimeLimit.truncated"] and "is_success" in info for info in infos)
    for lane, info in enumerate(infos):
        assert info["terminal_observation"].shape == first[lane].shape
        assert not np.array_equal(info["terminal_observation"], obs[lane])


def test_seeds_of_lanes():
    ours = native()

    def first():
        ours.reset()  # nothing is seen yet
        return ours.step(np.zeros((LANES, 2), dtype=np.float32))[0]

    ours.seed_lanes([11, 5, 11])
    obs = first()
    assert np.array_equal(obs[0], obs[2])
    assert not np.array_equal(obs[0], obs[1])
    ours.seed(5)
    assert np.array_equal(first()[0], obs[1])
    with pytest.raises(ValueError, match="one seed for each"):
        ours.seed_lanes([1])


def test_options_of_the_next_reset():
    ours = native("all")
    ours.seed(0)
    ours.set_options({"target.start_distance": 3.0})
    ours.reset()
    assert all(info["target_distance"] == pytest.approx(3.0) for info in ours.reset_infos)
    ours.set_options([{}, {"target.start_distance": 3.0}, {}])
    with pytest.raises(ValueError, match="same options"):
        ours.reset()


def test_attributes_and_methods():
    ours = native()
    assert ours.get_attr("action_space") == [ours.action_space] * LANES
    assert ours.get_attr("scenario", indices=[0])[0].name == "default"
    assert ours.has_attr("scenario")
    assert not ours.has_attr("no_such_thing")
    ours.set_attr("note", 5)
    assert ours.get_attr("note", [1, 2]) == [5, 5]
    ours.reset()
    states = ours.env_method("get_state")
    assert len(states) == LANES
    assert ours.env_method("set_state", states[0]) == [None] * LANES
    assert ours.env_is_wrapped(Monitor) == [False] * LANES
    wrapped = SlamTargetVecEnv(VectorWrapper(ours.envs))
    assert wrapped.env_is_wrapped(VectorWrapper) == [True] * LANES
    for wrong in (lambda: ours.set_attr("note", 1, 0), lambda: ours.env_method("get_state", indices=[0])):
        with pytest.raises(ValueError, match="all lanes are one environment"):
            wrong()


def test_render():
    ours = native(render_mode="rgb_array")
    ours.reset()
    assert ours.render_mode == "rgb_array"
    one = ours.env_method("render", indices=1)[0]
    assert one.dtype == np.uint8
    tiled = ours.render()
    assert tiled.shape == (2 * one.shape[0], 2 * one.shape[1], 3)
    ours.close()


def test_monitor_and_normalisation():
    ours = VecNormalize(VecMonitor(native()), gamma=0.98)
    theirs = VecNormalize(VecMonitor(dummy()), gamma=0.98)
    for venv in (ours, theirs):
        venv.seed(1)
        venv.reset()
    for _ in range(10):
        actions = np.full((LANES, 2), 0.3, dtype=np.float32)
        obs, rewards, dones, infos = ours.step(actions)
        their_obs, their_rewards, _, their_infos = theirs.step(actions)
        assert same(obs, their_obs)
        assert same(rewards, their_rewards)
        for info, expected, done in zip(infos, their_infos, dones, strict=True):
            if done:
                assert info["episode"]["r"] == expected["episode"]["r"]
                assert info["episode"]["l"] == expected["episode"]["l"] == 8
                assert same(info["terminal_observation"], expected["terminal_observation"])


def test_refuses_what_it_cannot_adapt():
    with pytest.raises(ValueError, match="autoreset_mode='SameStep'"):
        native(autoreset_mode="NextStep")
    with pytest.raises(ValueError, match="vector environment"):
        SlamTargetVecEnv(gym.make("SlamTarget-v0"))
    with pytest.raises(ValueError, match="'ends' or 'all'"):
        native(infos="some")


@pytest.mark.filterwarnings("ignore:It seems that you are using a dictionary")
def test_single_environment_passes_their_checker():
    check_env(gym.make("SlamTarget-v0", **SHORT).unwrapped)
