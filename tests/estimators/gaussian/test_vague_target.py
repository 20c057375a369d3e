import numpy as np
import pytest

from estimators import make
from estimators.interface import TARGET, Scan
from estimators.models import MotionModel, SensorModel, TargetModel

LANDMARK = (2.0, -1.0)


def seen_again(name, spread, absence):
    """A standing robot sees the target ahead, loses it, and sees it on its left; the estimator afterwards."""
    estimator = make(
        name,
        MotionModel(speed_std=1e-4, turn_std=1e-4),
        SensorModel(max_range=9.0, range_std=0.05, bearing_std=0.02),
        TargetModel(acceleration_density=0.1, initial_speed_std=0.2, reinitialise_spread=spread),
        max_landmarks=2,
    )
    estimator.reset(np.zeros((1, 3)), np.diag([0.01, 0.01, 1e-4])[None], seeds=[0])
    for bearing in (0.0, 1.5):
        scan = Scan.empty(1, 2)
        scan.count[0] = 2
        scan.ranges[0] = 1.0, np.hypot(*LANDMARK)
        scan.bearings[0] = bearing, np.arctan2(LANDMARK[1], LANDMARK[0])
        scan.labels[0] = TARGET, 0
        estimator.update(scan)
        if bearing == 0.0:
            for _ in range(int(absence / 0.1)):
                estimator.predict(np.zeros((1, 2)), 0.1)
    return estimator


@pytest.mark.parametrize("name", ["ekf", "fej-ekf", "ri-ekf", "cdkf"])
def test_a_vague_target_starts_anew_from_the_return(name):
    found = seen_again(name, 0.5, absence=60.0)
    truth = np.array([np.cos(1.5), np.sin(1.5)])
    np.testing.assert_allclose(found.belief.target_position[0], truth, atol=0.1)
    assert found.counts["reinitialised"][0] == 1
    joint = found.belief.joint(0)[1]
    assert np.linalg.eigvalsh(joint).min() > -1e-12
    assert np.trace(found.belief.target_position_cov[0]) < 0.05
    assert abs(joint[0, 3]) > 1e-3  # it hangs on the robot's pose


@pytest.mark.parametrize("name", ["ekf", "cdkf"])
def test_a_target_seen_a_moment_ago_does_not(name):
    plain, ready = (seen_again(name, spread, absence=0.5) for spread in (np.inf, 0.5))
    np.testing.assert_array_equal(plain.belief.joint(0)[1], ready.belief.joint(0)[1])
    assert ready.counts["reinitialised"][0] == 0
