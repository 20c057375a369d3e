"""One robot, step by step, under its scenario's own policy, with a clock on every filter."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slam_gym import policies
from slam_gym.scenario import Scenario
from slam_gym.simulation import Simulation

Floats = NDArray[np.float64]


def drive(scenario: Scenario, estimators: Sequence[tuple[str, Mapping[str, Any]]], seed: int) -> Iterator[Simulation]:
    """The simulation after each step, until the policy or the scenario ends.

    Args:
        scenario: whose policy does without an observation.
        estimators: (name, options); all process the same data, the policy acts on the first one's belief.
        seed: of world and filters.
    """
    simulation = Simulation(scenario, estimators, num_lanes=1, timed=True)
    simulation.reset([seed])
    context = policies.PolicyContext.from_scenario(scenario)
    policy = policies.make(scenario.policy.name, context, 1, **scenario.policy.options)
    policy.reset(np.zeros(1, dtype=np.int64), np.array([seed]))
    for _ in range(scenario.max_steps):
        command = context.action_map.to_command(policy.act(None, simulation.estimators[0].belief))
        if policy.finished[0]:
            break
        simulation.advance(command)
        yield simulation


def seconds_per_step(spent: Sequence[Floats]) -> Floats:
    """[T, E] seconds of each step from what `clock` read after each."""
    return np.diff(np.array(spent), axis=0, prepend=0.0)


def clock(simulation: Simulation) -> Floats:
    """[E] seconds that each filter has taken so far, predictions and updates."""
    return simulation.predict_seconds + simulation.update_seconds
