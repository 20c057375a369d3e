import numpy as np
import pytest
from scipy.linalg import expm

from estimators._recording import DT, MOTION, SENSOR, TARGET_MODEL, feed, record
from estimators.gaussian import invariant
from estimators.gaussian.invariant import RIEKF
from estimators.interface import TARGET
from estimators.kernels.jit import jit
from estimators.kernels.left_looking import CORRECTION, TURN, scratch
from estimators.models import TargetModel
from estimators.testing import checks

J = np.array([[0.0, -1.0], [1.0, 0.0]])
TWIST = TargetModel(kind="twist", speed=0.3, turn_rate=0.1, speed_std=0.1, turn_std=0.1)


@pytest.mark.parametrize("check", checks("ri-ekf"), ids=str)
def test_contract(check):
    check()


@jit
def _retract(mu, P, work, rows, n_t, count, own_heading, nis):
    invariant.retract(mu, P, work, 0, P.shape[1], rows, n_t, count, own_heading, nis)


def exponential(heading, vectors):
    """The group element of xi = (heading, one 2-vector per point): rotation and translations [2, k]."""
    algebra = np.zeros((2 + len(vectors),) * 2)
    algebra[:2, :2], algebra[:2, 2:] = heading * J, np.transpose(vectors)
    group = expm(algebra)
    return group[:2, :2], group[:2, 2:]


@pytest.mark.parametrize("angle", [0.0, 1e-6, 1e-3, 0.4, -1.3])
@pytest.mark.parametrize("n_t", [0, 3, 4])
@pytest.mark.parametrize("held", [0, 4])
@pytest.mark.parametrize("nis", [2.0, np.inf], ids=["expected", "unexpected"])
def test_retraction_is_the_group_exponential(angle, n_t, held, nis):
    """And the change of coordinates is the derivative of the new ordinary coordinates by the old.

    What the sweep's returns took off, the rows collected, leaves the covariance before.
    """
    rng = np.random.default_rng(2)
    count, n = 3, 16
    used = 3 + n_t + 2 * count
    mu, P, work = np.zeros((1, n)), np.zeros((1, n, n)), scratch(n)
    step = work[CORRECTION]
    mu[0, :used], step[:used] = 3.0 * rng.standard_normal(used), 0.2 * rng.standard_normal(used)
    work[:held, :used] = 0.1 * rng.standard_normal((held, used))
    step[2] = angle
    A = rng.standard_normal((used, used))
    P[0, :used, :used] = A @ A.T
    P[0] = (P[0] + P[0].T) / 2
    twist = n_t == 3
    points = [0, *([3, 5] if n_t == 4 else []), *(3 + n_t + 2 * slot for slot in range(count))]
    bodies = [(2, points), *([(5, [3])] if twist else [])]
    expected, M = mu[0].copy(), np.eye(n)
    for heading, rows in bodies:
        th = step[heading]
        xi = [step[j : j + 2] - J @ mu[0, j : j + 2] * th for j in rows]
        R, t = exponential(th, xi)
        for k, j in enumerate(rows):
            expected[j : j + 2] = R @ mu[0, j : j + 2] + t[:, k]
            M[j : j + 2, heading] += J @ (expected[j : j + 2] - mu[0, j : j + 2])
        expected[heading] = (mu[0, heading] + th + np.pi) % (2 * np.pi) - np.pi
    collected = work[:held, :n].copy()
    left = P[0] - collected.T @ collected
    work[TURN, :n] = left[2]  # as the update keeps it
    cov = M @ left @ M.T
    _retract(mu, P, work, held, n_t, count, twist, nis)
    np.testing.assert_allclose(mu[0], expected, atol=1e-12)
    np.testing.assert_allclose(P[0], cov, atol=1e-9)
    np.testing.assert_array_equal(P[0], P[0].T)


