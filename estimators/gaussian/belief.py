"""From the joint Gaussian to the belief's buffers: one kernel for robot and target, one for the map."""

import math

from estimators.kernels.borrow import borrow
from estimators.kernels.gaussian import ROBOT
from estimators.kernels.jit import inline, subroutine
from estimators.kernels.linalg import nearest_covariance
from estimators.models import TWIST

FULL_CIRCLE_VARIANCE = math.pi**2 / 3.0  # of a heading about which nothing is known


@inline
def relative(mu, P, lane, j, c, s):
    """The point at row j in the robot's frame: (x, y) and its covariance (xx, xy, yy), cross terms included.

    q = C'(l - p), with Jacobian C'[-I, -J(l - p), I] over robot position, heading and the point; c, s are the
    cosine and sine of the robot's heading. Where both are known far less well than one to the other, less than
    rounding may be left of the difference: it is a covariance all the same (`nearest_covariance`).
    """
    dx, dy = mu[lane, j] - mu[lane, 0], mu[lane, j + 1] - mu[lane, 1]
    f0, f1, turn = P[lane, j, 2] - P[lane, 0, 2], P[lane, j + 1, 2] - P[lane, 1, 2], P[lane, 2, 2]
    e00 = P[lane, j, j] - 2.0 * P[lane, j, 0] + P[lane, 0, 0] + 2.0 * dy * f0 + dy * dy * turn
    e11 = P[lane, j + 1, j + 1] - 2.0 * P[lane, j + 1, 1] + P[lane, 1, 1] - 2.0 * dx * f1 + dx * dx * turn
    e01 = P[lane, j, j + 1] - P[lane, j, 1] - P[lane, j + 1, 0] + P[lane, 0, 1] - dx * f0 + dy * f1 - dx * dy * turn
    xx = c * c * e00 + 2.0 * c * s * e01 + s * s * e11
    yy = s * s * e00 - 2.0 * c * s * e01 + c * c * e11
    xy = c * s * (e11 - e00) + (c * c - s * s) * e01
    xx, xy, yy = nearest_covariance(xx, xy, yy)
    return c * dx + s * dy, c * dy - s * dx, xx, xy, yy


@inline
def _set2(cov, lane, xx, xy, yy):
    cov[lane, 0, 0], cov[lane, 0, 1], cov[lane, 1, 0], cov[lane, 1, 1] = xx, xy, xy, yy


@inline
def _derive_velocity(mu, P, lane, model, velocity, velocity_cov, heading, heading_var):
    """World velocity and heading from the target model's own coordinates."""
    if model.target_kind == TWIST:
        speed, angle, variance = model.target_speed, mu[lane, 5], P[lane, 5, 5]
        vx, vy = speed * math.cos(angle), speed * math.sin(angle)
        velocity[lane, 0], velocity[lane, 1], heading[lane], heading_var[lane] = vx, vy, angle, variance
        _set2(velocity_cov, lane, vy * vy * variance, -vx * vy * variance, vx * vx * variance)
        return
    vx, vy = mu[lane, 5], mu[lane, 6]
    xx, xy, yy = P[lane, 5, 5], P[lane, 5, 6], P[lane, 6, 6]
    velocity[lane, 0], velocity[lane, 1] = vx, vy
    _set2(velocity_cov, lane, xx, xy, yy)
    square = vx * vx + vy * vy
    heading[lane], heading_var[lane] = 0.0, FULL_CIRCLE_VARIANCE
    if square > 0.0:
        angle = math.atan2(vy, vx)
        heading[lane] = angle if angle < math.pi else -math.pi
        u0, u1 = -vy / square, vx / square  # of the heading by the velocity; square * square could overflow
        variance = u0 * u0 * xx + 2.0 * u0 * u1 * xy + u1 * u1 * yy
        if variance < FULL_CIRCLE_VARIANCE:
            heading_var[lane] = max(variance, 0.0)


