import math

import numpy as np
import pytest

from slam_gym import policies


@pytest.fixture
def pursuit(make_context):
    def build(lanes=1, context=None, **options):
        return policies.make("pursuit", context or make_context(), lanes, **options)

    return build


def standing(x, y):
    return lambda k: ((x, y), (0.0, 0.0))


@pytest.mark.parametrize("target", [(6.0, 0.0), (-5.0, 0.3), (-5.0, -0.3), (0.0, 7.0), (0.4, 0.0)])
def test_reaches_the_stand_off_distance_and_faces_a_standing_target(pursuit, drive, target):
    pose, _ = drive(pursuit(stand_off=1.5), [0.0, 0.0, 0.0], standing(*target), 200)
    rel = np.subtract(target, pose[0, :2])
    assert np.hypot(*rel) == pytest.approx(1.5, abs=0.02)
    bearing = (math.atan2(rel[1], rel[0]) - pose[0, 2] + math.pi) % (2 * math.pi) - math.pi
    assert bearing == pytest.approx(0.0, abs=0.02)


def test_anticipates_a_target_on_a_circle(pursuit, drive, make_context):
    context = make_context(speed=4.0, turn=2.0, step_dt=0.02)

    def circle(k):
        angle = 1.0 * k * 0.02
        return (3 * math.cos(angle), 3 * math.sin(angle)), (-3 * math.sin(angle), 3 * math.cos(angle))

    errors = {}
    for lead in (0.0, 1.0):
        pose, _ = drive(pursuit(context=context, lead=lead), [3.0, -4.0, math.pi / 2], circle, 400)
        errors[lead] = abs(np.hypot(*(np.array(circle(400)[0]) - pose[0, :2])) - 1.5)
    assert errors[1.0] < 0.1 < errors[0.0]


@pytest.mark.parametrize(("heading", "target", "sign"), [
    (0.0, (2.0, 1.0), 1), (0.0, (2.0, -1.0), -1), (3.1, (-2.0, -0.5), 1), (-3.1, (-2.0, 0.5), -1),
    (0.0, (-3.0, 0.1), 1),
])  # fmt: skip
def test_turns_the_short_way(pursuit, make_belief, heading, target, sign):
    policy = pursuit()
    policy.reset(np.arange(1), np.arange(1))
    policy.act(None, make_belief([0.0, 0.0, heading], target))
    assert np.sign(policy.command[0, 1]) == sign


def test_does_not_drive_away_from_a_target_behind(pursuit, make_belief):
    policy = pursuit()
    policy.reset(np.arange(1), np.arange(1))
    policy.act(None, make_belief([0.0, 0.0, 0.0], (-4.0, 0.5)))
    assert policy.command[0, 0] == 0.0


def test_commands_stay_within_the_limits(pursuit, drive):
    _, commands = drive(pursuit(), [0.0, 0.0, 0.0], standing(-9.0, 4.0), 60)
    assert commands[..., 0].max() <= 1.0 + 1e-12
    assert commands[..., 0].min() >= -0.4 - 1e-12
    assert np.abs(commands[..., 1]).max() <= 1.5 + 1e-12


def test_looks_around_for_a_target_never_seen(pursuit, drive):
    pose, commands = drive(pursuit(look_rate=0.7), [1.0, 2.0, 0.0], standing(0.0, 0.0), 20, known=False)
    np.testing.assert_allclose(commands, np.broadcast_to([0.0, 0.7], commands.shape))
    np.testing.assert_allclose(pose[0, :2], [1.0, 2.0])


def test_drives_to_where_the_target_was_lost_then_looks_around(pursuit, make_belief, move):
    policy = pursuit(lost_std=1.0, look_rate=0.7)
    policy.reset(np.arange(1), np.arange(1))
    pose = np.zeros((1, 3))
    policy.act(None, make_belief(pose, (4.0, 1.0)))
    for k in range(150):
        # The filter goes on guessing, ever less surely and in the wrong direction.
        policy.act(None, make_belief(pose, (4.0 + k, -9.0), std=2.0))
        pose = move(pose, policy.command, 0.1)
    assert np.hypot(*(pose[0, :2] - [4.0, 1.0])) <= 0.5
    np.testing.assert_array_equal(policy.command[0], [0.0, 0.7])
    policy.act(None, make_belief(pose, (8.0, 1.0)))
    assert policy.command[0, 0] != 0.0 or abs(policy.command[0, 1]) != 0.7


def test_reset_forgets_where_the_target_was_in_its_lanes_only(pursuit, make_belief):
    policy = pursuit(2)
    policy.reset(np.arange(2), np.arange(2))
    poses = np.zeros((2, 3))
    policy.act(None, make_belief(poses, (5.0, 0.0)))
    policy.reset(np.array([1]), np.array([9]))
    policy.act(None, make_belief(poses, (5.0, 0.0), known=False))
    assert policy.command[0, 0] > 0.0
    assert policy.command[1, 0] == 0.0


def test_lanes_equal_single_lanes_bit_for_bit(pursuit, make_belief):
    rng = np.random.default_rng(1)
    poses, targets = rng.normal(0, 3, (5, 3)), rng.normal(0, 3, (5, 2))
    velocities, stds = rng.normal(0, 1, (5, 2)), np.array([[0.1], [2.0], [0.3], [0.1], [3.0]])
    known = np.array([True, True, False, True, True])
    many = pursuit(5)
    many.reset(np.arange(5), np.arange(5))
    singles = [pursuit(1) for _ in range(5)]
    for k in range(3):
        together = many.act(None, make_belief(poses + k, targets, velocities, stds, known))
        for i, single in enumerate(singles):
            if k == 0:
                single.reset(np.arange(1), np.array([i]))
            one = single.act(None, make_belief(poses[i] + k, targets[i], velocities[i], stds[i], known[i]))
            assert one.tobytes() == together[i].tobytes()


def test_a_bicycle_follows_and_circles_when_lost(pursuit, drive, make_context):
    context = make_context("bicycle", speed=3.0)
    pose, _ = drive(pursuit(context=context, stand_off=3.0), [0.0, 0.0, 0.0], standing(30.0, 15.0), 300)
    assert np.hypot(30.0 - pose[0, 0], 15.0 - pose[0, 1]) == pytest.approx(3.0, abs=0.3)
    _, commands = drive(pursuit(context=context), [0.0, 0.0, 0.0], standing(0.0, 0.0), 5, known=False)
    np.testing.assert_allclose(commands[-1, 0], [0.6, math.pi / 6])


@pytest.mark.parametrize("options", [{"stand_off": -1.0}, {"turn_gain": math.nan}, {"look_rate": math.inf}])
def test_impossible_options_are_named(pursuit, options):
    with pytest.raises(ValueError, match=next(iter(options))):
        pursuit(**options)