def test_a_correction_by_kilometres_leaves_the_digits_of_what_is_known_to_micrometres():
    """P <- M P M' against the same in numbers of twice the length: to rounding of what is left, not of the way gone."""
    rng = np.random.default_rng(3)
    count, n, used = 2, 8, 7
    mu, P, work = np.zeros((1, n)), np.zeros((1, n, n)), scratch(n)
    mu[0, :used] = 5.0 * rng.standard_normal(used)
    scales = np.array([1e-6, 1e-6, 1e-10, *[1e-6] * 4])
    A = scales[:, None] * rng.standard_normal((used, used))
    P[0, :used, :used] = A @ A.T
    P[0] = (P[0] + P[0].T) / 2
    step = work[CORRECTION]
    step[:used] = 1e4 * rng.standard_normal(used)
    step[2] = 0.3
    before, start = P[0].copy(), mu[0].copy()
    work[TURN, :n] = before[2]
    _retract(mu, P, work, 0, 0, count, False, np.inf)
    M = np.eye(n, dtype=np.longdouble)
    for j in (0, 3, 5):
        M[j : j + 2, 2] += J @ (mu[0, j : j + 2] - start[j : j + 2])
    expected = M @ before.astype(np.longdouble) @ M.T
    root = np.sqrt(np.maximum(np.diag(expected), 1e-300))
    assert (np.abs(P[0] - expected) / np.outer(root, root)).max() < 1e-13


def test_corrections_there_and_back_by_kilometres_leave_a_covariance():
    """Landmarks known to a micrometre from each other, and together to a decimetre; what is left is nearly what was."""
    rng = np.random.default_rng(4)
    count, n, used = 2, 8, 7
    mu, P, work = np.zeros((1, n)), np.zeros((1, n, n)), scratch(n)
    own = np.array([0.1, 0.1, 1e-6, 0.1, 0.1, 0.1, 0.1])
    P[0, :used, :used] = np.outer(own, own) + np.diag((1e-5 * own) ** 2)
    before = P[0].copy()
    for way in rng.standard_normal((20, used)) * 1e4:
        for sign in (1.0, -1.0):
            work[CORRECTION, :used] = sign * way
            work[CORRECTION, 2] = 0.0
            _retract(mu, P, work, 0, 0, count, False, np.inf)
            std = np.sqrt(np.diag(P[0, :used, :used]))
            assert np.linalg.eigvalsh(P[0, :used, :used] / np.outer(std, std))[0] > -1e-12
    np.testing.assert_allclose(P[0], before, rtol=1e-6, atol=1e-12)


class GroupFilter:
    """The invariant EKF as the papers write it: covariance of xi, updates through the matrix exponential.

    Columns of X: robot, target position and velocity (constant velocity), landmarks.
    """

    def __init__(self, pose, pose_cov, target, target_cov):
        self.heading, self.X = pose[2], np.column_stack([pose[:2], target[:2], target[2:]])
        ordinary = np.zeros((7, 7))
        ordinary[:3, :3] = pose_cov[np.ix_([2, 0, 1], [2, 0, 1])]
        ordinary[3:, 3:] = target_cov
        back = np.linalg.inv(self.to_ordinary())
        self.P = back @ ordinary @ back.T  # over xi = (heading, one 2-vector per column)
        self.slots = {TARGET: 1}

    def to_ordinary(self):
        """T of dx = T xi: dq = xi_q + J q dheading. Order (heading, columns)."""
        T = np.eye(1 + 2 * self.X.shape[1])
        T[1:, 0] = (J @ self.X).T.ravel()
        return T

    def predict(self, control, dt):
        v, w = control
        F = np.eye(len(self.P))
        F[3:5, 5:7] = dt * np.eye(2)  # the error of the target's position by its velocity's
        end = self.heading + w * dt
        c, s = np.cos(end), np.sin(end)
        self.P = F @ self.P @ F.T
        self.X[:, 0] += v * dt * np.array([c, s])
        self.X[:, 1] += dt * self.X[:, 2]
        self.heading = end
        G = np.zeros((len(self.P), 2))
        G[0, 1], G[1:3, 0], G[1:3, 1] = dt, dt * np.array([c, s]), v * dt * dt * np.array([-s, c])
        Q = G @ np.diag([MOTION.speed_std**2, MOTION.turn_std**2]) @ G.T
        q = TARGET_MODEL.acceleration_density**2
        Q[3:7, 3:7] = q * np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], np.eye(2))
        back = np.linalg.inv(self.to_ordinary())
        self.P += back @ Q @ back.T

    def update(self, labels, returns):
        known = [k for k, label in enumerate(labels) if label in self.slots]
        H, y = np.zeros((2 * len(known), len(self.P))), np.zeros(2 * len(known))
        for row, k in enumerate(known):
            column = self.slots[labels[k]]
            D = self.X[:, column] - self.X[:, 0]
            A = np.array([D / np.linalg.norm(D), J @ D / (D @ D)])
            rows = slice(2 * row, 2 * row + 2)
            H[rows, 1:3], H[rows, 1 + 2 * column : 3 + 2 * column] = -A, A  # nothing by the heading: it is invariant
            y[rows] = returns[k] - [np.linalg.norm(D), np.arctan2(D[1], D[0]) - self.heading]
        y[1::2] = (y[1::2] + np.pi) % (2.0 * np.pi) - np.pi
        R = np.diag(np.tile([SENSOR.range_std**2, SENSOR.bearing_std**2], len(known)))
        K = self.P @ H.T @ np.linalg.inv(H @ self.P @ H.T + R)
        xi, self.P = K @ y, (np.eye(len(self.P)) - K @ H) @ self.P
        turn, moved = exponential(xi[0], xi[1:].reshape(-1, 2))
        self.heading, self.X = self.heading + xi[0], turn @ self.X + moved
        for k, label in enumerate(labels):
            if label not in self.slots:
                self._initialise(label, *returns[k])

    def _initialise(self, label, distance, bearing):
        angle = self.heading + bearing
        u = np.array([np.cos(angle), np.sin(angle)])
        back = np.column_stack([u, distance * J @ u])
        noise = back @ np.diag([SENSOR.range_std**2, SENSOR.bearing_std**2]) @ back.T
        n = len(self.P)
        grown = np.zeros((n + 2, n))
        grown[:n], grown[n:, 1:3] = np.eye(n), np.eye(2)  # its invariant error is the robot's
        self.P = grown @ self.P @ grown.T
        self.P[n:, n:] += noise
        self.slots[label] = self.X.shape[1]
        self.X = np.column_stack([self.X, self.X[:, 0] + distance * u])


