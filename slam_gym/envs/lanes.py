"""What the single and the vector environment share: L lanes of simulation, observation and scoring."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.kernels.bound import Bound, chain
from estimators.registry import unknown_name
from slam_gym import reward
from slam_gym.actions import ActionMap, not_finite
from slam_gym.envs.scoring import Ending, Scorer
from slam_gym.first_use import FirstUse
from slam_gym.observation import Observer
from slam_gym.observation_cloud import CloudObserver
from slam_gym.scenario import Scenario
from slam_gym.simulation import Simulation
from slam_gym.specs import Spec
from slam_gym.threads import Shared

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

OBSERVATIONS = ("box", "dict")
SEED_LIMIT = 2**31  # of seeds drawn where the user gives none


def _mapping(name: str, value: Any, example: str) -> dict[str, Any]:
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        raise ValueError(f"{name} must be a dictionary like {example}; got {value!r}")
    return dict(value)


def _scenario(source: Any, changes: Mapping[str, Any]) -> Scenario:
    if not isinstance(source, (str, Path, Mapping, Scenario)):
        raise ValueError(f"scenario must be a name, a TOML file's path or a dictionary; got {source!r}")
    return Scenario.load(source, **changes)


class Lanes:
    """L lanes: commands in, observations, rewards, ends and info out. See the environments for the arguments.

    Attributes:
        simulation, scenario, action_map, observer, scorer: the parts.
        action: [L, 2] the last actions, cut to [-1, 1] by the map only where they move the robot.
        max_steps, hold: simulation steps of an episode, and of one action.
    """

    def __init__(
        self,
        num_lanes: int,
        *,
        scenario: Any = "default",
        scenario_options: Any = None,
        estimator: Any = "ekf",
        estimator_options: Any = None,
        observation: str = "box",
        action: str | None = None,
        reward_weights: Any = None,
        nearest_landmarks: int = 8,
        sectors: int = 8,
        terminate_on_capture: float | None = None,
        terminate_outside: bool = False,
        success_error: float = 1.0,
        allow_truth: bool = False,
        target_cloud: int = 0,
        target_cloud_options: Any = None,
        threads: int = 1,
    ) -> None:
        ending = Ending(terminate_on_capture, terminate_outside, success_error)
        weights = reward.weights(_mapping("reward", reward_weights, '{"track": 1.0}'))
        if observation not in OBSERVATIONS:
            raise ValueError(unknown_name("observation", str(observation), list(OBSERVATIONS)))
        if not isinstance(estimator, str):
            raise ValueError(f"estimator must be a name such as 'ekf'; got {estimator!r}")
        changes = _mapping("scenario_options", scenario_options, '{"sensor.max_range": 5.0}')
        options = _mapping("estimator_options", estimator_options, '{"gate": 16.0}')
        cloud_options = _mapping("target_cloud_options", target_cloud_options, '{"evasive": True}')
        if cloud_options and not target_cloud:
            raise ValueError(f"target_cloud_options without a cloud: give target_cloud too; got {cloud_options}")
        self.scenario = _scenario(scenario, changes)
        if terminate_on_capture is not None and not self.scenario.has_target:
            raise ValueError(f"terminate_on_capture needs a target; scenario {self.scenario.name!r} has none")
        self.num_lanes, self.observation = num_lanes, observation
        self.action_map = ActionMap(self.scenario, action)
        kind = CloudObserver if target_cloud else Observer
        self.observer = kind(self.scenario, num_lanes, nearest_landmarks, sectors)
        self.max_steps, self.hold = int(self.scenario.max_steps), int(self.scenario.hold)
        self.action: Floats = np.zeros((num_lanes, 2))
        self._command: Floats = np.zeros((num_lanes, 2))
        self._all = np.arange(num_lanes)
        chosen = estimator, options
        with FirstUse(self.scenario, Spec.parse(chosen)) as first_use:
            self.simulation = Simulation(self.scenario, [chosen], num_lanes, threads, allow_truth=allow_truth)
            if target_cloud:
                self.simulation.attach_cloud(target_cloud, **cloud_options)
            border = self.observer.border
            self.scorer = Scorer(self.scenario, self.simulation, weights, ending, border, self.action)
            self._bind(first_use)

    def reset(self, seeds: Ints | None, lanes: Ints | None = None, options: Mapping[str, Any] | None = None) -> None:
        """Begin an episode in the named lanes (None: all), and score them; seeds None: the next of the same seeds."""
        self.simulation.reset(seeds, lanes, options or None)
        chosen = self._all if lanes is None else lanes
        numbers = self.simulation.world.numbers[chosen]
        self.observer.border[chosen, 0] = 0.5 * numbers["arena_width"]
        self.observer.border[chosen, 1] = 0.5 * numbers["arena_height"]
        self.scorer.begin(chosen)
        self._look(chosen)

    def step(self, lanes: Ints | None = None) -> None:
        """Carry out `action` for `hold` simulation steps in the named lanes (None: all), and score them.

        Raises:
            ValueError: an action that is no finite number.
        """
        chosen = self._all if lanes is None else lanes
        if self._whole is not None:
            if not self._whole(chosen):
                raise not_finite(self.action)
            return
        if not self._advance(chosen):
            raise not_finite(self.action)
        for _ in range(1, self.hold):
            going = chosen[self.simulation.world.step_count[chosen] < self.max_steps]
            if len(going):
                self._advance(going)
        self._look(chosen)

    def _bind(self, first_use: FirstUse) -> None:
        """Compiled calls for all that happens between action and belief, and between belief and observation.

        `_whole`: both, where one action is one simulation step with its sweep. `_move` and `_take`: where the sweep may
        have to wait. None of them: where the estimator has no kernels to be called, or somebody has to look on.
        """
        simulation, world = self.simulation, self.simulation.world
        self._belief = simulation.estimators[0].belief
        self._command_of = self.action_map.bound(self.action, self._command)
        watch = chain(self.observer.bound(self._belief, world), self.scorer.bound)
        scratch = self.observer.scratch + self.scorer.scratch
        first_use.wait()
        bound = simulation.bound_calls()
        self._whole: Callable[[Ints], bool] | None = None
        self._move: Callable[[Ints], bool] | None = None
        self._take: Callable[[Ints], bool] | None = None
        compiled = bound is not None and simulation.is_plain and not simulation.clouds
        if bound is not None and compiled:
            watch, scratch = chain(bound.fill, watch), scratch + bound.scratch
            ahead = chain(self._command_of, world.bound_step(self._command), bound.predict)
            if self.scenario.sensor_period > 1:
                self._move, self._take = self._share(scratch, ahead), self._share(scratch, bound.update)
            elif self.hold > 1:
                self._move = self._share(scratch, chain(ahead, bound.update))
            else:
                self._whole = self._finite_first(self._share(scratch, chain(ahead, bound.update), watch))
        self._watch, self._fills = self._share(scratch, watch), compiled

    def _share(self, scratch: tuple[Any, ...], *calls: Bound) -> Callable[[Ints], bool]:
        """One call of several, for some lanes at a time and by all threads."""
        if self.num_lanes > 1:
            return Shared(calls, scratch, self.num_lanes, self.simulation.world.crew)
        return chain(*calls)

    def _finite_first(self, call: Callable[[Ints], bool]) -> Callable[[Ints], bool]:
        """The call, after all actions are known to be finite: a block of lanes does not know the others'."""
        command_of = self._command_of
        return call if self.num_lanes == 1 else lambda lanes: command_of(lanes) and call(lanes)

    def _advance(self, lanes: Ints) -> bool:
        """One simulation step of the lanes; False, and nothing has moved, where an action is no finite number."""
        if self._move is None:
            finite = self._command_of(lanes)
            if finite:
                self.simulation.advance(self._command, None if len(lanes) == self.num_lanes else lanes)
            return finite
        finite = self._finite_first(self._move)(lanes)
        if finite and self._take is not None:
            due = self.simulation.due(lanes)
            if due is not None:
                self._take(due)
        return finite

    def _look(self, lanes: Ints) -> None:
        """Observe, measure and score the lanes named; what the kernels above have changed nobody calls stale."""
        if self._fills and len(lanes) == self.num_lanes:
            self._belief.mark_fresh()  # in a moment
        elif self._belief.is_stale:
            self._belief.refresh()
        self._watch(lanes)
        if isinstance(self.observer, CloudObserver):
            self.observer.fill_cloud(self._belief)

    def observe(self) -> NDArray[np.float32]:
        """[L, n] flat observations of the last step or reset, a fresh array."""
        return self.observer.out.copy()

    def get_state(self) -> dict[str, Any]:
        """Everything that changes between calls, as copies."""
        return {
            "simulation": self.simulation.get_state(),
            "scorer": self.scorer.get_state(),
            "border": self.observer.border.copy(),
            "observation": self.observer.out.copy(),
            "action": self.action.copy(),
        }

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore what `get_state` returned."""
        self.simulation.set_state(state["simulation"])
        self.scorer.set_state(state["scorer"])
        self.observer.border[:] = state["border"]
        self.observer.out[:] = state["observation"]
        self.action[:] = state["action"]
