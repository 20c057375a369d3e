"""Lanes, threads, seeds, episodes and state: the same world however it is run."""

import pickle

import numpy as np
import pytest

from slam_gym.scenario import Scenario
from slam_gym.world import World

BUSY = {  # everything random at once
    "sensor.clutter_rate": 1.0, "sensor.mislabel_probability": 0.05, "sensor.error_time_constant": 1.0,
    "robot.command_delay": 0.2, "robot.start_position_std": 0.1, "landmarks.layout": "clustered",
    "sensor.max_range": [5.0, 7.0], "robot.speed_std": [0.02, 0.05], "sensor_period": 2,
}  # fmt: skip
STATE = (
    "pose", "start_pose", "start_cov", "target", "target_heading", "odometry", "landmarks", "landmark_radius",
    "landmark_count", "time_since_seen", "target_visible", "target_detected", "due", "collisions", "in_collision",
    "step_count",
)  # fmt: skip


def command(lane_seed, step):
    return [0.9 * np.cos(0.1 * step + lane_seed), 1.4 * np.sin(0.07 * step + 2.0 * lane_seed)]


def observe(world, lane):
    """Everything that one lane shows, as bytes."""
    n = world.scan.count[lane]
    seen = [
        world.scan.ranges[lane, :n],
        world.scan.bearings[lane, :n],
        world.scan.labels[lane, :n],
        world.origin[lane, :n],
    ]
    return b"".join(np.ascontiguousarray(a).tobytes() for a in [*(getattr(world, name)[lane] for name in STATE), *seen])


def play(world, seeds, steps=25):
    """What the lanes show, step by step."""
    shown = [[observe(world, lane) for lane in range(world.num_lanes)]]
    for step in range(steps):
        world.step(np.array([command(seed, step) for seed in seeds]))
        shown.append([observe(world, lane) for lane in range(world.num_lanes)])
    return shown


@pytest.fixture(scope="module")
def busy():
    return Scenario.load("evasive", **BUSY)


@pytest.fixture(scope="module")
def singles(busy):
    """What single worlds with the seeds 0, 1, ... show: [seed][step]."""
    found = []
    for seed in range(64):
        world = World(busy)
        world.reset([seed])
        found.append([step[0] for step in play(world, [seed])])
    return found


@pytest.mark.parametrize(("num_lanes", "threads"), [(1, 1), (1, 2), (7, 1), (7, 2), (64, 1), (64, 2), (64, 5)])
def test_lanes_are_single_worlds_bit_for_bit(busy, singles, num_lanes, threads):
    world = World(busy, num_lanes, threads)
    world.reset(np.arange(num_lanes))
    shown = play(world, range(num_lanes))
    for lane in range(num_lanes):
        assert [step[lane] for step in shown] == singles[lane]


@pytest.mark.parametrize(
    ("lanes", "threads"), [(np.array([0, 2]), 2), (np.arange(3)[::2], 1), (np.array([0, 2], dtype=np.int32), 1)]
)
def test_some_lanes_step_while_others_rest(busy, singles, lanes, threads):
    world = World(busy, 3, threads)
    world.reset([5, 6, 7])
    resting = observe(world, 1)
    for step in range(25):
        world.step(np.array([command(seed, step) for seed in (5, 6, 7)]), lanes)
        assert observe(world, 0) == singles[5][step + 1]
        assert observe(world, 2) == singles[7][step + 1]
    assert observe(world, 1) == resting


def test_one_lane_starts_again_while_others_go_on(busy, singles):
    world = World(busy, 2)
    world.reset([1, 2])
    for step in range(10):
        world.step(np.array([command(1, step), command(2, step)]))
    world.reset([4], np.array([1]))
    for step in range(10, 20):
        world.step(np.array([command(1, step), command(4, step - 10)]))
        assert observe(world, 0) == singles[1][step + 1]
        assert observe(world, 1) == singles[4][step - 9]


def test_the_same_draws_whatever_is_commanded():
    everywhere = {"sensor.max_range": 90.0, "sensor.field_of_view": 2.0 * np.pi, "landmarks.opaque": False}
    white = {"robot.turn_std": 0.05, "robot.turn_std_per_turn": 0.0, "robot.turn_std_per_speed": 0.0}
    scenario = Scenario.load("default", **everywhere, **white)
    still, moving = World(scenario), World(scenario)
    for world in (still, moving):
        world.reset([11])
    for _ in range(50):
        before = still.pose[0, 2], moving.pose[0, 2]
        still.step(np.zeros((1, 2)))
        moving.step(np.array([[0.7, 0.8]]))
        np.testing.assert_array_equal(still.target, moving.target)  # it does not react to the robot
        np.testing.assert_array_equal(still.landmarks, moving.landmarks)
        turns = [
            (w.pose[0, 2] - b + np.pi) % (2.0 * np.pi) - np.pi for w, b in zip((still, moving), before, strict=True)
        ]
        assert turns[1] - 0.08 == pytest.approx(turns[0], abs=1e-12)
        n = still.scan.count[0]
        assert n == moving.scan.count[0]
        np.testing.assert_array_equal(still.origin[0, :n], moving.origin[0, :n])  # the same are missed
        noise, row = [], np.maximum(still.origin[0, :n], -1)  # the target's is the last
        for world in (still, moving):
            points = np.concatenate([world.landmarks[0], world.target[:1, :2]])[row]
            distance = np.linalg.norm(points - world.pose[0, :2], axis=1)
            noise.append((world.scan.ranges[0, :n] - distance) / (0.05 + 0.02 * distance))
        np.testing.assert_allclose(noise[0], noise[1], atol=1e-9)


