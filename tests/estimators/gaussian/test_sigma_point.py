"""CDKF-SLAM against its literal form: the whole state's Cholesky factor, every sigma point through every function."""

import math

import numpy as np
import pytest

from estimators._recording import DT, MOTION, SENSOR, TARGET_MODEL, feed, record, start
from estimators.gaussian.ekf import EKF
from estimators.gaussian.sigma_point import CDKF
from estimators.interface import TARGET, Scan
from estimators.models import MotionModel, SensorModel, TargetModel
from estimators.testing import checks

TWIST_TARGET = TargetModel(kind="twist", speed=0.3, turn_rate=0.1, speed_std=0.2, turn_std=0.2, iterate_spread=np.inf)


def wrap(angle):
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def root(P):
    """Cholesky factor of a positive semidefinite matrix, column by column."""
    L, A = np.zeros_like(P), P.copy()
    floor = 1e-14 * max(np.max(np.diag(P)), 0.0)
    for j in range(len(P)):
        if A[j, j] > floor:
            L[:, j] = A[:, j] / np.sqrt(A[j, j])
            L[:j, j] = 0.0
            A -= np.outer(L[:, j], L[:, j])
    return L


def interpolate(f, x, P, h):
    """Eqs. (9)-(12): mean, covariance, covariance with x (rows: x), of f(x), x ~ (x, P)."""
    columns = root(P).T
    base = f(x)
    mean, cov, cross = base.copy(), np.zeros((len(base), len(base))), np.zeros((len(x), len(base)))
    for s in columns:
        up, down = f(x + h * s), f(x - h * s)
        mean += (up + down - 2.0 * base) / (2.0 * h**2)
        cov += np.outer(up - down, up - down) / (4.0 * h**2)
        cov += (h**2 - 1.0) / (4.0 * h**4) * np.outer(up + down - 2.0 * base, up + down - 2.0 * base)
        cross += np.outer(s, up - down) / (2.0 * h)
    return mean, cov, cross


class Literal:
    """One lane, as the paper writes it; `few_first` puts the variables of a function at the head of the state."""

    def __init__(self, motion, sensor, target, pose, pose_cov, h, few_first):
        self.motion, self.sensor, self.target, self.h, self.few_first = motion, sensor, target, h, few_first
        self.mu, self.P = np.array(pose, dtype=float), np.array(pose_cov, dtype=float)
        self.at = {}  # label -> first row

    def through(self, f, rows, noise=()):
        """Interpolate f(variables at rows, noise inputs) over the whole state."""
        n, rows = len(self.mu), list(rows)
        order = rows + [i for i in range(n) if i not in rows] if self.few_first else list(range(n))
        place = [order.index(i) for i in rows]
        P = np.zeros((n + len(noise), n + len(noise)))
        P[:n, :n] = self.P[np.ix_(order, order)]
        P[n:, n:] = np.diag(np.square(noise))
        x = np.append(self.mu[order], np.zeros(len(noise)))
        mean, cov, cross = interpolate(lambda z: f(z[place], z[n:]), x, P, self.h)
        return mean, cov, cross[np.argsort(order)]

    def replace(self, rows, mean, cov, cross):
        """Put a function of the state in the place of rows."""
        rows = list(rows)
        self.mu[rows] = mean
        self.P[rows, :] = cross.T
        self.P[:, rows] = cross
        self.P[np.ix_(rows, rows)] = cov

    def predict(self, control, dt):
        std = np.array([self.motion.speed_std, self.motion.turn_std])
        if self.motion.noise_law == "root-second":
            std /= np.sqrt(dt)
        self.replace(range(3), *self.through(lambda x, e: self.drive(x, control + e, dt), range(3), std))
        if TARGET in self.at and self.target.kind == "twist":
            rates, std = [self.target.speed, self.target.turn_rate], [self.target.speed_std, self.target.turn_std]
            rows = range(self.at[TARGET], self.at[TARGET] + 3)
            self.replace(rows, *self.through(lambda x, e: self.unicycle(x, rates + e, dt), rows, std))
        elif TARGET in self.at:
            rows = range(self.at[TARGET], self.at[TARGET] + 4)
            F = np.eye(4) + dt * np.eye(4, k=2)
            self.replace(rows, *self.through(lambda x, e: F @ x, rows))
            q = self.target.acceleration_density**2 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
            self.P[np.ix_(rows, rows)] += np.kron(q, np.eye(2))
        self.wrap_headings()

    def drive(self, x, control, dt):
        if self.motion.kind == "unicycle":
            return self.unicycle(x, control, dt)
        (v, g), base = control, self.motion.wheelbase
        return np.add(x, [v * dt * np.cos(x[2] + g), v * dt * np.sin(x[2] + g), v * dt * np.sin(g) / base])

    @staticmethod
    def unicycle(x, control, dt):
        end = x[2] + control[1] * dt
        return np.array([x[0] + control[0] * dt * np.cos(end), x[1] + control[0] * dt * np.sin(end), end])

    def wrap_headings(self):
        self.mu[2] = wrap(self.mu[2])
        if TARGET in self.at and self.target.kind == "twist":
            self.mu[self.at[TARGET] + 2] = wrap(self.mu[self.at[TARGET] + 2])

    def update(self, returns):
        fresh = [one for one in returns if one[2] not in self.at]
        for r, b, label in returns:
            if label in self.at:
                self.correct(self.at[label], r, b)
        for r, b, label in fresh:
            self.add(label, r, b)

    def correct(self, j, r, b):
        rows = [0, 1, 2, j, j + 1]
        dx, dy = self.mu[[j, j + 1]] - self.mu[:2]
        centre = math.atan2(dy, dx) - self.mu[2]

        def h(x, _):
            dx, dy = x[3:] - x[:2]
            return np.array([math.hypot(dx, dy), wrap(math.atan2(dy, dx) - x[2] - centre)])

        mean, cov, cross = self.through(h, rows)
        S = cov + np.diag([self.sensor.range_std**2, self.sensor.bearing_std**2])
        K = cross @ np.linalg.inv(S)
        self.mu += K @ np.array([r - mean[0], wrap(b - centre - mean[1])])
        self.P -= K @ S @ K.T
        self.wrap_headings()

    def add(self, label, r, b):
        def point(x, e):
            return x[:2] + (r + e[0]) * np.array([np.cos(x[2] + b + e[1]), np.sin(x[2] + b + e[1])])

        mean, cov, cross = self.through(point, range(3), [self.sensor.range_std, self.sensor.bearing_std])
        more = np.zeros(2 if label == TARGET else 0)
        n, size = len(self.mu), 2 + len(more)
        P = np.zeros((n + size, n + size))
        P[:n, :n] = self.P
        P[:n, n : n + 2] = cross[:n]
        P[n : n + 2, :n] = cross[:n].T
        P[n : n + 2, n : n + 2] = cov
        P[n + 2 :, n + 2 :] = self.target.initial_speed_std**2 * np.eye(len(more)) if len(more) else 0.0
        self.mu, self.P, self.at[label] = np.concatenate([self.mu, mean, more]), P, n


