"""Policies that look for a lost target: the spiral, the choice of views, and what negative information is worth."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from agents.scripted.viewpoints import BINS, HEADING, X, Y, choose_views
from slam_gym import policies
from slam_gym.evaluation_plan import Combination
from slam_gym.evaluation_unit import simulate
from slam_gym.scenario import Scenario
from slam_gym.simulation import Simulation
from slam_gym.specs import Spec
from slam_gym.stats import paired_difference
from slam_gym.tables import run_table


def _drive(policy, steps, belief, dt=0.1):
    """Places [steps, 2] of a perfect unicycle that the policy drives while the belief is moved along."""
    places = []
    for _ in range(steps):
        command = policy.context.action_map.to_command(policy.act(None, belief))[0]
        x, y, heading = belief.pose[0]
        belief.pose[0] = x + dt * command[0] * math.cos(heading), y + dt * command[0] * math.sin(heading), \
            heading + dt * command[1]  # fmt: skip
        places.append(belief.pose[0, :2].copy())
    return np.array(places)


def _unknown_target():
    return SimpleNamespace(
        pose=np.zeros((1, 3)), target_known=np.zeros(1, dtype=np.bool_), target_position=np.zeros((1, 2)),
        target_rel=np.zeros((1, 2)), target_rel_cov=np.zeros((1, 2, 2)), target_rel_velocity=np.zeros((1, 2)),
    )  # fmt: skip


def test_the_spiral_widens_and_leaves_no_strip_wider_than_its_pitch():
    scenario = Scenario.load("default", **{"arena.width": 40.0, "arena.height": 40.0})
    policy = policies.make("search", policies.PolicyContext.from_scenario(scenario), pitch=4.0)
    policy.reset(np.array([0]), np.array([0]))
    places = _drive(policy, 1200, _unknown_target())
    grid = np.stack(np.meshgrid(np.linspace(-8, 8, 33), np.linspace(-8, 8, 33)), axis=-1).reshape(-1, 2)
    grid = grid[np.hypot(*grid.T) < 8.0]
    gaps = np.hypot(*(grid[:, None] - places[None]).transpose(2, 0, 1)).min(axis=1)
    assert gaps.max() < 0.5 * 4.0 + 0.5
    assert np.hypot(*places[-1]) > np.hypot(*places[300])


def _view(points, weights, pillars=(), pose=(0.0, 0.0, 0.0)):
    """The view chosen by one lane with a forward sensor: range 4 m, half field of view 0.5 rad, pillars of 0.5 m."""
    points, pillars = np.array([points], dtype=float), np.array(pillars, dtype=float).reshape(1, -1, 2)
    goal = np.full((1, 4), -1.0)
    choose_views(
        np.ones(1, dtype=np.bool_), np.array([pose]), points, np.array([weights], dtype=float),
        np.ones(pillars.shape[:2], dtype=np.bool_), pillars, (4.0, 0.5, 0.5), (-0.4, 1.0, 1.5), (10.0, 10.0), 0.05,
        5.0, 1.05, np.zeros(3 * pillars.shape[1]), np.zeros(BINS), goal,
    )  # fmt: skip
    return goal[0]


def test_a_view_is_where_the_cloud_can_be_seen_soonest():
    near = _view([[0.0, 3.0], [0.1, 3.0]], [0.5, 0.5])
    assert np.allclose(near[[X, Y]], 0.0)  # a turn on the spot shows it
    bearing = math.atan2(3.0, 0.0)
    assert abs(math.remainder(near[HEADING] - bearing, math.tau)) < 0.5
    far = _view([[9.0, 0.0], [9.0, 0.1]], [0.5, 0.5])
    assert math.hypot(9.0 - far[X], far[Y]) < 4.0  # out of range: go there
    heavy = _view([[0.0, 3.0], [0.0, -3.0]], [0.3, 0.7])
    assert math.sin(heavy[HEADING]) < 0.0


def test_a_view_does_not_count_what_a_pillar_hides():
    hidden, pillar = [3.0, 0.0], [1.5, 0.0]
    view = _view([hidden, hidden], [0.5, 0.5], [pillar])
    sight = np.linspace(view[[X, Y]], hidden, 200)
    assert np.hypot(*(sight - pillar).T).min() > 0.45
    assert not np.allclose(view[[X, Y]], 0.0)


def test_a_world_without_a_target_is_no_error():
    scenario = Scenario.load("default", **{"target.kind": "none"})
    record = simulate(Combination(scenario.replace("max_steps", 5), Spec.parse("pursuit-search"),
                                  (Spec.parse("ekf"),), 0), 0, [0])[0]  # fmt: skip
    assert np.isfinite(record["robot_error"]).all()


@pytest.mark.parametrize("name", ["search", "pursuit-search", "pursuit-hunt"])
def test_lanes_decide_as_single_robots_do(name):
    scenario = Scenario.load("discovery")
    context = policies.PolicyContext.from_scenario(scenario)

    def actions(seeds):
        simulation, policy = Simulation(scenario, [("ekf", {})], len(seeds)), policies.make(name, context, len(seeds))
        if policy.needs_target_cloud:
            simulation.attach_cloud(policy.needs_target_cloud, **policy.target_cloud_options)
        simulation.reset(np.array(seeds))
        policy.reset(np.arange(len(seeds)), np.array(seeds))
        taken = []
        for _ in range(40):
            taken.append(policy.act(None, simulation.estimators[0].belief).copy())
            simulation.advance(context.action_map.to_command(taken[-1]))
        return np.array(taken)

    together = actions([3, 4, 5])
    for i, seed in enumerate([3, 4, 5]):
        assert np.array_equal(together[:, i], actions([seed])[:, 0])


@pytest.mark.parametrize(("name", "option"), [("search", "pitch"), ("pursuit-search", "discount")])
def test_impossible_numbers_are_refused(name, option):
    context = policies.PolicyContext.from_scenario(Scenario.load("default"))
    with pytest.raises(ValueError, match=option):
        policies.make(name, context, **{option: -1.0})


def _runs(scenario, policy, runs):
    combination = Combination(Scenario.load(scenario), Spec.parse(policy), (Spec.parse("ekf"),), 0)
    return run_table((scenario, policy, "ekf"), simulate(combination, 1, range(runs))[0])


@pytest.mark.slow
def test_negative_information_finds_the_target_sooner():
    """At least 15 % sooner by the paired interval, and nearly every target found."""
    blind = _runs("discovery", "pursuit-search:negative_information=false", 200)
    found = _runs("discovery", "pursuit-search", 200)
    saved = paired_difference(blind["find_time"], found["find_time"])
    assert saved.low > 0.15 * blind["find_time"].mean()
    assert found["never_found"].mean() <= 0.02


@pytest.mark.slow
def test_search_keeps_the_target_that_pursuit_loses():
    plain, search = _runs("default", "pursuit", 120), _runs("default", "pursuit-search", 120)
    assert paired_difference(plain["lost_share"], search["lost_share"]).low > 0.0
