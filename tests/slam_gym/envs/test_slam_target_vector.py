import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import slam_gym  # noqa: F401  (registers the environment)
from slam_gym.envs.slam_target_vector import SlamTargetVectorEnv
from slam_gym.testing import check_vector_env

SHORT = {"max_steps": 15}


def make(num_envs=3, mode=AutoresetMode.SAME_STEP, **kwargs):
    kwargs.setdefault("scenario_options", SHORT)
    return gym.make_vec("SlamTarget-v0", num_envs=num_envs, autoreset_mode=mode, **kwargs)


def single(**kwargs):
    return gym.make("SlamTarget-v0", scenario_options=SHORT, **kwargs)


def play(envs, steps, seed=None, action_seed=3):
    rng = np.random.default_rng(action_seed)
    if seed is not None:
        envs.reset(seed=seed)
    shape = (envs.num_envs, 2)
    return [envs.step(rng.uniform(-1, 1, shape).astype(np.float32)) for _ in range(steps)]


@pytest.mark.parametrize("observation", ["box", "dict"])
def test_lanes_are_single_environments_in_all_three_modes(observation):
    check_vector_env(
        lambda n, mode: make(n, mode, observation=observation),
        lambda: single(observation=observation),
        num_envs=3,
        steps=40,
    )


def test_lanes_of_a_sparse_sensor_and_held_actions_are_single_environments():
    options = {"max_steps": 14, "hold": 4, "sensor_period": 3}
    check_vector_env(
        lambda n, mode: make(n, mode, scenario_options=options),
        lambda: gym.make("SlamTarget-v0", scenario_options=options),
        num_envs=2,
        steps=10,
    )


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_an_episode_that_begins_where_it_may_end_is_not_over_before_a_step(mode):
    envs = make(2, mode, estimator="dead-reckoning", terminate_on_capture=100.0)
    envs.reset(seed=0)
    nothing = np.zeros((2, 2), dtype=np.float32)
    assert envs.step(nothing)[2].all()
    if mode == AutoresetMode.DISABLED:
        envs.reset(options={"reset_mask": np.ones(2, dtype=np.bool_)})
    over = envs.step(nothing)[2]
    assert not over.any() if mode == AutoresetMode.NEXT_STEP else over.all()


@pytest.mark.parametrize("lanes", [2, 7])
def test_a_lane_does_not_depend_on_how_many_there_are(lanes):
    few, many = play(make(lanes), 20, seed=0), play(make(16), 0, seed=0)
    assert not many
    wide = make(16)
    wide.reset(seed=0)
    rng = np.random.default_rng(3)
    for observations, rewards, *_ in few:
        actions = np.zeros((16, 2), dtype=np.float32)
        actions[:lanes] = rng.uniform(-1, 1, (lanes, 2)).astype(np.float32)
        all_observations, all_rewards, *_ = wide.step(actions)
        np.testing.assert_array_equal(all_observations[:lanes], observations)
        np.testing.assert_array_equal(all_rewards[:lanes], rewards)


def test_threads_change_nothing():
    for one, two in zip(play(make(5), 20, seed=1), play(make(5, threads=2), 20, seed=1), strict=True):
        np.testing.assert_equal(one[:4], two[:4])


def test_it_equals_gymnasiums_own_vector_of_single_environments():
    native, synced = make(3, AutoresetMode.NEXT_STEP), gym.vector.SyncVectorEnv([single] * 3)
    np.testing.assert_array_equal(native.reset(seed=5)[0], synced.reset(seed=5)[0])
    for ours, theirs in zip(play(native, 32), play(synced, 32), strict=True):
        for mine, other in zip(ours[:4], theirs[:4], strict=True):
            np.testing.assert_array_equal(mine, other)


def test_subprocesses_find_it_by_the_id_alone():
    maker = "slam_gym:SlamTarget-v0"
    envs = gym.make_vec(maker, num_envs=2, vectorization_mode="async", scenario_options=SHORT)
    try:
        observations, _ = envs.reset(seed=2)
        np.testing.assert_array_equal(observations, make(2).reset(seed=2)[0])
        assert envs.step(envs.action_space.sample())[1].shape == (2,)
    finally:
        envs.close()


@pytest.mark.parametrize("through", ["pickle", "state"])
def test_it_goes_on_bit_for_bit(through):
    envs = make().unwrapped
    play(envs, 20, seed=1)
    if through == "pickle":
        other = pickle.loads(pickle.dumps(envs))
    else:
        other = make().unwrapped
        other.set_state(envs.get_state())
    for one, two in zip(play(envs, 20, action_seed=9), play(other, 20, action_seed=9), strict=True):
        np.testing.assert_equal(one[:4], two[:4])


def test_pictures_one_per_lane():
    envs = make(2, render_mode="rgb_array")
    envs.reset(seed=0)
    pictures = envs.render()
    envs.close()
    assert [picture.dtype for picture in pictures] == [np.uint8] * 2
    assert not np.array_equal(*pictures)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: SlamTargetVectorEnv(num_envs=0), "num_envs must be a whole number of at least 1"),
        (lambda: SlamTargetVectorEnv(num_envs=2, autoreset_mode="later"), "autoreset_mode must be one of"),
        (lambda: SlamTargetVectorEnv(num_envs=2, render_mode="human"), "render_mode must be None or 'rgb_array'; got"),
        (lambda: SlamTargetVectorEnv(num_envs=2).reset(seed=[1]), "one for each of the 2 lanes"),
        (lambda: SlamTargetVectorEnv(num_envs=2).reset(seed=-3), "zero"),
        (lambda: SlamTargetVectorEnv(num_envs=2).reset(options={"reset_mask": [True, False]}), "boolean array"),
        (lambda: SlamTargetVectorEnv(num_envs=2).reset(options={"reset_mask": np.zeros(2, bool)}), "at least one True"),
    ],
)
def test_wrong_calls_say_what_to_do(call, message):
    with pytest.raises((ValueError, gym.error.Error), match=message):
        call()


def test_wrong_actions_are_refused():
    envs = make(2).unwrapped
    with pytest.raises(gym.error.ResetNeeded):
        envs.step(np.zeros((2, 2), dtype=np.float32))
    envs.reset(seed=0)
    with pytest.raises(ValueError, match=r"shape \(2, 2\)"):
        envs.step(np.zeros((3, 2), dtype=np.float32))
    for bad, told in (
        ([[0.5, 0.0], [np.nan, 1.0]], r"\[nan, 1.0\] in lane 1$"),
        ([[np.inf, 0.0]] * 2, "lane 0, and 1 more"),
    ):
        with pytest.raises(ValueError, match=f"finite numbers.*{told}"):
            envs.step(np.array(bad, dtype=np.float32))


def test_ended_lanes_refuse_to_go_on_without_autoreset():
    envs = make(2, AutoresetMode.DISABLED).unwrapped
    play(envs, 15, seed=0)
    with pytest.raises(gym.error.ResetNeeded, match="reset_mask"):
        envs.step(np.zeros((2, 2), dtype=np.float32))
