"""The sensor: who is seen, against brute force; what is reported, against its laws."""

import math

import numpy as np
import pytest

from estimators import TARGET, UNKNOWN
from slam_gym.scenario import Scenario
from slam_gym.world import World
from slam_gym.world_sensor import FALSE_ALARM


def wrap(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


def hides(eye, point, centre, radius):
    """Whether a disc meets the segment: the nearest of many points on it lies within the radius."""
    share = np.linspace(0.0, 1.0, 4001)[:, None]
    along = eye + share * (point - eye)
    return np.linalg.norm(along - centre, axis=1).min() < radius


def margin(eye, point, centre, radius):
    """How far the disc's rim is from the segment's decision, to leave out the undecidable."""
    share = np.linspace(0.0, 1.0, 4001)[:, None]
    return abs(np.linalg.norm(eye + share * (point - eye) - centre, axis=1).min() - radius)


def run(steps, num_lanes=1, base="open", lanes=None, command=(0.3, 0.2), **overrides):
    """A world after a number of steps."""
    world = World(Scenario.load(base, **overrides), num_lanes)
    world.reset(np.arange(num_lanes))
    for _ in range(steps):
        world.step(np.tile(command, (num_lanes, 1)), lanes)
    return world


def errors(world):
    """Range error / deviation and bearing error / deviation of every return with a source, over all lanes."""
    found = []
    for lane in range(world.num_lanes):
        for i in range(world.scan.count[lane]):
            source = world.origin[lane, i]
            if source != FALSE_ALARM:
                point = world.target[lane, :2] if source == TARGET else world.landmarks[lane, source]
                dx, dy = point - world.pose[lane, :2]
                r = math.hypot(dx, dy)
                sensor = world.scenario.sensor
                b = sensor.range_std_per_range * r
                std = math.hypot(sensor.range_std, b) if sensor.range_law == "quadrature" else sensor.range_std + b
                bearing = world.scan.bearings[lane, i] - math.atan2(dy, dx) + world.pose[lane, 2]
                found.append([(world.scan.ranges[lane, i] - r) / std, wrap(bearing) / sensor.bearing_std])
    return np.array(found)


@pytest.mark.parametrize("opaque", [True, False])
@pytest.mark.parametrize("view", [120.0, 300.0, 360.0])
def test_who_is_seen(opaque, view):
    world = run(7, 60, "default", **{
        "sensor.detection_probability": 1.0, "landmarks.opaque": opaque, "landmarks.count": [0, 20],
        "sensor.min_range": 1.0, "sensor.field_of_view": math.radians(view), "landmarks.radius": 0.6,
    })  # fmt: skip
    decided = seen_in_all = 0
    for lane in range(60):
        eye, heading = world.pose[lane, :2], world.pose[lane, 2]
        pillars, n = world.landmarks[lane], world.landmark_count[lane]
        seen = set(world.origin[lane, : world.scan.count[lane]].tolist())
        seen_in_all += len(seen)
        for source in [*range(n), TARGET]:
            point = world.target[lane, :2] if source == TARGET else pillars[source]
            distance = np.linalg.norm(point - eye)
            bearing = wrap(math.atan2(*(point - eye)[::-1]) - heading)
            expected = 1.0 <= distance <= 6.0 and abs(bearing) <= math.radians(view) / 2
            close = min(abs(distance - 1.0), abs(distance - 6.0), abs(abs(bearing) - math.radians(view) / 2) or 1)
            others = [j for j in range(n) if j != source]
            # A robot that stands in a pillar sees out of it: only what lies ahead hides.
            ahead = [j for j in others if (pillars[j] - eye) @ (point - eye) > 0.0]
            if opaque:
                expected &= not any(hides(eye, point, pillars[j], 0.6) for j in ahead)
                close = min([close, *(margin(eye, point, pillars[j], 0.6) for j in ahead)])
            if close > 2e-3:
                decided += 1
                assert (source in seen) == expected, (lane, source)
        assert world.target_visible[lane] == world.target_detected[lane] == (TARGET in seen)
    assert decided > 500
    assert seen_in_all > 60


def test_all_round_means_all_round():
    world = run(1, 200, command=(0.0, 0.0), **{"sensor.max_range": 40.0, "robot.turn_std": 0.0})
    assert (world.scan.count == 21).all()


@pytest.mark.parametrize(("law", "share"), [("sum", 0.02), ("quadrature", 0.05), ("sum", 0.0)])
def test_noise_has_its_law(law, share):
    found = errors(run(1, 1500, **{
        "sensor.range_std": 0.1, "sensor.range_std_per_range": share, "sensor.range_law": law,
        "sensor.bearing_std": 0.05,
    }))  # fmt: skip
    n = len(found)
    assert n > 8000
    for values in found.T:
        assert values.mean() == pytest.approx(0.0, abs=4 / math.sqrt(n))
        assert values.std() == pytest.approx(1.0, rel=4 / math.sqrt(2 * n))
        assert np.mean(np.abs(values) > 1.96) == pytest.approx(0.05, abs=0.01)
    assert abs(np.corrcoef(found.T)[0, 1]) < 4 / math.sqrt(n)


def series(steps, num_lanes, **overrides):
    """Standardised errors [steps, L, N + 1, 2] of all sources, always seen, of a robot at rest."""
    overrides |= {"sensor.max_range": 60.0, "landmarks.count": 5}
    world = World(Scenario.load("open", **overrides), num_lanes)
    world.reset(np.arange(num_lanes))
    found = []
    for _ in range(steps):
        world.step(np.zeros((num_lanes, 2)))
        if world.due[0]:
            found.append(errors(world).reshape(num_lanes, 6, 2))
    return np.array(found)


@pytest.mark.parametrize("period", [1, 4])
def test_errors_forget_with_their_time_constant(period):
    e = series(160, 60, **{"sensor.error_time_constant": 2.0, "sensor_period": period})
    np.testing.assert_allclose(e.std(axis=(0, 1, 2)), 1.0, rtol=0.1)
    np.testing.assert_allclose(e[0].std(axis=(0, 1)), 1.0, rtol=0.2)  # from the first sweep on
    for seconds in (0.8, 2.0):
        lag = round(seconds / (0.1 * period))
        assert np.mean(e[lag:] * e[:-lag]) == pytest.approx(math.exp(-seconds / 2.0), abs=0.06)
    assert np.mean(e[:, :, 0] * e[:, :, 1]) == pytest.approx(0.0, abs=0.1)  # each source has its own
    assert np.mean(e[:, :, :, 0] * e[:, :, :, 1]) == pytest.approx(0.0, abs=0.1)


def test_white_errors_forget_at_once():
    e = series(100, 40)
    assert np.mean(e[1:] * e[:-1]) == pytest.approx(0.0, abs=0.02)


def test_sweeps_come_at_their_period():
    world = World(Scenario.load("open", sensor_period=3))
    world.reset([0])
    due = []
    for _ in range(9):
        before = world.scan.ranges.copy()
        world.step(np.zeros((1, 2)))
        due.append(bool(world.due[0]))
        assert due[-1] or (world.scan.ranges == before).all()
    assert due == [False, False, True] * 3


def test_detection_probability():
    certain = run(1, 800)
    world = run(1, 800, **{"sensor.detection_probability": 0.7})
    share = world.scan.count.sum() / certain.scan.count.sum()
    assert share == pytest.approx(0.7, abs=0.03)
    visible = certain.target_visible
    assert (world.target_visible == visible).all()
    assert world.target_detected[visible].mean() == pytest.approx(0.7, abs=0.07)
    kept = {(lane, s) for lane in range(800) for s in world.origin[lane, : world.scan.count[lane]].tolist()}
    assert all((world.target_detected[lane]) == ((lane, TARGET) in kept) for lane in range(800))


def test_a_missed_return_changes_no_other():
    certain, world = run(5, 50), run(5, 50, **{"sensor.detection_probability": 0.6})
    for lane in range(50):
        n, m = certain.scan.count[lane], world.scan.count[lane]
        ranges = dict(zip(certain.origin[lane, :n].tolist(), certain.scan.ranges[lane, :n], strict=True))
        for source, distance in zip(world.origin[lane, :m].tolist(), world.scan.ranges[lane, :m], strict=True):
            assert distance == pytest.approx(ranges[source], abs=1e-12)


def test_time_since_seen():
    world = World(Scenario.load("open", **{"sensor.detection_probability": 0.5}))
    world.reset([3])
    expected = 0.0
    for _ in range(100):
        world.step(np.zeros((1, 2)))
        expected = 0.0 if world.target_detected[0] else expected + 0.1
        assert world.time_since_seen[0] == pytest.approx(expected)


def test_false_alarms_are_poisson_over_the_area_swept():
    rate = 2.5
    counts, ranges, bearings = [], [], []
    world = World(Scenario.load("open", **{
        "sensor.clutter_rate": rate, "sensor.min_range": 1.0, "sensor.field_of_view": 2.0, "landmarks.count": 3,
    }), 200)  # fmt: skip
    world.reset(np.arange(200))
    for _ in range(20):
        world.step(np.zeros((200, 2)))
        for lane in range(200):
            n = world.scan.count[lane]
            false = world.origin[lane, :n] == FALSE_ALARM
            counts.append(false.sum())
            ranges.extend(world.scan.ranges[lane, :n][false])
            bearings.extend(world.scan.bearings[lane, :n][false])
    assert np.mean(counts) == pytest.approx(rate, abs=4 * math.sqrt(rate / 4000))
    assert np.var(counts) == pytest.approx(rate, rel=0.12)
    assert (world.overflow == 0).all()
    assert min(ranges) >= 1.0 and max(ranges) <= 7.0
    area = (np.array(ranges) ** 2 - 1.0) / 48.0  # uniform over the area: uniform in r^2
    assert np.mean(area) == pytest.approx(0.5, abs=0.015)
    assert np.var(area) == pytest.approx(1 / 12, rel=0.05)
    assert np.abs(bearings).max() <= 1.0
    assert np.var(bearings) == pytest.approx(1 / 3, rel=0.05)


def test_labels():
    world = run(3, 20)
    for lane in range(20):
        n = world.scan.count[lane]
        assert (world.scan.labels[lane, :n] == world.origin[lane, :n]).all()
        assert len(set(world.origin[lane, :n].tolist())) == n
    assert world.scan.complete.all()


def test_unlabelled_landmarks_and_a_target_that_is_told_from_them():
    world = run(3, 20, **{"landmarks.labelled": False})
    for lane in range(20):
        n = world.scan.count[lane]
        expected = np.where(world.origin[lane, :n] == TARGET, TARGET, UNKNOWN)
        assert (world.scan.labels[lane, :n] == expected).all()


def test_mislabelled_returns_carry_another_landmarks_id():
    world = run(1, 1000, **{"sensor.mislabel_probability": 0.2})
    wrong = total = 0
    used = set()
    for lane in range(1000):
        for label, source in zip(
            world.scan.labels[lane, : world.scan.count[lane]].tolist(),
            world.origin[lane, : world.scan.count[lane]].tolist(),
            strict=True,
        ):
            if source == TARGET:
                assert label == TARGET
            else:
                total += 1
                wrong += label != source
                used.add(label)
                assert 0 <= label < 20
    assert wrong / total == pytest.approx(0.2, abs=0.02)
    assert used == set(range(20))


def test_ranges_stay_positive():
    world = run(1, 300, **{"sensor.range_std": 5.0, "landmarks.layout": "ring", "landmarks.ring_radius": 0.5})
    for lane in range(300):
        assert (world.scan.ranges[lane, : world.scan.count[lane]] > 0.0).all()
