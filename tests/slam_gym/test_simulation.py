import numpy as np
import pytest

from slam_gym.scenario import Scenario
from slam_gym.simulation import Simulation

COMMAND = np.array([0.5, 0.2])


def simulate(estimators, lanes=3, steps=30, name="open", seed=0, **kwargs):
    simulation = Simulation(Scenario.load(name), estimators, num_lanes=lanes, **kwargs)
    simulation.reset(np.arange(lanes) + seed)
    for _ in range(steps):
        simulation.advance(np.tile(COMMAND, (lanes, 1)))
    return simulation


def test_estimators_beside_each_other_see_identical_data():
    alone = simulate([("ekf", {})])
    together = simulate([("dead-reckoning", {}), ("ekf", {}), ("ekf", {"gate": 1e9})])
    for index in (1, 2):
        np.testing.assert_array_equal(together.estimators[index].belief.pose, alone.estimators[0].belief.pose)
    np.testing.assert_array_equal(together.world.pose, alone.world.pose)


def test_some_lanes_only():
    simulation = simulate([("ekf", {})])
    before = simulation.estimators[0].belief.pose.copy(), simulation.world.pose.copy()
    simulation.advance(np.tile(COMMAND, (3, 1)), np.array([1]))
    after = simulation.estimators[0].belief.pose, simulation.world.pose
    for old, new in zip(before, after, strict=True):
        np.testing.assert_array_equal(old[[0, 2]], new[[0, 2]])
        assert (old[1] != new[1]).any()


def test_sweeps_come_when_they_are_due():
    simulation = Simulation(Scenario.load("slamto"), [("ekf", {})], timed=True)
    simulation.reset([0])
    for _ in range(24):
        simulation.advance(np.array([[3.0, 1.0]]))
    assert (simulation.predict_calls[0], simulation.update_calls[0]) == (24, 3)
    assert simulation.predict_seconds[0] > 0.0 and simulation.update_seconds[0] > 0.0


def test_timing_changes_no_number():
    timed, plain = simulate([("ekf", {})], timed=True), simulate([("ekf", {})])
    np.testing.assert_array_equal(timed.estimators[0].belief.pose, plain.estimators[0].belief.pose)


def test_a_filter_that_is_told_the_truth_needs_leave():
    with pytest.raises(ValueError, match="handed the truth"):
        simulate([("ideal-ekf", {})])
    simulation = simulate([("ideal-ekf", {}), ("ekf", {})], allow_truth=True)
    assert np.isfinite(simulation.measure(0)["pose_nees"]).all()


def test_landmarks_without_ids_are_associated_by_distance():
    scenario = Scenario.load("open", **{"landmarks.labelled": False})
    simulation = Simulation(scenario, [("ekf", {})])
    simulation.reset([0])
    for _ in range(30):
        simulation.advance(COMMAND[None])
    count = int(simulation.estimators[0].belief.landmark_count[0])
    assert simulation.estimators[0].association == "nearest"
    assert 5 <= count <= simulation.world.landmark_count[0]
    assert simulation.measure()["landmark_error"][0] < 0.5


def test_filters_are_told_what_was_drawn_for_their_episode():
    scenario = Scenario.load("open", **{"sensor.range_std": [0.01, 0.5]})
    simulation = Simulation(scenario, [("ekf", {})], num_lanes=4)
    simulation.reset(np.arange(4))
    believed = simulation.estimators[0].models["range_std"]
    np.testing.assert_array_equal(believed, simulation.world.numbers["sensor_range_std"])
    assert len(set(believed)) == 4


def test_a_prior_of_the_target_is_handed_on():
    simulation = Simulation(Scenario.load("slamto"), [("ekf", {})])
    simulation.reset([0])
    belief = simulation.estimators[0].belief
    assert belief.target_known[0]
    np.testing.assert_allclose(belief.target_position[0], simulation.world.target[0, :2])


def test_state_restores_bit_for_bit():
    simulation, other = simulate([("ekf", {})]), simulate([("ekf", {})], steps=0, seed=77)
    other.set_state(simulation.get_state())
    for s in (simulation, other):
        for _ in range(10):
            s.advance(np.tile(COMMAND, (3, 1)))
    np.testing.assert_array_equal(simulation.estimators[0].belief.pose, other.estimators[0].belief.pose)
    np.testing.assert_array_equal(simulation.world.target, other.world.target)
