"""Train a policy with Stable-Baselines3's PPO in many worlds at once, and drive with it.

python examples/06_train_ppo.py [decisions] [lanes]      needs pip install -c constraints.txt ".[rl]"

`slam-gym train` does the same with evaluations, the best policy kept, TensorBoard and --resume.
"""

import sys
import tempfile
import time
from pathlib import Path

import gymnasium as gym
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

import slam_gym  # noqa: F401  (registers SlamTarget-v0)
from agents.sb3.policy_file import export_policy
from agents.sb3.vec_env import SlamTargetVecEnv
from slam_gym.evaluation import compare

HOLD = 4  # simulation steps that an action lasts


def train(decisions, lanes):
    envs = gym.make_vec("SlamTarget-v0", num_envs=lanes, scenario_options={"hold": HOLD})
    venv = VecNormalize(VecMonitor(SlamTargetVecEnv(envs)), gamma=0.98)
    net = {"net_arch": [128, 128]}
    model = PPO("MlpPolicy", venv, n_steps=64, batch_size=16 * lanes, n_epochs=5, gamma=0.98, learning_rate=7e-4,
                policy_kwargs=net, seed=0, device="cpu")  # fmt: skip
    started = time.perf_counter()
    model.learn(decisions)
    print(f"{model.num_timesteps / (time.perf_counter() - started):,.0f} decisions per second in {lanes} worlds")
    return model, envs.scenario.dt * HOLD


def main(decisions=200_000, lanes=256):
    model, decision_dt = train(decisions, lanes)
    with tempfile.TemporaryDirectory() as folder:
        export_policy(model, Path(folder), action="twist", decision_dt=decision_dt)  # weights and JSON, no pickle
        drivers = ["pursuit", ("learned", {"path": folder}), "random"]
        results = compare("default", ["ekf"], drivers, runs=min(40, lanes), seed=1, jobs=1)

    table = results.summary.assign(policy=["pursuit", "learned", "random"])
    columns = ["policy", "target_error_mean", "lost_share", "robot_error_mean"]
    print(table[columns].to_string(index=False, float_format="{:.3f}".format))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
