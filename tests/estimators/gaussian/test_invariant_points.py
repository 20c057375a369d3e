"""Right-invariant filters over the spread, against a dense group filter with literal sigma points."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from estimators._recording import DT, MOTION, SENSOR, TARGET_MODEL, feed, record
from estimators.gaussian.invariant import RIEKF
from estimators.gaussian.invariant_points import RICDKF, RITaylorEKF
from estimators.interface import TARGET, Scan
from estimators.models import MotionModel, SensorModel, TargetModel
from estimators.testing import checks

J = np.array([[0.0, -1.0], [1.0, 0.0]])
TWIST = TargetModel(kind="twist", speed=0.3, turn_rate=0.1, speed_std=0.1, turn_std=0.1)
R = np.diag([SENSOR.range_std**2, SENSOR.bearing_std**2])


def wrap(angle):
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def along_group(mean, error):
    """The retraction: heading first, then points; error in right-invariant coordinates."""
    algebra = np.zeros((2 + (len(mean) - 1) // 2,) * 2)
    algebra[:2, :2], algebra[:2, 2:] = error[0] * J, error[1:].reshape(-1, 2).T
    group = expm(algebra)
    points = group[:2, :2] @ mean[1:].reshape(-1, 2).T + group[:2, 2:]
    return np.concatenate([[mean[0] + error[0]], points.T.ravel()])


class Literal:
    """Robot, constant-velocity target and landmarks; covariance over xi; sigma points through the whole group."""

    def __init__(self, pose, pose_cov, target, target_cov, moments):
        self.mean = np.concatenate([[pose[2]], pose[:2], target])
        cov = np.zeros((7, 7))
        cov[:3, :3], cov[3:, 3:] = pose_cov[np.ix_([2, 0, 1], [2, 0, 1])], target_cov
        back = np.linalg.inv(self.to_ordinary())
        self.P, self.at, self.moments = back @ cov @ back.T, {TARGET: 3}, moments

    def to_ordinary(self):
        T = np.eye(len(self.mean))
        T[1:, 0] = (self.mean[1:].reshape(-1, 2) @ J.T).ravel()
        return T

    def predict(self, control, dt):
        (v, w), F, Q = control, np.eye(len(self.P)), np.zeros_like(self.P)
        F[3:5, 5:7] = dt * np.eye(2)
        end = self.mean[0] + w * dt
        c, s = np.cos(end), np.sin(end)
        self.mean[:3] += [w * dt, v * dt * c, v * dt * s]
        self.mean[3:5] += dt * self.mean[5:7]
        G = np.zeros((len(self.P), 2))
        G[0, 1], G[1:3, 0], G[1:3, 1] = dt, dt * np.array([c, s]), v * dt * dt * np.array([-s, c])
        Q[3:7, 3:7] = TARGET_MODEL.acceleration_density**2 * np.kron(
            [[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], np.eye(2)
        )
        Q += G @ np.diag([MOTION.speed_std**2, MOTION.turn_std**2]) @ G.T
        back = np.linalg.inv(self.to_ordinary())
        self.P = F @ self.P @ F.T + back @ Q @ back.T

    def returned(self, mean, j, centre):
        dx, dy = mean[j : j + 2] - mean[1:3]
        return np.array([np.hypot(dx, dy), centre + wrap(np.arctan2(dy, dx) - mean[0] - centre)])

    def correct(self, j, z):
        """Variables in the order eta, th, all others: eta = xi_point - xi_robot, along and across the beam."""
        n = len(self.P)
        B = np.zeros((n, n))
        dx, dy = self.mean[j : j + 2] - self.mean[1:3]
        beam = np.array([[dx, dy], [-dy, dx]]) / np.hypot(dx, dy)
        B[:2, j : j + 2], B[:2, 1:3], B[2, 0] = beam, -beam, 1.0
        others = [i for i in range(1, n) if i not in (j, j + 1)]
        B[range(3, n), others] = 1.0
        columns = np.linalg.inv(B) @ np.linalg.cholesky(B @ self.P @ B.T)
        centre = np.arctan2(dy, dx) - self.mean[0]
        f = lambda eps: self.returned(along_group(self.mean, columns @ eps), j, centre)  # noqa: E731
        expected, slope, curvature = self.moments(f, n)
        S = slope @ slope.T + curvature + R
        y = z - expected
        y[1] = wrap(y[1])
        K = columns @ slope.T @ np.linalg.inv(S)
        self.mean, self.P = along_group(self.mean, K @ y), self.P - K @ S @ K.T

    def update(self, returns):
        fresh = [one for one in returns if one[2] not in self.at]
        for r, b, label in returns:
            if label in self.at:
                self.correct(self.at[label], np.array([r, b]))
        for r, b, label in fresh:
            u = np.array([np.cos(self.mean[0] + b), np.sin(self.mean[0] + b)])
            back, n = np.column_stack([u, r * J @ u]), len(self.P)
            grown = np.zeros((n + 2, n))
            grown[:n], grown[n:, 1:3] = np.eye(n), np.eye(2)
            self.P = grown @ self.P @ grown.T
            self.P[n:, n:] += back @ R @ back.T
            self.mean, self.at[label] = np.append(self.mean, self.mean[1:3] + r * u), n


def central(f, n):
    """Eqs. (9)-(12) over n columns: mean, slope by them, covariance of second order."""
    h, base, D1, D2 = math.sqrt(3.0), f(np.zeros(n)), [], []
    for step in h * np.eye(n):
        up, down = f(step), f(-step)
        D1.append((up - down) / 2.0)
        D2.append((up + down) / 2.0 - base)
    D1, D2 = np.array(D1).T, np.array(D2).T
    return base + D2.sum(axis=1) / h**2, D1 / h, (h**2 - 1.0) / h**4 * D2 @ D2.T


def net(f, n):
    """Hermite coefficients of degree 2 over the first two columns: the third moves no return."""
    x, w = np.polynomial.hermite_e.hermegauss(5)
    nodes = [(a, b, p * q / (2.0 * np.pi)) for a, p in zip(x, w, strict=True) for b, q in zip(x, w, strict=True)]
    values = [(f(np.eye(n)[0] * a + np.eye(n)[1] * b), a, b, p) for a, b, p in nodes]
    basis = [lambda a, b: 1.0, lambda a, b: a, lambda a, b: b,
             lambda a, b: (a * a - 1.0) / math.sqrt(2.0), lambda a, b: (b * b - 1.0) / math.sqrt(2.0),
             lambda a, b: a * b]  # fmt: skip
    theta = np.array([sum(p * g(a, b) * value for value, a, b, p in values) for g in basis])
    slope = np.zeros((2, n))
    slope[:, :2] = theta[1:3].T
    return theta[0], slope, theta[3:].T @ theta[3:]


BOTH = pytest.mark.parametrize(
    ("cls", "moments"), [(RICDKF, central), (RITaylorEKF, net)], ids=["ri-cdkf", "ri-taylor"]
)


@BOTH
def test_whole_run_is_the_literal_one(cls, moments):
    recording, cov, target_cov = record(1, 30, seed=3), np.diag([0.05, 0.05, 0.04]), 0.05 * np.eye(4)
    at_once = replace(TARGET_MODEL, iterate_spread=math.inf)  # the literal filter does not iterate
    estimator = cls(MOTION, SENSOR, at_once, max_landmarks=8)
    estimator.reset(recording.start, cov, seeds=[0], target=recording.target_start, target_cov=target_cov)
    feed(estimator, recording)
    literal = Literal(recording.start[0], cov, recording.target_start[0], target_cov, moments)
    for step in recording.steps:
        literal.predict(step.control[0], DT)
        n = step.scan.count[0]
        scan = step.scan
        literal.update(list(zip(scan.ranges[0, :n], scan.bearings[0, :n], scan.labels[0, :n], strict=True)))
    ids = estimator.ids[0, : estimator.count[0]]
    rows = [0, 1, 2, *range(3, 7), *(literal.at[label] + d for label in ids for d in (0, 1))]
    T = literal.to_ordinary()
    mean, joint = estimator.joint(0)
    order = [2, 0, 1, *range(3, len(mean))]
    gap = mean[order] - literal.mean[rows]
    gap[0] = wrap(gap[0])
    np.testing.assert_allclose(gap, 0.0, atol=1e-9)
    np.testing.assert_allclose(joint[np.ix_(order, order)], (T @ literal.P @ T.T)[np.ix_(rows, rows)], atol=1e-9)


@BOTH
def test_turning_the_world_turns_the_estimate(cls, moments):
    recording = record(1, 30)
    turn = np.array([[np.cos(2.0), -np.sin(2.0)], [np.sin(2.0), np.cos(2.0)]])
    beliefs = []
    for moved in (False, True):
        pose = recording.start.copy()
        if moved:
            pose[0, :2], pose[0, 2] = turn @ pose[0, :2] + [5.0, -3.0], pose[0, 2] + 2.0
        estimator = cls(MOTION, SENSOR, TWIST, max_landmarks=8)
        estimator.reset(pose, np.zeros((3, 3)), seeds=[0])
        feed(estimator, recording)
        belief = estimator.belief
        beliefs.append((belief.pose[0, :2].copy(), belief.target_rel[0].copy(), belief.landmark_rel[0].copy()))
    plain, other = beliefs
    np.testing.assert_allclose(other[0], turn @ plain[0] + [5.0, -3.0], atol=1e-8)
    np.testing.assert_allclose(other[1], plain[1], atol=1e-8)
    np.testing.assert_allclose(other[2], plain[2], atol=1e-8)


@BOTH
def test_with_little_noise_it_is_the_right_invariant_ekf(cls, moments):
    """What parts them falls with the covariance: a tenth of the deviations, a hundredth of the gap."""
    gaps = []
    for scale in (1e-1, 1e-2):
        motion = MotionModel(speed_std=0.5 * scale, turn_std=0.5 * scale)
        sensor = SensorModel(range_std=0.2 * scale, bearing_std=0.1 * scale)
        found = []
        for kind in (cls, RIEKF):
            estimator = kind(motion, sensor, None, max_landmarks=4)
            estimator.reset(np.zeros(3), scale**2 * np.diag([0.1, 0.1, 0.1]), seeds=0)
            for distance in (1.0, 0.9):
                estimator.predict(np.array([[1.0, 0.2]]), 0.1)
                estimator.update(one_return(distance, 0.5))
            found.append(estimator.joint(0)[1] / scale**2)
        gaps.append(np.abs(found[0] - found[1]).max())
    assert gaps[0] < 1e-2
    assert gaps[1] < 1.2e-2 * gaps[0]


def one_return(distance, bearing):
    scan = Scan.empty(1, 1)
    scan.count[0], scan.ranges[0, 0], scan.bearings[0, 0], scan.labels[0, 0] = 1, distance, bearing, 0
    return scan


@BOTH
def test_a_landmark_known_no_better_than_it_is_near(cls, moments):
    """Straight behind, then from within its own uncertainty: finite, and no surer than the geometry allows."""
    estimator = cls(MOTION, SensorModel(range_std=0.2, bearing_std=0.1), None, max_landmarks=4)
    estimator.reset(np.zeros(3), np.diag([0.01, 0.01, 0.05]), seeds=0)
    estimator.update(one_return(0.15, -math.pi))
    estimator.update(one_return(0.2, math.nextafter(math.pi, 0.0)))
    belief = estimator.belief
    assert abs(belief.pose[0, 2]) < 1e-3
    assert belief.landmark_rel[0, 0] == pytest.approx([-0.17, 0.0], abs=0.05)
    assert belief.pose_cov[0, 2, 2] > 0.04


@pytest.mark.parametrize("h", [0.0, -1.0, math.nan, math.inf])
def test_h_must_be_a_positive_number(h):
    with pytest.raises(ValueError, match="h must be a positive number"):
        RICDKF(MOTION, SENSOR, None, max_landmarks=4, h=h)


@pytest.mark.parametrize("check", [*checks("ri-cdkf", budget=6), *checks("ri-taylor-ekf")], ids=str)
def test_the_contract_holds(check):
    check()


@pytest.mark.slow
def test_consistent_where_the_cdkf_is_not():
    """The loop of Tian et al. 2010, both with at most 10 landmarks."""
    from slam_gym.evaluation import compare

    names = ["cdkf:budget=10", "ri-cdkf:budget=10"]
    runs = compare("tian-sparse", names, runs=150, seed=20240, jobs=1, tracks=0).runs
    nees = runs.pivot(index="run", columns="estimator", values="pose_nees_mean")
    assert nees[names[0]].mean() > 4.0
    assert 2.6 < nees[names[1]].mean() < 3.4
    gain = nees[names[0]] - nees[names[1]]
    assert gain.mean() - 1.96 * gain.std() / math.sqrt(len(gain)) > 0.5
