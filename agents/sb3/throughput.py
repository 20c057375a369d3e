"""How much of a training's time the environment takes: PPO on our lanes, on nothing, and as it is usually set up."""

from collections.abc import Callable, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecNormalize

from agents.sb3 import hyperparameters
from agents.sb3.vec_env import SlamTargetVecEnv
from slam_gym.benchmark.environment import ARGUMENTS
from slam_gym.benchmark.timing import least_seconds

USUAL_LANES = 8  # of DummyVecEnv, with PPO's defaults
EVERY = 8  # steps between two sweeps, of the sparser kind


class Stub(VecEnv):
    """Costs nothing: the same observation and reward at every step. What is left of a training is the learning."""

    def __init__(self, like: VecEnv) -> None:
        self.render_mode = None
        super().__init__(like.num_envs, like.observation_space, like.action_space)
        shape = like.observation_space.shape or ()
        self._observation = np.zeros((self.num_envs, *shape), dtype=like.observation_space.dtype)
        self._reward, self._done = np.zeros(self.num_envs, dtype=np.float32), np.zeros(self.num_envs, dtype=np.bool_)
        self._infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]

    def reset(self) -> Any:
        """The observation."""
        return self._observation

    def step_async(self, actions: NDArray[Any]) -> None:
        """Nothing."""

    def step_wait(self) -> Any:
        """Observation, reward, dones, infos."""
        return self._observation, self._reward, self._done, self._infos

    def close(self) -> None:
        """Nothing."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute, the same in every lane."""
        return [getattr(self, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set it."""
        setattr(self, attr_name, value)

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """There are none."""
        raise AttributeError(f"the stub has no method {method_name!r}")

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """It never is."""
        return [False] * self.num_envs


def training_rows(rounds: int = 3, usual: bool = True) -> list[dict[str, Any]]:
    """Rows (name, decisions per second, share of the zero-cost stub's) of PPO in scenario `open` with the joint EKF.

    A decision is one step of the environment. The first rows take the hyperparameters of `slam-gym train`.

    Args:
        rounds: see `least_seconds`.
        usual: also PPO's defaults on DummyVecEnv of the single environment.
    """
    chosen = hyperparameters.read(hyperparameters.FOLDER / "ppo.yml", "open", {})
    rollout = chosen.n_envs * int(chosen.values["n_steps"])

    def native(**options: Any) -> SlamTargetVecEnv:
        return SlamTargetVecEnv(gym.make_vec("slam_gym:SlamTarget-v0", num_envs=chosen.n_envs, **ARGUMENTS, **options))

    each, sparse = native(), native(scenario_options={"sensor_period": EVERY})
    lanes = f"{chosen.n_envs} lanes"
    environments: dict[str, tuple[VecEnv, int]] = {
        f"a stub of {lanes} that costs nothing": (Stub(each), rollout),
        f"make_vec, {lanes}, an update each step": (each, rollout),
        f"make_vec, {lanes}, an update each {EVERY}th step": (sparse, rollout),
    }
    models = {name: _taught(venv, chosen) for name, (venv, _) in environments.items()}
    if usual:
        name = f"DummyVecEnv of {USUAL_LANES} x gym.make, PPO's defaults"
        dummy = DummyVecEnv([lambda: gym.make("slam_gym:SlamTarget-v0", **ARGUMENTS)] * USUAL_LANES)
        models[name] = PPO("MlpPolicy", dummy, device="cpu")
        environments[name] = (dummy, models[name].n_steps * USUAL_LANES)
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        works = {name: _rollout(model, environments[name][1]) for name, model in models.items()}
        seconds = least_seconds(works, rounds=rounds, slice_seconds=0.0)
    finally:
        torch.set_num_threads(threads)
        for venv, _ in environments.values():
            venv.close()
    return _rates(seconds, [size for _, size in environments.values()])


def _taught(venv: VecEnv, chosen: hyperparameters.Hyperparameters) -> PPO:
    normalised = VecNormalize(venv, **chosen.normalise) if chosen.normalise is not None else venv
    return PPO("MlpPolicy", normalised, device="cpu", **chosen.arguments(PPO))


def _rollout(model: PPO, decisions: int) -> Callable[[], object]:
    """One rollout and what is learned from it."""
    return lambda: model.learn(decisions, reset_num_timesteps=False)


def _rates(seconds: dict[str, float], sizes: Sequence[int]) -> list[dict[str, Any]]:
    rates = [size / second for size, second in zip(sizes, seconds.values(), strict=True)]
    return [
        {"name": name, "per_second": rate, "of_stub": rate / rates[0]}
        for name, rate in zip(seconds, rates, strict=True)
    ]
