"""Gymnasium's vector environments as Stable-Baselines3's VecEnv.

Stable-Baselines3 has a vector interface of its own, older than Gymnasium's: `done` instead of two flags, one info
dictionary per environment, the last observation of an episode in `terminal_observation`, and `TimeLimit.truncated`
where an episode was only cut off, so that the value of what would have come is not forgotten.

>>> import gymnasium as gym
>>> import slam_gym
>>> from stable_baselines3 import PPO
>>> venv = SlamTargetVecEnv(gym.make_vec("SlamTarget-v0", num_envs=256))
>>> PPO("MlpPolicy", venv, n_steps=64, batch_size=4096).learn(2_000_000)  # doctest: +SKIP
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

Infos = Literal["ends", "all"]
BATCHED = {"observation_space": "single_observation_space", "action_space": "single_action_space"}


class SlamTargetVecEnv(VecEnv):
    """Lets Stable-Baselines3 train on a vector environment; `VecMonitor` and `VecNormalize` go around it.

    Equal, bit for bit, to `DummyVecEnv` of the single environments.

    Args:
        envs: a vector environment with autoreset in the same step (`SlamTargetVectorEnv` as `gym.make_vec` makes it).
        infos: "ends": an info is filled only where an episode ends, which is all that Stable-Baselines3 reads and
            many times faster; "all": always.

    Raises:
        ValueError: another mode of autoreset, or something else than a vector environment.
    """

    def __init__(self, envs: VectorEnv[Any, Any, Any], infos: Infos = "ends") -> None:
        if not isinstance(envs, VectorEnv):
            raise ValueError(f"expected a vector environment such as gym.make_vec('SlamTarget-v0') gives; got {envs!r}")
        mode = envs.metadata.get("autoreset_mode")
        if mode != AutoresetMode.SAME_STEP:
            raise ValueError(
                f"Stable-Baselines3 needs autoreset in the same step; this environment has {mode}. "
                "Make it with autoreset_mode='SameStep'"
            )
        if infos not in ("ends", "all"):
            raise ValueError(f"infos must be 'ends' or 'all'; got {infos!r}")
        self.envs, self.infos = envs, infos
        self._actions: Any = None
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)
        self.metadata = {**self.metadata, "render_fps": envs.metadata.get("render_fps", 10)}

    # ------------------------------------------------------------------------------------------------ episodes

    def seed_lanes(self, seeds: Sequence[int]) -> None:
        """Each lane's own seed for the next reset; `seed(s)` gives lane i the seed s + i."""
        if len(seeds) != self.num_envs:
            raise ValueError(f"expected one seed for each of {self.num_envs} lanes; got {len(seeds)}")
        self._seeds = [int(seed) for seed in seeds]

    def reset(self) -> Any:
        """Begin an episode in every lane, with the seeds and options announced for it."""
        options = self._options[0]
        if any(other != options for other in self._options):
            raise ValueError("all lanes take the same options: pass set_options one dictionary")
        seeds: Any = None if all(seed is None for seed in self._seeds) else self._seeds
        observations, infos = self.envs.reset(seed=seeds, options=options or None)
        self._reset_seeds()
        self._reset_options()
        self.reset_infos = list(lane_infos(infos, self.num_envs))
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        """Announce the actions [L, 2]."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Carry them out: observations, rewards [L] float32, dones [L], infos."""
        observations, rewards, terminated, truncated, infos = self.envs.step(self._actions)
        dones = np.asarray(terminated) | np.asarray(truncated)
        each = self._each(infos, dones, terminated, truncated)
        return observations, np.asarray(rewards, dtype=np.float32), dones, each

    def _each(self, infos: Mapping[str, Any], dones: Any, terminated: Any, truncated: Any) -> list[dict[str, Any]]:
        """One info per lane; where an episode ended, the old episode's, the new one's going to `reset_infos`."""
        each: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        over = np.flatnonzero(dones)
        if self.infos == "all":
            each = [{**info, "TimeLimit.truncated": False} for info in lane_infos(infos, self.num_envs)]
        if len(over):
            begun = lane_infos(infos, self.num_envs, over)
            ended = lane_infos(infos.get("final_info", {}), self.num_envs, over)
            for lane, old, new in zip(map(int, over), ended, begun, strict=True):
                old["TimeLimit.truncated"] = bool(truncated[lane] and not terminated[lane])
                old["terminal_observation"] = infos["final_obs"][lane]
                each[lane], self.reset_infos[lane] = old, new
        return each

    # ------------------------------------------------------------------------------------ attributes and methods

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute, which all lanes share: the same value for each index; spaces are those of one lane."""
        name = BATCHED.get(attr_name, attr_name)
        target = self.envs if hasattr(self.envs, name) else self.envs.unwrapped
        return [getattr(target, name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute, which all lanes share.

        Raises:
            ValueError: for some lanes only.
        """
        self._all_or_none(f"the attribute {attr_name!r}", indices)
        setattr(self.envs.unwrapped, attr_name, value)

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Call a method of the vector environment, once for all lanes; its result stands for each of them.

        `render` gives each lane's picture.

        Raises:
            ValueError: for some lanes only, unless it is `render`.
        """
        chosen = list(self._get_indices(indices))
        if method_name == "render":
            images = self.get_images()
            return [images[lane] for lane in chosen]
        self._all_or_none(f"the method {method_name!r}", indices)
        target = self.envs if hasattr(self.envs, method_name) else self.envs.unwrapped
        return [getattr(target, method_name)(*method_args, **method_kwargs)] * len(chosen)

    def _all_or_none(self, what: str, indices: Any) -> None:
        if sorted(self._get_indices(indices)) != list(range(self.num_envs)):
            raise ValueError(f"all lanes are one environment: {what} cannot be used for lanes {indices} only")

    def env_is_wrapped(self, wrapper_class: type[Any], indices: Any = None) -> list[bool]:
        """Whether the vector environment is wrapped in that class; wrappers of single environments never are there."""
        envs, found = self.envs, False
        while isinstance(envs, VectorWrapper):
            found = found or isinstance(envs, wrapper_class)
            envs = envs.env
        return [found] * len(list(self._get_indices(indices)))

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Each lane's picture; None without render_mode="rgb_array"."""
        if self.render_mode is None:
            gym.logger.warn("no pictures without a render mode: make the environment with render_mode='rgb_array'")
            return [None] * self.num_envs
        pictures: Any = self.envs.render()
        return list(pictures or ())

    def close(self) -> None:
        """Close the vector environment."""
        self.envs.close()


def lane_infos(infos: Mapping[str, Any], num_envs: int, lanes: Any = None) -> Iterator[dict[str, Any]]:
    """Gymnasium's arrays by key with masks, as a dictionary for each of the named lanes (None: all)."""
    told = np.arange(num_envs) if lanes is None else np.asarray(lanes)
    rows: list[dict[str, Any]] = [{} for _ in told]
    for key, values in infos.items():
        if key.startswith("_") or key in ("final_obs", "final_info"):
            continue
        mask = infos.get(f"_{key}")
        there = np.ones(len(told), dtype=np.bool_) if mask is None else np.asarray(mask)[told]
        chosen = np.asarray(values)[told]
        plain = list(chosen) if chosen.ndim > 1 else chosen.tolist()
        for row, value, defined in zip(rows, plain, there.tolist(), strict=True):
            if defined:
                row[key] = value
    return iter(rows)
