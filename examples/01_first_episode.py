"""A first episode: the Gymnasium environment, driven by its action space, then by a policy that sees the belief.

python examples/01_first_episode.py [steps]
"""

import sys

import gymnasium as gym
import numpy as np

import slam_gym  # noqa: F401  (registers SlamTarget-v0)
from slam_gym import policies
from slam_gym.scenario import Scenario


def random_episode(env, steps):
    """As with any Gymnasium environment. The observation is what the estimator believes; the truth is in `info`."""
    env.action_space.seed(0)
    observation, info = env.reset(seed=0)
    total = 0.0
    for _ in range(steps):
        observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
        total += reward
        if terminated or truncated:
            break
    return observation, total, info


def pursuit_episode(env, steps):
    """A policy by name. It acts on the belief of the environment's estimator, for any number of lanes: here one."""
    policy = policies.make("pursuit", policies.PolicyContext.from_scenario(Scenario.load("default")), stand_off=1.5)
    policy.reset(np.array([0]), np.array([0]))
    observation, info = env.reset(seed=0)
    total = 0.0
    for _ in range(steps):
        action = policy.act(observation[None], env.unwrapped.belief)[0]
        observation, reward, terminated, truncated, info = env.step(action.astype(np.float32))
        total += reward
        if terminated or truncated:
            break
    return observation, total, info


def main(steps=400):
    env = gym.make("SlamTarget-v0", scenario="default", estimator="ekf")
    for name, episode in (("random", random_episode), ("pursuit", pursuit_episode)):
        observation, total, info = episode(env, steps)
        print(
            f"{name:8} reward {total:8.2f}, observation of {observation.size} numbers; at the end the robot's estimate"
        )
        print(f"    is {info['robot_error']:.2f} m off, the target's {info['target_error']:.2f} m")
    env.close()


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
