import numpy as np
import pytest

from slam_gym import policies
from slam_gym.episode import Episode
from slam_gym.scenario import Scenario


def test_drives_to_the_true_target_whatever_is_believed(make_context, make_belief, move):
    policy = policies.make("oracle", make_context(), 2, stand_off=1.0)
    policy.reset(np.arange(2), np.arange(2))
    poses, targets = np.array([[0.0, 0.0, 1.0], [3.0, 1.0, -2.0]]), np.array([[5.0, 2.0], [-4.0, 0.0]])
    for _ in range(250):
        policy.set_truth(poses, np.hstack([targets, np.zeros((2, 2))]))
        policy.act(None, make_belief(poses + 1.0, -targets, known=False))
        poses = move(poses, policy.command, 0.1)
    np.testing.assert_allclose(np.hypot(*(targets - poses[:, :2]).T), 1.0, atol=0.02)


def test_nobody_but_evaluation_tells_the_truth(make_context, make_belief):
    policy = policies.make("oracle", make_context())
    with pytest.raises(RuntimeError, match="told no truth"):
        policy.act(None, make_belief([0.0, 0.0, 0.0]))
    assert policies.is_reference("oracle:stand_off=1")
    assert not policies.is_reference("pursuit")
    assert not policies.is_reference("no such policy")


def test_without_a_target_there_is_nothing_to_tell(make_context):
    with pytest.raises(ValueError, match="policy 'oracle' is told where the target is, and this scenario has none"):
        policies.make("oracle", make_context(target=None))


def test_an_episode_tells_it():
    episode = Episode(Scenario.load("discovery"), ["ekf"], policy="oracle", seed=3)
    for _ in range(300):
        episode.step()
    world = episode.simulation.world
    assert np.hypot(*(world.target[0, :2] - world.pose[0, :2])) < 4.0
