"""The oracle of a smoother: all residuals at once, minimised by SciPy."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import least_squares

from estimators.interface import TARGET


def wrap(angle):
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


class BatchProblem:
    """Poses [K + 1, 3], constant-velocity target [K, 4] from its first sighting on, landmarks; one lane.

    A pose's motion is explained by its two control errors (u [K, 2]), so that no covariance need be inverted.
    """

    def __init__(self, recording, lane, steps, motion, sensor, target, pose_std, dt):
        self.steps, self.lane = recording.steps[:steps], lane
        self.motion, self.sensor, self.target, self.dt = motion, sensor, target, dt
        self.start, self.pose_std = recording.start[lane], pose_std
        labels = {int(label) for s in self.steps for label in s.scan.labels[lane, : s.scan.count[lane]]}
        self.slots = {label: i for i, label in enumerate(sorted(labels - {TARGET}))}
        self.landmarks = recording.landmarks[lane]
        q = target.acceleration_density**2
        cov = q * np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], np.eye(2))
        self.whiten = np.linalg.inv(np.linalg.cholesky(cov))

    def unpack(self, x):
        K, n = len(self.steps), len(self.slots)
        first, x = x[:3], x[3:]
        errors, x = x[: 2 * K].reshape(K, 2), x[2 * K :]
        states, points = x[: 4 * K].reshape(K, 4), x[4 * K :].reshape(n, 2)
        pose, poses = first, []
        for step, (dv, dw) in zip(self.steps, errors, strict=True):
            v, w = step.control[self.lane] + [dv, dw]
            end = pose[2] + w * self.dt
            pose = np.array([pose[0] + v * self.dt * np.cos(end), pose[1] + v * self.dt * np.sin(end), end])
            poses.append(pose)
        return first, errors, np.array(poses), states, points

    def residuals(self, x):
        first, errors, poses, states, points = self.unpack(x)
        out = [(first - self.start) / self.pose_std, (errors / [self.motion.speed_std, self.motion.turn_std]).ravel()]
        out.append(states[0, 2:] / self.target.initial_speed_std)
        for before, after in pairwise(states):
            expected = before + self.dt * np.append(before[2:], [0.0, 0.0])
            out.append(self.whiten @ (after - expected))
        for k, (step, pose) in enumerate(zip(self.steps, poses, strict=True)):
            n = step.scan.count[self.lane]
            for label, r, b in zip(
                step.scan.labels[self.lane, :n], step.scan.ranges[self.lane, :n], step.scan.bearings[self.lane, :n],
                strict=True,
            ):  # fmt: skip
                point = states[k, :2] if label == TARGET else points[self.slots[int(label)]]
                dx, dy = point - pose[:2]
                bearing = wrap(b - np.arctan2(dy, dx) + pose[2])
                out.append([(r - np.hypot(dx, dy)) / self.sensor.range_std, bearing / self.sensor.bearing_std])
        return np.concatenate([np.ravel(one) for one in out])

    def solve(self):
        """Mean and covariance over (last pose, target's state, landmarks by label)."""
        targets = np.array([step.target[self.lane] for step in self.steps])
        guess = [self.start, np.zeros(2 * len(self.steps)), targets.ravel()]
        guess += [self.landmarks[label] for label in self.slots]
        found = least_squares(self.residuals, np.concatenate(guess), xtol=1e-14, ftol=1e-14, gtol=1e-12)
        cov = np.linalg.inv(found.jac.T @ found.jac)

        def present(x):
            _, _, poses, states, points = self.unpack(x)
            return np.concatenate([poses[-1], states[-1], points.ravel()])

        mean = present(found.x)
        by = np.array([(present(found.x + d) - present(found.x - d)) / 2e-6 for d in 1e-6 * np.eye(len(found.x))])
        return mean, by.T @ cov @ by


@pytest.fixture(scope="session")
def batch_problem():
    """The class itself: a test directory's modules cannot be imported."""
    return BatchProblem
