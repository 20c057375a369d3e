"""A dense NumPy filter as the textbook writes it: full matrices, Joseph-free, one instance per lane."""

import math

import numpy as np
import pytest

from estimators.interface import TARGET

J = np.array([[0.0, -1.0], [1.0, 0.0]])


def wrap(angle):
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


class DenseFilter:
    """EKF, FEJ-EKF or ideal EKF of robot, target and landmarks under known association; unicycle robot.

    mode: where Jacobians are taken ("ekf", "fej", "ideal"). The truth (pose, target, landmarks) is set before each
    call under "ideal".
    """

    def __init__(self, mode, motion, sensor, target, pose, pose_cov, target_prior=None):
        self.mode, self.motion, self.sensor, self.target = mode, motion, sensor, target
        self.n_t = 0 if target_prior is None else len(target_prior[0])
        self.has_target = target_prior is not None
        self.mu = np.array(pose, dtype=float)
        self.P = np.array(pose_cov, dtype=float)
        if self.has_target:
            self._extend(target_prior[0], target_prior[1], np.zeros((self.n_t, 3)))
        self.slots, self.first = {}, {}
        self.anchor = self.mu[: 3 + self.n_t].copy()
        self.past = self.truth = None

    def _extend(self, mean, cov, cross):
        self.mu = np.append(self.mu, mean)
        self.P = np.block([[self.P, cross.T], [cross, cov]])

    def predict(self, control, dt):
        n, (v, w) = len(self.mu), control
        end = self.mu[2] + w * dt
        moved = self.mu.copy()
        moved[:3] += np.array([v * dt * np.cos(end), v * dt * np.sin(end), w * dt])
        F, Q = np.eye(n), np.zeros((n, n))
        heading, start = self.mu[2], self.mu[:2]
        if self.mode == "fej":
            start = self.anchor[:2]
        column = J @ (moved[:2] - start)
        if self.mode == "ideal":
            column = J @ (self.truth[0][:2] - self.past[0][:2])
            heading = self.past[0][2]
        F[:2, 2] = column
        G = self._control_jacobian(v, w, dt, heading)
        Q[:3, :3] = G @ np.diag([self.motion.speed_std**2, self.motion.turn_std**2]) @ G.T
        if self.has_target:
            self._move_target(moved, F, Q, dt)
        self.mu, self.P = moved, F @ self.P @ F.T + Q
        self.anchor = self.mu[: 3 + self.n_t].copy()
        self.past = self.truth

    @staticmethod
    def _control_jacobian(v, w, dt, heading):
        c, s = np.cos(heading + w * dt), np.sin(heading + w * dt)
        return np.array([[dt * c, -v * dt * dt * s], [dt * s, v * dt * dt * c], [0.0, dt]])

    def _move_target(self, moved, F, Q, dt):
        if self.n_t == 4:
            q = self.target.acceleration_density**2
            F[3, 5] = F[4, 6] = dt
            moved[3:5] += dt * moved[5:7]
            Q[3:7, 3:7] = q * np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], np.eye(2))
            if self.mode == "fej":
                F[3:5, 2] = J @ (moved[3:5] - self.anchor[3:5] - dt * self.anchor[5:7])
                F[5:7, 2] = J @ (moved[5:7] - self.anchor[5:7])
            return
        v, w, heading = self.target.speed, self.target.turn_rate, self.mu[5]
        end = heading + w * dt
        moved[3:6] += [v * dt * np.cos(end), v * dt * np.sin(end), w * dt]
        F[3:5, 5] = J @ (moved[3:5] - (self.anchor if self.mode == "fej" else self.mu)[3:5])
        G = self._control_jacobian(v, w, dt, heading)
        Q[3:6, 3:6] = G @ np.diag([self.target.speed_std**2, self.target.turn_std**2]) @ G.T

    def _linear_points(self, label, j):
        """Where A, and where the heading column, take the vector from robot to point."""
        D = self.mu[j : j + 2] - self.mu[:2]
        if self.mode == "ideal":
            true = self.truth[1][:2] if label == TARGET else self.truth[2][label]
            return true - self.truth[0][:2], true - self.truth[0][:2]
        if self.mode == "fej":
            return D, (self.anchor[3:5] if label == TARGET else self.first[label]) - self.anchor[:2]
        return D, D

    def _observe(self, label, z):
        j = 3 if label == TARGET else self.slots[label]
        dx, dy = self.mu[j : j + 2] - self.mu[:2]
        y = z - [math.hypot(dx, dy), math.atan2(dy, dx) - self.mu[2]]
        y[1] = wrap(y[1])
        at, column_at = self._linear_points(label, j)
        A = np.array([at / np.linalg.norm(at), J @ at / (at @ at)])
        H = np.zeros((2, len(self.mu)))
        H[:, :2], H[:, 2], H[:, j : j + 2] = -A, -A @ J @ column_at, A
        S = H @ self.P @ H.T + np.diag([self.sensor.range_std**2, self.sensor.bearing_std**2])
        K = self.P @ H.T @ np.linalg.inv(S)
        self.mu, self.P = self.mu + K @ y, (np.eye(len(self.mu)) - K @ H) @ self.P
        self.mu[2] = wrap(self.mu[2])

    def update(self, labels, returns):
        fresh = [k for k, label in enumerate(labels) if label != TARGET and label not in self.slots]
        for k, label in enumerate(labels):
            if k not in fresh and (label != TARGET or self.has_target):
                self._observe(label, returns[k])
        for k in fresh:
            self._initialise(labels[k], *returns[k])

    def _initialise(self, label, distance, bearing):
        angle = self.mu[2] + bearing
        D = distance * np.array([np.cos(angle), np.sin(angle)])
        point = self.mu[:2] + D
        at = column_at = D
        if self.mode == "fej":
            column_at = point - self.anchor[:2]
        if self.mode == "ideal":
            at = column_at = self.truth[2][label] - self.truth[0][:2]
        back = np.linalg.inv(np.array([at / np.linalg.norm(at), J @ at / (at @ at)]))
        G = np.zeros((2, len(self.mu)))
        G[:, :2], G[:, 2] = np.eye(2), J @ column_at
        noise = back @ np.diag([self.sensor.range_std**2, self.sensor.bearing_std**2]) @ back.T
        self.slots[label], self.first[label] = len(self.mu), point
        self._extend(point, G @ self.P @ G.T + noise, G @ self.P)