def test_neighbouring_seeds_and_episodes_share_nothing():
    world = World(Scenario.load("open"), 50)
    world.reset(np.arange(50))
    first = world.landmarks[:, :, 0].copy()
    world.next_episode()
    second = world.landmarks[:, :, 0].copy()
    assert abs(np.corrcoef(first[:-1].ravel(), first[1:].ravel())[0, 1]) < 0.13
    assert abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) < 0.13
    assert len(np.unique(first)) == first.size
    world.reset(np.arange(50))
    np.testing.assert_array_equal(world.landmarks[:, :, 0], first)


def test_layouts():
    def placed(**overrides):
        world = World(Scenario.load("open", **overrides), 200)
        world.reset(np.arange(200))
        return world.landmarks[:, : world.landmark_count[0]]

    uniform = placed(**{"landmarks.margin": 1.0, "landmarks.center_x": 5.0, "landmarks.clearance": 0.0})
    assert np.abs(uniform - [5.0, 0.0]).max() <= 9.0
    np.testing.assert_allclose(uniform.std(axis=(0, 1)), 18 / np.sqrt(12), rtol=0.05)
    clear = placed(**{"landmarks.clearance": 3.0})
    assert np.hypot(*np.moveaxis(clear, -1, 0)).min() >= 3.0
    ring = np.hypot(*np.moveaxis(placed(**{
        "landmarks.layout": "ring", "landmarks.ring_radius": 6.0, "landmarks.ring_width": 2.0,
        "landmarks.ring_gap": 1.0,
    }), -1, 0))  # fmt: skip
    assert ((np.abs(ring - 6.0) >= 1.0 - 1e-9) & (np.abs(ring - 6.0) <= 2.0 + 1e-9)).all()
    grid = placed(**{"landmarks.layout": "grid", "landmarks.count": 9})
    axis = np.array([-20 / 3, 0.0, 20 / 3])
    np.testing.assert_allclose(
        np.sort(grid[0], axis=0), np.sort(np.array([[x, y] for x in axis for y in axis]), axis=0), atol=1e-9
    )
    assert (grid == grid[0]).all()
    clustered = placed(**{"landmarks.layout": "clustered", "landmarks.clusters": 2, "landmarks.cluster_std": 0.1})
    nearest = [np.sort(np.linalg.norm(points[:, None] - points[None], axis=-1), axis=1)[:, 1] for points in clustered]
    assert np.median(nearest) < 0.15
    pillars = World(Scenario.load("default", **{"landmarks.gap": 0.4}), 50)
    pillars.reset(np.arange(50))
    for lane in range(50):
        points = pillars.landmarks[lane, : pillars.landmark_count[lane]]
        apart = np.linalg.norm(points[:, None] - points[None], axis=-1) + 9.0 * np.eye(len(points))
        assert apart.min() >= 1.4


def test_a_map_from_a_file(tmp_path):
    (tmp_path / "map.csv").write_text("name,x_m,y_m\na,1,2\nb,3,-4\n")
    world = World(Scenario.load("open", **{"landmarks.layout": "file", "landmarks.file": str(tmp_path / "map.csv")}), 2)
    world.reset([0, 1])
    np.testing.assert_array_equal(world.landmarks, [[[1, 2], [3, -4]]] * 2)
    assert (world.landmark_count == 2).all()


def test_ranges_are_drawn_anew_each_episode():
    ranges = {"sensor.max_range": [4.0, 8.0], "landmarks.count": [3, 6], "robot.speed_std": [0.1, 0.3]}
    world = World(Scenario.load("open", **ranges), 2000)
    world.reset(np.arange(2000))
    drawn = world.numbers.copy()
    reach = drawn["sensor_max_range"]
    assert (reach.min() >= 4.0, reach.max() <= 8.0) == (True, True)
    assert reach.mean() == pytest.approx(6.0, abs=0.1)
    assert reach.std() == pytest.approx(4.0 / np.sqrt(12), rel=0.05)
    np.testing.assert_array_equal(np.unique(world.landmark_count), [3, 4, 5, 6])
    np.testing.assert_allclose(np.bincount(world.landmark_count)[3:] / 2000, 0.25, atol=0.05)
    assert abs(np.corrcoef(reach, drawn["robot_speed_std"])[0, 1]) < 0.1
    world.next_episode()
    assert (world.numbers["sensor_max_range"] != reach).all()
    world.reset(np.arange(2000))
    np.testing.assert_array_equal(world.numbers, drawn)


