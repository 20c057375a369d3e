"""UKF-SLAM against FilterPy's sigma points and transform, over the five variables of each function."""

import math

import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints, unscented_transform

from estimators._recording import MOTION, SENSOR
from estimators.gaussian.unscented import UKF
from estimators.interface import TARGET, Scan
from estimators.models import TargetModel
from estimators.testing import checks

TWIST = TargetModel(kind="twist", speed=0.3, turn_rate=0.1, speed_std=0.2, turn_std=0.2, iterate_spread=np.inf)


class FilterPySLAM:
    """Robot, twist target and landmarks; what a function does not depend on follows by regression."""

    def __init__(self, pose, pose_cov, target, target_cov, settings):
        self.mu, self.P, self.at = np.append(pose, target), np.zeros((6, 6)), {TARGET: 3}
        self.P[:3, :3], self.P[3:, 3:] = pose_cov, target_cov
        self.points = MerweScaledSigmaPoints(5, **settings)

    def through(self, f, rows, noise=()):
        rows, n = list(rows), len(self.mu)
        cov = np.zeros((5, 5))
        cov[: len(rows), : len(rows)] = self.P[np.ix_(rows, rows)]
        cov[range(len(rows), 5), range(len(rows), 5)] = np.square(noise)
        x = np.append(self.mu[rows], np.zeros(len(noise)))
        sigmas = self.points.sigma_points(x, cov)
        values = np.array([f(s[: len(rows)], s[len(rows) :]) for s in sigmas])
        mean, spread = unscented_transform(values, self.points.Wm, self.points.Wc)
        few = sum(w * np.outer(s - x, v - mean) for w, s, v in zip(self.points.Wc, sigmas, values, strict=True))
        with_few = np.zeros((n, 5))
        with_few[:, : len(rows)] = self.P[:, rows]
        return mean, spread, with_few @ np.linalg.solve(cov, few)

    def move(self, rows, control, std, dt):
        def unicycle(x, e):
            v, w = np.add(control, e)
            end = x[2] + w * dt
            return np.array([x[0] + v * dt * np.cos(end), x[1] + v * dt * np.sin(end), end])

        mean, cov, cross = self.through(unicycle, rows, std)
        self.mu[rows], self.P[rows, :], self.P[:, rows], self.P[np.ix_(rows, rows)] = mean, cross.T, cross, cov

    def predict(self, control, dt):
        self.move([0, 1, 2], control, [MOTION.speed_std, MOTION.turn_std], dt)
        self.move([3, 4, 5], [TWIST.speed, TWIST.turn_rate], [TWIST.speed_std, TWIST.turn_std], dt)

    def update(self, label, r, b):
        if label not in self.at:
            self.add(label, r, b)
            return
        j = self.at[label]

        def h(x, _):
            dx, dy = x[3:] - x[:2]
            return np.array([math.hypot(dx, dy), math.atan2(dy, dx) - x[2]])

        mean, cov, cross = self.through(h, [0, 1, 2, j, j + 1])
        S = cov + np.diag([SENSOR.range_std**2, SENSOR.bearing_std**2])
        K = cross @ np.linalg.inv(S)
        self.mu, self.P = self.mu + K @ (np.array([r, b]) - mean), self.P - K @ S @ K.T

    def add(self, label, r, b):
        def point(x, e):
            return x[:2] + (r + e[0]) * np.array([np.cos(x[2] + b + e[1]), np.sin(x[2] + b + e[1])])

        mean, cov, cross = self.through(point, [0, 1, 2], [SENSOR.range_std, SENSOR.bearing_std])
        self.at[label] = len(self.mu)
        self.mu, self.P = np.append(self.mu, mean), np.block([[self.P, cross], [cross.T, cov]])


def one_return(label, distance, bearing):
    scan = Scan.empty(1, 1)
    scan.count[0], scan.ranges[0, 0], scan.bearings[0, 0], scan.labels[0, 0] = 1, distance, bearing, label
    return scan


@pytest.mark.parametrize(
    "settings", [{"alpha": 1.0, "beta": 0.0, "kappa": 0.0}, {"alpha": 0.7, "beta": 2.0, "kappa": 1.0}], ids=str
)
def test_it_is_filterpys_transform(settings):
    pose_cov, target_cov = np.diag([0.1, 0.2, 0.05]), np.diag([0.3, 0.1, 0.4])
    pose, target = np.array([1.0, 2.0, 0.4]), np.array([4.0, 1.0, -0.3])
    estimator = UKF(MOTION, SENSOR, TWIST, max_landmarks=4, **settings)
    estimator.reset(pose, pose_cov, seeds=0, target=target, target_cov=target_cov)
    oracle = FilterPySLAM(pose, pose_cov, target, target_cov, settings)
    for label, r, b in ((0, 3.0, 0.5), (1, 2.0, -0.4), (TARGET, 3.0, -0.6), (0, 3.1, 0.4), (1, 2.0, -0.4)):
        estimator.predict(np.array([[1.0, 0.4]]), 0.2)
        oracle.predict([1.0, 0.4], 0.2)
        estimator.update(one_return(label, r, b))
        oracle.update(label, r, b)
    mean, cov = estimator.joint(0)
    assert mean == pytest.approx(oracle.mu, abs=1e-8)
    assert cov == pytest.approx(oracle.P, abs=1e-8)


@pytest.mark.parametrize("options", [{"alpha": 0.0}, {"alpha": math.nan}, {"beta": math.inf}, {"kappa": -5.0}], ids=str)
def test_weights_that_make_no_sense_are_refused(options):
    with pytest.raises(ValueError, match=rf"{next(iter(options))} must be .*; got"):
        UKF(MOTION, SENSOR, None, max_landmarks=4, **options)


@pytest.mark.parametrize("check", checks("ukf"), ids=str)
def test_the_contract_holds(check):
    check()
