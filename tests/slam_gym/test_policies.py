import numpy as np
import pytest

from slam_gym import policies
from slam_gym.policies import Policy, PolicyContext
from slam_gym.scenario import Scenario


class Spin(Policy):
    """Turns.

    Args:
        rate: [rad/s].
    """

    summary = "turns"

    def __init__(self, context, num_lanes=1, *, rate=0.5):
        super().__init__(context, num_lanes)
        self.command[:, 1] = rate

    def reset(self, lanes, seeds):
        pass

    def act(self, observation, belief):
        return self.to_action(self.command)


@pytest.fixture
def context():
    return PolicyContext.from_scenario(Scenario.load("default"))


@pytest.fixture
def spin():
    policies.register("test-spin", Spin)
    yield "test-spin"
    del policies._registered["test-spin"]


def test_scripted_policies_are_found_by_their_entry_points():
    assert {"random", "stationary", "constant", "waypoints", "pursuit"} <= set(policies.names())
    for name in policies.names():
        found = policies.get(name)
        assert issubclass(found, Policy)
        assert 10 < len(found.summary) < 90
        assert len(found.__doc__) > 100


def test_every_option_is_documented_and_has_a_default():
    for name in policies.names():
        for option in policies.options(name):
            assert f"{option}:" in policies.get(name).__doc__, f"{name}: {option}"


def test_an_unknown_name_lists_the_choices_and_the_nearest():
    with pytest.raises(ValueError, match=r"unknown policy 'persuit'. Did you mean 'pursuit'\? Choices: .*stationary"):
        policies.get("persuit")


def test_an_unknown_option_lists_the_choices_and_the_nearest(context):
    with pytest.raises(ValueError, match=r"policy 'pursuit': unknown option 'standoff'. Did you mean 'stand_off'\?"):
        policies.make("pursuit", context, standoff=2.0)
    with pytest.raises(ValueError, match="policy 'stationary' has no options; got 'speed'"):
        policies.make("stationary", context, speed=2.0)


def test_a_registered_policy_is_known_by_name(context, spin):
    assert spin in policies.names()
    assert policies.options(spin) == {"rate": 0.5}
    policy = policies.make(spin, context, 3, rate=-0.25)
    action = policy.act(None, None)
    assert action.shape == (3, 2)
    np.testing.assert_allclose(context.action_map.to_command(action)[:, 1], -0.25)


def test_a_taken_name_is_refused(spin):
    with pytest.raises(ValueError, match="exists already"):
        policies.register("pursuit", Spin)
    with pytest.raises(ValueError, match="exists already"):

        @policies.register(spin)
        class Other(Spin):
            pass


def test_no_lanes_is_refused(context):
    with pytest.raises(ValueError, match="num_lanes must be at least 1; got 0"):
        policies.make("stationary", context, 0)


def test_the_context_knows_the_scenario():
    scenario = Scenario.load("slamto")
    context = PolicyContext.from_scenario(scenario)
    assert context.dt == pytest.approx(scenario.dt * scenario.hold)
    assert context.speed_max == 4.0
    assert context.turn_max == 2.0
    assert context.sensor.max_range == 7.0
    assert not context.is_bicycle


def test_the_context_of_a_bicycle_has_its_steering():
    context = PolicyContext.from_scenario(Scenario.load("tian-sparse"))
    assert context.is_bicycle
    assert context.steering_max == pytest.approx(np.radians(30))
    assert context.steering_rate == pytest.approx(np.radians(20))
    assert context.motion.wheelbase == 4.0


@pytest.mark.parametrize("action", ["twist", "wheels"])
def test_the_same_command_whatever_the_kind_of_action(action):
    context = PolicyContext.from_scenario(Scenario.load("default"), action)
    policy = policies.make("constant", context, speed=0.4, turn_rate=0.3)
    np.testing.assert_allclose(context.action_map.to_command(policy.act(None, None)), [[0.4, 0.3]], atol=1e-12)


def test_where_a_number_is_drawn_anew_the_middle_of_its_range_is_known():
    scenario = Scenario.load("default", **{"robot.speed_max": [1.0, 2.0]})
    assert PolicyContext.from_scenario(scenario).speed_max == pytest.approx(1.5)
