"""The environment for many robots at once, over the same code as the single one."""

import copy
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from estimators.interface import Belief
from slam_gym.envs.lanes import SEED_LIMIT, Lanes
from slam_gym.envs.scoring import FLAGS, NUMBERS
from slam_gym.envs.slam_target import (
    PICTURE,
    check_render_mode,
    frames_per_second,
    generator_state,
    set_generator_state,
)
from slam_gym.scenario import Scenario

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]

RENDER_MODES = ["rgb_array"]  # one window for many robots would show little


class SlamTargetVectorEnv(VectorEnv[Any, Any, Any]):
    """`SlamTargetEnv` for L independent robots, worlds and estimators, stepped together in compiled code.

    ```python
    import gymnasium as gym
    import slam_gym

    envs = gym.make_vec("SlamTarget-v0", num_envs=256, scenario="default", estimator="ekf")
    observations, infos = envs.reset(seed=0)
    observations, rewards, terminations, truncations, infos = envs.step(envs.action_space.sample())
    ```

    Actions, observations, rewards, info, ends and arguments are those of `SlamTargetEnv`, each with the lane first.
    Lane i of a batch reset with seed s is, bit for bit, the single environment reset with s + i, and so are its later
    episodes. A list of L seeds names each lane's own.

    **Autoreset** (`autoreset_mode`, also in `metadata`), as Gymnasium defines it:

    | mode                    | what happens to a lane whose episode has ended |
    |-------------------------|---|
    | `"SameStep"` (default)  | begins its next episode in the same step; the last observation and info of the old one |
    |                         | stand in `infos["final_obs"]` and `infos["final_info"]`, with the masks `_final_obs`, |
    |                         | `_final_info` |
    | `"NextStep"`            | begins its next episode in the next step; that action is ignored, its reward is 0 |
    | `"Disabled"`            | waits for `reset(options={"reset_mask": mask})` |

    Of Gymnasium's vector wrappers those that change observations (`NormalizeObservation`, `FlattenObservation`, ...)
    refuse `"SameStep"`, the adapter for Stable-Baselines3 (`agents.sb3.vec_env.SlamTargetVecEnv`) needs it.

    **Info**: every key has an array [L] (or [L, 3], [L, 4]), and `_key` a mask of the lanes where it is defined.

    **Reset options**: as for the single environment, for all lanes that are reset, and `reset_mask` [L] bool.

    Args:
        num_envs: L.
        scenario, scenario_options, estimator, estimator_options, observation, action, reward, nearest_landmarks,
            sectors, terminate_on_capture, terminate_outside, success_error, allow_truth, target_cloud,
            target_cloud_options: see `SlamTargetEnv`.
        render_mode: None or "rgb_array": `render` gives one picture per lane.
        autoreset_mode: see above.
        threads: how many share the lanes of a step, from some thirty on; any number gives the same bits. Particle
            filters and target clouds share the world's part alone.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012  (Gymnasium's)
        "render_modes": RENDER_MODES,
        "render_fps": 10,
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        scenario: str | Path | Mapping[str, Any] | Scenario = "default",
        scenario_options: Mapping[str, Any] | None = None,
        estimator: str = "ekf",
        estimator_options: Mapping[str, Any] | None = None,
        observation: str = "box",
        action: str | None = None,
        reward: Mapping[str, float] | None = None,
        nearest_landmarks: int = 8,
        sectors: int = 8,
        terminate_on_capture: float | None = None,
        terminate_outside: bool = False,
        success_error: float = 1.0,
        allow_truth: bool = False,
        target_cloud: int = 0,
        target_cloud_options: Mapping[str, Any] | None = None,
        render_mode: str | None = None,
        autoreset_mode: str | AutoresetMode = "SameStep",
        threads: int = 1,
    ) -> None:
        arguments = {name: value for name, value in locals().items() if name not in ("self", "__class__")}
        self._arguments = copy.deepcopy(arguments)
        if isinstance(num_envs, bool) or not isinstance(num_envs, (int, np.integer)) or num_envs < 1:
            raise ValueError(f"num_envs must be a whole number of at least 1; got {num_envs!r}")
        self.render_mode = check_render_mode(render_mode, RENDER_MODES)
        self.autoreset_mode = _autoreset_mode(autoreset_mode)
        settings = {**self._arguments, "reward_weights": reward}
        for name in ("num_envs", "render_mode", "reward", "autoreset_mode"):
            del settings[name]
        self.num_envs = int(num_envs)
        self.lanes = Lanes(self.num_envs, **settings)
        self.simulation, self.scenario = self.lanes.simulation, self.lanes.scenario
        self.metadata = {
            **self.metadata,
            "render_fps": frames_per_second(self.scenario),
            "autoreset_mode": self.autoreset_mode,
        }
        self.single_observation_space = self.lanes.observer.space(observation)
        self.single_action_space = gym.spaces.Box(-1.0, 1.0, (2,), dtype=np.float32)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._flat = observation == "box"
        self._ended: Bools = np.zeros(self.num_envs, dtype=np.bool_)
        self._seeded: Bools = np.zeros(self.num_envs, dtype=np.bool_)
        self._note_lanes()
        self._renderers: list[Any] = []
        poses = ["robot_pose", "target_state"] if self.simulation.world.has_target else ["robot_pose"]
        always = [*FLAGS, *poses]
        self._names = [*NUMBERS, *map("_{}".format, NUMBERS), *FLAGS, *map("_{}".format, always), *poses]  # of `_info`
        self._info_of: dict[str, Any] = dict.fromkeys(self._names)
        self._told: Bools = np.ones((len(always), self.num_envs), dtype=np.bool_)

    @property
    def belief(self) -> Belief:
        """What the estimators believe, for planners; valid until the next call."""
        return self.simulation.estimators[0].belief

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin an episode in all lanes, or in those of `options["reset_mask"]`; see the class.

        Raises:
            ValueError: seeds or a mask of another length, an unknown option or impossible value.
        """
        options = dict(options or {})
        mask = _reset_mask(options.pop("reset_mask", None), self.num_envs)
        lanes = np.flatnonzero(mask)
        seeds = self._seeds(seed)
        fresh = np.array([i for i in lanes if seeds[i] is not None], dtype=np.int64)
        again = np.array([i for i in lanes if seeds[i] is None], dtype=np.int64)
        if len(fresh):
            chosen = np.array([seeds[i] for i in fresh], dtype=object)
            self.lanes.reset(chosen, None if len(fresh) == self.num_envs else fresh, options)
        if len(again):
            self.lanes.reset(None, None if len(again) == self.num_envs else again, options)
        self._seeded[lanes], self._ended[lanes] = True, False
        self._note_lanes()
        return self._pack(self.lanes.observe()), self._info(mask)

    def _seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        """One seed per lane; None: the lane's next episode."""
        if seed is None or isinstance(seed, (int, np.integer)):
            super().reset(seed=None if seed is None else int(seed))
            seeds: list[int | None] = [None if seed is None else int(seed) + i for i in range(self.num_envs)]
        else:
            seeds = [None if one is None else int(one) for one in seed]
            if len(seeds) != self.num_envs:
                raise ValueError(f"a list of seeds needs one for each of the {self.num_envs} lanes; got {len(seeds)}")
            if any(one is not None for one in seeds):
                super().reset(seed=next(one for one in seeds if one is not None))
        if any(one is not None and one < 0 for one in seeds):
            raise ValueError(f"seeds must be zero or more; got {seed}")
        if not self._all_seeded:
            drawn = self.np_random.integers(SEED_LIMIT, size=self.num_envs)
            seeds = [int(drawn[i]) if one is None and not self._seeded[i] else one for i, one in enumerate(seeds)]
        return seeds

    def step(self, actions: Any) -> tuple[Any, Floats, Bools, Bools, dict[str, Any]]:
        """One action in every lane; see the class.

        Raises:
            ValueError: actions of another shape, or one that is not finite.
            gymnasium.error.ResetNeeded: a lane has not been reset, or has ended and autoreset is disabled.
        """
        lanes = self.lanes
        if np.shape(actions) != (self.num_envs, 2):
            raise ValueError(f"actions must have shape ({self.num_envs}, 2); got {np.shape(actions)}")
        if not self._all_seeded:
            raise gym.error.ResetNeeded("call reset() before step()")
        lanes.action[:] = actions
        if self._some_ended:
            self._step_some()
        else:
            lanes.step()
        scorer = lanes.scorer
        terminated, truncated = scorer.ended.copy()
        rewards = scorer.reward.copy()
        if 1 in scorer.ended.tobytes():  # a tenth of the time of `any`
            ended = terminated | truncated
            if self.autoreset_mode is AutoresetMode.SAME_STEP:
                return self._begin_next(ended, rewards, terminated, truncated)
            self._ended = ended
            self._note_lanes()
        elif self._some_ended:
            self._ended[:] = False
            self._note_lanes()
        return self._pack(lanes.observe()), rewards, terminated, truncated, self._info()

    def _note_lanes(self) -> None:
        """What every step asks of the lanes: to ask NumPy each time would take as long as a lane's step."""
        self._some_ended, self._all_seeded = bool(self._ended.any()), bool(self._seeded.all())

    def _step_some(self) -> None:
        """Step the lanes that go on, and begin the next episode in those that ended in the last step."""
        over, going = np.flatnonzero(self._ended), np.flatnonzero(~self._ended)
        if self.autoreset_mode is AutoresetMode.DISABLED:
            raise gym.error.ResetNeeded(
                f"lanes {over.tolist()} have ended and autoreset is disabled: "
                "call reset(options={'reset_mask': mask})"
            )
        self.lanes.action[over] = 0.0
        if len(going):
            self.lanes.step(going)
        self.lanes.reset(None, None if len(over) == self.num_envs else over)

    def _begin_next(self, ended: Bools, rewards: Floats, terminated: Bools, truncated: Bools) -> Any:
        """Autoreset in the same step: what was last, then the next episodes' beginnings."""
        over = np.flatnonzero(ended)
        last, last_info = self.lanes.observe(), self._info(ended)
        final: NDArray[Any] = np.full(self.num_envs, None, dtype=object)
        for lane in over:
            final[lane] = self._pack(last[lane].copy())
        self.lanes.reset(None, None if len(over) == self.num_envs else over)
        info = self._info()
        info["final_obs"], info["_final_obs"] = final, ended.copy()
        info["final_info"], info["_final_info"] = last_info, ended.copy()
        return self._pack(self.lanes.observe()), rewards, terminated, truncated, info

    def _pack(self, flat: NDArray[np.float32]) -> Any:
        return flat if self._flat else self.lanes.observer.split(flat)

    def _info(self, where: Bools | None = None) -> dict[str, Any]:
        """Arrays by key with their masks; `where` [L]: the only lanes that are told of."""
        scorer, world = self.lanes.scorer, self.simulation.world
        defined, told = scorer.defined.copy(), self._told.copy()
        if where is not None:
            defined &= where
            told &= where
        arrays = [*scorer.values.copy(), *defined, *scorer.flags.copy(), *told, world.pose.copy()]
        if world.has_target:
            arrays.append(world.target.copy())
        info = self._info_of.copy()  # its table is large enough: half the time of one that grows
        info.update(zip(self._names, arrays, strict=True))
        return info

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """One picture per lane, [height, width, 3] uint8; None without a render mode."""
        if self.render_mode is None:
            return None
        if not self._all_seeded:
            raise gym.error.ResetNeeded("call reset() before render()")
        from slam_gym.render import Frame, Renderer  # pygame only where pictures are wanted

        if not self._renderers:
            self._renderers = [Renderer("rgb_array", size=PICTURE) for _ in range(self.num_envs)]
        frames = (Frame.from_simulation(self.simulation, lane) for lane in range(self.num_envs))
        pictures = (renderer.draw(frame) for renderer, frame in zip(self._renderers, frames, strict=True))
        return tuple(picture for picture in pictures if picture is not None)

    def close_extras(self, **kwargs: Any) -> None:
        """Let the pictures go."""
        for renderer in self._renderers:
            renderer.close()
        self._renderers = []

    def get_state(self) -> dict[str, Any]:
        """Everything that changes between calls, as copies; `set_state` goes on from there bit for bit."""
        state = {"lanes": self.lanes.get_state(), "ended": self._ended.copy(), "seeded": self._seeded.copy()}
        return {**state, **generator_state(self)}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore what `get_state` returned, of this environment or of another made with the same arguments."""
        self.lanes.set_state(state["lanes"])
        self._ended, self._seeded = state["ended"].copy(), state["seeded"].copy()
        self._note_lanes()
        set_generator_state(self, state)

    def __getstate__(self) -> dict[str, Any]:
        """For pickle and copy: arguments and state."""
        return {"arguments": self._arguments, "state": self.get_state(), "spec": self.spec}

    def __setstate__(self, saved: dict[str, Any]) -> None:
        self.__init__(**saved["arguments"])  # type: ignore[misc]
        self.spec = saved["spec"]
        self.set_state(saved["state"])


def _autoreset_mode(mode: str | AutoresetMode) -> AutoresetMode:
    try:
        return AutoresetMode(mode)
    except ValueError:
        choices = ", ".join(repr(choice.value) for choice in AutoresetMode)
        raise ValueError(f"autoreset_mode must be one of {choices}; got {mode!r}") from None


def _reset_mask(mask: Any, num_envs: int) -> Bools:
    """Which lanes to reset: all where no mask is given.

    Raises:
        ValueError: not a boolean array of that length, or one without a True.
    """
    if mask is None:
        return np.ones(num_envs, dtype=np.bool_)
    if not isinstance(mask, np.ndarray) or mask.shape != (num_envs,) or mask.dtype != np.bool_:
        raise ValueError(f"options['reset_mask'] must be a boolean array of shape ({num_envs},); got {mask!r}")
    if not mask.any():
        raise ValueError("options['reset_mask'] must have at least one True")
    return mask.copy()
