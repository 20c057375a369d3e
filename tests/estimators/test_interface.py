"""The contract's own classes: the scan, the belief's laziness, the prior's checks."""

import numpy as np
import pytest

from estimators._recording import MOTION, SENSOR, TARGET_MODEL
from estimators.interface import UNKNOWN, Belief, Scan
from estimators.models import MotionModel, TargetModel
from estimators.single_lane import LaneBelief, SingleLaneEstimator


class Still(SingleLaneEstimator):
    def reset_one(self, models, pose, pose_cov, seed, target, target_cov):
        return pose, pose_cov, target, target_cov

    def predict_one(self, state, models, control, dt):
        return state

    def update_one(self, state, models, returns):
        return state

    def describe_one(self, state, models):
        self.described = getattr(self, "described", 0) + 1
        return LaneBelief(*state)


@pytest.fixture
def still():
    return Still(MOTION, SENSOR, TARGET_MODEL, num_lanes=2, max_landmarks=4)


ZERO = np.zeros((3, 3))
POSE = np.zeros((2, 3))
WRONG_PRIORS = [
    ({"pose": np.zeros(4)}, r"pose must have shape \[2, 3\] or \[3\]; got \[4\]"),
    ({"pose": [[0.0, 0.0, np.nan]] * 2}, "pose must be finite"),
    ({"pose_cov": np.zeros((3, 4))}, r"pose_cov must have shape \[2, 3, 3\] or \[3, 3\]; got \[3, 4\]"),
    ({"seeds": [1, 2, 3]}, r"seeds must be one integer per lane, shape \[2\]; got \[3\]"),
    ({"lanes": [0, 0]}, r"lanes must be distinct indices below 2; got \[0, 0\]"),
    ({"lanes": [0, 2]}, "lanes must be distinct indices below 2"),
    ({"target": np.zeros(4)}, "target and target_cov go together"),
    ({"target": np.zeros(3), "target_cov": np.eye(3)}, r"target \(x, y, velocity_x, velocity_y\) must have shape"),
]


@pytest.mark.parametrize(("changes", "message"), WRONG_PRIORS)
def test_a_wrong_prior_is_explained(still, changes, message):
    arguments = {"pose": POSE, "pose_cov": ZERO, "seeds": [0, 1], **changes}
    with pytest.raises(ValueError, match=message):
        still.reset(**arguments)


def test_a_target_prior_without_a_target_model_is_refused():
    still = Still(MOTION, SENSOR, None, num_lanes=1, max_landmarks=4)
    with pytest.raises(ValueError, match="without a target model"):
        still.reset(np.zeros(3), ZERO, seeds=0, target=np.zeros(4), target_cov=np.eye(4))


def test_one_prior_serves_every_lane_and_its_heading_is_wrapped(still):
    still.reset([1.0, 2.0, 7.0], ZERO, seeds=3)
    assert still.belief.pose == pytest.approx(np.tile([1.0, 2.0, 7.0 - 2 * np.pi], (2, 1)))


@pytest.mark.parametrize("changes", [{"num_lanes": 0}, {"max_landmarks": 0}])
def test_sizes_are_at_least_one(changes):
    with pytest.raises(ValueError, match="must be at least 1; got 0"):
        Still(MOTION, SENSOR, None, **{"num_lanes": 1, "max_landmarks": 1, **changes})


def test_a_lane_may_have_numbers_of_its_own_but_not_another_kind_of_target(still):
    still.set_models(1, MotionModel(speed_std=0.9), SENSOR, TARGET_MODEL)
    assert still.models["speed_std"].tolist() == [MOTION.speed_std, 0.9]
    assert still.lane_models[1].motion.speed_std == 0.9
    with pytest.raises(ValueError, match="fixed at construction"):
        still.set_models(0, MOTION, SENSOR, TargetModel(kind="twist"))
    with pytest.raises(ValueError, match="fixed at construction"):
        still.set_models(0, MOTION, SENSOR, None)


def test_the_belief_is_computed_once_when_read(still):
    still.reset(POSE, ZERO, seeds=0)
    assert not hasattr(still, "described")
    assert still.belief.pose is still.belief.pose
    assert still.belief.pose_cov.shape == (2, 3, 3)
    assert still.described == 2  # one per lane
    still.predict(np.zeros((2, 2)), 0.1)
    assert still.belief.target_mean.shape == (2, 4)
    assert still.described == 4


def test_a_family_without_joint_or_particles_says_so(still):
    with pytest.raises(NotImplementedError, match="Still keeps no joint Gaussian"):
        still.belief.joint(0)
    with pytest.raises(NotImplementedError, match="Still keeps no particles"):
        still.belief.particles(0)


def test_every_documented_field_exists():
    words = set(Belief.__doc__.replace(",", " ").replace("[", " ").replace(";", " ").split())
    for name in (*Belief._CORE, *Belief._MAP):
        assert name in words
        assert isinstance(getattr(Belief, name), property)


def test_an_empty_scan():
    scan = Scan.empty(2, 3)
    assert scan.ranges.shape == scan.bearings.shape == scan.labels.shape == (2, 3)
    assert scan.count.tolist() == [0, 0]
    assert scan.complete.all()
    assert (scan.labels == UNKNOWN).all()
