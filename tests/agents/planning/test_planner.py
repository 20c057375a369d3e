"""What plans do: against a search of everything, in worlds where the right move is known, and over lanes."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from agents.planning import planner
from agents.planning.beam import _command, _look_around, _place_cost
from agents.planning.lookahead import drive, grow
from agents.planning.state import TARGET
from estimators.kernels.jit import jit
from slam_gym import policies
from slam_gym.episode import Episode
from slam_gym.policies import PolicyContext
from slam_gym.scenario import Scenario
from slam_gym.simulation import Simulation


def episode(scenario="default", policy="receding-horizon", estimator="ekf", seed=0, steps=25):
    found = Episode(Scenario.load(scenario), [estimator], policy=policy, seed=seed)
    for _ in range(steps):
        found.step()
    return found


@jit
def one_segment(x, P, n, number, pillars, num_pillars, commands, weights, timing, stand_off, limits, model, B):
    v, w = _command(number, x, commands, timing[0], stand_off, limits)
    dx, dy, heading = drive(x, v, w, timing[0])
    cost = _place_cost(x, pillars, num_pillars, model.landmark_radius, weights, stand_off)
    grow(P, n, dx, dy, heading, v, w, timing[0], timing[1], model, timing[3])
    seen = _look_around(x, P, n, pillars, num_pillars, weights[5], timing[2], model, B)
    cost += P[TARGET, TARGET] + P[TARGET + 1, TARGET + 1] + weights[0] * (P[0, 0] + P[1, 1] + P[2, 2])
    return cost + weights[1] * (1.0 - seen) + (weights[6] if number else 0.0)


@pytest.mark.parametrize("seed", [1, 2, 5])
def test_a_wide_beam_finds_what_trying_every_plan_finds(seed):
    drive = episode(seed=seed)
    policy = drive.policy.__class__(drive.context, horizon=2, beam=len(planner.COMMANDS))
    belief = drive.simulation.estimators[0].belief
    n, num_pillars = policy._gather(0, belief)
    costs = {}
    for plan in itertools.product(range(len(planner.COMMANDS)), repeat=2):
        x, P = policy._x.copy(), policy._P.copy()
        costs[plan] = sum(
            one_segment(x, P, n, number, policy._pillars, num_pillars, policy._commands, policy._weights,
                        policy._timing, policy._stand_off, policy._limits, policy._model, policy._B)
            for number in plan
        )  # fmt: skip
    assert policy._best(0, belief) == min(costs, key=costs.get)[0]


def test_a_segment_with_fewer_sweeps_is_worth_as_much_as_one_with_a_worse_sensor():
    """Five steps to a sweep and five times the variances weigh the same."""
    every, context = [], episode(steps=0).context
    rare = replace(context, sensor_period=5)
    root = math.sqrt(5.0)
    worse = replace(context.sensor, range_std=root * context.sensor.range_std,
                    range_std_per_range=root * context.sensor.range_std_per_range,
                    bearing_std=root * context.sensor.bearing_std)  # fmt: skip
    weights = {"distance_weight": 0.0, "departure": 0.0, "unseen_weight": 0.0}
    for seed in range(30):
        belief = episode(seed=seed).simulation.estimators[0].belief
        every.append([planner.RecedingHorizon(one, **weights)._best(0, belief)
                      for one in (context, rare, replace(context, sensor=worse))])  # fmt: skip
    usual, rarely, badly = zip(*every, strict=True)
    assert rarely == badly != usual


def test_lanes_equal_single_lanes_bit_for_bit():
    scenario = Scenario.load("default")
    seeds, commands = np.array([3, 8, 21]), []
    for lanes in ([0, 1, 2], [0], [1], [2]):
        simulation = Simulation(scenario, [("ekf", {})], num_lanes=len(lanes))
        context = PolicyContext.from_scenario(scenario)
        policy = policies.make("receding-horizon", context, len(lanes), search=False)
        policy.reset(np.arange(len(lanes)), seeds[lanes])
        simulation.reset(seeds[lanes])
        for _ in range(30):
            action = policy.act(None, simulation.estimators[0].belief)
            simulation.advance(context.action_map.to_command(action))
        commands.append(np.hstack([policy.command, simulation.world.pose]))
    assert commands[0].tobytes() == np.vstack(commands[1:]).tobytes()


def test_pillars_are_kept_clear_of():
    """Counted collisions over the same worlds, with and without their price."""
    hits = {}
    for weight in (0.0, 1.0):
        hits[weight] = sum(
            int(episode(policy=f"receding-horizon:search=false,pillar_weight={weight}", seed=s, steps=150)
                .simulation.world.collisions[0])
            for s in range(4)
        )  # fmt: skip
    assert hits[1.0] <= hits[0.0]


def test_estimators_without_a_joint_gaussian_are_planned_on_too():
    drive = episode(estimator="slamto", steps=60)
    world = drive.simulation.world
    assert np.hypot(*(world.target[0, :2] - world.pose[0, :2])) < 6.0


@pytest.mark.parametrize("name", ["greedy-info", "receding-horizon"])
def test_drives_a_standing_target_s_distance_and_looks_at_it(name):
    scenario = Scenario.load("open", **{"target.speed": 0.0})
    drive = Episode(scenario, ["ekf"], policy=(name, {"distance_weight": 0.1}), seed=4)
    for _ in range(150):
        drive.step()
    world = drive.simulation.world
    dx, dy = world.target[0, :2] - world.pose[0, :2]
    assert math.hypot(dx, dy) < 3.0
    assert bool(world.target_detected[0])


@pytest.mark.parametrize("options", [
    {"horizon": 0}, {"beam": 2.5}, {"segment": math.nan}, {"pose_weight": -1.0}, {"visibility": "sofft"},
])  # fmt: skip
def test_impossible_options_are_named(make_context, options):
    with pytest.raises(ValueError, match=next(iter(options))):
        policies.make("receding-horizon", make_context(), **options)
