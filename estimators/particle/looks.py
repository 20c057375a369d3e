"""A proposal from all that a particle sees: returns with the points they are taken for, gathered as `looks`.

    looks [K, 10]   per return: point (x, y, xx, xy, yy), range, beam (cosine, sine), variance of range and bearing

`kind` says what is made of them: SAMPLED, `sampled.improve`; UNSCENTED, `unscented.condition_unscented`. LINEAR is
FastSLAM 2's, which `gaussian_pose` does for all particles at once.
"""

import math

from estimators.kernels.association import DROPPED, NEW, TARGET_SLOT, slot_by_label
from estimators.kernels.jit import inline, jit
from estimators.kernels.range_bearing import noise_std
from estimators.models import NO_TARGET
from estimators.particle.gaussian_pose import draw_poses
from estimators.particle.layout import OPEN, USED
from estimators.particle.map_storage import open_column
from estimators.particle.sampled import improve
from estimators.particle.target import position_rows
from estimators.particle.unscented import condition_unscented

LINEAR, SAMPLED, UNSCENTED = 0, 1, 2
LOOK = 10  # numbers per return


@inline
def look_through(look, point, p):
    """Write one particle's point into a look. point: rows of a landmark or a target."""
    p00, p01, p11 = position_rows(point)
    look[0], look[1], look[2], look[3], look[4] = point[0, p], point[1, p], p00[p], p01[p], p11[p]


@inline
def look_along(look, model, distance, bearing):
    """Write one return into a look."""
    range_std, bearing_std = noise_std(model, distance)
    look[5], look[6], look[7] = distance, math.cos(bearing), math.sin(bearing)
    look[8], look[9] = range_std * range_std, bearing_std * bearing_std


@inline
def propose_one(kind, state, p, pose, pose_cov, looks, n_z, samples, work, box):
    """One particle's proposal, written over its Gaussian; the log of what its weight is multiplied by."""
    if kind == UNSCENTED:
        return condition_unscented(pose, pose_cov, p, looks, n_z, work)
    return improve(state.key, state.step, p, pose, pose_cov, looks, n_z, samples, work, box)


@inline
def target_waits(model, state):
    """Whether the target takes no part: its heading is open, or this return may start it anew."""
    return state.hypotheses != 1 or model.reinitialise_nis < math.inf


@jit
def propose_from_looks_lanes(
    lanes, ranges, bearings, labels, count, proposed, models, state, ids, pose, pose_cov, maps, points, ancestors,
    index, target, log_w, looks, slots, kind, samples, work, box, normals,
):  # fmt: skip
    """Every particle's proposal, weight and draw from a sweep whose returns say what they are.

    Args:
        proposed: [L, K] written, for the update that follows.
        looks: [K, 10] scratch; slots: [K] integer scratch; samples: [S, 4] scratch; work: [12, 3] scratch.
        box: [3] see `sampled`.
    """
    for lane in lanes:
        usable, taken, has_target = 0, 0, models[lane].target_kind != NO_TARGET
        for k in range(count[lane]):
            proposed[lane, k] = OPEN
            distance, bearing = ranges[lane, k], bearings[lane, k]
            slot = slot_by_label(ids, lane, state[lane].count, labels[lane, k], distance, bearing, has_target)
            usable += slot != DROPPED
            if slot == DROPPED or slot == NEW or (slot == TARGET_SLOT and target_waits(models[lane], state[lane])):
                continue
            if slot != TARGET_SLOT:
                open_column(slot, maps[lane], points[lane], ancestors[lane], index[lane])
            look_along(looks[taken], models[lane], distance, bearing)
            slots[taken] = slot
            proposed[lane, k] = USED
            taken += 1
        for p in range(log_w.shape[1] if taken > 0 else 0):
            for i in range(taken):
                point = target[lane, 0] if slots[i] == TARGET_SLOT else maps[lane, index[lane, 0, slots[i]]]
                look_through(looks[i], point, p)
            log_w[lane, p] += propose_one(
                kind, state[lane], p, pose[lane], pose_cov[lane], looks, taken, samples, work, box
            )
        if usable > 0:
            draw_poses(state[lane].key, state[lane].step, pose[lane], pose_cov[lane], normals)
