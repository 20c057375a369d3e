"""The cloud of a lost target: when it lives, what an empty sweep teaches, and the contract of `belief.target_cloud`."""

import numpy as np
import pytest

import estimators
from estimators import TARGET, MotionModel, Scan, SensorModel, TargetModel
from estimators.target_cloud import TargetCloud

ARENA = (20.0, 20.0)
SENSOR = SensorModel(max_range=6.0, field_of_view=2.0, detection_probability=0.9, landmark_radius=0.5)
TARGET_MODEL = TargetModel(acceleration_density=0.3)


def _estimator(num_lanes=2, sensor=SENSOR, target=TARGET_MODEL):
    made = estimators.make("ekf", MotionModel(), sensor, target, num_lanes=num_lanes, max_landmarks=4)
    made.reset(np.zeros(3), np.zeros((3, 3)), seeds=np.arange(num_lanes))
    return made


def _scan(num_lanes, *returns):
    scan = Scan.empty(num_lanes, 4)
    for i, (distance, bearing, label) in enumerate(returns):
        scan.ranges[:, i], scan.bearings[:, i], scan.labels[:, i] = distance, bearing, label
    scan.count[:] = len(returns)
    return scan


def _step(estimator, cloud, scan, control=(0.0, 0.0)):
    estimator.predict(np.tile(np.array(control), (estimator.num_lanes, 1)), 0.1)
    cloud.predict(0.1)
    estimator.update(scan)
    cloud.update(scan)


def test_a_belief_without_a_cloud_says_what_to_do():
    estimator = _estimator()
    assert not estimator.belief.has_target_cloud
    with pytest.raises(RuntimeError, match="TargetCloud"):
        _ = estimator.belief.target_cloud


def test_an_unseen_target_is_anywhere_but_in_view():
    estimator = _estimator()
    cloud = TargetCloud(estimator, 2000, arena=ARENA)
    cloud.reset(None, [1, 2])
    points, weights = estimator.belief.target_cloud
    assert points.shape == (2, 2000, 2)
    assert (np.abs(points) <= 10.0).all()
    assert np.allclose(points.mean(axis=1), 0.0, atol=0.5)  # even over the arena
    assert np.allclose(points.std(axis=1), 20.0 / np.sqrt(12.0), atol=0.3)
    for _ in range(3):
        _step(estimator, cloud, _scan(2))
    points, weights = estimator.belief.target_cloud
    assert np.allclose(weights.sum(axis=1), 1.0)
    inside = (np.hypot(*points.T).T < 5.0) & (np.abs(np.arctan2(points[..., 1], points[..., 0])) < 0.8)
    assert (weights * inside).sum(axis=1).max() < 0.005


def test_the_cloud_follows_the_gaussian_while_the_target_is_seen_and_lives_once_it_is_not():
    estimator = _estimator()
    cloud = TargetCloud(estimator, 1000, arena=ARENA)
    cloud.reset(None, [1, 2])
    for _ in range(5):
        _step(estimator, cloud, _scan(2, (4.0, 0.2, TARGET)))
    assert not cloud.lost.any()
    belief = estimator.belief
    points, _ = belief.target_cloud
    assert np.allclose(points.mean(axis=1), belief.target_position, atol=0.02)
    assert np.allclose(np.cov(points[0].T), belief.target_position_cov[0], rtol=0.2, atol=1e-4)
    _step(estimator, cloud, _scan(2))
    assert cloud.lost.all()
    _step(estimator, cloud, _scan(2, (4.0, 0.2, TARGET)))
    assert not cloud.lost.any()


def test_an_incomplete_sweep_is_no_evidence():
    estimator = _estimator()
    cloud = TargetCloud(estimator, 500, arena=ARENA)
    cloud.reset(None, [1, 2])
    scan = _scan(2)
    scan.complete[:] = False
    _step(estimator, cloud, scan)
    assert np.all(estimator.belief.target_cloud[1] == 1.0 / 500)


@pytest.mark.parametrize("evasive", [False, True])
@pytest.mark.parametrize("seen", [False, True])
def test_what_is_foreseen_is_what_comes_if_nothing_is_seen(evasive, seen):
    estimator = _estimator()
    cloud = TargetCloud(estimator, 300, arena=ARENA, evasive=evasive)
    cloud.reset(None, [1, 2])
    for _ in range(5):
        _step(estimator, cloud, _scan(2, *([(4.0, 0.2, TARGET)] if seen else [])))
    _step(estimator, cloud, _scan(2))
    ahead, before = np.zeros((12, 300, 2)), cloud.get_state()
    estimator.belief.foresee_target(1, 0.4, ahead)
    assert all(np.array_equal(before[name], array) for name, array in cloud.get_state().items())
    for expected in ahead:
        cloud.predict(0.4)
        np.testing.assert_array_equal(estimator.belief.target_cloud[0][1], expected)


def test_a_target_in_view_is_foreseen_from_its_gaussian():
    estimator = _estimator()
    cloud = TargetCloud(estimator, 1000, arena=ARENA, turn_rate=0.0)
    cloud.reset(None, [1, 2])
    for k in range(20):
        _step(estimator, cloud, _scan(2, (3.0 + 0.05 * k, 0.0, TARGET)))
    ahead = np.zeros((2, 1000, 2))
    cloud.foresee(0, 0.5, ahead)
    belief = estimator.belief
    for k, places in enumerate(ahead):
        expected = belief.target_position[0] + 0.5 * (k + 1) * belief.target_velocity[0]
        np.testing.assert_allclose(places.mean(axis=0), expected, atol=0.05)


def test_a_cloud_learns_whether_its_target_flees_and_forgets_it_at_a_reset():
    """One lane sees a target that runs straight off, the other one that passes across; both 2 to 5 m away."""
    estimator = _estimator()
    cloud = TargetCloud(estimator, 400, arena=ARENA, evasive=True)
    cloud.reset(None, [1, 2])
    start = cloud.get_state()["evasion"]
    for k in range(30):
        scan = _scan(2, (0.0, 0.0, TARGET))
        scan.ranges[0, 0], scan.bearings[0, 0] = 2.0 + 0.1 * k, 0.3
        scan.ranges[1, 0], scan.bearings[1, 0] = np.hypot(4.0, 1.5 - 0.1 * k), np.arctan2(1.5 - 0.1 * k, 4.0)
        _step(estimator, cloud, scan)
    learned = cloud.get_state()["evasion"]
    assert learned[0] > start[0] + 1.0
    assert learned[1] < start[1] - 1.0
    cloud.reset(np.array([0]), [3])
    assert cloud.get_state()["evasion"].tolist() == [start[0], learned[1]]
    cloud.set_state({**cloud.get_state(), "evasion": learned})
    assert np.array_equal(cloud.get_state()["evasion"], learned)


def test_a_cloud_that_does_not_learn_it_moves_as_ever():
    estimator = _estimator()
    cloud = TargetCloud(estimator, 50, arena=ARENA)
    cloud.reset(None, [1, 2])
    for k in range(10):
        _step(estimator, cloud, _scan(2, (2.0 + 0.1 * k, 0.0, TARGET)))
    assert np.isneginf(cloud.get_state()["evasion"]).all()
