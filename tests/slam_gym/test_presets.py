import math
from pathlib import Path

import numpy as np
import pytest

from slam_gym import policies
from slam_gym.policies import PolicyContext
from slam_gym.scenario import Scenario, scenario_names
from slam_gym.world import World

DEGREE = math.radians(1.0)
PRESETS = {
    "default", "discovery", "evasive", "evasive-hard", "geng-hu", "geng-l1", "geng-m1", "geng-m2", "mrclam", "open",
    "revisit", "slamto", "tian-dense", "tian-sparse",
}  # fmt: skip
ZONE = {
    "arena.width": 20, "arena.height": 20, "arena.walls": True, "arena.holds_robot": False, "dt": 0.1,
    "max_steps": 400, "sensor_period": 1, "robot.speed_min": -0.4, "robot.speed_max": 1, "robot.turn_max": 1.5,
    "robot.speed_std": 0.02, "robot.turn_std": 0.02, "robot.speed_std_per_speed": 0.1, "robot.turn_std_per_turn": 0.1,
    "robot.turn_std_per_speed": 0.05, "sensor.max_range": 6, "sensor.field_of_view": 120 * DEGREE,
    "sensor.range_std": 0.05, "sensor.range_std_per_range": 0.02, "sensor.bearing_std": 0.03,
    "sensor.detection_probability": 0.95, "landmarks.radius": 0.5, "landmarks.opaque": True,
    "landmarks.count": (15, 20), "target.waypoint_rate": 0.4, "target.start_distance": (2, 4.5),
    "target.start_bearing": (-40 * DEGREE, 40 * DEGREE), "target.placed": "in-view", "filter.noise_inflation": 1,
}  # fmt: skip
TIAN = {
    "robot.kind": "bicycle", "robot.speed_max": 3, "robot.wheelbase": 4, "robot.steering_max": 30 * DEGREE,
    "robot.steering_rate": 20 * DEGREE, "robot.noise_on": "odometry", "robot.speed_std": 0.3,
    "robot.turn_std": 3 * DEGREE, "robot.noise_law": "step", "dt": 0.025, "sensor_period": 8, "sensor.max_range": 30,
    "sensor.field_of_view": math.pi, "sensor.range_std": 0.1, "sensor.bearing_std": DEGREE, "target.kind": "none",
    "robot.start_position_std": 0, "robot.start_heading_std": 0,
}  # fmt: skip


def geng(turn_rate, steps, wheel, range_std, bearing):
    s = wheel * 0.5
    return {
        "dt": 1, "sensor_period": 1, "max_steps": steps, "burn_in": 10, "target.kind": "none", "landmarks.count": 20,
        "landmarks.layout": "ring", "landmarks.ring_width": 4, "landmarks.ring_radius": 0.5 / turn_rate,
        "robot.speed_std": s / math.sqrt(2), "robot.turn_std": math.sqrt(2) * s / 0.5, "sensor.min_range": 0.5,
        "sensor.max_range": 5, "sensor.field_of_view": 2 * math.pi, "sensor.range_std": range_std,
        "sensor.bearing_std": bearing * DEGREE, "robot.start_position_std": 0, "policy.name": "constant",
        "policy.options": {"speed": 0.5, "turn_rate": turn_rate},
    }  # fmt: skip


NUMBERS = {
    "default": ZONE | {"target.kind": "waypoints", "target.speed": (0.8, 1.1)},
    "discovery": ZONE | {
        "landmarks.count": (10, 20), "target.speed": (0.5, 0.9), "target.waypoint_rate": 0.15,
        "target.placed": "out-of-view", "target.start_distance": (5, 9), "target.start_bearing": (-math.pi, math.pi),
    },
    "revisit": ZONE | {
        "landmarks.count": 5, "target.speed": (0.4, 0.7), "target.waypoint_rate": 0.15,
        "robot.speed_std_per_speed": 0.15, "robot.turn_std_per_turn": 0.15, "robot.turn_std_per_speed": 0.075,
    },
    "evasive": ZONE | {"target.kind": "evasive", "target.speed": (1, 1.3), "target.flee_distance": 5},
    "evasive-hard": ZONE | {
        "target.kind": "evasive", "target.speed": (1, 1.2), "landmarks.radius": 0.8, "sensor.max_range": 5,
        "sensor.detection_probability": 0.9, "robot.turn_max": 1,
    },
    "open": {
        "landmarks.count": 20, "landmarks.radius": 0, "landmarks.opaque": False, "sensor_period": 1,
        "sensor.detection_probability": 1,
    },
    "slamto": {
        "arena.width": 10, "arena.height": 10, "dt": 0.02, "max_steps": 320, "sensor_period": 8,
        "robot.speed_std": 0.4, "robot.turn_std": 0.0872, "robot.speed_max": 4, "robot.turn_max": 2,
        "target.kind": "twist", "target.speed": 3, "target.turn_rate": 1, "target.speed_std": 0.8,
        "target.turn_std": 0.6, "target.known_start": True, "sensor.range_std": 0.1, "sensor.bearing_std": 0.008,
        "sensor.max_range": 7, "sensor.field_of_view": math.pi, "landmarks.count": 20, "landmarks.layout": "uniform",
        "robot.noise_law": "step", "policy.name": "pursuit",
    },
    "tian-sparse": TIAN | {"landmarks.layout": "file", "policy.name": "waypoints"},
    "tian-dense": TIAN | {"landmarks.layout": "uniform", "landmarks.count": 135, "policy.name": "waypoints"},
    "geng-hu": geng(0.075, 660, 0.02, 0.1, 1),
    "geng-l1": geng(0.05, 1000, 0.01, 0.1, 1),
    "geng-m1": geng(0.05, 1000, 0.02, 0.1, 2),
    "geng-m2": geng(0.05, 1000, 0.03, 0.2, 3),
    "mrclam": {
        "sensor.field_of_view": 1.18, "sensor.range_std": 0.02, "sensor.range_std_per_range": 0.043,
        "sensor.range_law": "quadrature", "sensor.bearing_std": 0.014, "sensor.error_time_constant": 6,
        "robot.speed_max": 0.086, "robot.command_delay": 0.2, "robot.speed_scale": 0.935, "robot.turn_scale": 0.948,
        "robot.turn_bias": -0.0023, "robot.noise_law": "root-second", "landmarks.count": 15,
    },
}  # fmt: skip


