import numpy as np
import pytest

from slam_gym.actions import ActionMap
from slam_gym.scenario import Scenario

OPEN, TIAN = Scenario.load("open"), Scenario.load("tian-sparse")


@pytest.mark.parametrize(
    ("scenario", "kind", "action", "command"),
    [
        (OPEN, "twist", (1.0, 0.0), (1.0, 0.0)),
        (OPEN, "twist", (-1.0, 0.5), (-0.4, 0.75)),
        (OPEN, "twist", (0.0, -1.0), (0.0, -1.5)),
        (OPEN, "wheels", (1.0, 1.0), (1.0, 0.0)),
        (OPEN, "wheels", (-0.5, 0.5), (0.0, 2.0)),
        (TIAN, "steering", (1.0, 1.0), (3.0, np.pi / 6)),
    ],
)
def test_known_commands(scenario, kind, action, command):
    np.testing.assert_allclose(ActionMap(scenario, kind).to_command(np.array([action])), [command], atol=1e-9)


@pytest.mark.parametrize(("scenario", "kind"), [(OPEN, "twist"), (OPEN, "wheels"), (TIAN, "steering")])
def test_there_and_back(scenario, kind):
    mapping = ActionMap(scenario, kind)
    action = np.random.default_rng(0).uniform(0 if kind == "steering" else -1, 1, (50, 2))
    np.testing.assert_allclose(mapping.to_action(mapping.to_command(action)), action, atol=1e-12)


@pytest.mark.parametrize("action", [np.zeros(2), np.zeros((3, 1)), np.zeros((1, 2, 1)), 0.5])
def test_actions_of_another_shape_are_refused(action):
    with pytest.raises(ValueError, match=r"an array \[lanes, 2\], also of a single lane; got shape"):
        ActionMap(OPEN, "twist").to_command(action)


def test_actions_beyond_one_are_cut():
    mapping = ActionMap(OPEN, "twist")
    command = np.zeros((1, 2))
    assert mapping.fill(np.array([[7.0, -9.0]]), command)
    np.testing.assert_allclose(command, [[1.0, -1.5]])


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_is_no_number_is_noticed(bad):
    assert not ActionMap(OPEN, "twist").fill(np.array([[0.0, bad]]), np.zeros((1, 2)))


@pytest.mark.parametrize(
    ("scenario", "kind", "message"),
    [(OPEN, "twst", "Did you mean 'twist'"), (OPEN, "steering", "'twist' or 'wheels'"), (TIAN, "twist", "'steering'")],
)
def test_wrong_kinds(scenario, kind, message):
    with pytest.raises(ValueError, match=message):
        ActionMap(scenario, kind)