@subroutine
def fill_core(
    mu, P, models, known, pose, pose_cov, target_known, mean, cov, position, position_cov, velocity, velocity_cov,
    heading, heading_var, rel, rel_cov, rel_velocity, lanes,
):  # fmt: skip
    """Robot and target of the named lanes; see `Belief` for the buffers."""
    n_t = mean.shape[1]
    mu, P, velocity, velocity_cov = borrow(mu), borrow(P), borrow(velocity), borrow(velocity_cov)
    position_cov, rel_cov = borrow(position_cov), borrow(rel_cov)
    heading, heading_var = borrow(heading), borrow(heading_var)
    for index in range(lanes.size):
        lane = lanes[index]
        for i in range(ROBOT):
            pose[lane, i] = mu[lane, i]
            for j in range(ROBOT):
                pose_cov[lane, i, j] = P[lane, i, j]
        target_known[lane] = known[lane]
        seen = 1.0 if known[lane] else 0.0
        for i in range(n_t):
            mean[lane, i] = seen * mu[lane, ROBOT + i]
            for j in range(n_t):
                cov[lane, i, j] = seen * P[lane, ROBOT + i, ROBOT + j]
        if known[lane]:
            position[lane, 0], position[lane, 1] = mu[lane, 3], mu[lane, 4]
            _set2(position_cov, lane, P[lane, 3, 3], P[lane, 3, 4], P[lane, 4, 4])
            _derive_velocity(mu, P, lane, models[lane], velocity, velocity_cov, heading, heading_var)
            c, s = math.cos(mu[lane, 2]), math.sin(mu[lane, 2])
            rel[lane, 0], rel[lane, 1], xx, xy, yy = relative(mu, P, lane, ROBOT, c, s)
            _set2(rel_cov, lane, xx, xy, yy)
            rel_velocity[lane, 0] = c * velocity[lane, 0] + s * velocity[lane, 1]
            rel_velocity[lane, 1] = c * velocity[lane, 1] - s * velocity[lane, 0]
        else:
            heading[lane], heading_var[lane] = 0.0, 0.0
            for i in range(2):
                position[lane, i] = velocity[lane, i] = rel[lane, i] = rel_velocity[lane, i] = 0.0
            _set2(position_cov, lane, 0.0, 0.0, 0.0)
            _set2(velocity_cov, lane, 0.0, 0.0, 0.0)
            _set2(rel_cov, lane, 0.0, 0.0, 0.0)


@subroutine
def fill_map(mu, P, n_t, count, ids, landmark_count, landmark_id, landmark_mapped, mean, cov, rel, rel_cov, lanes):
    """Landmarks of the named lanes; empty slots are zero with id -1, and are left alone where they were empty.

    In a filter that has run off by a million kilometres rounding may leave no covariance: the nearest one is told.
    """
    mu, P, mean, cov, rel, rel_cov = borrow(mu), borrow(P), borrow(mean), borrow(cov), borrow(rel), borrow(rel_cov)
    for index in range(lanes.size):
        lane = lanes[index]
        landmark_count[lane] = count[lane]
        c, s = math.cos(mu[lane, 2]), math.sin(mu[lane, 2])
        for slot in range(ids.shape[1]):
            used = slot < count[lane]
            if not (used or landmark_mapped[lane, slot]):
                continue
            landmark_mapped[lane, slot] = used
            landmark_id[lane, slot] = ids[lane, slot] if used else -1
            j = ROBOT + n_t + 2 * slot
            x, y, xx, xy, yy = 0.0, 0.0, 0.0, 0.0, 0.0
            if used:
                x, y, xx, xy, yy = relative(mu, P, lane, j, c, s)
            rel[lane, slot, 0], rel[lane, slot, 1] = x, y
            rel_cov[lane, slot, 0, 0], rel_cov[lane, slot, 0, 1] = xx, xy
            rel_cov[lane, slot, 1, 0], rel_cov[lane, slot, 1, 1] = xy, yy
            mean[lane, slot, 0], mean[lane, slot, 1] = mu[lane, j], mu[lane, j + 1]
            xx, xy, yy = nearest_covariance(P[lane, j, j], P[lane, j, j + 1], P[lane, j + 1, j + 1])
            cov[lane, slot, 0, 0], cov[lane, slot, 0, 1] = xx, xy
            cov[lane, slot, 1, 0], cov[lane, slot, 1, 1] = xy, yy
