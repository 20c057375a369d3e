"""Many worlds side by side in one process: the native vector environment, and how fast it is.

python examples/04_vector_env.py [lanes] [steps]
"""

import sys
import time

import gymnasium as gym
import numpy as np

import slam_gym  # noqa: F401  (registers SlamTarget-v0)


def main(lanes=256, steps=400):
    envs = gym.make_vec("SlamTarget-v0", num_envs=lanes, scenario="open", estimator="ekf")
    observations, _ = envs.reset(seed=0)  # lane i is the single environment seeded with i
    print(f"observations {observations.shape}, actions {envs.action_space.shape}")

    rng = np.random.default_rng(0)
    actions = rng.uniform(-1.0, 1.0, envs.action_space.shape).astype(np.float32)
    episodes = 0
    started = time.perf_counter()
    for _ in range(steps):
        observations, _, terminations, truncations, _ = envs.step(actions)
        episodes += int((terminations | truncations).sum())
    seconds = time.perf_counter() - started

    print(f"{lanes * steps / seconds:,.0f} steps per second, {episodes} episodes ended; finite: "
          f"{bool(np.isfinite(observations).all())}")  # fmt: skip
    envs.close()


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