def returns_of(scan, lane=0):
    n = scan.count[lane]
    return list(zip(scan.ranges[lane, :n], scan.bearings[lane, :n], scan.labels[lane, :n], strict=True))


def run_literal(recording, pose_cov, few_first):
    literal = Literal(MOTION, SENSOR, TARGET_MODEL, recording.start[0], pose_cov, math.sqrt(3.0), few_first)
    for step in recording.steps:
        literal.predict(step.control[0], DT)
        literal.update(returns_of(step.scan))
    return literal


def landmark_gap(estimator, literal):
    belief = estimator.belief
    means = {int(i): m for i, m in zip(belief.landmark_id[0], belief.landmark_mean[0], strict=True) if i >= 0}
    marks = {label: literal.mu[j : j + 2] for label, j in literal.at.items() if label >= 0}
    assert set(means) == set(marks)
    return max(np.linalg.norm(means[label] - marks[label]) for label in marks)


@pytest.fixture(scope="module")
def recording():
    return record(1, 60, seed=2)


COVARIANCES = [np.zeros((3, 3)), np.diag([0.04, 0.04, 0.01]), np.outer([0.2, 0.1, 0.1], [0.2, 0.1, 0.1])]


@pytest.mark.parametrize("pose_cov", COVARIANCES, ids=["known", "spread", "rank-one"])
@pytest.mark.parametrize(("few_first", "bound"), [(True, 1e-6), (False, 1e-3)], ids=["few-first", "as-printed"])
def test_a_run_agrees_with_the_literal_form(recording, pose_cov, few_first, bound):
    estimator = CDKF(MOTION, SENSOR, TARGET_MODEL, max_landmarks=10)
    start(estimator, recording, pose_cov=pose_cov)
    feed(estimator, recording)
    literal = run_literal(recording, pose_cov, few_first)
    target = literal.at[TARGET]
    assert np.linalg.norm(estimator.belief.pose[0] - literal.mu[:3]) < bound
    assert estimator.belief.pose_cov[0] == pytest.approx(literal.P[:3, :3], abs=bound)
    assert np.linalg.norm(estimator.belief.target_mean[0] - literal.mu[target : target + 4]) < bound
    assert estimator.belief.target_cov[0] == pytest.approx(
        literal.P[target : target + 4, target : target + 4], abs=bound
    )
    assert landmark_gap(estimator, literal) < bound


MOTIONS = [
    MotionModel(kind="bicycle", speed_std=0.3, turn_std=0.05, wheelbase=2.0),
    MotionModel(speed_std=0.1, turn_std=0.2, noise_law="root-second"),
]


