import numpy as np
import pytest

from estimators.interface import Belief
from slam_gym.assignment import gospa, match_landmarks
from slam_gym.metrics import METRIC, Meter

NAMES = ("x", "y", "velocity_x", "velocity_y")


class Holder:
    """An estimator that only holds numbers."""

    def _fill_core(self, buffers):
        """Nothing to refresh."""

    _fill_map = _fill_core


def spd(rng, lanes, n):
    root = rng.standard_normal((lanes, n, n))
    return root @ root.transpose(0, 2, 1) + 0.2 * np.eye(n)


def random_belief(lanes=3, capacity=5, names=NAMES, seed=0):
    rng = np.random.default_rng(seed)
    belief = Belief(Holder(), lanes, capacity, names)
    values = belief.buffers
    n = len(names)
    values["pose"][:] = rng.standard_normal((lanes, 3))
    values["pose_cov"][:] = spd(rng, lanes, 3)
    values["target_known"][:] = True
    values["target_mean"][:] = rng.standard_normal((lanes, n))
    values["target_cov"][:] = spd(rng, lanes, n)
    values["target_position"][:] = values["target_mean"][:, :2]
    values["target_position_cov"][:] = values["target_cov"][:, :2, :2]
    values["target_velocity"][:] = rng.standard_normal((lanes, 2))
    values["target_heading"][:] = rng.uniform(-3, 3, lanes)
    values["target_rel"][:] = rng.standard_normal((lanes, 2))
    values["landmark_id"][:] = np.arange(capacity)
    values["landmark_mapped"][:, : capacity - 1] = True
    values["landmark_count"][:] = capacity - 1
    values["landmark_mean"][:] = rng.standard_normal((lanes, capacity, 2))
    values["landmark_cov"][:] = spd(rng, lanes * capacity, 2).reshape(lanes, capacity, 2, 2)
    return belief


def truth(lanes=3, count=6, seed=1):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((lanes, 3)), rng.standard_normal((lanes, 4)), rng.standard_normal((lanes, count, 2))


def wrap(angle):
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def quadratic(error, cov):
    return float(error @ np.linalg.solve(cov, error))


def test_every_number_equals_the_textbook_formula():
    belief, (pose, target, landmarks) = random_belief(), truth()
    record = Meter(3, 5).measure(belief, pose, target, landmarks)
    b = belief.buffers
    for lane in range(3):
        error = b["pose"][lane] - pose[lane]
        error[2] = wrap(error[2])
        c, s = np.cos(pose[lane, 2]), np.sin(pose[lane, 2])
        turned = np.array([[c, s], [-s, c]]) @ (target[lane, :2] - pose[lane, :2])
        state_error = b["target_mean"][lane] - target[lane]
        map_error = b["landmark_mean"][lane, :4] - landmarks[lane, :4]
        expected = {
            "robot_error": np.hypot(*error[:2]),
            "heading_error": abs(error[2]),
            "target_error": np.linalg.norm(b["target_position"][lane] - target[lane, :2]),
            "target_error_rel": np.linalg.norm(b["target_rel"][lane] - turned),
            "target_velocity_error": np.linalg.norm(b["target_velocity"][lane] - target[lane, 2:]),
            "target_heading_error": abs(wrap(b["target_heading"][lane] - np.arctan2(target[lane, 3], target[lane, 2]))),
            "landmark_error": np.sqrt((map_error**2).sum(axis=1).mean()),
            "pose_nees": quadratic(error, b["pose_cov"][lane]),
            "target_nees": quadratic(state_error[:2], b["target_cov"][lane, :2, :2]),
            "target_state_nees": quadratic(state_error, b["target_cov"][lane]),
            "landmark_nees": np.mean([quadratic(map_error[j], b["landmark_cov"][lane, j]) for j in range(4)]),
            "landmark_count": 4.0,
        }
        for name, value in expected.items():
            assert record[name][lane] == pytest.approx(value, rel=1e-6), name
        assert np.isnan(record["landmark_gospa"][lane])


def test_a_unicycle_targets_heading_is_wrapped_in_its_nees():
    belief = random_belief(names=("x", "y", "heading"))
    pose, target, _ = truth()
    heading = belief.buffers["target_mean"][:, 2] + 2.0 * np.pi - 0.01
    record = Meter(3, 5).measure(belief, pose, target, target_heading=wrap(heading))
    for lane in range(3):
        error = np.append(belief.buffers["target_mean"][lane, :2] - target[lane, :2], 0.01)
        assert record["target_state_nees"][lane] == pytest.approx(quadratic(error, belief.buffers["target_cov"][lane]))


def test_coordinates_that_nobody_knows_have_no_state_nees():
    record = Meter(3, 5).measure(random_belief(names=("x", "y", "mood")), *truth()[:2])
    assert np.isnan(record["target_state_nees"]).all()
    assert np.isfinite(record["target_nees"]).all()


