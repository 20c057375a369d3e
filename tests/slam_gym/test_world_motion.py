"""Robot and target against the textbook in NumPy, and their noise against its laws."""

import math

import numpy as np
import pytest

from slam_gym.scenario import Scenario
from slam_gym.world import World

STILL = {
    "robot.speed_std": 0.0, "robot.turn_std": 0.0, "robot.speed_std_per_speed": 0.0, "robot.turn_std_per_turn": 0.0,
    "robot.turn_std_per_speed": 0.0,
}  # fmt: skip


def make(num_lanes=1, seed=0, **overrides):
    world = World(Scenario.load("open", **{"target.kind": "none", **STILL, **overrides}), num_lanes)
    world.reset(seed + np.arange(num_lanes))
    return world


def wrap(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def unicycle(pose, v, w, dt):
    end = pose[2] + w * dt
    return np.array([pose[0] + v * dt * math.cos(end), pose[1] + v * dt * math.sin(end), wrap(end)])


def bicycle(pose, v, steering, dt, wheelbase):
    x, y, heading = pose
    return np.array(
        [
            x + v * dt * math.cos(steering + heading),
            y + v * dt * math.sin(steering + heading),
            wrap(heading + v * dt * math.sin(steering) / wheelbase),
        ]
    )


def test_unicycle_is_eq_16():
    world = make()
    pose = world.pose[0].copy()
    for i in range(200):
        command = np.array([[0.9 * math.cos(i / 20), 1.4 * math.sin(i / 7)]])
        world.step(command)
        v = max(command[0, 0], -0.4)
        pose = unicycle(pose, v, command[0, 1], 0.1)
        np.testing.assert_allclose(world.pose[0], pose, atol=1e-9)
        np.testing.assert_allclose(world.odometry[0], [v, command[0, 1]], atol=1e-15)
    assert world.step_count[0] == 200


def test_commands_are_limited():
    world = make()
    world.step(np.array([[9.0, -9.0]]))
    np.testing.assert_allclose(world.pose[0], unicycle(np.zeros(3), 1.0, -1.5, 0.1), atol=1e-12)
    world.step(np.array([[-9.0, 9.0]]))
    np.testing.assert_allclose(world.odometry[0], [-0.4, 1.5])


def test_bicycle_is_eq_15_and_its_wheels_turn_no_faster_than_they_can():
    rate, limit = math.radians(20), math.radians(30)
    world = make(**{
        "robot.kind": "bicycle", "robot.speed_max": 3.0, "robot.steering_max": limit, "robot.steering_rate": rate,
        "dt": 0.025,
    })  # fmt: skip
    pose, steering = world.pose[0].copy(), 0.0
    for i in range(400):
        wanted = 1.0 if i < 200 else -0.2
        world.step(np.array([[3.0, wanted]]))
        steering += np.clip(np.clip(wanted, -limit, limit) - steering, -rate * 0.025, rate * 0.025)
        pose = bicycle(pose, 3.0, steering, 0.025, 4.0)
        np.testing.assert_allclose(world.pose[0], pose, atol=1e-9)
        assert world.odometry[0, 1] == pytest.approx(steering)
    assert steering == pytest.approx(-0.2)


def test_commands_act_after_their_delay_and_are_reported_at_once():
    world = make(**{"robot.command_delay": 0.3})
    commands = [0.2, 0.4, 0.6, 0.8, 1.0, 0.1, 0.3]
    moved = []
    for v in commands:
        before = world.pose[0, 0]
        world.step(np.array([[v, 0.0]]))
        assert world.odometry[0, 0] == v
        moved.append((world.pose[0, 0] - before) / 0.1)
    np.testing.assert_allclose(moved, [0, 0, 0, *commands[:-3]], atol=1e-12)


def test_delay_starts_anew_with_the_episode():
    world = make(**{"robot.command_delay": 0.3})
    for _ in range(5):
        world.step(np.array([[1.0, 0.0]]))
    world.reset([0])
    world.step(np.array([[0.5, 0.0]]))
    assert (world.pose[0] == world.start_pose[0]).all()


def test_true_rate_is_scale_times_reported_plus_bias():
    numbers = {"robot.speed_scale": 0.9, "robot.turn_scale": 0.8, "robot.turn_bias": -0.05}
    on_motion = make(**numbers)
    on_motion.step(np.array([[0.5, 0.4]]))
    np.testing.assert_allclose(on_motion.odometry[0], [0.5, 0.4])
    np.testing.assert_allclose(on_motion.pose[0], unicycle(np.zeros(3), 0.45, 0.27, 0.1), atol=1e-12)
    still = make(**numbers)
    still.step(np.zeros((1, 2)))
    assert (still.pose == 0.0).all()  # the bias acts while the robot is commanded to move
    on_odometry = make(**numbers, **{"robot.noise_on": "odometry"})
    on_odometry.step(np.array([[0.5, 0.4]]))
    np.testing.assert_allclose(on_odometry.pose[0], unicycle(np.zeros(3), 0.5, 0.4, 0.1), atol=1e-12)
    reported = on_odometry.odometry[0]
    np.testing.assert_allclose([0.9 * reported[0], 0.8 * reported[1] - 0.05], [0.5, 0.4])


@pytest.mark.parametrize(("law", "scale"), [("step", 1.0), ("root-second", 1.0 / math.sqrt(0.1))])
@pytest.mark.parametrize("on", ["motion", "odometry"])
def test_noise_has_its_law(law, scale, on):
    L = 4000
    world = make(L, **{
        "robot.speed_std": 0.05, "robot.speed_std_per_speed": 0.1, "robot.turn_std": 0.02,
        "robot.turn_std_per_turn": 0.2, "robot.turn_std_per_speed": 0.3, "robot.noise_law": law, "robot.noise_on": on,
    })  # fmt: skip
    world.step(np.tile([0.5, -0.8], (L, 1)))
    x, y, heading = world.pose.T  # at the end of the step, from the origin
    speed, turn = (x * np.cos(heading) + y * np.sin(heading)) / 0.1, heading / 0.1
    if on == "odometry":
        np.testing.assert_allclose([speed.std(), turn.std()], 0.0, atol=1e-9)
        speed, turn = world.odometry.T
    sd_v, sd_w = scale * (0.05 + 0.1 * 0.5), scale * (0.02 + 0.2 * 0.8 + 0.3 * 0.5)
    for values, mean, sd in ((speed, 0.5, sd_v), (turn, -0.8, sd_w)):
        assert values.mean() == pytest.approx(mean, abs=4 * sd / math.sqrt(L))
        assert values.std() == pytest.approx(sd, rel=4 / math.sqrt(2 * L))
    assert abs(np.corrcoef(speed, turn)[0, 1]) < 4 / math.sqrt(L)


def test_noise_is_fresh_at_each_step():
    world = make(**{"robot.turn_std": 0.1})
    turns = []
    for _ in range(2000):
        before = world.pose[0, 2]
        world.step(np.zeros((1, 2)))
        turns.append(wrap(world.pose[0, 2] - before) / 0.1)
    turns = np.array(turns)
    assert turns.std() == pytest.approx(0.1, rel=0.07)
    assert abs(np.corrcoef(turns[1:], turns[:-1])[0, 1]) < 0.09


def test_start_is_off_by_its_deviation_and_the_filter_is_told():
    L = 4000
    world = make(L, **{"robot.start_x": 1.0, "robot.start_position_std": 0.2, "robot.start_heading_std": 0.1})
    assert (world.start_pose == [1.0, 0.0, 0.0]).all()
    np.testing.assert_allclose((world.pose - world.start_pose).std(axis=0), [0.2, 0.2, 0.1], rtol=0.05)
    np.testing.assert_allclose(world.start_cov[0], np.diag([0.04, 0.04, 0.01]))


def test_start_exactly_one_sigma_off():
    world = make(**{
        "robot.start_position_std": 0.3, "robot.start_heading_std": 0.05, "robot.start_noise": "one-sigma",
    })  # fmt: skip
    sigma = np.array([0.3 * math.cos(0.05), 0.3 * math.sin(0.05), 0.05])  # Eq. (38), Tian et al. 2010
    np.testing.assert_allclose(world.pose[0] - world.start_pose[0], sigma, atol=1e-12)
    np.testing.assert_allclose(world.start_cov[0], np.outer(sigma, sigma), atol=1e-12)


def test_robot_leaves_the_arena_unless_it_is_held():
    free, held = make(), make(**{"arena.holds_robot": True})
    for _ in range(150):
        free.step(np.array([[1.0, 0.0]]))
        held.step(np.array([[1.0, 0.0]]))
    assert free.pose[0, 0] == pytest.approx(15.0)
    assert held.pose[0, 0] == 10.0


@pytest.mark.parametrize("collision", ["none", "count", "block"])
def test_collisions(tmp_path, collision):
    (tmp_path / "map.csv").write_text("x_m,y_m\n2,0\n8,0\n")
    world = make(**{
        "landmarks.layout": "file", "landmarks.file": str(tmp_path / "map.csv"), "landmarks.radius": 0.5,
        "landmarks.collision": collision, "robot.radius": 0.2, "robot.start_x": 0.03,
    })  # fmt: skip
    inside = 0
    for _ in range(100):
        world.step(np.array([[1.0, 0.0]]))
        inside += int(abs(world.pose[0, 0] - 2.0) < 0.7 - 1e-9)
        touches = np.abs(world.pose[0, 0] - np.array([2.0, 8.0])).min() < 0.7 - 1e-9
        if collision != "block":
            assert world.in_collision[0] == (touches and collision == "count")
    assert world.collisions[0] == {"none": 0, "count": 2, "block": 1}[collision]
    assert (inside > 0) == (collision != "block")


# --- the target


def follow(steps, num_lanes=1, seed=0, command=(0.0, 0.0), **overrides):
    """The target's states [steps + 1, L, 4] and headings [steps + 1, L]."""
    world = World(Scenario.load("open", **{**STILL, **overrides}), num_lanes)
    world.reset(seed + np.arange(num_lanes))
    states, headings = [world.target.copy()], [world.target_heading.copy()]
    for _ in range(steps):
        world.step(np.tile(command, (num_lanes, 1)))
        states.append(world.target.copy())
        headings.append(world.target_heading.copy())
    return np.array(states), np.array(headings), world


TWIST = {"target.kind": "twist", "target.speed": 1.5, "target.turn_rate": 0.7, "arena.walls": False}


def test_a_twist_without_noise_is_a_circle():
    states, headings, _ = follow(50, **TWIST)
    pose = np.array([*states[0, 0, :2], headings[0, 0]])
    for state, heading in zip(states[1:, 0], headings[1:, 0], strict=True):
        pose = unicycle(pose, 1.5, 0.7, 0.1)
        np.testing.assert_allclose([*state[:2], heading], pose, atol=1e-9)
        np.testing.assert_allclose(state[2:], 1.5 * np.array([math.cos(pose[2]), math.sin(pose[2])]), atol=1e-9)


def test_a_twists_noise_is_of_each_steps_rates():
    states, headings, _ = follow(1, 4000, **TWIST, **{"target.turn_std": 0.6, "target.speed_std": 0.8})
    turn = wrap(headings[1] - headings[0]) / 0.1
    way = (states[1, :, :2] - states[0, :, :2]) / 0.1
    speed = way[:, 0] * np.cos(headings[1]) + way[:, 1] * np.sin(headings[1])
    for values, mean, sd in ((turn, 0.7, 0.6), (speed, 1.5, 0.8)):
        assert values.mean() == pytest.approx(mean, abs=4 * sd / math.sqrt(4000))
        assert values.std() == pytest.approx(sd, rel=0.05)


def test_constant_velocity_changes_by_white_acceleration():
    overrides = {"target.kind": "constant-velocity", "target.acceleration_density": 0.4, "arena.walls": False}
    states, headings, _ = follow(40, 2000, **overrides)
    np.testing.assert_allclose(states[1:, :, :2], states[:-1, :, :2] + 0.1 * states[:-1, :, 2:], atol=1e-12)
    change = states[-1, :, 2:] - states[0, :, 2:]
    assert change.std() == pytest.approx(0.4 * math.sqrt(4.0), rel=0.05)
    np.testing.assert_allclose(headings[-1], np.arctan2(states[-1, :, 3], states[-1, :, 2]), atol=1e-12)


@pytest.mark.parametrize("radius", [0.0, 1.2], ids=["open", "pillars that reach into the walls"])
@pytest.mark.parametrize("kind", ["constant-velocity", "twist", "waypoints", "evasive"])
def test_walls_hold_the_target(kind, radius):
    overrides = {"target.kind": kind, "target.speed": 2.0, "target.turn_rate": 0.05, "landmarks.radius": radius}
    states, _, _ = follow(300, 30, command=(1.0, 0.2), **overrides)
    assert (np.abs(states[..., :2]) <= 10.0).all()
    assert np.abs(states[-1, :, :2] - states[150, :, :2]).max() > 1.0


def test_a_dead_end_is_left_again():
    """However rarely waypoints change: none that lies behind it is waited for."""
    overrides = {"target.speed": 1.0, "target.waypoint_rate": 0.0, "landmarks.radius": 1.2, "landmarks.count": 30}
    states, _, _ = follow(1500, 30, **overrides)
    where = states[..., :2]
    assert (np.abs(where) <= 10.0).all()
    for start in range(0, 1500, 300):  # in each half minute everybody gets somewhere
        assert np.ptp(where[start : start + 300], axis=0).max(axis=-1).min() > 1.0


def test_a_target_that_begins_in_a_pillar_at_a_wall_walks_out():
    placed = {"target.placed": "fixed", "target.start_x": 9.8, "target.start_y": 0.0, "target.speed": 1.0}
    states, _, world = follow(200, 40, **placed, **{"landmarks.radius": 1.2, "landmarks.count": 30})
    inside = np.linalg.norm(states[:, :, None, :2] - world.landmarks[None], axis=-1).min(axis=-1) < 1.2 - 1e-6
    assert inside[0].any()
    assert not inside[-1].any()


def test_waypoints_change_at_their_rate():
    states, headings, _ = follow(400, 100, **{"target.speed": 0.5, "target.waypoint_rate": 0.3, "target.turn_max": 9.0})
    speed = np.hypot(states[1:, :, 2], states[1:, :, 3])
    np.testing.assert_allclose(speed, 0.5, atol=1e-9)
    turns = np.abs(wrap(np.diff(headings, axis=0))) > 0.02  # steering at once, it turns where the waypoint changes
    bursts = turns[1:] & ~turns[:-1]
    assert bursts.sum() / (100 * 40.0) == pytest.approx(0.3, rel=0.2)


def test_waypoints_turn_no_faster_than_allowed():
    _, headings, _ = follow(300, 20, **{"target.turn_max": 0.6, "arena.walls": False})
    assert np.abs(wrap(np.diff(headings, axis=0))).max() <= 0.06 + 1e-9


def test_the_evasive_flees_a_robot_that_comes_near():
    near = {
        "target.kind": "evasive", "target.speed": 1.0, "target.turn_max": 40.0, "target.placed": "fixed",
        "target.start_x": 2.0, "target.start_y": 0.0, "arena.walls": False, "target.flee_distance": 5.0,
    }  # fmt: skip
    states, _, _ = follow(25, 20, **near)
    distance = np.linalg.norm(states[..., :2], axis=-1)
    np.testing.assert_allclose(np.diff(distance, axis=0), 0.1, atol=1e-6)  # straight away from the robot
    unmoved, _, _ = follow(25, 20, **{**near, "target.flee_distance": 0.0})
    assert np.diff(np.linalg.norm(unmoved[..., :2], axis=-1), axis=0).min() < 0.0


def test_a_chased_target_does_not_stay_in_the_wall():
    states, _, world = follow(400, 20, command=(1.0, 0.0), **{"target.kind": "evasive", "target.speed": 1.2})
    assert np.hypot(states[-100:, :, 2], states[-100:, :, 3]).mean() > 0.8
    assert world.has_target


def test_the_target_goes_around_pillars():
    overrides = {"landmarks.radius": 0.8, "target.speed": 1.0}
    states, _, world = follow(300, 20, **overrides)
    gap = np.linalg.norm(states[:, :, None, :2] - world.landmarks[None], axis=-1) - world.landmark_radius
    assert gap.min() > -1e-6
    assert (np.hypot(states[..., 2], states[..., 3]).mean(axis=0) > 0.7).all()


def test_a_recorded_path_is_followed(tmp_path):
    (tmp_path / "path.csv").write_text("time_s,x_m,y_m\n10.0,0,0\n10.25,1,0\n11.0,1,3\n11.5,1,3\n")
    path = {"target.kind": "recorded", "target.file": str(tmp_path / "path.csv")}
    states, headings, _ = follow(30, **path)
    times = 10.0 + 0.1 * np.arange(31)
    np.testing.assert_allclose(states[:, 0, 0], np.interp(times, [10, 10.25, 11, 11.5], [0, 1, 1, 1]), atol=1e-9)
    np.testing.assert_allclose(states[:, 0, 1], np.interp(times, [10, 10.25, 11, 11.5], [0, 0, 3, 3]), atol=1e-9)
    np.testing.assert_allclose(states[1, 0, 2:], [4.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(states[6, 0, 2:], [0.0, 4.0], atol=1e-9)
    np.testing.assert_allclose(states[-1, 0, 2:], 0.0)
    assert headings[0, 0] == 0.0
    assert headings[-1, 0] == pytest.approx(math.pi / 2)


def test_a_recorded_path_runs_forward(tmp_path):
    (tmp_path / "path.csv").write_text("time_s,x_m,y_m\n1,0,0\n0,1,0\n")
    with pytest.raises(ValueError, match="time_s must increase from row to row"):
        World(Scenario.load("open", **{"target.kind": "recorded", "target.file": str(tmp_path / "path.csv")}))


def test_the_target_starts_where_it_should():
    for placed, near, far in (("in-view", 2.0, 4.5), ("out-of-view", 5.0, 9.0), ("anywhere", 1.0, 8.0)):
        bearing = [-0.7, 0.7] if placed == "in-view" else [-math.pi, math.pi]
        wish = {
            "target.placed": placed,
            "target.start_distance": [near, far],
            "target.start_bearing": bearing,
        }
        world = World(Scenario.load("default", **wish), 300)
        world.reset(np.arange(300))
        offset = world.target[:, :2] - world.pose[:, :2]
        distance = np.hypot(*offset.T)
        assert ((distance >= near - 1e-9) & (distance <= far + 1e-9)).all()
        if placed == "in-view":
            assert world.target_visible.all()
            assert (np.abs(np.arctan2(offset[:, 1], offset[:, 0])) <= 0.7 + 1e-9).all()
        if placed == "out-of-view":
            assert not world.target_visible.any()
        assert (np.abs(world.target[:, :2]) <= 10.0).all()
