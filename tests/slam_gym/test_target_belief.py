"""What filters believe of a target at its first sightings and after a long absence, in the world of Wu and Sun 2013."""

import numpy as np
import pytest

from estimators import make
from estimators.interface import TARGET, Scan
from slam_gym import policies
from slam_gym.policy_view import PolicyView
from slam_gym.scenario import Scenario
from slam_gym.simulation import Simulation

RUNS = 200


def follow(names, steps, *, known, absence=range(0)):
    """Errors [m] and NEES2 [runs] of each filter, sweep by sweep; the target is hidden in sweeps of `absence`."""
    scenario = Scenario.load("slamto").replace("max_steps", steps + 1)
    simulation = Simulation(scenario, [("ri-ekf", {})], num_lanes=RUNS)
    simulation.reset(np.arange(RUNS))
    world, lanes = simulation.world, np.arange(RUNS)
    motion, sensor, target = scenario.models()
    mean, cov = world.target_start(lanes) if known else (None, None)
    filters = {name: make(name, motion, sensor, target, num_lanes=RUNS, max_landmarks=20) for name in names}
    for one in filters.values():
        one.reset(world.start_pose, world.start_cov, seeds=lanes, target=mean, target_cov=cov)
    context = policies.PolicyContext.from_scenario(scenario)
    policy = policies.make("pursuit", context, RUNS, **dict(scenario.policy.options))
    policy.reset(lanes, lanes)
    view, found, sweep = PolicyView(policy, scenario), {name: [] for name in names}, 0
    for _ in range(steps):
        action = policy.act(view.observe(simulation, 0), simulation.estimators[0].belief)
        simulation.advance(context.action_map.to_command(action))
        for one in filters.values():
            one.predict(world.odometry, scenario.dt)
        if not world.due[0]:
            continue
        scan = without_target(world.scan) if sweep in absence else world.scan
        for name, one in filters.items():
            one.update(scan)
            away, P = one.belief.target_position - world.target[:, :2], one.belief.target_position_cov
            assert one.belief.target_known.all()
            nees = np.einsum("li,li->l", away, np.linalg.solve(P, away[..., None])[..., 0])
            found[name].append((np.hypot(*away.T), nees))
        sweep += 1
    return found


def without_target(scan):
    """The target is the last return of a sweep."""
    last = np.maximum(scan.count - 1, 0)
    seen = (scan.count > 0) & (scan.labels[np.arange(RUNS), last] == TARGET)
    return Scan(scan.ranges, scan.bearings, scan.labels, scan.count - seen, scan.complete)


def test_the_second_sighting():
    """Unknown at the start: a usable position at once, and one that knows how good it is."""
    found = follow(["ekf", "ri-ekf"], 17, known=False)
    for sightings in found.values():
        error, nees = sightings[1]
        assert error.mean() < 0.11
        assert nees.mean() < 2.5


@pytest.mark.slow
def test_a_return_after_eighty_sweeps():
    found = follow(["ekf", "fej-ekf", "ri-ekf", "cdkf"], 8 * 93, known=True, absence=range(10, 90))
    for sightings in found.values():
        assert sightings[90][1].mean() < 2.5
