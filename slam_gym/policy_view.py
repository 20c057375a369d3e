"""What a policy is shown: an observation and a target cloud where it needs them, else neither, at no cost.

A `TruthAwarePolicy` is handed the truth here and nowhere else.
"""

from typing import Any

from slam_gym.observation import Observer
from slam_gym.observation_cloud import CloudObserver
from slam_gym.policies import Policy, TruthAwarePolicy
from slam_gym.scenario import Scenario
from slam_gym.simulation import Simulation


class PolicyView:
    """Builds the observation of a simulation's lanes as the environment does, and attaches a target cloud.

    Args:
        policy: whose `needs_observation`, `needs_target_cloud` and options of the two count.
        scenario: that is simulated.
    """

    def __init__(self, policy: Policy, scenario: Scenario) -> None:
        self._observer: Observer | None = None
        if policy.needs_observation:
            kind = CloudObserver if policy.needs_target_cloud else Observer
            self._observer = kind(scenario, policy.num_lanes, **policy.observation_options)
        self._told = policy if isinstance(policy, TruthAwarePolicy) else None
        self._num_points, self._cloud_options = policy.needs_target_cloud, policy.target_cloud_options

    def attach(self, simulation: Simulation, driver: int = 0) -> None:
        """Give estimator number `driver` the target cloud that the policy reads; before the simulation's reset."""
        if self._num_points and simulation.scenario.has_target:
            simulation.attach_cloud(self._num_points, driver, **self._cloud_options)

    def observe(self, simulation: Simulation, driver: int = 0) -> Any:
        """[L, n] float32 of the belief of estimator number `driver`; None where the policy needs none."""
        world = simulation.world
        if self._told is not None and world.has_target:
            self._told.set_truth(world.pose, world.target)
        if self._observer is None:
            return None
        self._observer.border[:, 0] = 0.5 * world.numbers["arena_width"]
        self._observer.border[:, 1] = 0.5 * world.numbers["arena_height"]
        return self._observer.observe(simulation.estimators[driver].belief, world)