def value_of(scenario, dotted):
    for name in dotted.split("."):
        scenario = getattr(scenario, name)
    return scenario


def test_they_are_all_there():
    assert set(scenario_names()) == PRESETS
    assert all(Scenario.load(name).name == name and Scenario.load(name).summary for name in PRESETS)


@pytest.mark.parametrize("name", NUMBERS)
def test_numbers(name):
    scenario = Scenario.load(name)
    for dotted, expected in NUMBERS[name].items():
        value = value_of(scenario, dotted)
        if isinstance(expected, (str, bool, dict)):
            assert value == expected, dotted
        else:
            assert value == pytest.approx(expected, rel=1e-4, abs=1e-9), dotted


@pytest.mark.parametrize("name", ["default", "discovery", "revisit", "evasive", "evasive-hard"])
def test_filters_in_the_zones(name):
    target = Scenario.load(name).models()[2]
    assert (target.kind, target.acceleration_density, target.reinitialise_nis) == ("constant-velocity", 0.3, 35.0)


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_each_steps(name):
    world = World(Scenario.load(name), 3)
    world.reset([1, 2, 3])
    command = np.tile([0.3, 0.1], (3, 1))
    returns = 0
    for _ in range(50):
        world.step(command)
        returns += int(world.scan.count[world.due].sum())
        n = world.scan.count.max()
        for array in (world.pose, world.target, world.odometry, world.scan.ranges[:, :n], world.scan.bearings[:, :n]):
            assert np.isfinite(array).all()
    assert returns > 0
    assert (world.step_count == 50).all()
    assert (world.overflow == 0).all()


def test_slamto_starts_four_metres_behind_on_the_circle():
    world = World(Scenario.load("slamto"))
    world.reset([0])
    x, y, heading = world.pose[0]
    assert math.hypot(x, y) == pytest.approx(3.0, abs=1e-4)
    assert np.linalg.norm(world.target[0, :2]) == pytest.approx(3.0)
    behind = math.atan2(world.target[0, 1], world.target[0, 0]) - math.atan2(y, x)
    assert 3.0 * behind == pytest.approx(4.0, abs=1e-4)
    assert heading == pytest.approx(math.atan2(y, x) + math.pi / 2, abs=1e-4)
    assert np.hypot(*world.target[0, 2:]) == pytest.approx(3.0)
    mean, cov = world.target_start()
    np.testing.assert_allclose(mean[0], [3.0, 0.0, math.pi / 2], atol=1e-6)
    assert (cov == 0.0).all() and (world.start_cov == 0.0).all()


def test_open_sees_about_eight_landmarks():
    world = World(Scenario.load("open"), 64)
    world.reset(np.arange(64))
    seen = []
    for step in range(100):
        world.step(np.tile([0.8, 0.5 if step % 40 < 20 else -0.5], (64, 1)))
        seen.append(np.mean(world.scan.count - world.target_detected))
    assert 7.0 < np.mean(seen) < 9.0


def test_mrclam_sweeps():
    scenario = Scenario.load("mrclam")
    assert 1.0 / (scenario.dt * scenario.sensor_period) == pytest.approx(4.2)


def test_geng_circles_within_its_ring():
    world = World(Scenario.load("geng-hu"), 8)
    world.reset(np.arange(8))
    distance = np.linalg.norm(world.landmarks, axis=-1)
    assert (np.abs(distance - 0.5 / 0.075) <= 4.0 + 1e-5).all()
    other = world.landmarks.copy()
    world.next_episode()
    assert not np.array_equal(world.landmarks, other)


def drive_the_loop(scenario, **options):
    context = PolicyContext.from_scenario(scenario)
    policy = policies.make("waypoints", context, 1, **{**scenario.policy.options, **options})
    policy.reset(np.array([0]), np.array([0]))
    world = World(scenario)
    world.reset([0])
    steps = sweeps = 0
    while steps < scenario.max_steps:
        action = policy.act(None, None)
        if policy.finished[0]:
            break
        world.step(context.action_map.to_command(action))
        steps += 1
        sweeps += int(world.due[0])
    return steps, sweeps


def test_the_generated_loop_is_driven_to_its_end():
    scenario = Scenario.load("tian-sparse")
    assert scenario.max_landmarks == 35
    steps, sweeps = drive_the_loop(scenario)
    assert 5000 < steps < scenario.max_steps
    assert sweeps == steps // 8


def test_the_published_loop_takes_8779_steps_and_1097_sweeps():
    web = Path(__file__).resolve().parents[2] / "../shared/data/webmap"
    if not web.is_dir():
        pytest.skip("the published map is not here")
    scenario = Scenario.load("tian-sparse", **{"landmarks.file": str(web / "webmap_landmarks.csv")})
    assert scenario.max_landmarks == 35
    assert drive_the_loop(scenario, file=str(web / "webmap_waypoints.csv")) == (8779, 1097)
