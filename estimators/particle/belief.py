"""Filling the belief's buffers from particles, lane by lane."""

import math

from estimators.kernels.existence import SHOWN
from estimators.kernels.jit import jit
from estimators.models import TWIST
from estimators.particle.map_storage import read_column
from estimators.particle.moments import (
    direction_variance,
    landmark_moments,
    pose_moments,
    relative_mean,
    relative_origin,
    relative_spread,
    shares,
    target_moments,
    turned_velocity,
    velocity_moments,
    write_relative,
)
from estimators.particle.proposal import trigonometry
from estimators.particle.target import position_rows


@jit
def fill_pose_lanes(pose, pose_cov, w, scratch, mean, cov):
    """Pose [L, 3] and covariance [L, 3, 3]."""
    for lane in range(pose.shape[0]):
        trigonometry(pose[lane, 2], scratch[0], scratch[1])
        pose_moments(pose[lane], pose_cov[lane], w[lane], scratch[0], scratch[1], mean[lane], cov[lane])


@jit
def fill_target_lanes(
    models, state, pose, pose_cov, target, log_hypothesis, w, scratch, known, mean, cov, velocity, velocity_cov,
    heading, heading_var, relative, relative_cov, relative_velocity,
):  # fmt: skip
    """The target's buffers (see `Belief`), zero on entry: they stay so where it is not known."""
    cosine, sine, work, share = scratch[0], scratch[1], scratch[2:6], scratch[8:16]
    for lane in range(pose.shape[0]):
        hypotheses = state[lane].hypotheses
        known[lane] = hypotheses > 0
        if hypotheses == 0:
            continue
        twist = models[lane].target_kind == TWIST
        cloud = target[lane]
        trigonometry(pose[lane, 2], cosine, sine)
        shares(log_hypothesis[lane], hypotheses, w[lane], share)
        target_moments(cloud, hypotheses, share, twist, work, mean[lane], cov[lane])
        x0, y0 = relative_origin(cloud[0, 0, 0], cloud[0, 1, 0], pose[lane], cosine, sine)
        mx, my, s00, s01, s11 = x0, y0, 0.0, 0.0, 0.0
        for g in range(hypotheses):
            a, b = relative_mean(cloud[g, 0], cloud[g, 1], share[g], pose[lane], cosine, sine, x0, y0)
            mx, my = mx + a, my + b
        for g in range(hypotheses):
            p00, p01, p11 = position_rows(cloud[g])
            a, b, c = relative_spread(
                cloud[g, 0], cloud[g, 1], p00, p01, p11, share[g], pose[lane], pose_cov[lane], cosine, sine, mx, my
            )
            s00, s01, s11 = s00 + a, s01 + b, s11 + c
        write_relative(mx, my, s00, s01, s11, relative[lane], relative_cov[lane])
        if twist:
            velocity_moments(
                cloud, hypotheses, share, cosine, sine, models[lane].target_speed, velocity[lane], velocity_cov[lane],
                relative_velocity[lane],
            )  # fmt: skip
            heading[lane], heading_var[lane] = mean[lane, 2], cov[lane, 2, 2]
        else:
            vx, vy = mean[lane, 2], mean[lane, 3]
            turned_velocity(cloud[0, 2], cloud[0, 3], share[0], cosine, sine, relative_velocity[lane])
            velocity[lane, 0], velocity[lane, 1] = vx, vy
            for i in range(2):
                for j in range(2):
                    velocity_cov[lane, i, j] = cov[lane, 2 + i, 2 + j]
            heading[lane] = math.atan2(vy, vx)
            heading_var[lane] = direction_variance(vx, vy, cov[lane, 2, 2], cov[lane, 2, 3], cov[lane, 3, 3])


@jit
def fill_map_lanes(
    state, ids, used, pose, pose_cov, maps, points, ancestors, index, w, own_maps, exists, scratch, count, out_ids,
    mapped, mean, cov, relative, relative_cov,
):  # fmt: skip
    """The map's buffers (see `Belief`), empty on entry.

    own_maps: whether each particle has a map of its own (the heaviest particle's is shown) or columns are shared.
    exists: [L, M or 0, N] log odds of existence, where landmarks may be false alarms.
    """
    cosine, sine, weights = scratch[0], scratch[1], scratch[2]
    for lane in range(pose.shape[0]):
        trigonometry(pose[lane, 2], cosine, sine)
        heaviest = 0
        for p in range(w.shape[1]):
            heaviest = p if w[lane, p] > w[lane, heaviest] else heaviest
            weights[p] = 0.0 if own_maps else w[lane, p]
        if own_maps:
            weights[heaviest] = 1.0
        for j in range(used[lane, heaviest] if own_maps else state[lane].count):
            if exists.shape[1] > 0 and not exists[lane, j, heaviest] > SHOWN:
                continue  # likely a false alarm
            count[lane] += 1
            mapped[lane, j] = True
            out_ids[lane, j] = j if own_maps else ids[lane, j]
            m = read_column(j, maps[lane], points[lane], ancestors[lane], index[lane], scratch[3:8])
            landmark_moments(m[0], m[1], m[2], m[3], m[4], weights, mean[lane, j], cov[lane, j])
            x0, y0 = relative_origin(m[0, 0], m[1, 0], pose[lane], cosine, sine)
            a, b = relative_mean(m[0], m[1], weights, pose[lane], cosine, sine, x0, y0)
            s00, s01, s11 = relative_spread(
                m[0], m[1], m[2], m[3], m[4], weights, pose[lane], pose_cov[lane], cosine, sine, x0 + a, y0 + b
            )
            write_relative(x0 + a, y0 + b, s00, s01, s11, relative[lane, j], relative_cov[lane, j])
