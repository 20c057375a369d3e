import numpy as np
import pytest

from estimators._recording import DT, MOTION, SENSOR, TARGET_MODEL, feed, record, start
from estimators.gaussian.invariant import RIEKF
from estimators.gaussian.recorded import RecordedRIEKF
from estimators.gaussian.recorded_returns import return_noise
from estimators.gaussian.robot_errors import RobotErrors
from estimators.interface import TARGET, Scan
from estimators.kernels.jit import jit
from estimators.models import MotionModel, pack_models
from estimators.testing import checks

ERRORS = RobotErrors(
    speed_scale_std=0.05, turn_scale_std=0.04, turn_bias_std=0.02, range_scale_std=0.02, bearing_bias_std=0.01,
    turn_noise=0.02, lateral_noise=1e-3, target_time=5.0, target_pull=0.1, target_centre_x=0.4, target_centre_y=-0.2,
)  # fmt: skip


@pytest.mark.parametrize("check", checks("recorded-ri-ekf"), ids=str)
def test_contract(check):
    check()


def made(errors, cls=RecordedRIEKF, motion=MOTION, **options):
    own = {"errors": errors} if cls is RecordedRIEKF else {}
    return cls(motion, SENSOR, TARGET_MODEL, max_landmarks=8, **own, **options)


def test_without_errors_it_is_the_invariant_filter():
    recording = record(1, 60, seed=4)
    ours, plain = made(RobotErrors()), made(None, RIEKF)
    for estimator in (ours, plain):
        start(estimator, recording)
        feed(estimator, recording)
    for found, expected in zip(ours.joint(0), plain.joint(0), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-9)


def moved(x, control, dt, errors):
    """The motion of pose, target and constants as the class documents it, for a finite difference."""
    pose, (px, py, vx, vy), (dv, dw, b) = x[:3], x[3:7], x[7:10]
    turn = (control[1] * (1 + dw) + b) * dt
    way = control[0] * (1 + dv) * dt
    heading = pose[2] + turn
    px, py = px + dt * vx, py + dt * vy
    decay, pull = dt / errors.target_time, errors.target_pull * dt
    velocity = [
        vx - decay * vx - pull * (px - errors.target_centre_x),
        vy - decay * vy - pull * (py - errors.target_centre_y),
    ]
    return np.array(
        [pose[0] + way * np.cos(heading), pose[1] + way * np.sin(heading), heading, px, py, *velocity, *x[7:]]
    )


def test_prediction_is_the_linearised_motion():
    """Mean by the motion itself, covariance by its finite-difference Jacobian and the documented noise."""
    estimator, recording = made(ERRORS), record(1, 30, seed=1)
    start(estimator, recording, pose_cov=np.diag([0.01, 0.02, 0.03]))
    feed(estimator, recording)
    used = 3 + 4 + 5 + 2 * int(estimator.count[0])
    mean, cov = estimator.mu[0, :used].copy(), estimator.P[0, :used, :used].copy()
    control = np.array([0.7, -0.4])
    F = np.empty((used, used))
    for i in range(used):
        step = np.zeros(used)
        step[i] = 1e-6
        F[:, i] = (moved(mean + step, control, DT, ERRORS) - moved(mean - step, control, DT, ERRORS)) / 2e-6
    estimator.predict(control[None], DT)
    expected = moved(mean, control, DT, ERRORS)
    np.testing.assert_allclose(estimator.mu[0, :used], expected, atol=1e-12)
    way = control[0] * (1 + mean[7]) * DT
    c, s = np.cos(expected[2]), np.sin(expected[2])
    G = np.array([[c, -way * s], [s, way * c], [0.0, 1.0]])
    Q = np.zeros((used, used))
    along, turn = (MOTION.speed_std * DT) ** 2, (MOTION.turn_std * DT) ** 2 + ERRORS.turn_noise * abs(control[1]) * DT
    Q[:3, :3] = G @ np.diag([along, turn]) @ G.T
    Q[:2, :2] += ERRORS.lateral_noise * way * np.outer([-s, c], [-s, c])
    density = TARGET_MODEL.acceleration_density**2
    for axis in (3, 4):
        Q[np.ix_([axis, axis + 2], [axis, axis + 2])] += density * np.array([[DT**3 / 3, DT**2 / 2], [DT**2 / 2, DT]])
    np.testing.assert_allclose(estimator.P[0, :used, :used], F @ cov @ F.T + Q, atol=1e-9)


