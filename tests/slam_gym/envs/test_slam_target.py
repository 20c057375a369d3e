import copy
import json
import pickle
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import RecordVideo

import slam_gym  # noqa: F401  (registers the environment)
from slam_gym.envs.slam_target import SlamTargetEnv

SHORT = {"max_steps": 20}


def make(**kwargs):
    kwargs.setdefault("scenario_options", SHORT)
    return gym.make("SlamTarget-v0", **kwargs)


def play(env, steps, *, seed=None, action_seed=7):
    """Observations, rewards and infos of a few random steps."""
    rng = np.random.default_rng(action_seed)
    observation, info = env.reset(seed=seed)
    rows = [(observation, 0.0, info)]
    for _ in range(steps):
        observation, reward, terminated, truncated, info = env.step(rng.uniform(-1, 1, 2).astype(np.float32))
        rows.append((observation, reward, info))
        if terminated or truncated:
            break
    return rows


def assert_same(a, b):
    assert len(a) == len(b)
    for (obs_a, reward_a, info_a), (obs_b, reward_b, info_b) in zip(a, b, strict=True):
        np.testing.assert_equal(obs_a, obs_b)
        np.testing.assert_equal((reward_a, info_a), (reward_b, info_b))


@pytest.mark.parametrize("observation", ["box", "dict"])
def test_gymnasium_checks_pass_with_warnings_as_errors(observation):
    env = make(observation=observation, render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped, skip_render_check=False)


@pytest.mark.parametrize("observation", ["box", "dict"])
def test_a_whole_episode_passes_the_checks_of_every_step_that_make_leaves_out(observation):
    env = make(observation=observation, disable_env_checker=False)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(play(env, 25, seed=0)) == SHORT["max_steps"] + 1


@pytest.mark.parametrize("observation", ["box", "dict"])
def test_stable_baselines_checks_pass_with_warnings_as_errors(observation):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker.check_env(make(observation=observation).unwrapped)


def test_the_spec_survives_json():
    env = make(estimator="ekf", estimator_options={"gate": 25.0}, reward={"effort": 0.1}, observation="dict")
    again = gym.make(EnvSpec.from_json(env.spec.to_json()))
    assert again.spec.kwargs == env.spec.kwargs
    assert_same(play(env, 5, seed=3), play(again, 5, seed=3))


def test_the_same_seed_gives_the_same_episode_and_another_another():
    env = make()
    first, second, other = play(env, 20, seed=1), play(env, 20, seed=1), play(env, 20, seed=2)
    assert_same(first, second)
    assert not np.array_equal(first[5][0], other[5][0])


def test_a_reset_without_seed_is_fresh_and_reproducible():
    env, again = make(), make()
    episodes = [play(env, 5, seed=4), play(env, 5), play(env, 5)]
    assert not np.array_equal(episodes[1][3][0], episodes[2][3][0])
    for episode, repeated in zip(episodes, [play(again, 5, seed=4), play(again, 5), play(again, 5)], strict=True):
        assert_same(episode, repeated)


def test_truncated_at_the_scenarios_end_and_never_before():
    rows = play(make(), 100, seed=0)
    assert len(rows) - 1 == 20
    env = make()
    env.reset(seed=0)
    ends = [env.step(env.action_space.sample())[2:4] for _ in range(20)]
    assert [truncated for _, truncated in ends] == [False] * 19 + [True]
    assert not any(terminated for terminated, _ in ends)


def test_capture_and_leaving_terminate_where_asked():
    env = make(terminate_on_capture=100.0)
    env.reset(seed=0)
    *_, terminated, truncated, info = env.step(np.zeros(2, dtype=np.float32))
    assert terminated and not truncated and info["captured"] and info["is_success"]
    env = make(scenario_options={"max_steps": 20, "arena.width": 0.5, "arena.walls": False}, terminate_outside=True)
    env.reset(seed=0)
    for _ in range(20):
        *_, terminated, _, info = env.step(np.array([1.0, 0.0], dtype=np.float32))
        if terminated:
            break
    assert terminated and info["outside"]


def test_nothing_can_be_captured_where_there_is_no_target():
    with pytest.raises(ValueError, match="terminate_on_capture needs a target; scenario 'tian-sparse' has none"):
        make(scenario="tian-sparse", terminate_on_capture=0.5)


def test_the_observation_does_not_know_the_truth():
    env = make().unwrapped
    env.reset(seed=0)
    for _ in range(5):
        before = env.step(np.array([0.5, 0.1], dtype=np.float32))[0]
    world = env.simulation.world
    for truth in (world.pose, world.target, world.landmarks, world.target_heading):
        truth += 1.234
    world.target_visible[:] = ~world.target_visible
    np.testing.assert_array_equal(env._observe(), before)


@pytest.mark.parametrize("kind", ["twist", "wheels"])
def test_a_forward_action_drives_forward(kind):
    env = make(action=kind, scenario="open", scenario_options={"max_steps": 20, "robot.speed_std_per_speed": 0.0})
    env.reset(seed=0)
    action = [1.0, 0.0] if kind == "twist" else [1.0, 1.0]
    for _ in range(10):
        info = env.step(np.array(action, dtype=np.float32))[-1]
    assert info["robot_pose"][0] == pytest.approx(1.0, abs=0.1)


def test_a_bicycle_is_steered():
    env = make(scenario="tian-sparse")
    env.reset(seed=0)
    for _ in range(20):
        info = env.step(np.array([1.0, 0.5], dtype=np.float32))[-1]
    assert info["robot_pose"][2] > 0.0 and "target_error" not in info and "target_distance" not in info


