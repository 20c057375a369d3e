"""The policies that look at nothing: random, stationary, constant."""

import math

import numpy as np
import pytest

from slam_gym import policies


def start(policy, seeds):
    policy.reset(np.arange(policy.num_lanes), np.asarray(seeds))
    return policy


def test_stationary_stands_still(make_context):
    policy = start(policies.make("stationary", make_context(), 3), [0, 1, 2])
    np.testing.assert_array_equal(policy.act(None, None), np.zeros((3, 2)))


def test_constant_holds_the_command_that_was_asked_for(make_context):
    context = make_context()
    policy = start(policies.make("constant", context, 2, speed=0.5, turn_rate=-0.3), [0, 1])
    for _ in range(3):
        np.testing.assert_allclose(context.action_map.to_command(policy.act(None, None)), [[0.5, -0.3]] * 2)


def test_constant_defaults_to_a_circle_of_half_the_arena(make_context):
    policy = policies.make("constant", make_context(arena=(20.0, 12.0)))
    assert policy.command[0, 0] / policy.command[0, 1] == pytest.approx(3.0)


def test_constant_turns_a_bicycle_at_the_rate_asked_for(make_context):
    policy = policies.make("constant", make_context("bicycle", speed=3.0), speed=2.0, turn_rate=0.2)
    speed, steering = policy.command[0]
    assert speed * math.sin(steering) / 4.0 == pytest.approx(0.2)


def test_constant_commands_beyond_the_limits_saturate(make_context):
    policy = start(policies.make("constant", make_context(), speed=50.0, turn_rate=-50.0), [0])
    np.testing.assert_array_equal(policy.act(None, None), [[1.0, -1.0]])


def test_random_is_uniform_and_depends_on_the_lane_seed_alone(make_context):
    many = start(policies.make("random", make_context(), 400, hold_time=0.0), np.arange(400) + 7)
    single = start(policies.make("random", make_context(), 1, hold_time=0.0), [7 + 3])
    drawn = np.array([many.act(None, None) for _ in range(50)])
    alone = np.array([single.act(None, None) for _ in range(50)])
    assert drawn[:, 3].tobytes() == alone[:, 0].tobytes()
    flat = drawn.reshape(-1, 2)
    assert np.abs(flat).max() <= 1.0
    np.testing.assert_allclose(flat.mean(axis=0), 0.0, atol=0.02)
    np.testing.assert_allclose(flat.var(axis=0), 1.0 / 3.0, atol=0.02)
    np.testing.assert_allclose(np.corrcoef(drawn[0, :, 0], drawn[1, :, 0])[0, 1], 0.0, atol=0.2)


def test_random_holds_each_action_and_starts_anew_after_reset(make_context):
    policy = start(policies.make("random", make_context(step_dt=0.1, hold=2), 2, hold_time=1.0), [1, 2])
    drawn = np.array([policy.act(None, None) for _ in range(15)])
    assert len(np.unique(drawn[:, 0, 0])) == 3  # 1 s is 5 decisions of 0.2 s
    policy.reset(np.array([0]), np.array([1]))
    again = policy.act(None, None)
    np.testing.assert_array_equal(again[0], drawn[0, 0])
    assert (again[1] != drawn[0, 1]).all()


@pytest.mark.parametrize(("name", "options"), [
    ("random", {"hold_time": -1.0}), ("constant", {"speed": math.nan}), ("constant", {"turn_rate": math.inf}),
])  # fmt: skip
def test_impossible_options_are_named(make_context, name, options):
    with pytest.raises(ValueError, match=next(iter(options))):
        policies.make(name, make_context(), **options)