@jit
def _noise(models, errors, distance, age):
    return return_noise(models[0], errors[0], distance, age)


def test_noise_carries_the_information_rate_of_a_first_order_process():
    """n returns of one label, dt apart, are worth 1' C^-1 1, C the covariance of a first-order process."""
    errors = RobotErrors(range_time=4.0, bearing_time=3.0, bearing_correlated_std=0.03)
    models = np.array([pack_models(MOTION, SENSOR, TARGET_MODEL)])
    n, step, distance = 100_000, 0.5, 2.0
    r00, r11 = _noise(models, errors.pack(), distance, step)
    f, variance = np.exp(-step / errors.range_time), SENSOR.range_std**2
    information = (2.0 + (n - 2) * (1.0 - f)) / (1.0 + f) / variance  # 1' C^-1 1, C_ij = variance f^|i - j|
    assert n / r00 == pytest.approx(information, rel=1e-3)
    late = _noise(models, errors.pack(), distance, 1e9)
    assert late == pytest.approx((variance, SENSOR.bearing_std**2))
    assert SENSOR.bearing_std**2 < r11 < SENSOR.bearing_std**2 + 12.0 * errors.bearing_correlated_std**2


def one(returns):
    scan = Scan.empty(1, len(returns))
    scan.count[0] = len(returns)
    for k, (label, distance, bearing) in enumerate(returns):
        scan.labels[0, k], scan.ranges[0, k], scan.bearings[0, k] = label, distance, bearing
    return scan


def still(errors):
    estimator = made(errors, motion=MotionModel(speed_std=1e-3, turn_std=1e-3))
    estimator.reset(np.zeros(3), np.zeros((3, 3)), seeds=np.zeros(1, dtype=np.int64))
    return estimator


@pytest.mark.parametrize("label", [3, TARGET])
def test_a_label_rejected_three_times_starts_anew(label):
    """A wrong first sighting is given up for three that agree; rejected ones scattered about are not believed."""
    errors = RobotErrors(landmark_gate=30.0, target_gate=13.8, restart_after=3)
    gated = still(errors)
    for distance in (2.0, 4.0, 4.02, 3.98):
        gated.predict(np.zeros((1, 2)), 0.1)
        gated.update(one([(label, distance, 0.1)]))
    belief = gated.belief
    found = belief.target_rel[0] if label == TARGET else belief.landmark_rel[0, 0]
    assert np.hypot(*found) == pytest.approx(3.98, abs=1e-6)
    assert gated.counts["gate_rejected"][0] == 3 and gated.counts["reinitialised"][0] == 1
    scattered = still(errors)
    for distance in (2.0, 4.0, 5.0, 3.2, 5.6):
        scattered.predict(np.zeros((1, 2)), 0.1)
        scattered.update(one([(label, distance, 0.1)]))
    belief = scattered.belief
    found = belief.target_rel[0] if label == TARGET else belief.landmark_rel[0, 0]
    assert np.hypot(*found) == pytest.approx(2.0, abs=0.3)
    assert scattered.counts["reinitialised"][0] == 0


def test_constants_are_learnt():
    """A robot 5 % faster than commanded, seen against landmarks that it maps while it stands."""
    rng = np.random.default_rng(0)
    estimator = made(RobotErrors(speed_scale_std=0.1), motion=MotionModel(speed_std=0.01, turn_std=0.01))
    estimator.reset(np.zeros(3), np.zeros((3, 3)), seeds=np.zeros(1, dtype=np.int64))
    points, x = np.array([[4.0, 2.0], [5.0, -2.0], [3.0, -1.5]]), 0.0
    for k in range(120):
        speed = 0.0 if k < 40 else 0.3
        x += 1.05 * speed * DT
        estimator.predict(np.array([[speed, 0.0]]), DT)
        z = [
            (j, np.hypot(px - x, py) + 0.05 * rng.standard_normal(), np.arctan2(py, px - x) + 0.02 * rng.normal())
            for j, (px, py) in enumerate(points)
        ]
        estimator.update(one(z))
    found, std = estimator.constants["speed_scale"][0], estimator.constants["speed_scale_std"][0]
    assert std < 0.02 and abs(found - 0.05) < 3 * std


def test_wrong_errors_are_told():
    with pytest.raises(ValueError, match="errors must be a RobotErrors or a mapping of its numbers"):
        made({"colour": 3.0})
    with pytest.raises(ValueError, match=r"RobotErrors.range_time must be a number that is zero or more; got -1"):
        RobotErrors(range_time=-1.0)
