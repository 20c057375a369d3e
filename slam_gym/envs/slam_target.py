"""The environment for one robot."""

import copy
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from estimators.interface import Belief
from slam_gym import observation, reward
from slam_gym.envs.lanes import SEED_LIMIT, Lanes
from slam_gym.envs.scoring import LaneScore
from slam_gym.scenario import Scenario

RENDER_MODES = ["human", "rgb_array"]
PICTURE = (900, 700)  # [px]

Observation = NDArray[np.float32] | dict[str, NDArray[np.float32]]


class SlamTargetEnv(gym.Env[Any, NDArray[np.float32]]):
    """A robot finds its place among unknown landmarks, maps them, and keeps track of a moving target.

    ## Description

    The robot drives in the plane with noisy odometry and a range-bearing sensor. An estimator (a joint extended Kalman
    filter by default) does simultaneous localisation and mapping and tracks the target. The agent drives the robot and
    sees only what the estimator believes. What it should learn is how to move so that the target stays in view and both
    are estimated well: in most scenarios the landmarks are opaque pillars that hide the target.

    ```python
    import gymnasium as gym
    import slam_gym

    env = gym.make("SlamTarget-v0", scenario="default", estimator="ekf")
    observation, info = env.reset(seed=0)
    observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
    ```

    Where nothing is imported (subprocesses), use the id `"slam_gym:SlamTarget-v0"`. `gym.make_vec` gives the native
    vector environment, the same code with many lanes, and takes `autoreset_mode` and `threads` besides: `slam-gym list
    SlamTargetVectorEnv`.

    ## Action Space

    `Box(-1, 1, (2,), float32)`; numbers beyond are cut, NaN and infinity are errors. One action lasts `hold`
    simulation steps of the scenario.

    | action       | component 0                                        | component 1 |
    |--------------|----------------------------------------------------|---|
    | `"twist"`    | forward: 1 = top speed, -1 = fastest reverse speed | turn: 1 = highest turn rate, to the left |
    | `"wheels"`   | left wheel: 1 = top speed                          | right wheel |
    | `"steering"` | forward, as for "twist" (bicycle robots only)      | steering angle: 1 = leftmost |

    ## Observation Space

    `Box` of 24 + S + 6 K numbers in float32 (80 by default), or with `observation="dict"` the same numbers by block
    (Gymnasium keeps blocks in alphabetical order: `FlattenObservation` gives another order than the Box's).

    OBSERVATION_TABLE

    ## Rewards

    REWARD_TABLE

    ## Starting State

    Landmarks, target, sensor errors and every number that the scenario gives as a range are drawn anew each episode;
    the robot starts where the scenario says. `reset(seed=s)` names the draws, whatever is done afterwards; a reset
    without seed begins the next episode of the same seed, with fresh draws that are again the same for any policy.
    `reset(options=...)` sets numbers of the scenario for one episode, by dotted key:
    `{"target.start_distance": 3.0, "target.start_bearing": [-0.5, 0.5], "target.speed": 0.4}`.

    ## Episode End

    Truncation: after `max_steps` simulation steps of the scenario (the environment does this itself). Termination:
    never by default; with `terminate_on_capture` when the robot is nearer to the target than that, with
    `terminate_outside` when the robot leaves the arena.

    ## Information

    The truth lives only here. Numbers that are not defined (no target known yet, no covariance) are left out.

    | key                                             | what |
    |-------------------------------------------------|---|
    | `robot_error`, `heading_error`                  | of the robot's pose [m], [rad] |
    | `target_error`, `target_error_rel`              | of the target's position in the world, in the robot's frame |
    | `target_velocity_error`, `target_heading_error` | [m/s], [rad] |
    | `landmark_error`, `landmark_count`              | root mean square over the map [m]; landmarks in it |
    | `pose_nees`, `target_nees`, `target_state_nees`, `landmark_nees` | error squared in units of the covariance |
    | `reward_<term>`                                 | the value of each reward term, before its weight |
    | `target_distance`, `time_since_seen`            | true distance [m]; since the last return of the target [s] |
    | `target_seen`, `target_visible`, `target_lost`  | in the latest sweep; could be seen; unseen for over 2 s |
    | `collisions`, `in_collision`                    | with pillars, so far; now |
    | `outside`, `captured`                           | of the arena; as `terminate_on_capture` has it |
    | `is_success`                                    | captured, or tracked: not lost and `target_error` below |
    |                                                 | `success_error` (`robot_error` where there is no target) |
    | `robot_pose`, `target_state`                    | true (x, y, heading); (x, y, velocity_x, velocity_y) |

    Where the sensor tells no ids, the landmarks' errors are left out (matching maps takes too long for every step).

    ## Arguments

    All of JSON types, so that `env.spec.to_json()` works.

    | argument               | default      | what |
    |------------------------|--------------|---|
    | `scenario`             | `"default"`  | name (`slam-gym list scenarios`), path of a TOML file, or dictionary |
    | `scenario_options`     | `{}`         | changes by dotted key, `{"sensor.max_range": 5.0}` |
    | `estimator`            | `"ekf"`      | name (`slam-gym list estimators`) |
    | `estimator_options`    | `{}`         | the estimator's own |
    | `observation`          | `"box"`      | or `"dict"` |
    | `action`               | `None`       | `"twist"`, `"wheels"`, `"steering"`; None: the robot's usual one |
    | `reward`               | `{}`         | weights by term, `{"effort": 0.1}`; the others keep their defaults |
    | `nearest_landmarks`    | 8            | K, landmarks in the observation |
    | `sectors`              | 8            | S, directions in the observation |
    | `terminate_on_capture` | `None`       | [m] |
    | `terminate_outside`    | `False`      | |
    | `success_error`        | 1.0          | [m] |
    | `allow_truth`          | `False`      | accept reference estimators that are handed the truth |
    | `target_cloud`         | 0            | points that follow a lost target; above 0 also a block `cloud` |
    | `target_cloud_options` | `{}`         | of `estimators.TargetCloud`, `{"evasive": True}`: the target may flee |
    | `render_mode`          | `None`       | `"human"` (a window) or `"rgb_array"` |

    ## Version History

    * v0: initial version. Before 1.0 numbers may change; the CHANGELOG says so.
    """

    metadata: dict[str, Any] = {"render_modes": RENDER_MODES, "render_fps": 10}  # noqa: RUF012  (Gymnasium's)

    def __init__(
        self,
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
    ) -> None:
        arguments = {name: value for name, value in locals().items() if name not in ("self", "__class__")}
        self._arguments = copy.deepcopy(arguments)
        self.render_mode = check_render_mode(render_mode, RENDER_MODES)
        settings = {**self._arguments, "reward_weights": reward}
        del settings["render_mode"], settings["reward"]
        self.lanes = Lanes(1, **settings)
        self.simulation, self.scenario = self.lanes.simulation, self.lanes.scenario
        self.metadata = {**self.metadata, "render_fps": frames_per_second(self.scenario)}
        self.observation_space = self.lanes.observer.space(observation)
        self.action_space = gym.spaces.Box(-1.0, 1.0, (2,), dtype=np.float32)
        self._flat = observation == "box"
        self._score = LaneScore(self.lanes.scorer)
        self._action, self._row = self.lanes.action[0], self.lanes.observer.out[0]  # the one lane's
        self._seeded = False
        self._renderer: Any = None

    @property
    def belief(self) -> Belief:
        """What the estimator believes, for planners; valid until the next call."""
        return self.simulation.estimators[0].belief

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; see the class for `seed` and `options`.

        Raises:
            ValueError: an unknown option or impossible value.
        """
        super().reset(seed=seed)
        if seed is None and not self._seeded:
            seed = int(self.np_random.integers(SEED_LIMIT))
        self.lanes.reset(None if seed is None else np.array([seed], dtype=object), options=options)
        self._seeded = True
        if self.render_mode == "human":
            self.render()
        observation, *_, info = self._score(self._observe())
        return observation, info

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Carry out one action; see the class.

        Raises:
            ValueError: an action of another shape, or one that is not finite.
            gymnasium.error.ResetNeeded: `reset` has not been called.
        """
        if not self._seeded:
            raise gym.error.ResetNeeded("call reset() before step()")
        if getattr(action, "shape", None) != (2,) and np.shape(action) != (2,):  # the first is the faster to ask
            raise ValueError(f"the action must have shape (2,); got {np.shape(action)}")
        self._action[:] = action
        self.lanes.step()
        if self.render_mode == "human":
            self.render()
        return self._score(self._observe())

    def _observe(self) -> Observation:
        return self._row.copy() if self._flat else self.lanes.observer.split(self._row)

    def render(self) -> NDArray[np.uint8] | None:
        """The present picture: [height, width, 3] uint8 in mode "rgb_array"; "human" shows it in a window."""
        if self.render_mode is None:
            gym.logger.warn(
                "You are calling render method without specifying any render mode. You can specify the render_mode at "
                f'initialization, e.g. gym.make("SlamTarget-v0", render_mode="rgb_array"); modes: {RENDER_MODES}'
            )
            return None
        if not self._seeded:
            raise gym.error.ResetNeeded("call reset() before render()")
        from slam_gym.render import Frame, Renderer  # pygame only where pictures are wanted

        if self._renderer is None:
            self._renderer = Renderer(self.render_mode, size=PICTURE, fps=self.metadata["render_fps"])  # type: ignore[arg-type]
        return self._renderer.draw(Frame.from_simulation(self.simulation))

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def get_state(self) -> dict[str, Any]:
        """Everything that changes between calls, as copies; `set_state` goes on from there bit for bit."""
        return {"lanes": self.lanes.get_state(), "seeded": self._seeded, **generator_state(self)}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore what `get_state` returned, of this environment or of another made with the same arguments."""
        self.lanes.set_state(state["lanes"])
        self._seeded = state["seeded"]
        set_generator_state(self, state)

    def __getstate__(self) -> dict[str, Any]:
        """For pickle and copy: arguments and state; a window is not carried over."""
        return {"arguments": self._arguments, "state": self.get_state(), "spec": self.spec}

    def __setstate__(self, saved: dict[str, Any]) -> None:
        self.__init__(**saved["arguments"])  # type: ignore[misc]
        self.spec = saved["spec"]
        self.set_state(saved["state"])


def _page(text: str) -> str:
    """The class's page with the tables of observation and reward in their places, as far in as what is around them."""
    for mark, module in (("OBSERVATION_TABLE", observation), ("REWARD_TABLE", reward)):
        before, after = text.split(mark)
        indent = before[before.rindex("\n") + 1 :]  # none from Python 3.13 on, which takes it off docstrings
        table = textwrap.indent((module.__doc__ or "").strip(), indent)
        text = f"{before.removesuffix(indent)}{table}{after}"
    return text


SlamTargetEnv.__doc__ = _page(SlamTargetEnv.__doc__ or "")


def check_render_mode(mode: Any, modes: Sequence[str]) -> str | None:
    """The mode, where it is one of those offered.

    Raises:
        ValueError: it is not.
    """
    if mode is not None and mode not in modes:
        raise ValueError(f"render_mode must be {' or '.join(map(repr, [None, *modes]))}; got {mode!r}")
    return mode


def frames_per_second(scenario: Scenario) -> int:
    """Pictures per second of real time, one per action."""
    return max(1, round(1.0 / (scenario.dt * scenario.hold)))


def generator_state(env: Any) -> dict[str, Any]:
    """Gymnasium's own random generator, as part of a state."""
    return {"generator": copy.deepcopy(env._np_random), "generator_seed": env._np_random_seed}


def set_generator_state(env: Any, state: Mapping[str, Any]) -> None:
    """Restore what `generator_state` returned."""
    env._np_random, env._np_random_seed = copy.deepcopy(state["generator"]), state["generator_seed"]
