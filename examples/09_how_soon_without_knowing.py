"""How soon could a target be found by somebody who is not told where it is? A bound for every policy.

python examples/09_how_soon_without_knowing.py [worlds] [plans kept] [steps]

Until the target is seen a robot only learns "not yet". So who knows how targets begin and move, but not where this one
is, drives one path, the same in every world but for the pillars. Where nothing hides and no look misses, the best path
for these very worlds finds sooner than any policy, as far as a beam finds it. Policies drive both there and as it is.
"""

import sys

import numpy as np

from slam_gym.evaluation import compare
from slam_gym.evaluation_plan import WORLD_SEEDS, run_seeds
from slam_gym.scenario import Scenario
from slam_gym.world import World

COMMANDS = [(1, 0), (1, 0.5), (1, -0.5), (1, 1), (1, -1), (0, 1), (0, -1), (0.4, 1), (0.4, -1)]  # shares of the limits
HOLD = 5  # steps that a command lasts
CLEAR = {"landmarks.opaque": False, "sensor.detection_probability": 1.0}
ONWARD = 2.5  # [s] that a target not yet found counts when plans are compared


def targets(scenario, worlds, steps, seed):
    """Places [steps, worlds, 2] of targets that are left alone, and the robot's start [3]."""
    world = World(scenario, worlds)
    world.reset(run_seeds(seed, WORLD_SEEDS, range(worlds)))
    start, places = world.pose[0].copy(), np.empty((steps, worlds, 2))
    for step in range(steps):
        world.step(np.zeros((worlds, 2)))
        places[step] = world.target[:, :2]
    return places, start


def in_view(poses, places, sensor):
    """[plans, worlds]: whether a target is in range and in the field of view of a plan's pose; pillars hide nothing."""
    dx, dy = (places[None, :, axis] - poses[:, axis, None] for axis in (0, 1))
    square = dx * dx + dy * dy
    forward = dx * np.cos(poses[:, 2, None]) + dy * np.sin(poses[:, 2, None])
    return (square < sensor.max_range**2) & (forward > np.cos(0.5 * sensor.field_of_view) * np.sqrt(square))


def soonest(places, start, scenario, width):
    """Least mean time to find [s] of one path for all worlds; who is not found in time counts until the end."""
    commands, dt = np.array(COMMANDS) * (scenario.robot.speed_max, scenario.robot.turn_max), scenario.dt
    poses, hidden, cost = start[None], np.ones((1, places.shape[1]), dtype=bool), np.full(1, dt)
    for segment in range(len(places) // HOLD):
        poses, hidden, cost = (np.repeat(a, len(commands), axis=0) for a in (poses, hidden, cost))
        v, w = np.tile(commands, (len(poses) // len(commands), 1)).T
        for step in range(segment * HOLD, (segment + 1) * HOLD):
            way = poses[:, 2] + 0.5 * dt * w
            poses = poses + dt * np.stack([v * np.cos(way), v * np.sin(way), w], axis=1)
            hidden &= ~in_view(poses, places[step], scenario.sensor)
            cost = cost + dt * hidden.mean(axis=1)
        order = np.argsort(cost + ONWARD * hidden.mean(axis=1), kind="stable")
        cells = np.round(2.0 * np.column_stack([poses[:, :2], np.sin(poses[:, 2]), np.cos(poses[:, 2])]))[order]
        first = np.sort(np.unique(cells, axis=0, return_index=True)[1])  # one plan of those that end alike
        best = order[first[:width]]
        poses, hidden, cost = poses[best], hidden[best], cost[best]
    return cost.min()


def main(worlds=400, width=100, steps=400, seed=0):
    scenario = Scenario.load("discovery")
    bound = soonest(*targets(scenario, worlds, steps, seed), scenario, width)
    print(f"mean time to find in {worlds} worlds [s]: bound without knowing {bound:.2f}")
    for world, overrides in {"as it is": {}, "where nothing hides and no look misses": CLEAR}.items():
        options = {"runs": worlds, "steps": steps, "seed": seed, "overrides": overrides}
        runs = compare(scenario, ["ri-ekf"], ["pursuit", "pursuit-hunt", "oracle"], **options).runs
        found = runs.groupby("policy", sort=False)["find_time"].mean()
        gap = found["pursuit"] - found["oracle"]
        print(f"\n{world}:")
        for name, value in {**found, "bound": bound}.items():
            print(f"{name:16} {value:6.2f}   closes {(found['pursuit'] - value) / gap:5.2f} of the gap to the oracle")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:4]))
