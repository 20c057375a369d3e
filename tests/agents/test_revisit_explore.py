import numpy as np
import pytest

from slam_gym import policies
from slam_gym.episode import Episode
from slam_gym.policies import PolicyContext
from slam_gym.scenario import Scenario
from slam_gym.simulation import Simulation


def with_map(belief, pose_std, landmarks, stds):
    lanes = len(belief.pose)
    belief.pose_cov = np.tile(np.diag([pose_std**2, pose_std**2, 0.0]), (lanes, 1, 1))
    belief.landmark_mean = np.tile(np.asarray(landmarks, dtype=np.float64), (lanes, 1, 1))
    belief.landmark_cov = np.tile(np.square(stds)[:, None, None] * np.eye(2), (lanes, 1, 1, 1))
    belief.landmark_mapped = np.ones((lanes, len(stds)), dtype=np.bool_)
    return belief


def test_returns_to_the_well_known_landmark_until_the_pose_is_known_again(make_context, make_belief, move):
    policy = policies.make("pursuit-revisit", make_context(), return_std=0.3, resume_std=0.15, distance_kept=2.0)
    policy.reset(np.arange(1), np.arange(1))
    pose, target = np.zeros((1, 3)), (0.0, 9.0)
    for _ in range(150):
        policy.act(None, with_map(make_belief(pose, target), 0.4, [[8.0, 0.0], [0.0, 3.0]], np.array([0.02, 0.5])))
        pose = move(pose, policy.command, 0.1)
    assert np.hypot(*(pose[0, :2] - [8.0, 0.0])) == pytest.approx(2.0, abs=0.1)
    for std, returns in ((0.2, True), (0.1, False), (0.2, False), (0.31, True)):  # hysteresis
        policy.act(None, with_map(make_belief(pose, target), std, [[8.0, 0.0]], np.array([0.02])))
        towards = abs(policy.command[0, 1]) < 0.5
        assert towards == returns, std


def test_does_not_return_to_a_map_that_cannot_help(make_context, make_belief):
    commands = []
    for name in ("pursuit", "pursuit-revisit"):
        policy = policies.make(name, make_context())
        policy.reset(np.arange(1), np.arange(1))
        policy.act(None, with_map(make_belief([0.0, 0.0, 0.0], (4.0, 2.0)), 0.9, [[-5.0, 0.0]], np.array([0.8])))
        commands.append(policy.command.copy())
    np.testing.assert_array_equal(*commands)


def test_exploring_sees_more_than_pursuing():
    seen = {}
    for name in ("explore", "pursuit"):
        seen[name] = 0
        for seed in (2, 3, 4):
            drive = Episode(Scenario.load("default"), ["ekf"], policy=name, seed=seed)
            most = 0.0
            for _ in range(400):
                drive.step()
                most = max(most, drive.policy.seen.mean() if name == "explore" else 0.0)
            seen[name] += int(drive.simulation.estimators[0].belief.landmark_mapped.sum())
            assert most > 0.7 or name == "pursuit"
    assert seen["explore"] > seen["pursuit"]


def test_a_poorly_known_landmark_is_visited_when_all_is_seen(make_context, make_belief):
    policy = policies.make("explore", make_context())
    policy.reset(np.arange(1), np.arange(1))
    policy.seen[:] = True
    belief = with_map(make_belief([0.0, 0.0, 0.0]), 0.0, [[6.0, 0.0], [-3.0, 3.0]], np.array([0.05, 0.6]))
    for _ in range(3):
        policy.act(None, belief)
    assert policy.command[0, 1] > 0.0  # to the left, where the second one is
    policy.act(None, with_map(make_belief([0.0, 0.0, 0.0]), 0.0, [[6.0, 0.0]], np.array([0.05])))


def test_a_bicycle_cannot_explore(make_context):
    with pytest.raises(ValueError, match="bicycle"):
        policies.make("explore", make_context("bicycle"))


@pytest.mark.parametrize("name", ["explore", "pursuit-revisit"])
def test_lanes_equal_single_lanes_bit_for_bit(name):
    scenario, seeds, found = Scenario.load("revisit"), np.array([4, 9]), []
    for lanes in ([0, 1], [0], [1]):
        simulation = Simulation(scenario, [("ekf", {})], num_lanes=len(lanes))
        context = PolicyContext.from_scenario(scenario)
        policy = policies.make(name, context, len(lanes))
        policy.reset(np.arange(len(lanes)), seeds[lanes])
        simulation.reset(seeds[lanes])
        for _ in range(60):
            simulation.advance(context.action_map.to_command(policy.act(None, simulation.estimators[0].belief)))
        found.append(simulation.world.pose.copy())
    assert found[0].tobytes() == np.vstack(found[1:]).tobytes()


def test_impossible_options_are_named(make_context):
    with pytest.raises(ValueError, match="resume_std must be below"):
        policies.make("pursuit-revisit", make_context(), return_std=0.2, resume_std=0.3)
    with pytest.raises(ValueError, match="cell"):
        policies.make("explore", make_context(), cell=0.0)
