"""The base class for filters of one robot: what it fills in for the author."""

import numpy as np
import pytest

from estimators._recording import MOTION, SENSOR, TARGET_MODEL
from estimators.models import TargetModel
from estimators.single_lane import UNIFORM_HEADING_VAR, LaneBelief, SingleLaneEstimator, course, relative


class Told(SingleLaneEstimator):
    """Believes what the test tells it."""

    told = None

    def reset_one(self, models, pose, pose_cov, seed, target, target_cov):
        return {"pose": pose, "pose_cov": pose_cov, "target": target, "target_cov": target_cov}

    def predict_one(self, state, models, control, dt):
        return {**state, "pose": state["pose"] + [control[0] * dt, 0.0, 0.0]}

    def update_one(self, state, models, returns):
        return state

    def describe_one(self, state, models):
        return self.told or LaneBelief(**state)


def random_cov(rng, n):
    root = rng.standard_normal((n, n))
    return root @ root.T


def numeric_relative(pose, point):
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.array([[c, s], [-s, c]]) @ (point - pose[:2])


def test_relative_is_the_linearised_transform_with_cross_terms():
    rng = np.random.default_rng(0)
    pose, point, joint = rng.standard_normal(3), rng.standard_normal(2), random_cov(rng, 5)
    rel, cov = relative(pose, joint[:3, :3], point, joint[3:, 3:], joint[3:, :3])
    J, eps = np.empty((2, 5)), 1e-6
    for i in range(5):
        step = eps * np.eye(5)[i]
        up = numeric_relative(pose + step[:3], point + step[3:])
        down = numeric_relative(pose - step[:3], point - step[3:])
        J[:, i] = (up - down) / (2 * eps)
    assert rel == pytest.approx(numeric_relative(pose, point))
    assert cov == pytest.approx(J @ joint @ J.T, rel=1e-6)


@pytest.mark.parametrize("kind", ["twist", "constant-velocity"])
def test_velocity_and_heading_follow_from_the_targets_own_coordinates(kind):
    rng = np.random.default_rng(1)
    model = TargetModel(kind=kind, speed=0.7)
    n_t = len(model.coordinates)
    told = Told(MOTION, SENSOR, model, max_landmarks=2)
    told.reset(np.zeros(3), np.eye(3), seeds=0)
    target = np.array([1.0, 2.0, 0.6, 0.8])[:n_t]
    told.told = LaneBelief(np.array([0.0, 0.0, np.pi / 2]), np.eye(3), target, random_cov(rng, n_t))
    belief = told.belief
    velocity = np.array([0.6, 0.8]) if n_t == 4 else 0.7 * np.array([np.cos(0.6), np.sin(0.6)])
    assert belief.target_velocity[0] == pytest.approx(velocity)
    assert belief.target_heading[0] == pytest.approx(np.arctan2(velocity[1], velocity[0]))
    assert belief.target_rel[0] == pytest.approx([2.0, -1.0])
    assert belief.target_rel_velocity[0] == pytest.approx([velocity[1], -velocity[0]])
    assert np.linalg.eigvalsh(belief.target_velocity_cov[0]).min() > -1e-12


def test_a_course_of_nothing_is_uniform():
    assert course(np.zeros(2), np.eye(2)) == (0.0, UNIFORM_HEADING_VAR)
    assert course(np.array([1e-3, 0.0]), np.eye(2)) == (0.0, UNIFORM_HEADING_VAR)
    assert course(np.array([0.0, 2.0]), 0.04 * np.eye(2)) == (pytest.approx(np.pi / 2), pytest.approx(0.01))


def test_landmarks_come_and_go():
    told = Told(MOTION, SENSOR, TARGET_MODEL, max_landmarks=3)
    told.reset(np.zeros(3), np.zeros((3, 3)), seeds=0)
    points, covs = np.array([[1.0, 0.0], [0.0, 2.0]]), np.array([np.eye(2), 2 * np.eye(2)])
    told.told = LaneBelief(np.zeros(3), np.zeros((3, 3)), landmark_ids=[7, 3], landmarks=points, landmark_covs=covs)
    assert told.belief.landmark_id.tolist() == [[7, 3, -1]]
    assert told.belief.landmark_mapped.tolist() == [[True, True, False]]
    assert told.belief.landmark_rel[0, :2] == pytest.approx(points)
    assert told.belief.landmark_rel_cov[0, 1] == pytest.approx(2 * np.eye(2))
    assert not told.belief.target_known.any()
    told.told = LaneBelief(np.zeros(3), np.zeros((3, 3)))
    told.predict(np.zeros((1, 2)), 0.1)
    assert told.belief.landmark_count.tolist() == [0]
    assert told.belief.landmark_id.tolist() == [[-1] * 3]
    assert not told.belief.landmark_mean.any()


def test_a_lane_must_be_reset_before_it_moves():
    told = Told(MOTION, SENSOR, None, num_lanes=2, max_landmarks=3)
    told.reset(np.ones(3), np.zeros((3, 3)), seeds=0, lanes=np.array([1]))
    assert told.belief.pose.tolist() == [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]
    told.predict(np.ones((2, 2)), 0.5, lanes=np.array([1]))
    assert told.belief.pose[1].tolist() == [1.5, 1.0, 1.0]
    with pytest.raises(RuntimeError, match="lane 0 has no prior yet: call reset"):
        told.predict(np.ones((2, 2)), 0.5)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ((np.zeros(3), np.eye(3)), "must return a LaneBelief; got tuple"),
        (LaneBelief(np.zeros(3), np.eye(2)), r"pose_cov must have the shape \[3, 3\]; got \[2, 2\]"),
        (LaneBelief(np.zeros(3), np.eye(3), np.zeros(2), np.eye(2)), r"target must have the shape"),
        (LaneBelief(np.zeros(3), np.eye(3), landmark_ids=[1], landmarks=np.zeros((2, 2))), r"landmarks must have"),
        (LaneBelief(np.zeros(3), np.eye(3), landmark_ids=range(4)), "4 landmarks, but max_landmarks is 3"),
    ],
)
def test_what_an_author_gets_wrong_is_said(wrong, message):
    told = Told(MOTION, SENSOR, TARGET_MODEL, max_landmarks=3)
    told.reset(np.zeros(3), np.zeros((3, 3)), seeds=0)
    told.told = wrong
    with pytest.raises((ValueError, TypeError), match=r"Told\.describe_one.*" + message):
        told.belief.pose  # noqa: B018


def test_a_target_without_a_model_is_said():
    told = Told(MOTION, SENSOR, None, max_landmarks=3)
    told.reset(np.zeros(3), np.zeros((3, 3)), seeds=0)
    told.told = LaneBelief(np.zeros(3), np.eye(3), np.zeros(4), np.eye(4))
    with pytest.raises(ValueError, match=r"shape \[0\] \(no target model: leave it None\); got \[4\]"):
        told.belief.pose  # noqa: B018


def test_a_forgotten_return_is_said():
    class Forgetful(Told):
        def predict_one(self, state, models, control, dt):
            pass

    forgetful = Forgetful(MOTION, SENSOR, None, max_landmarks=3)
    forgetful.reset(np.zeros(3), np.zeros((3, 3)), seeds=0)
    with pytest.raises(TypeError, match=r"Forgetful\.predict_one must return the lane's new state"):
        forgetful.predict(np.zeros((1, 2)), 0.1)
