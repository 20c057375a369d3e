"""The same work as one step of the environment in good, clean NumPy: what most people would write today.

World (robot, target, sensor), joint EKF over robot, target and landmarks with one 2 x 2 update per return, errors,
NEES, observation and reward. No class hierarchy, no copies that can be avoided, no n x n x n product: predictions touch
only the rows and columns that change, an update is a rank-2 downdate.
"""

import math

import numpy as np

ROBOT, TARGET = slice(0, 3), slice(3, 7)


class NumpyEnv:
    """The scenario `open` with known association, for one robot."""

    def __init__(self, landmarks, pose, target, *, max_range, dt=0.1, seed=0):
        self.landmarks = np.array(landmarks)
        self.pose, self.target = np.array(pose, dtype=np.float64), np.array(target, dtype=np.float64)
        self.max_range, self.dt = max_range, dt
        self.rng = np.random.default_rng(seed)
        self.mu = np.concatenate([pose, np.zeros(4)])
        self.P = np.zeros((7, 7))
        self.row = np.full(len(landmarks), -1)  # where a landmark is in the state
        self.target_known = False
        self.goal, self.steps, self.since = self.rng.uniform(-10, 10, 2), 0, 0.0

    # ------------------------------------------------------------------------------------------------------ world

    def move(self, v, w):
        n_v, n_w = self.rng.standard_normal(2)
        v_true = v + (0.02 + 0.1 * abs(v)) * n_v
        w_true = w + (0.02 + 0.1 * abs(w) + 0.05 * abs(v)) * n_w
        heading = wrap(self.pose[2] + w_true * self.dt)
        self.pose[:] = (
            self.pose[0] + v_true * self.dt * np.cos(heading),
            self.pose[1] + v_true * self.dt * np.sin(heading),
            heading,
        )
        if self.rng.random() < 0.015:
            self.goal = self.rng.uniform(-10, 10, 2)
        way = self.goal - self.target[:2]
        distance = max(np.hypot(way[0], way[1]), 1e-9)
        self.target[2:] = 0.5 * way / distance
        self.target[:2] += self.dt * self.target[2:]

    def sense(self):
        points = np.vstack([self.landmarks, self.target[:2]])
        delta = points - self.pose[:2]
        distance = np.hypot(delta[:, 0], delta[:, 1])
        seen = np.flatnonzero(distance <= self.max_range)
        noise = self.rng.standard_normal((len(seen), 2))
        r = distance[seen]
        ranges = r + (0.05 + 0.02 * r) * noise[:, 0]
        bearings = wrap(np.arctan2(delta[seen, 1], delta[seen, 0]) - self.pose[2] + 0.03 * noise[:, 1])
        return seen, ranges, bearings

    # ----------------------------------------------------------------------------------------------------- filter

    def predict(self, v, w):
        mu, P, dt = self.mu, self.P, self.dt
        heading = wrap(mu[2] + w * dt)
        c, s = np.cos(heading), np.sin(heading)
        dx, dy = v * dt * c, v * dt * s
        mu[0] += dx
        mu[1] += dy
        mu[2] = heading
        F = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
        B = np.array([[dt * c, -dy * dt], [dt * s, dx * dt], [0.0, dt]])
        std = np.array([0.02 + 0.1 * abs(v), 0.02 + 0.1 * abs(w) + 0.05 * abs(v)])
        P[ROBOT, :] = F @ P[ROBOT, :]
        P[:, ROBOT] = P[ROBOT, :].T
        P[ROBOT, ROBOT] = F @ P[ROBOT, ROBOT] + (B * std**2) @ B.T
        if self.target_known:
            mu[3:5] += dt * mu[5:7]
            P[3:5, :] += dt * P[5:7, :]
            P[:, 3:5] += dt * P[:, 5:7]
            q = 0.3**2
            P[3, 3] += q * dt**3 / 3
            P[4, 4] += q * dt**3 / 3
            P[5, 5] += q * dt
            P[6, 6] += q * dt
            for a, b in ((3, 5), (4, 6)):
                P[a, b] += q * dt**2 / 2
                P[b, a] = P[a, b]

    def update(self, seen, ranges, bearings):
        count = len(self.landmarks)
        for i, r, b in zip(seen, ranges, bearings, strict=True):
            j = (3 if self.target_known else -1) if i == count else self.row[i]
            if j >= 0:
                self.correct(j, r, b)
        for i, r, b in zip(seen, ranges, bearings, strict=True):
            if i == count and not self.target_known:
                self.target_known = True
                self.add(3, r, b)
                self.P[5, 5] = self.P[6, 6] = 0.7**2
            elif i < count and self.row[i] < 0:
                self.row[i] = len(self.mu)
                self.mu = np.append(self.mu, [0.0, 0.0])
                self.P = np.pad(self.P, (0, 2))
                self.add(self.row[i], r, b)

    def correct(self, j, r_seen, b_seen):
        """One return: W = P H' chol(S)^-T from the five rows of P that H hits, then a rank-2 downdate."""
        mu, P = self.mu, self.P
        dx, dy = float(mu[j] - mu[0]), float(mu[j + 1] - mu[1])
        square = dx * dx + dy * dy
        r = math.sqrt(square)
        A = np.array([[dx / r, dy / r], [-dy / square, dx / square]])
        HP = A @ (P[j : j + 2] - P[:2])
        HP[1] -= P[2]
        S = (HP[:, j : j + 2] - HP[:, :2]) @ A.T
        s00, s01, s11 = S[0, 0] + (0.05 + 0.02 * r) ** 2, S[0, 1] - HP[0, 2], S[1, 1] - HP[1, 2] + 0.03**2
        l00 = math.sqrt(s00)
        l10 = s01 / l00
        l11 = math.sqrt(s11 - l10 * l10)
        W = np.array([[1.0 / l00, 0.0], [-l10 / (l00 * l11), 1.0 / l11]]) @ HP
        e0 = (r_seen - r) / l00
        e1 = (wrap(b_seen - math.atan2(dy, dx) + mu[2]) - l10 * e0) / l11
        mu += e0 * W[0] + e1 * W[1]
        P -= W.T @ W
        mu[2] = wrap(mu[2])

    def add(self, j, r, b):
        mu, P = self.mu, self.P
        angle = mu[2] + b
        c, s = np.cos(angle), np.sin(angle)
        mu[j : j + 2] = mu[0] + r * c, mu[1] + r * s
        G = np.array([[1.0, 0.0, -r * s], [0.0, 1.0, r * c]])
        P[j : j + 2, :] = G @ P[ROBOT, :]
        P[:, j : j + 2] = P[j : j + 2, :].T
        Z = np.array([[c, -r * s], [s, r * c]])
        R = np.array([(0.05 + 0.02 * r) ** 2, 0.03**2])
        P[j : j + 2, j : j + 2] = G @ P[ROBOT, ROBOT] @ G.T + (Z * R) @ Z.T

    # -------------------------------------------------------------------------------- what is said about the step

    def relative(self, rows):
        """Points at rows [k] in the robot's frame with their covariances [k, 2, 2], cross terms included."""
        mu, P = self.mu, self.P
        c, s = math.cos(mu[2]), math.sin(mu[2])
        C = np.array([[c, s], [-s, c]])
        pair = rows[:, None] + np.arange(2)
        q = (mu[pair] - mu[:2]) @ C.T
        turn = np.stack([q[:, 1], -q[:, 0]], axis=1)
        cross = P[pair, :2]
        cov = C @ (P[pair[:, :, None], pair[:, None, :]] - cross - cross.swapaxes(1, 2) + P[:2, :2]) @ C.T
        lever = turn[:, :, None] * ((P[pair, 2] - P[:2, 2]) @ C.T)[:, None, :]
        return q, cov + lever + lever.swapaxes(1, 2) + P[2, 2] * turn[:, :, None] * turn[:, None, :]

    def observe(self, seen_target):
        rows = np.append(self.row[self.row >= 0], 3 if self.target_known else [])
        rows = rows.astype(int)
        q, cov = self.relative(rows)
        r = np.hypot(q[:, 0], q[:, 1])
        table = np.column_stack([r, q[:, 1] / r, q[:, 0] / r, np.sqrt(cov[:, 0, 0]), np.sqrt(cov[:, 1, 1])])
        out = np.zeros(80, dtype=np.float32)
        last = len(rows) - 1 if self.target_known else len(rows)
        nearest = np.argsort(r[:last])[:8]
        out[32 : 32 + 5 * len(nearest)] = table[nearest].ravel()
        out[72 : 72 + len(nearest)] = 1.0
        if self.target_known:
            c, s = np.cos(self.mu[2]), np.sin(self.mu[2])
            vx, vy = self.mu[5:7]
            out[:3] = 1.0, seen_target, min(self.since / 10.0, 1.0)
            out[3:11] = (*table[last, :3], c * vx + s * vy, c * vy - s * vx, *table[last, 3:],
                         cov[last, 0, 1] / (table[last, 3] * table[last, 4]))  # fmt: skip
            direction = np.arctan2(q[last, 1], q[last, 0])
            out[11 + round(direction / (np.pi / 4)) % 8] = 1.0
        std = np.sqrt(np.diag(self.P)[:3])
        out[19:26] = self.mu[0], self.mu[1], np.sin(self.mu[2]), np.cos(self.mu[2]), *std
        return np.clip(out, -5.0, 5.0)

    def measure(self):
        """Errors and NEES of robot, target and map."""
        mu, P = self.mu, self.P
        e = mu[:3] - self.pose
        e[2] = wrap(e[2])
        info = {
            "robot_error": float(np.hypot(e[0], e[1])),
            "heading_error": float(abs(e[2])),
            "pose_nees": float(e @ np.linalg.solve(P[ROBOT, ROBOT] + 1e-12 * np.eye(3), e)),
        }
        if self.target_known:
            d = mu[TARGET] - self.target
            info["target_error"] = float(np.hypot(d[0], d[1]))
            info["target_nees"] = float(d[:2] @ np.linalg.solve(P[3:5, 3:5], d[:2]))
            info["target_state_nees"] = float(d @ np.linalg.solve(P[TARGET, TARGET], d))
        known = np.flatnonzero(self.row >= 0)
        if len(known):
            rows = self.row[known]
            d = np.stack([mu[rows], mu[rows + 1]], axis=1) - self.landmarks[known]
            pair = np.stack([rows, rows + 1], axis=1)
            blocks = P[pair[:, :, None], pair[:, None, :]]
            info["landmark_error"] = float(np.sqrt(np.mean(np.sum(d * d, axis=1))))
            info["landmark_nees"] = float(
                np.mean(np.einsum("ki,ki->k", d, np.linalg.solve(blocks, d[:, :, None])[..., 0]))
            )
        return info

    def step(self, action):
        v, w = float(np.clip(action[0], -0.4, 1.0)), float(np.clip(action[1], -1.0, 1.0)) * 1.5
        self.move(v, w)
        seen, ranges, bearings = self.sense()
        self.predict(v, w)
        self.update(seen, ranges, bearings)
        seen_target = len(seen) > 0 and seen[-1] == len(self.landmarks)
        self.since = 0.0 if seen_target else self.since + self.dt
        self.steps += 1
        info = self.measure()
        error = min(info.get("target_error", 8.0), 8.0)
        distance = float(np.hypot(*(self.target[:2] - self.pose[:2])))
        reward = float(seen_target) - 0.3 * error - 0.03 * distance
        return self.observe(seen_target), reward, False, self.steps >= 400, info


def wrap(angle):
    """Within [-pi, pi)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi
