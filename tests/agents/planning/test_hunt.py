"""The hunt for a lost target: against the plan's cost written out, in scenes with one right answer, and in runs."""

import itertools
import math

import numpy as np
import pytest

from agents.planning.hunt import best_hunt
from agents.planning.pursuit_hunt import COMMANDS
from slam_gym import policies
from slam_gym.evaluation_plan import Combination
from slam_gym.evaluation_unit import simulate
from slam_gym.scenario import Scenario
from slam_gym.specs import Spec
from slam_gym.stats import paired_difference
from slam_gym.tables import run_table

SENSOR = (4.0, math.cos(0.6), 0.5, 0.9)  # range, cosine of half the view, pillars' radius, detection probability
PACE = (1.0, 1.5)
LOOK = 0.4


def hunt(pose, ahead, weights, pillars=(), looks=2, width=8, settings=(1.0, 0.3, 0.2), commands=None):
    """Number of the command that `best_hunt` begins with."""
    commands = np.array(COMMANDS) * PACE if commands is None else commands
    rows = np.ascontiguousarray(np.transpose(np.array(ahead, dtype=float), (0, 2, 1)))
    n, plans, pillars = len(weights), width * len(commands), np.array(pillars, dtype=float).reshape(-1, 2)
    return int(best_hunt(
        np.array(pose, dtype=float), np.array(weights, dtype=float), rows, LOOK, pillars, len(pillars), commands,
        looks, width, SENSOR, PACE, settings, np.zeros((2, plans, 3)), np.zeros((2, plans, n)),
        np.zeros((2, plans)), np.zeros(plans), np.zeros((2, plans), dtype=np.int64), np.zeros(width, dtype=np.int64),
        np.zeros(width, dtype=np.int64), np.zeros_like(pillars), np.zeros(n, dtype=np.int64), np.zeros((4, n)),
    ))  # fmt: skip


def sees(pose, point, pillars):
    """Whether the point is in range, in view, and the segment to it leaves every pillar's disc alone."""
    offset = np.array(point) - pose[:2]
    r = math.hypot(*offset)
    off = abs(math.remainder(math.atan2(offset[1], offset[0]) - pose[2], math.tau))
    if r > SENSOR[0] or off > 0.6:
        return False
    along = np.linspace(0.0, 1.0, 2001)[:, None] * offset + pose[:2]
    return all(np.hypot(*(along - pillar).T).min() >= SENSOR[2] for pillar in pillars)


def cost(plan, pose, ahead, weights, pillars, looks, settings):
    """The plan's cost as its docstring writes it, look by look."""
    pose, left, total = np.array(pose, dtype=float), np.array(weights, dtype=float), 0.0
    for t, places in enumerate(ahead):
        v, w = np.array(COMMANDS[plan[t // looks]]) * PACE
        heading = pose[2] + 0.5 * w * LOOK
        pose += LOOK * np.array([v * math.cos(heading), v * math.sin(heading), w])
        left *= [1.0 - SENSOR[3] * sees(pose, point, pillars) for point in places]
        depth = sum(max(0.0, 0.7 - math.hypot(*(pillar - pose[:2]))) / 0.2 for pillar in pillars)
        total += LOOK * (left.sum() + settings[1] * depth)
    for point, u in zip(ahead[-1], left, strict=True):
        offset = np.array(point) - pose[:2]
        off = abs(math.remainder(math.atan2(offset[1], offset[0]) - pose[2], math.tau))
        way = max(math.hypot(*offset) - 0.8 * SENSOR[0], 0.0) / PACE[0] + max(off - 0.7 * 0.6, 0.0) / PACE[1]
        total += settings[0] * u * way
    return total


@pytest.mark.parametrize("seed", range(6))
def test_a_wide_beam_finds_what_trying_every_plan_finds(seed):
    rng = np.random.default_rng(seed)
    start, steps = rng.uniform(-5, 5, (12, 2)), rng.uniform(-0.3, 0.3, (12, 2))
    ahead = np.array([start + (t + 1) * steps for t in range(4)])
    weights = rng.dirichlet(np.ones(12))
    pillars = rng.uniform(-3, 3, (4, 2)) + 1.0
    pose, settings = [0.2, -0.1, 0.5], (0.7, 0.4, 0.2)
    costs = {
        plan: cost(plan, pose, ahead, weights, pillars, 2, settings)
        for plan in itertools.product(range(len(COMMANDS)), repeat=2)
    }
    found = hunt(pose, ahead, weights, pillars, width=len(COMMANDS), settings=settings)
    assert min(c for plan, c in costs.items() if plan[0] == found) <= min(costs.values()) + 1e-9


def still(*points, steps=8):
    return np.tile(np.array(points, dtype=float), (steps, 1, 1))


def test_it_turns_to_the_heavier_side():
    left, right = [0.0, 2.0], [0.0, -2.0]
    for heavy, sign in ((left, 1.0), (right, -1.0)):
        number = hunt([0, 0, 0], still(heavy, left, right), [0.6, 0.2, 0.2])
        assert COMMANDS[number][1] * sign > 0.0


def test_it_drives_to_what_is_out_of_range_and_around_what_a_pillar_hides():
    assert COMMANDS[hunt([0, 0, 0], still([9.0, 0.0]), [1.0])][0] == 1.0
    number = hunt([0, 0, 0], still([2.6, 0.0]), [1.0], [[2.0, 0.1]])
    assert COMMANDS[number][0] == 1.0 and COMMANDS[number][1] < 0.0  # past the side that it stands less far out on


def test_it_awaits_what_comes():
    """A point that walks around the pillar into view by itself is not driven to, one that stays behind it is."""
    coming = np.array([[[3.0, 1.0 - 0.7 * t]] for t in range(8)])
    pillar = [[1.5, 0.35]]
    costs = [cost((7,) * 4, [0, 0, 0], ahead, [1.0], np.array(pillar), 2, (1.0, 0.3, 0.2)) for ahead in
             (coming, still([3.0, 0.7]))]  # fmt: skip
    assert costs[0] < 0.6 * costs[1]
    assert COMMANDS[hunt([0, 0, 0], still([3.0, 0.7]), [1.0], pillar)] != (0.0, 0.0)


def test_a_bicycle_is_never_told_to_turn_on_the_spot(make_context):
    policy = policies.make("pursuit-hunt", make_context("bicycle", speed=3.0))
    assert (policy._commands[:, 0] > 0.0).all()
    curvature = math.sin(policy.context.steering_max) / policy.context.motion.wheelbase
    assert (np.abs(policy._commands[:, 1]) <= policy._commands[:, 0] * curvature + 1e-12).all()


def test_a_world_without_a_target_is_no_error():
    scenario = Scenario.load("default", **{"target.kind": "none"}).replace("max_steps", 5)
    record = simulate(Combination(scenario, Spec.parse("pursuit-hunt"), (Spec.parse("ekf"),), 0), 0, [0])[0]
    assert np.isfinite(record["robot_error"]).all()


@pytest.mark.parametrize("options", [
    {"segments": 0}, {"looks": 1.5}, {"beam": 65}, {"look": 0.0}, {"patience": -1.0}, {"replan": math.inf},
])  # fmt: skip
def test_impossible_options_are_named(make_context, options):
    with pytest.raises(ValueError, match=next(iter(options))):
        policies.make("pursuit-hunt", make_context(), **options)


def _runs(scenario, policy, runs):
    """Enough runs to tell a difference of three points: where targets flee, half as many let chance decide."""
    combination = Combination(Scenario.load(scenario), Spec.parse(policy), (Spec.parse("ri-ekf"),), 0)
    return run_table((scenario, policy, "ri-ekf"), simulate(combination, 1, range(runs), score_map=False)[0])


@pytest.mark.slow
def test_the_hunt_finds_a_target_sooner_than_the_best_view():
    views, hunting = _runs("discovery", "pursuit-search", 300), _runs("discovery", "pursuit-hunt", 300)
    assert paired_difference(views["find_time"], hunting["find_time"]).low > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["default", "evasive-hard"])
def test_the_hunt_keeps_the_target_that_the_best_view_loses(scenario):
    views, hunting = _runs(scenario, "pursuit-search", 300), _runs(scenario, "pursuit-hunt", 300)
    assert paired_difference(views["lost_share"], hunting["lost_share"]).low > 0.0


@pytest.mark.slow
def test_a_target_that_flees_is_kept_by_who_learns_that_it_does():
    plain, learning = (_runs("evasive-hard", f"pursuit-hunt:evasive={e}", 300) for e in ("false", "true"))
    assert paired_difference(plain["lost_share"], learning["lost_share"]).low > 0.0
