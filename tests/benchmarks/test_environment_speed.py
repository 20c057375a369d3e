"""Ratios of the environment's speed to the same work in clean NumPy, both in one process, interleaved.

`pytest -m benchmark -s tests/benchmarks` prints the steps per second too; those depend on the machine and are not
asserted.
"""

import importlib.util
from pathlib import Path
from time import perf_counter

import gymnasium as gym
import numpy as np
import pytest

import slam_gym  # noqa: F401  (registers the environment)

pytestmark = pytest.mark.benchmark

ACTION = np.array([0.4, 0.3], dtype=np.float32)
ROUNDS, STEPS, SETTLED = 25, 60, 100  # measurements; steps in each; steps until the map is whole


def numpy_env(env):
    """The NumPy step in the world of a reset environment."""
    path = Path(__file__).with_name("numpy_baseline.py")
    spec = importlib.util.spec_from_file_location("numpy_baseline", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    world = env.unwrapped.simulation.world
    max_range = env.unwrapped.scenario.sensor.max_range
    return module.NumpyEnv(world.landmarks[0], world.pose[0], world.target[0], max_range=max_range)


def seconds_per_step(step, action, steps=STEPS):
    began = perf_counter()
    for _ in range(steps):
        step(action)
    return (perf_counter() - began) / steps


@pytest.fixture(scope="module")
def seconds():
    """The least seconds per (lane-)step of: the single environment, the vector environment, NumPy."""
    env = gym.make("SlamTarget-v0", scenario="open", estimator="ekf")
    envs = gym.make_vec("SlamTarget-v0", num_envs=256, scenario="open", estimator="ekf")
    actions = np.tile(ACTION, (256, 1))
    best = {"single": np.inf, "vector": np.inf, "numpy": np.inf}
    for round_ in range(ROUNDS):
        if round_ % 5 == 0:  # everybody starts anew, and measures with a whole map
            env.reset(seed=0)
            envs.reset(seed=0)
            baseline = numpy_env(env)
            for _ in range(SETTLED):
                env.step(ACTION)
                envs.step(actions)
                baseline.step(ACTION)
        best["single"] = min(best["single"], seconds_per_step(env.step, ACTION))
        best["vector"] = min(best["vector"], seconds_per_step(envs.step, actions, 4) / 256)
        best["numpy"] = min(best["numpy"], seconds_per_step(baseline.step, ACTION, 10))
    for name, value in best.items():
        print(f"\n{name}: {1e6 * value:.2f} us per step, {1.0 / value:,.0f} per second", end="")
    return best


def test_a_single_step_is_15_times_as_fast_as_clean_numpy(seconds):
    assert seconds["numpy"] / seconds["single"] >= 15.0


def test_a_lane_of_many_is_twice_as_fast_as_a_single_environment(seconds):
    assert seconds["single"] / seconds["vector"] >= 2.0