def test_whole_run_is_the_filter_on_the_group():
    recording = record(2, 40)
    cov, target_cov = np.diag([0.02, 0.02, 0.01]), 0.01 * np.eye(4)
    estimator = RIEKF(MOTION, SENSOR, TARGET_MODEL, num_lanes=2, max_landmarks=8)
    estimator.reset(recording.start, cov, seeds=[0, 1], target=recording.target_start, target_cov=target_cov)
    feed(estimator, recording)
    for lane in range(2):
        group = GroupFilter(recording.start[lane], cov, recording.target_start[lane], target_cov)
        for step in recording.steps:
            group.predict(step.control[lane], DT)
            n = step.scan.count[lane]
            returns = np.column_stack([step.scan.ranges[lane, :n], step.scan.bearings[lane, :n]])
            group.update(step.scan.labels[lane, :n].tolist(), returns)
        columns = [0, 1, 2, *(group.slots[label] for label in estimator.ids[lane, : estimator.count[lane]])]
        rows = [0, *(1 + 2 * c + d for c in columns for d in (0, 1))]
        T = group.to_ordinary()
        expected_cov = (T @ group.P @ T.T)[np.ix_(rows, rows)]
        mean, joint = estimator.joint(lane)
        order = [2, 0, 1, *range(3, len(mean))]
        gap = mean[order] - np.append(group.heading, group.X[:, columns].T.ravel())
        gap[0] = (gap[0] + np.pi) % (2.0 * np.pi) - np.pi
        np.testing.assert_allclose(gap, 0.0, atol=1e-9)
        np.testing.assert_allclose(joint[np.ix_(order, order)], expected_cov, atol=1e-9)


def test_turning_the_world_turns_the_estimate():
    """Invariance: the same data under a turned and shifted prior give the turned and shifted belief."""
    recording = record(1, 30)
    turn = np.array([[np.cos(2.0), -np.sin(2.0)], [np.sin(2.0), np.cos(2.0)]])
    beliefs = []
    for moved in (False, True):
        pose = recording.start.copy()
        if moved:
            pose[0, :2], pose[0, 2] = turn @ pose[0, :2] + [5.0, -3.0], pose[0, 2] + 2.0
        estimator = RIEKF(MOTION, SENSOR, TWIST, max_landmarks=8)
        estimator.reset(pose, np.zeros((3, 3)), seeds=[0])
        feed(estimator, recording)
        belief = estimator.belief
        beliefs.append((belief.pose[0].copy(), belief.target_position[0].copy(), belief.target_rel[0].copy(),
                        belief.landmark_rel[0].copy(), belief.landmark_rel_cov[0].copy()))  # fmt: skip
    plain, other = beliefs
    np.testing.assert_allclose(other[0][:2], turn @ plain[0][:2] + [5.0, -3.0], atol=1e-9)
    np.testing.assert_allclose(other[1], turn @ plain[1] + [5.0, -3.0], atol=1e-9)
    for a, b in zip(plain[2:], other[2:], strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)
