"""One episode, step by step: a policy drives on one belief while any number of estimators process the same data."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slam_gym import policies
from slam_gym.first_use import FirstUse
from slam_gym.policy_view import PolicyView
from slam_gym.scenario import Scenario
from slam_gym.simulation import Simulation
from slam_gym.specs import Spec

Floats = NDArray[np.float64]

Named = str | tuple[str, Mapping[str, Any]]

ONE_LANE = np.zeros(1, dtype=np.int64)


class Episode:
    """A single-lane simulation with a driver.

    Args:
        scenario: the world.
        estimators: "ekf", "slamto:particles=500" or (name, options); the policy acts on the belief of the first.
        policy: "pursuit", "pursuit:stand_off=2", (name, options) or the folder of a training; None: the scenario's own.
        seed: of world, estimators and policy.
        cloud_points: where a lost target may be, beside each estimator, for pictures; 0: none.

    Attributes:
        simulation: world, estimators and meters.
        names: what the estimators are called, with their options.
        policy: the driver.
        driver: index of the estimator whose belief the policy acts on.
    """

    def __init__(
        self,
        scenario: Scenario,
        estimators: Sequence[Named] = ("ekf",),
        *,
        policy: Named | None = None,
        seed: int = 0,
        cloud_points: int = 0,
    ) -> None:
        specs = [Spec.parse(estimator) for estimator in estimators]
        if not specs:
            raise ValueError("an episode needs at least one estimator, for example 'ekf'")
        self.scenario, self.driver = scenario, 0
        self.names = [spec.label for spec in specs]
        with FirstUse(scenario, specs[0]) as first_use:
            self.simulation = Simulation(scenario, [(s.name, s.options) for s in specs], num_lanes=1, allow_truth=True)
            first_use.wait()
        self.context = policies.PolicyContext.from_scenario(scenario)
        chosen = policies.parse(policy or (scenario.policy.name, scenario.policy.options))
        self.policy_name = chosen.label
        self.policy = policies.make(chosen.name, self.context, 1, **chosen.options)
        self._view = PolicyView(self.policy, scenario)
        self._view.attach(self.simulation, self.driver)
        for index in range(len(specs) if cloud_points and scenario.has_target else 0):
            if index not in self.simulation.clouds:
                self.simulation.attach_cloud(cloud_points, index)
        self.reset(seed)

    def reset(self, seed: int) -> None:
        """Start anew: another world, another run of the noise."""
        self.seed = seed
        seeds = np.array([seed], dtype=np.int64)
        self.simulation.reset(seeds)
        self.policy.reset(ONE_LANE, seeds)
        self._command = np.zeros((1, 2))
        self.step_count = 0

    @property
    def finished(self) -> bool:
        """Whether the scenario's steps are used up or the policy has nothing left to do."""
        return self.step_count >= self.scenario.max_steps or bool(self.policy.finished[0])

    @property
    def time(self) -> float:
        """[s] since the start."""
        return self.step_count * self.context.step_dt

    def warm_up(self) -> None:
        """Load or compile whatever a step needs, then start anew: no pause later."""
        for _ in range(2 * self.scenario.sensor_period + 1):
            self.step()
        self.simulation.measure()
        self.reset(self.seed)

    def step(self, command: Floats | None = None) -> None:
        """One simulation step; command [1, 2], physical: drive so instead of asking the policy."""
        if command is not None:
            self._command = command
        elif self.step_count % self.context.hold == 0:
            belief = self.simulation.estimators[self.driver].belief
            shown = self._view.observe(self.simulation, self.driver)
            self._command = self.context.action_map.to_command(self.policy.act(shown, belief))
            if self.policy.finished[0]:
                return
        self.simulation.advance(self._command)
        self.step_count += 1
