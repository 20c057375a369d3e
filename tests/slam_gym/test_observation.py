import math

import numpy as np
import pytest

from slam_gym.observation import FAR, FAST, Observer, equally_probable_points
from slam_gym.scenario import Scenario
from slam_gym.simulation import Simulation


def drive(name, steps, lanes=3, seed=0, **overrides):
    """A simulation somewhere in an episode, and its observer."""
    scenario = Scenario.load(name, **overrides)
    simulation = Simulation(scenario, [("ekf", {})], num_lanes=lanes)
    simulation.reset(np.arange(lanes) + seed)
    observer = Observer(scenario, lanes)
    rng = np.random.default_rng(seed)
    limit = scenario.robot.steering_max if scenario.robot.kind == "bicycle" else scenario.robot.turn_max
    for _ in range(steps):
        command = rng.uniform(-1, 1, (lanes, 2)) * [scenario.robot.speed_max, limit]
        simulation.advance(command)
    return simulation, observer


def oracle(simulation, observer, lane, K=8, S=8):
    """The rows of the module's table in plain NumPy, by block."""
    scenario, world, belief = simulation.scenario, simulation.world, simulation.estimators[0].belief
    unit, speed = scenario.sensor.max_range, scenario.robot.speed_max
    sweep = scenario.dt * scenario.sensor_period
    since, steps = world.time_since_seen[lane], world.step_count[lane]
    known = bool(belief.target_known[lane])
    seen = known and since < sweep - 0.5 * scenario.dt and since < (steps - 0.5) * scenario.dt
    blocks = {name: np.zeros(where.stop - where.start) for name, where in observer.blocks.items()}
    blocks["target"][:3] = known, seen, min(since / 10.0, 1.0) if scenario.has_target else 0.0
    if known:
        q, cov, velocity = belief.target_rel[lane], belief.target_rel_cov[lane], belief.target_rel_velocity[lane]
        r = np.hypot(*q)
        std = np.sqrt(np.diag(cov))
        blocks["target"][3:] = [r / unit, q[1] / r, q[0] / r, *velocity / speed, *std / unit, cov[0, 1] / std.prod()]
        points = q + equally_probable_points() @ np.linalg.cholesky(cov).T if not seen else q[None]
        for x, y in points:
            blocks["sectors"][math.floor((math.atan2(y, x) / (2 * math.pi) + 0.5 / S) % 1.0 * S)] += 1 / len(points)
    elif scenario.has_target:
        blocks["sectors"][:] = 1 / S
    x, y, heading = belief.pose[lane]
    R = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
    std = np.sqrt(np.diag(R @ belief.pose_cov[lane][:2, :2] @ R.T))
    turn = scenario.robot.steering_max if scenario.robot.kind == "bicycle" else scenario.robot.turn_max
    v, w = world.odometry[lane]
    blocks["robot"][:] = [x / unit, y / unit, np.sin(heading), np.cos(heading), *std / unit,
                          np.sqrt(belief.pose_cov[lane, 2, 2]), v / speed, w / turn]  # fmt: skip
    half = np.array(scenario.arena.size) / 2
    for i in range(4):  # walk along the direction to where it leaves the rectangle
        d = np.array([np.cos(heading + i * np.pi / 2), np.sin(heading + i * np.pi / 2)])
        inside = (np.abs([x, y]) < half).all()
        blocks["walls"][i] = min(np.where(d > 0, half - [x, y], -half - [x, y]) / d) / unit if inside else 0.0
    mapped = np.flatnonzero(belief.landmark_mapped[lane])
    distance = np.linalg.norm(belief.landmark_rel[lane, mapped], axis=1)
    for i, slot in enumerate(mapped[np.argsort(distance, kind="stable")][:K]):
        q, r = belief.landmark_rel[lane, slot], np.linalg.norm(belief.landmark_rel[lane, slot])
        std = np.sqrt(np.diag(belief.landmark_rel_cov[lane, slot]))
        blocks["landmarks"][5 * i : 5 * i + 5] = [r / unit, q[1] / r, q[0] / r, *std / unit]
        blocks["landmark_mask"][i] = 1.0
    low, high = observer.low, observer.high
    return {name: np.clip(block, low[observer.blocks[name]], high[observer.blocks[name]])
            for name, block in blocks.items()}  # fmt: skip


@pytest.mark.parametrize("name", ["default", "open", "discovery", "tian-sparse", "mrclam"])
@pytest.mark.parametrize("steps", [1, 90])
def test_every_block_against_numpy(name, steps):
    simulation, observer = drive(name, steps)
    rows = observer.observe(simulation.estimators[0].belief, simulation.world)
    assert rows.dtype == np.float32 and rows.shape == (3, 80)
    for lane in range(3):
        for block, expected in oracle(simulation, observer, lane).items():
            found = rows[lane, observer.blocks[block]]
            np.testing.assert_allclose(found, expected, atol=2e-6, err_msg=f"{name}, lane {lane}: {block}")


@pytest.mark.parametrize("name", ["default", "evasive-hard", "tian-sparse", "mrclam", "slamto"])
def test_always_within_the_space(name):
    simulation, observer = drive(name, 0, lanes=4)
    space = observer.space("box")
    rng = np.random.default_rng(1)
    for _ in range(200):
        simulation.advance(rng.uniform(-5, 5, (4, 2)))
        for row in observer.observe(simulation.estimators[0].belief, simulation.world):
            assert space.contains(row)


def test_the_sectors_hold_the_whole_probability():
    simulation, observer = drive("default", 150, lanes=32)
    rows = observer.observe(simulation.estimators[0].belief, simulation.world)
    known = simulation.estimators[0].belief.target_known
    assert known.any()
    np.testing.assert_allclose(rows[:, observer.blocks["sectors"]].sum(axis=1), 1.0, atol=1e-5)


def test_the_points_stand_for_a_standard_normal():
    points = equally_probable_points()
    assert points.shape == (64, 2)
    np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(points.T @ points / 64, np.eye(2), atol=0.12)  # quantiles cut the tails off


def test_a_dictionary_of_the_same_numbers():
    simulation, observer = drive("open", 20)
    flat = observer.observe(simulation.estimators[0].belief, simulation.world)
    blocks = observer.split(flat)
    np.testing.assert_array_equal(np.concatenate(list(blocks.values()), axis=1), flat)
    space = observer.space("dict")
    assert all(space[name].contains(block[0]) for name, block in blocks.items())


@pytest.mark.parametrize(("options", "message"), [({"nearest": 0}, "nearest_landmarks"), ({"sectors": 1}, "sectors")])
def test_sizes_out_of_reach_are_refused(options, message):
    with pytest.raises(ValueError, match=f"{message} must be a whole number"):
        Observer(Scenario.load("open"), 1, **options)


def test_bounds_are_those_of_the_page():
    observer = Observer(Scenario.load("open"), 1)
    assert observer.high[observer.blocks["target"]].max() == FAR
    assert observer.low[observer.blocks["robot"]].min() == -FAR
    assert FAST < FAR