def test_without_landmark_ids_the_reward_is_finite_and_the_map_is_counted():
    env = make(scenario="open", scenario_options={"landmarks.labelled": False, **SHORT}, reward={"explore": 1.0})
    rows = play(env, 10, seed=0)
    assert all(np.isfinite(reward) for _, reward, _ in rows)
    mapped = [info["landmark_count"] for *_, info in rows]
    assert mapped[-1] == env.unwrapped.belief.landmark_mapped.sum() > 0
    assert [info["reward_explore"] for *_, info in rows[1:]] == np.maximum(np.diff(mapped), 0.0).tolist()
    assert all("landmark_error" not in info for *_, info in rows)


def test_options_change_one_episode():
    env = make()
    _, info = env.reset(
        seed=0, options={"target.start_distance": 3.0, "target.start_bearing": 0.1, "target.speed": 0.0}
    )
    start = info["target_state"]
    assert info["target_distance"] == pytest.approx(3.0)
    *_, info = env.step(np.zeros(2, dtype=np.float32))
    np.testing.assert_allclose(info["target_state"][:2], start[:2])
    play(env, 3)
    assert env.unwrapped.simulation.world.numbers["target_speed"][0] > 0.0


@pytest.mark.parametrize("through", ["pickle", "deepcopy", "state"])
def test_it_goes_on_bit_for_bit(through):
    env = make().unwrapped
    play(env, 6, seed=5)
    if through == "state":
        other = make().unwrapped
        other.set_state(env.get_state())
    else:
        other = pickle.loads(pickle.dumps(env)) if through == "pickle" else copy.deepcopy(env)
    for _ in range(8):
        action = env.action_space.sample()
        np.testing.assert_equal(env.step(action), other.step(action))


def test_a_video_is_recorded(tmp_path):
    env = RecordVideo(make(render_mode="rgb_array", scenario_options={"max_steps": 4}), str(tmp_path / "videos"))
    play(env, 4, seed=0)
    env.close()
    assert [path.stat().st_size > 1000 for path in tmp_path.glob("videos/*.mp4")] == [True]


def test_a_reference_that_is_told_the_truth_is_refused_unless_asked_for():
    with pytest.raises(ValueError, match="handed the truth"):
        make(estimator="ideal-ekf")
    assert len(play(make(estimator="ideal-ekf", allow_truth=True), 3, seed=0)) == 4


def test_the_page_is_complete():
    page = SlamTargetEnv.__doc__
    for heading in ("Action Space", "Observation Space", "Rewards", "Starting State", "Episode End", "Arguments"):
        assert f"## {heading}" in page
    assert "_TABLE" not in page and "landmark_mask" in page and "| track " in page
    assert f"{make().observation_space.shape[0]} " in page


WRONG = {
    "scenario": ({"scenario": "defualt"}, "Did you mean 'default'"),
    "scenario type": ({"scenario": 3}, "scenario must be a name"),
    "option": ({"scenario_options": {"sensor.max_rang": 3.0}}, "Did you mean 'sensor.max_range'"),
    "value": ({"scenario_options": {"sensor.max_range": -3.0}}, "sensor.max_range must be more than 0"),
    "options type": ({"scenario_options": [1]}, "scenario_options must be a dictionary"),
    "estimator": ({"estimator": "efk"}, "Did you mean 'ekf'"),
    "options in the name": ({"estimator": "slamto:particles=9"}, r"the name is 'slamto'; its options .particles=9."),
    "estimator option": ({"estimator_options": {"gat": 3.0}}, "gat"),
    "observation": ({"observation": "boxes"}, "Did you mean 'box'"),
    "action": ({"action": "twists"}, "Did you mean 'twist'"),
    "steering": ({"action": "steering"}, "'twist' or 'wheels'"),
    "reward": ({"reward": {"trak": 1.0}}, "Did you mean 'track'"),
    "weight": ({"reward": {"track": "much"}}, "must be a finite number"),
    "landmarks": ({"nearest_landmarks": 0}, "nearest_landmarks must be a whole number"),
    "capture": ({"terminate_on_capture": -1.0}, "terminate_on_capture must be a positive number"),
    "render": ({"render_mode": "ascii"}, "render_mode must be None or 'human' or 'rgb_array'"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_arguments_say_what_to_do(case):
    kwargs, message = WRONG[case]
    with pytest.raises(ValueError, match=message):
        SlamTargetEnv(**kwargs)


@pytest.mark.parametrize(
    ("action", "message"),
    [
        (np.zeros(3, dtype=np.float32), r"shape \(2,\)"),
        (np.float32(0.5), r"shape \(2,\)"),
        (np.array([np.nan, 0.0], dtype=np.float32), "finite"),
        (np.array([0.0, np.inf], dtype=np.float32), "finite"),
    ],
)
def test_wrong_actions_are_refused(action, message):
    env = make().unwrapped
    env.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        env.step(action)


def test_a_step_needs_a_reset():
    env = make().unwrapped
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros(2, dtype=np.float32))


def test_the_info_is_plain_json_but_for_two_arrays():
    info = play(make(), 3, seed=0)[-1][2]
    arrays = {key: info.pop(key) for key in ("robot_pose", "target_state")}
    json.dumps(info)
    assert {key: value.shape for key, value in arrays.items()} == {"robot_pose": (3,), "target_state": (4,)}


def test_an_info_stays_as_it_was_and_belongs_to_its_reader():
    env = make()
    first = env.reset(seed=0)[1]
    as_it_was = copy.deepcopy(first)
    assert not np.array_equal(env.step(np.array([0.5, 0.3], dtype=np.float32))[-1]["robot_pose"], first["robot_pose"])
    np.testing.assert_equal(first, as_it_was)
    first["robot_pose"][0] = first["target_state"][0] = 100.0
    world = env.unwrapped.simulation.world
    assert world.pose[0, 0] < 100.0 and world.target[0, 0] < 100.0
