"""How long policies take to decide: the mean, and the slowest, so that no long plan hides behind many short ones."""

import sys
from time import perf_counter, thread_time
from typing import Any

import numpy as np

from slam_gym import policies
from slam_gym.policies import Floats, Ints, PolicyContext
from slam_gym.policy_view import PolicyView
from slam_gym.scenario import Scenario
from slam_gym.simulation import Simulation

SCENARIO, ESTIMATOR = "default", "ri-ekf"
SLOWEST = 0.01  # share of the decisions that count as the slowest
ROUNDS = 3  # in which each decision is timed
WARM_UP = 20  # steps before
CLOCK = perf_counter if sys.platform == "win32" else thread_time  # Windows counts a thread's time in steps of 16 ms


class Driver:
    """A policy that drives lanes of `default` again and again, the same way in the same worlds.

    Args:
        name: of the policy, with options.
        num_lanes: L.
    """

    def __init__(self, name: str, num_lanes: int = 1) -> None:
        scenario, chosen = Scenario.load(SCENARIO), policies.parse(name)
        self.num_lanes, self.max_steps = num_lanes, scenario.max_steps
        self.context = PolicyContext.from_scenario(scenario)
        self.policy = policies.make(chosen.name, self.context, num_lanes, **chosen.options)
        self.simulation = Simulation(scenario, [(ESTIMATOR, {})], num_lanes=num_lanes, allow_truth=True)
        self.view = PolicyView(self.policy, scenario)
        self.view.attach(self.simulation)

    def seconds(self, seeds: Ints, steps: int) -> Floats:
        """[steps] that each decision takes, of all lanes together; the policy's observation, if it reads one, in it."""
        self.simulation.reset(seeds)
        self.policy.reset(np.arange(self.num_lanes), seeds)
        belief, taken = self.simulation.estimators[0].belief, np.zeros(steps)
        for step in range(steps):
            began = CLOCK()
            action = self.policy.act(self.view.observe(self.simulation), belief)
            taken[step] = CLOCK() - began
            self.simulation.advance(self.context.action_map.to_command(action))
        return taken


def decision_row(name: str, runs: int, num_lanes: int, steps: int | None = None) -> dict[str, Any]:
    """A policy's microseconds per decision: mean, of the slowest and of the longest, and per lane of many.

    The same decisions are taken `ROUNDS` times, after a few that may compile, and the least processor time of each
    counts: what is left of the longest is the policy's, not the machine's.

    Args:
        name: of the policy.
        runs: of one lane, each of `steps` decisions.
        num_lanes: of many lanes, in one run.
        steps: of a run; None: the scenario's.
    """
    alone, together = Driver(name), Driver(name, num_lanes)
    steps = steps or alone.max_steps
    single = np.concatenate([_least(alone, np.array([seed]), steps) for seed in range(runs)])
    many = _least(together, np.arange(num_lanes), steps) / num_lanes
    slowest = np.sort(single)[-max(1, round(SLOWEST * single.size)) :]
    numbers = {
        "mean": single.mean(), "slowest": np.median(slowest), "longest": single.max(), "lane_mean": many.mean(),
        "lane_longest": many.max(),
    }  # fmt: skip
    return {"name": name, "lanes": num_lanes} | {key: 1e6 * float(value) for key, value in numbers.items()}


def _least(driver: Driver, seeds: Ints, steps: int) -> Floats:
    """[steps] least seconds of each decision; a first short drive does not count."""
    driver.seconds(seeds, min(steps, WARM_UP))
    return np.min([driver.seconds(seeds, steps) for _ in range(ROUNDS)], axis=0)