def test_what_is_not_there_is_undefined():
    belief = random_belief()
    belief.buffers["target_known"][:] = [False, True, True]
    belief.buffers["landmark_mapped"][2] = False
    pose, target, landmarks = truth()
    record = Meter(3, 5).measure(belief, pose, target, landmarks)
    names = [name for name in METRIC.names if name.startswith("target")]
    assert all(np.isnan(record[name][0]) and np.isfinite(record[name][1]) for name in names)
    assert np.isnan(record["landmark_error"][2])
    assert record["landmark_count"][2] == 0.0
    record = Meter(3, 5).measure(belief, pose, None)
    assert np.isnan(record["target_error"]).all()
    assert np.isfinite(record["robot_error"]).all()


def test_a_certain_start_has_no_nees_and_a_broken_covariance_an_infinite_one():
    belief, (pose, target, _) = random_belief(), truth()
    belief.buffers["pose_cov"][0] = 0.0
    belief.buffers["pose_cov"][1] = -np.eye(3)
    belief.buffers["pose"][2] = np.nan
    record = Meter(3, 5).measure(belief, pose, target)
    assert np.isnan(record["pose_nees"][0])
    assert np.isinf(record["pose_nees"][1:]).all()


def test_a_rank_deficient_covariance_is_regularised_by_its_own_scale():
    direction = np.array([1.0, 2.0, 0.5])
    belief, (pose, target, _) = random_belief(), truth()
    belief.buffers["pose_cov"][:] = 1e-4 * np.outer(direction, direction)
    belief.buffers["pose"][:] = pose + 0.02 * direction  # two standard deviations along the only uncertain direction
    record = Meter(3, 5).measure(belief, pose, target)
    np.testing.assert_allclose(record["pose_nees"], 4.0, rtol=1e-3)


def test_lanes_named_are_measured_and_the_others_left():
    belief, (pose, target, landmarks) = random_belief(), truth()
    meter = Meter(3, 5)
    everything = meter.measure(belief, pose, target, landmarks).copy()
    one = Meter(3, 5)
    record = one.measure(belief, pose, target, landmarks, lanes=np.array([1]))
    assert record[1].tobytes() == everything[1].tobytes()
    assert np.isnan(record["robot_error"][[0, 2]]).all()


def test_a_world_with_fewer_landmarks_than_slots_matches_only_those():
    belief, (pose, target, landmarks) = random_belief(), truth()
    record = Meter(3, 5).measure(belief, pose, target, landmarks, np.array([2, 2, 2]))
    error = belief.buffers["landmark_mean"][0, :2] - landmarks[0, :2]
    assert record["landmark_error"][0] == pytest.approx(np.sqrt((error**2).sum(axis=1).mean()))
    assert record["landmark_count"][0] == 4.0


def test_landmarks_without_ids_are_matched_by_distance():
    belief, (pose, target, landmarks) = random_belief(), truth()
    order = np.array([3, 0, 4, 1])
    landmarks = 10.0 * landmarks
    belief.buffers["landmark_mean"][:, :4] = landmarks[:, order] + 0.1
    meter = Meter(3, 5)
    record = meter.measure(belief, pose, target, landmarks, labelled=False)
    np.testing.assert_allclose(record["landmark_error"], np.hypot(0.1, 0.1), rtol=1e-6)
    missed = 2  # of six
    expected = np.sqrt(4 * 0.02 + 0.5 * meter.landmark_gate**2 * missed)
    np.testing.assert_allclose(record["landmark_gospa"], expected, rtol=1e-6)


def test_matching_is_one_to_one_and_gated():
    match = match_landmarks([[0.0, 0.0], [0.1, 0.0], [50.0, 0.0]], [[0.0, 0.0], [0.3, 0.0]], gate=1.0)
    np.testing.assert_array_equal(match, [0, 1, -1])
    assert match_landmarks(np.empty((0, 2)), [[0.0, 0.0]]).shape == (0,)
    np.testing.assert_array_equal(match_landmarks([[np.nan, 0.0]], [[0.0, 0.0]]), [-1])


def test_gospa_counts_missed_and_false_landmarks_alike():
    assert gospa([[0.0, 0.0]], [[0.0, 0.0]]) == 0.0
    assert gospa([[0.0, 0.0]], np.empty((0, 2)), cutoff=2.0) == pytest.approx(np.sqrt(2.0))
    assert gospa(np.empty((0, 2)), [[0.0, 0.0]], cutoff=2.0) == pytest.approx(np.sqrt(2.0))
    assert gospa([[0.0, 0.0]], [[0.5, 0.0]], cutoff=2.0) == pytest.approx(0.5)
    assert gospa([[0.0, 0.0]], [[90.0, 0.0]], cutoff=2.0) == pytest.approx(2.0)
