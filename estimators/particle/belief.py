"""Filling the belief's buffers from particles, lane by lane."""

import math

from estimators.kernels.jit import jit
from estimators.models import TWIST
from estimators.particle.moments import (
    direction_variance,
    landmark_moments,
    motion_moments,
    pose_moments,
    relative_moments,
    target_moments,
)


@jit
def fill_pose_lanes(pose, w, mean, cov):
    """Pose [L, 3] and covariance [L, 3, 3]."""
    for lane in range(pose.shape[0]):
        pose_moments(pose[lane], w[lane], mean[lane], cov[lane])


@jit
def fill_target_lanes(
    models, state, pose, target, log_hypothesis, w, known, mean, cov, velocity, velocity_cov, heading, heading_var,
    relative, relative_cov, relative_velocity,
):  # fmt: skip
    """The target's buffers (see `Belief`), zero on entry: they stay so where it is not known."""
    for lane in range(pose.shape[0]):
        hypotheses = state[lane].hypotheses
        known[lane] = hypotheses > 0
        if hypotheses == 0:
            continue
        twist = models[lane].target_kind == TWIST
        cloud, log_h = target[lane], log_hypothesis[lane]
        target_moments(cloud, log_h, hypotheses, w[lane], twist, mean[lane], cov[lane])
        motion_moments(
            cloud, log_h, hypotheses, w[lane], pose[lane], twist, models[lane].target_speed, velocity[lane],
            velocity_cov[lane], relative_velocity[lane],
        )  # fmt: skip
        a, b, c = (3, 4, 6) if twist else (4, 5, 8)
        relative_moments(
            cloud[:, 0], cloud[:, 1], cloud[:, a], cloud[:, b], cloud[:, c], log_h, hypotheses, pose[lane], w[lane],
            relative[lane], relative_cov[lane],
        )  # fmt: skip
        if twist:
            heading[lane], heading_var[lane] = mean[lane, 2], cov[lane, 2, 2]
        else:
            vx, vy, v_cov = mean[lane, 2], mean[lane, 3], velocity_cov[lane]
            heading[lane] = math.atan2(vy, vx)
            heading_var[lane] = direction_variance(vx, vy, v_cov[0, 0], v_cov[0, 1], v_cov[1, 1])


@jit
def fill_map_lanes(
    state, ids, used, pose, maps, w, own_maps, flat, one, count, out_ids, mapped, mean, cov, relative, relative_cov
):
    """The map's buffers (see `Belief`), empty on entry.

    Args:
        own_maps: whether each particle has a map of its own (the heaviest particle's is shown) or columns are shared.
        flat: [1, N] zeros; one: [N] scratch.
    """
    for lane in range(pose.shape[0]):
        weights, shown = w[lane], state[lane].count
        if own_maps:
            heaviest = 0
            for p in range(one.size):
                heaviest = p if w[lane, p] > w[lane, heaviest] else heaviest
                one[p] = 0.0
            one[heaviest] = 1.0
            weights, shown = one, used[lane, heaviest]
        count[lane] = shown
        for j in range(shown):
            mapped[lane, j] = True
            out_ids[lane, j] = j if own_maps else ids[lane, j]
            m, column = maps[lane, j], maps[lane, j : j + 1]
            landmark_moments(m[0], m[1], m[2], m[3], m[4], weights, mean[lane, j], cov[lane, j])
            relative_moments(
                column[:, 0], column[:, 1], column[:, 2], column[:, 3], column[:, 4], flat, 1, pose[lane], weights,
                relative[lane, j], relative_cov[lane, j],
            )  # fmt: skip