@pytest.fixture(scope="session")
def dense_filter():
    """The class itself: a test directory's modules cannot be imported."""
    return DenseFilter


@pytest.fixture(scope="session")
def run_dense():
    """Run a `DenseFilter` through one lane of a recording; it is returned at the end."""

    def run(dense, recording, lane, dt):
        for step in recording.steps:
            truth = (step.pose[lane], step.target[lane], recording.landmarks[lane])
            dense.truth = truth
            if dense.past is None:
                dense.past = (recording.start[lane], recording.target_start[lane], recording.landmarks[lane])
            dense.predict(step.control[lane], dt)
            n = step.scan.count[lane]
            returns = np.column_stack([step.scan.ranges[lane, :n], step.scan.bearings[lane, :n]])
            dense.update(step.scan.labels[lane, :n].tolist(), returns)
        return dense

    return run


@pytest.fixture(scope="session")
def compare_joint():
    """A filter's joint Gaussian against the dense one's, landmark by landmark."""

    def compare(estimator, lane, dense, tolerance=1e-9):
        mean, cov = estimator.joint(lane)
        n_t = dense.n_t
        rows = [*range(3 + n_t)]
        for label in estimator.ids[lane, : estimator.count[lane]]:
            rows += [dense.slots[label], dense.slots[label] + 1]
        assert len(mean) == len(dense.mu)
        gap = mean - dense.mu[rows]
        gap[2] = wrap(gap[2])
        if n_t == 3:
            gap[5] = wrap(gap[5])
        np.testing.assert_allclose(gap, 0.0, atol=tolerance)
        np.testing.assert_allclose(cov, dense.P[np.ix_(rows, rows)], atol=tolerance)

    return compare
