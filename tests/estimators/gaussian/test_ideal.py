import numpy as np
import pytest

from estimators._recording import DT, MOTION, SENSOR, TARGET_MODEL, feed, record, start
from estimators.gaussian.ideal import IdealEKF
from estimators.models import TargetModel
from estimators.testing import checks


@pytest.mark.parametrize("check", checks("ideal-ekf"), ids=str)
def test_contract(check):
    check()


@pytest.mark.parametrize("model", [None, TARGET_MODEL], ids=["alone", "constant-velocity"])
def test_whole_run_against_dense_matrices(model, dense_filter, run_dense, compare_joint):
    recording = record(2, 40)
    cov, target_cov = np.zeros((3, 3)), 0.01 * np.eye(4)
    estimator = IdealEKF(MOTION, SENSOR, model, num_lanes=2, max_landmarks=8)
    given = {} if model is None else {"target": recording.target_start, "target_cov": target_cov}
    estimator.reset(recording.start, cov, seeds=recording.seeds, **given)
    feed(estimator, recording)
    for lane in range(2):
        prior = None if model is None else (recording.target_start[lane], target_cov)
        dense = dense_filter("ideal", MOTION, SENSOR, model, recording.start[lane], cov, prior)
        compare_joint(estimator, lane, run_dense(dense, recording, lane, DT))


def test_twist_target_is_linearised_at_its_true_displacement():
    recording = record(1, 12)
    model = TargetModel(kind="twist", speed=0.3, turn_rate=0.0, speed_std=0.0, turn_std=0.0)
    estimator = IdealEKF(MOTION, SENSOR, model, max_landmarks=8)
    prior = np.append(recording.target_start[0, :2], 0.0)
    estimator.reset(recording.start, np.zeros((3, 3)), seeds=[0], target=prior, target_cov=np.diag([0.0, 0.0, 1.0]))
    for moved in ([0.0, 0.0], [0.0, 0.0], [0.1, -0.2]):
        truth = np.array([[1.0 + moved[0], 2.0 + moved[1], 0.3, 0.0]])
        estimator.set_truth(recording.start, truth, recording.landmarks)
        estimator.P[0, 3:5] = estimator.P[0, :, 3:5] = 0.0
        estimator.predict(np.zeros((1, 2)), DT)
    np.testing.assert_allclose(estimator.P[0, 3:5, 5], [0.2, 0.1], atol=1e-12)


def test_without_the_truth():
    recording = record(1, 2)
    estimator = IdealEKF(MOTION, SENSOR, TARGET_MODEL, max_landmarks=8)
    start(estimator, recording)
    with pytest.raises(ValueError, match="set_truth"):
        estimator.predict(recording.steps[0].control, DT)
    with pytest.raises(ValueError, match="set_truth"):
        estimator.update(recording.steps[0].scan)