@pytest.mark.parametrize("motion", MOTIONS, ids=["bicycle", "root-second"])
def test_a_prediction_of_robot_and_twist_target_is_the_literal_one(motion):
    pose_cov, target_cov = np.diag([0.1, 0.2, 0.05]), np.diag([0.3, 0.1, 0.4])
    pose, target = np.array([1.0, 2.0, 3.1]), np.array([4.0, 1.0, -3.1])
    estimator = CDKF(motion, SENSOR, TWIST_TARGET, max_landmarks=4)
    estimator.reset(pose, pose_cov, seeds=0, target=target, target_cov=target_cov)
    literal = Literal(motion, SENSOR, TWIST_TARGET, pose, pose_cov, math.sqrt(3.0), True)
    literal.mu, literal.P, literal.at[TARGET] = np.append(literal.mu, target), np.zeros((6, 6)), 3
    literal.P[:3, :3], literal.P[3:, 3:] = pose_cov, target_cov
    for scan in (one_return(0, 3.0, 0.5), one_return(TARGET, 3.0, -0.5), one_return(0, 3.1, 0.6)):
        estimator.predict(np.array([[1.0, 0.4]]), 0.2)
        literal.predict(np.array([1.0, 0.4]), 0.2)
        estimator.update(scan)
        literal.update(returns_of(scan))
    mean, cov = estimator.belief.joint(0)
    assert mean == pytest.approx(literal.mu, abs=1e-9)
    assert cov == pytest.approx(literal.P, abs=1e-9)


def one_return(label, distance, bearing):
    scan = Scan.empty(1, 1)
    scan.count[0] = 1
    scan.ranges[0, 0], scan.bearings[0, 0], scan.labels[0, 0] = distance, bearing, label
    return scan


def test_small_steps_and_small_spread_give_the_ekf(recording):
    """As h -> 0 the slopes become Jacobians; what is left of second order vanishes with the covariance."""
    gaps = []
    for scale in (1e-1, 1e-2):
        motion = MotionModel(speed_std=0.1 * scale, turn_std=0.1 * scale)
        sensor = SensorModel(max_range=6.0, range_std=0.05 * scale, bearing_std=0.02 * scale)
        poses = []
        for cls, options in ((CDKF, {"h": 0.03}), (EKF, {})):
            estimator = cls(motion, sensor, None, max_landmarks=10, **options)
            start(estimator, recording)
            for step in recording.steps[:12]:
                estimator.predict(step.control, DT)
                estimator.update(step.scan)
            poses.append((estimator.belief.pose[0].copy(), estimator.belief.pose_cov[0] / scale**2))
        gaps.append((np.abs(poses[0][0] - poses[1][0]).max(), np.abs(poses[0][1] - poses[1][1]).max()))
    assert gaps[0][0] < 1e-6
    assert gaps[1][0] < 1.1e-2 * gaps[0][0]
    assert gaps[1][1] < 1.1e-2 * gaps[0][1]


@pytest.mark.parametrize("h", [0.0, -1.0, math.nan, math.inf])
def test_h_must_be_a_positive_number(h):
    with pytest.raises(ValueError, match="h must be a positive number"):
        CDKF(MOTION, SENSOR, None, max_landmarks=4, h=h)


def test_a_bearing_across_the_cut_is_averaged_on_the_right_side():
    """A landmark straight behind: sigma points on both sides of +-pi."""
    estimator = CDKF(MOTION, SENSOR, None, max_landmarks=4)
    estimator.reset(np.zeros(3), np.diag([0.01, 0.01, 0.05]), seeds=0)
    estimator.update(one_return(0, 3.0, -math.pi))
    estimator.update(one_return(0, 3.0, math.nextafter(math.pi, 0.0)))
    assert estimator.belief.pose[0] == pytest.approx(np.zeros(3), abs=5e-3)
    assert estimator.belief.landmark_mean[0, 0] == pytest.approx([-2.925, 0.0], abs=2e-2)


@pytest.mark.parametrize("check", checks("cdkf", budget=6), ids=str)
def test_the_contract_holds(check):
    check()


def test_the_contract_holds_without_a_budget():
    for check in checks("cdkf"):
        check()


@pytest.mark.parametrize("seed", range(10))
def test_what_a_pose_known_along_one_line_sees_first_leaves_a_covariance(seed):
    """Heading and y vary together, x tells nearly all of y: slopes by what it does not tell are in the thousands."""
    rng = np.random.default_rng(seed)
    root = np.array([[0.15, 0.0], [-0.02, 1e-5], [0.0, 0.05]]) * rng.uniform(0.5, 1.5, (3, 2))
    estimator = CDKF(MotionModel(), SensorModel(range_std=1e-6, bearing_std=1e-7), None, max_landmarks=4)
    estimator.reset([[2.0, 4.0, 3.0]], [root @ root.T], seeds=[0])
    scan = Scan.empty(1, 4)
    scan.ranges[0], scan.bearings[0] = rng.uniform(3.0, 13.0, 4), rng.uniform(-3.0, 3.0, 4)
    scan.labels[0], scan.count[0] = range(4), 4
    estimator.update(scan)
    _, P = estimator.joint(0)
    std = np.sqrt(np.diag(P))
    assert len(P) == 11 and np.linalg.eigvalsh(P / np.outer(std, std))[0] > -1e-13