def test_filters_are_told_the_numbers_of_their_episode():
    world = World(Scenario.load("open", **{"sensor.max_range": [4.0, 8.0], "filter.motion": {"speed_std": 0.7}}), 3)
    world.reset([0, 1, 2])
    assert world.models_vary
    for lane in range(3):
        motion, sensor, target = world.lane_models(lane)
        assert sensor.max_range == world.numbers["sensor_max_range"][lane]
        assert motion.speed_std == 0.7
        assert target == world.scenario.models()[2]
    fixed = World(Scenario.load("default"))
    fixed.reset([0])
    assert not fixed.models_vary
    assert fixed.lane_models(0) == fixed.scenario.models()


def test_options_change_one_episode():
    world = World(Scenario.load("open"), 40)
    world.reset(np.arange(40))
    usual = world.target.copy()
    options = {"target.speed": 0.3, "target.start_distance": [5.0, 6.0], "sensor.max_range": 6.5}
    world.reset(np.arange(40), options=options)
    np.testing.assert_allclose(np.hypot(*world.target[:, 2:].T), 0.3)
    distance = np.linalg.norm(world.target[:, :2], axis=1)
    assert ((distance >= 5.0 - 1e-9) & (distance <= 6.0 + 1e-9)).all()
    assert world.lane_models(0)[1].max_range == 6.5
    world.reset(np.arange(40))
    np.testing.assert_array_equal(world.target, usual)
    assert world.lane_models(0)[1].max_range == 7.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"target.sped": 1.0}, r"unknown reset option 'target.sped'\. Did you mean 'target.speed'"),
        ({"target.kind": "none"}, "unknown reset option 'target.kind'"),
        ({"target.speed": -1.0}, r"target.speed must be at least 0; got -1.0"),
        ({"landmarks.count": 50}, r"reset options cannot raise landmarks.count"),
        ({"robot.command_delay": 1.0}, r"reset options cannot raise .*robot.command_delay"),
    ],
)
def test_wrong_options_are_refused_and_change_nothing(options, message):
    world = World(Scenario.load("open"))
    world.reset([0])
    before = pickle.dumps(world.get_state())
    for begin in (lambda: world.reset([1], options=options), lambda: world.next_episode(options=options)):
        with pytest.raises(ValueError, match=message):
            begin()
        assert pickle.dumps(world.get_state()) == before


@pytest.mark.parametrize(("lanes", "threads"), [(0, 1), (1, 0)])
def test_wrong_sizes(lanes, threads):
    with pytest.raises(ValueError, match="num_lanes and threads must be at least 1"):
        World(Scenario.load("open"), lanes, threads)


def test_state_goes_back_and_forth(busy):
    world = World(busy, 3)
    world.reset([0, 1, 2])
    play(world, range(3), 11)
    state = world.get_state()
    pickled = pickle.dumps(world)
    after = play(world, range(3), 15)
    world.set_state(state)
    assert play(world, range(3), 15) == after
    restored = pickle.loads(pickled)
    assert play(restored, range(3), 15) == after
    other = World(busy, 3)
    other.set_state(pickle.loads(pickle.dumps(state)))
    assert play(other, range(3), 15) == after
    with pytest.raises(ValueError, match="this state belongs to a world with other numbers"):
        World(busy, 2).set_state(state)


def test_state_is_a_copy(busy):
    world = World(busy)
    world.reset([0])
    state = world.get_state()
    before = {name: array.copy() for name, array in state.items()}
    play(world, [0], 3)
    assert all((state[name] == before[name]).all() for name in state)


def test_the_target_s_prior():
    known = {"target.known_start": True}
    assert World(Scenario.load("open")).target_start() is None
    assert World(Scenario.load("open", **known, **{"target.kind": "none"})).target_start() is None
    world = World(Scenario.load("open", **known), 3)
    world.reset([0, 1, 2])
    mean, cov = world.target_start(np.array([2, 0]))
    np.testing.assert_array_equal(mean, world.target[[2, 0]])
    assert cov.shape == (2, 4, 4)
    twist = World(Scenario.load("open", **known, **{"target.kind": "twist", "filter.target.kind": "constant-velocity"}))
    twist.reset([0])
    assert twist.target_start()[0].shape == (1, 4)  # in the coordinates of the filter's model


def test_buffers_are_filled_in_place(busy):
    world = World(busy, 2)
    names = [*STATE, "origin"]
    before = {name: getattr(world, name) for name in names} | {"ranges": world.scan.ranges}
    world.reset([0, 1])
    play(world, range(2), 3)
    assert all(getattr(world, name) is before[name] for name in names)
    assert world.scan.ranges is before["ranges"]
    assert all(getattr(world, name).flags.c_contiguous for name in names)
