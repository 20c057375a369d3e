import math

import gymnasium as gym
import numpy as np
import pytest

import slam_gym  # noqa: F401
from slam_gym.observation import FAR

N, S = 64, 6
L, STEPS = 8, 9
ARGUMENTS = {"estimator": "ekf", "sectors": S, "scenario": "default", "scenario_options": {"hold": 4}}


@pytest.fixture(scope="module")
def driven():
    """Robots that drove off blindly, with a cloud and without: environments and their last observations."""
    both = []
    for points in (N, 0):
        envs = gym.make_vec("SlamTarget-v0", num_envs=L, target_cloud=points, **ARGUMENTS).unwrapped
        shown, _ = envs.reset(seed=3)
        for step in range(STEPS):
            shown, *_ = envs.step(np.full((L, 2), [0.6, 0.3 * (-1) ** step], dtype=np.float32))
        both.append((envs, shown))
    return both


def test_the_sectors_and_distances_are_those_of_the_points(driven):
    envs, shown = driven[0]
    unit, belief = envs.scenario.sensor.max_range, envs.belief
    points, weights = belief.target_cloud
    found = envs.lanes.observer.split(shown)
    lost = found["target"][:, 1] == 0.0
    assert 0 < lost.sum() < L
    for lane in range(L):
        x, y, heading = belief.pose[lane]
        mass, far = np.zeros(S), np.zeros(S)
        for point, weight in zip(points[lane], weights[lane], strict=True):
            direction = math.atan2(point[1] - y, point[0] - x) - heading
            sector = math.floor((direction / (2.0 * math.pi) + 0.5 / S) % 1.0 * S)
            mass[sector] += weight
            far[sector] += weight * math.hypot(point[0] - x, point[1] - y) / unit
        expected = np.minimum(far / np.where(mass > 0.0, mass, 1.0), FAR)
        np.testing.assert_allclose(found["cloud"][lane], expected, atol=1e-6)
        if lost[lane]:
            np.testing.assert_allclose(found["sectors"][lane], mass, atol=1e-6)
            assert found["sectors"][lane].sum() == pytest.approx(1.0, abs=1e-5)


def test_nothing_else_changes(driven):
    (envs, shown), (_, plain) = driven
    assert shown.shape == (L, plain.shape[1] + S)
    np.testing.assert_array_equal(shown[:, 11 + S : -S], plain[:, 11 + S :])
    np.testing.assert_array_equal(shown[:, :11], plain[:, :11])
    seen = shown[:, 1] == 1.0
    np.testing.assert_array_equal(shown[seen, 11 : 11 + S], plain[seen, 11 : 11 + S])
    assert (np.abs(shown[~seen, 11 : 11 + S] - plain[~seen, 11 : 11 + S]).sum(axis=1) > 0.1).any()
    assert envs.single_observation_space.contains(shown[0])


def test_a_lane_is_a_single_environment(driven):
    _, shown = driven[0]
    env = gym.make("SlamTarget-v0", target_cloud=N, **ARGUMENTS)
    alone, _ = env.reset(seed=3 + 2)
    for step in range(STEPS):
        alone, *_ = env.step(np.array([0.6, 0.3 * (-1) ** step], dtype=np.float32))
    np.testing.assert_array_equal(alone, shown[2])


def test_options_go_to_the_cloud():
    """One that learns whether targets flee; where one does, other points than of one that does not ask."""
    options = {"scenario": "evasive-hard", "scenario_options": {"hold": 4}, "target_cloud": N}
    shown = []
    for told in ({"evasive": True}, {}):
        envs = gym.make_vec("SlamTarget-v0", num_envs=L, target_cloud_options=told, **options).unwrapped
        envs.reset(seed=3)
        for _ in range(STEPS):
            rows, *_ = envs.step(np.full((L, 2), [1.0, 0.0], dtype=np.float32))
        shown.append(envs.lanes.observer.split(rows))
        assert envs.simulation.clouds[0].evasive is bool(told)
    lost = shown[0]["target"][:, 1] == 0.0
    assert np.abs(shown[0]["cloud"] - shown[1]["cloud"])[lost].max() > 0.01


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"target_cloud": N, "target_cloud_options": {"evasiv": True}}, "'evasiv'. Did you mean 'evasive'"),
        ({"target_cloud": N, "target_cloud_options": {"evasive": "yes"}}, "evasive must be true or false"),
        ({"target_cloud_options": {"evasive": True}}, "give target_cloud too"),
        ({"target_cloud": N, "target_cloud_options": "evasive"}, "must be a dictionary"),
    ],
)
def test_options_that_there_are_not(wrong, message):
    with pytest.raises(ValueError, match=message):
        gym.make("SlamTarget-v0", **wrong)
