"""Association by likelihood, in each particle for itself: every particle has a map of its own.

A return inside `match_gate` of a landmark may be its; of several the one with the least NIS + log det S; of two
returns that want the same landmark the better fitting has it and the other is left alone. A return outside `new_gate`
of everything starts a landmark. Whether a return is the target's is decided by the particles together, by weight.

Given its pose a particle's landmarks are independent, so that this is also what JCBB comes to in a particle: the joint
test's matrix is block diagonal.

The likelihood of a return that matches nothing is a density in observation space, one over the sensor's area, never
one: otherwise particles that invent landmarks win.
"""

import math

from estimators.interface import TARGET
from estimators.kernels.elementary import sincos, wrap_smooth
from estimators.kernels.existence import log_odds_at_first, log_odds_seen
from estimators.kernels.jit import inline, jit, subroutine
from estimators.kernels.range_bearing import noise_std, usable
from estimators.models import NO_TARGET
from estimators.particle.columns import assimilate, beam_cov, fit, gather_weights
from estimators.particle.existence import note_missed, remove_unlikely
from estimators.particle.gaussian_pose import (
    condition_on_point,
    conditioned,
    displacement_cov,
    displacement_rows,
    draw_poses,
)
from estimators.particle.looks import LINEAR, UNSCENTED, look_along, look_through, propose_one, target_waits
from estimators.particle.proposal import trigonometry
from estimators.particle.steps import begin_sweep, finish_sweep, likelihood_rows, take_target
from estimators.particle.target import fit_point, position_rows
from estimators.particle.unscented import assimilate_unscented, first_sighting_unscented

NOBODY, STRUCK, TO_TARGET = -1, -2, -3  # a return's slot: outside every match gate; unusable; the target's
_LOG_TWO_PI = math.log(2.0 * math.pi)


@jit
def update_nearest_lanes(
    lanes, ranges, bearings, labels, count, complete, models, state, pose, pose_cov, maps, used, exists, target,
    log_hypothesis, log_w, w, scratch, normals, cost, nearest, slot, share, match_gate, new_gate, limit, islands,
    threshold, how,
):  # fmt: skip
    """Take in one sweep whose labels are not looked at, but for `TARGET`.

    Args:
        pose_cov: [L, 6, N] where poses are conditioned on the sweep and then drawn, [L, 0, N] where they are drawn.
        cost, nearest: [K, N] scratch: NIS + log det S of the best match, and the least NIS to anything.
        slot: [K, N] integer scratch. share: [K] scratch.
        exists: [L, M or 0, N] log odds of existence; limit: those below which a landmark is removed.
        how: the proposal's kind, room for its looks, samples, work, box; see `looks`.

    Returns:
        Whether some lane is to be resampled.
    """
    kind, looks, samples, work, box = how
    is_due = False
    for lane in lanes:
        n_z = count[lane]
        begin_sweep(pose[lane], scratch)
        for k in range(n_z):
            _begin_return(
                lane, ranges[lane, k], bearings[lane, k], labels[lane, k], models[lane], state, pose[lane],
                pose_cov[lane], target[lane], log_hypothesis[lane], scratch, cost[k], nearest[k], slot[k], match_gate,
            )  # fmt: skip
            share[k] = 0.0
            if slot[k, 0] == NOBODY:
                share[k] = _match(
                    ranges[lane, k], bearings[lane, k], models[lane], state[lane].count, pose[lane],
                    pose_cov[lane], maps[lane], used[lane], w[lane], scratch, cost[k], nearest[k], slot[k], match_gate,
                    new_gate,
                )  # fmt: skip
        _give_to_target(n_z, share, slot)
        told = False
        if kind != LINEAR and n_z > 0:
            told = _propose_from_looks(
                lane, n_z, ranges[lane], bearings[lane], models[lane], state, pose[lane], pose_cov[lane], maps[lane],
                target[lane], log_w[lane], scratch, normals, cost, slot, kind, looks, samples, work, box,
            )  # fmt: skip
        elif pose_cov.shape[1] > 0 and n_z > 0:
            told = _propose(
                lane, n_z, ranges[lane], bearings[lane], models[lane], state, pose[lane], pose_cov[lane], maps[lane],
                target[lane], log_w[lane], w[lane], scratch, normals, cost, slot,
            )  # fmt: skip
        for k in range(n_z):
            if slot[k, 0] == TO_TARGET:
                gathered = take_target(
                    lane, ranges[lane, k], bearings[lane, k], models[lane], state, pose[lane], target[lane],
                    log_hypothesis[lane], log_w[lane], w[lane], scratch, likelihood_rows(scratch, not told),
                )  # fmt: skip
                if gathered == 1 and not told:
                    gather_weights(log_w[lane], scratch[2], scratch[3])
        keeps_books = exists.shape[1] > 0
        if keeps_books and complete[lane]:
            note_missed(
                n_z, ranges[lane], bearings[lane], models[lane], state[lane].count, pose[lane], maps[lane],
                exists[lane], used[lane], scratch, slot, new_gate,
            )  # fmt: skip
        _apply_all(
            lane, n_z, ranges[lane], bearings[lane], models[lane], state, pose[lane], maps[lane], used[lane],
            exists[lane], log_w[lane], w[lane], scratch, cost, nearest, slot, new_gate, pose_cov.shape[1] == 0, kind,
        )  # fmt: skip
        if keeps_books:
            removed, state[lane].count = remove_unlikely(maps[lane], exists[lane], used[lane], w[lane], limit)
            state[lane].removed += int(removed + 0.5)
        finish_sweep(lane, state, target[lane], log_hypothesis[lane], log_w[lane], w[lane], islands, threshold)
        is_due = is_due or state[lane].due != 0
    return is_due


@inline
def _begin_return(
    lane, distance, bearing, label, model, state, pose, pose_cov, target, log_hypothesis, scratch, cost, nearest, slot,
    gate,
):  # fmt: skip
    """Sort out what is not to be matched; of the rest, the fit to the target stands first. Rows [N]."""
    start = NOBODY
    if not usable(distance, bearing):
        start = STRUCK
        state[lane].dropped += 1
    elif label == TARGET:
        start = TO_TARGET if model.target_kind != NO_TARGET else STRUCK
    for p in range(slot.size):
        cost[p], nearest[p], slot[p] = math.inf, math.inf, start
    if start != NOBODY:
        return
    range_std, bearing_std = noise_std(model, distance)
    for g in range(state[lane].hypotheses):
        terms = scratch[4:11]
        p00, p01, p11 = position_rows(target[g])
        if pose_cov.shape[0] > 0:
            displacement_rows(pose, pose_cov, target[g, 0], target[g, 1], p00, p01, p11, scratch[11:14])
            p00, p01, p11 = scratch[11], scratch[12], scratch[13]
        fit_point(
            target[g, 0], target[g, 1], p00, p01, p11, terms, pose[0], pose[1], scratch[0], scratch[1], distance,
            math.cos(bearing), math.sin(bearing), range_std * range_std, bearing_std * bearing_std,
            model.iterate_spread,
        )  # fmt: skip
        for p in range(slot.size):
            nis = terms[5, p]
            nearest[p] = min(nearest[p], nis)
            if nis <= gate and math.exp(log_hypothesis[g, p]) > 0.01:
                cost[p] = min(cost[p], nis + math.log(terms[6, p]))


@subroutine
def _match(
    distance, bearing, model, count, pose, pose_cov, maps, used, w, scratch, cost, nearest, slot, match_gate, new_gate
):
    """The best landmark of one return in every particle; returns the weight of those that prefer the target."""
    range_std, bearing_std = noise_std(model, distance)
    var_r, var_b = range_std * range_std, bearing_std * bearing_std
    cb, sb = math.cos(bearing), math.sin(bearing)
    as_target = scratch[11]
    for p in range(slot.size):
        as_target[p], cost[p] = cost[p], math.inf
    for j in range(count):
        mx, my, pxx, pxy, pyy = maps[j, 0], maps[j, 1], maps[j, 2], maps[j, 3], maps[j, 4]
        for p in range(slot.size):
            if j >= used[p]:
                continue
            beam_x, beam_y = cb * scratch[0, p] - sb * scratch[1, p], sb * scratch[0, p] + cb * scratch[1, p]
            dx, dy = mx[p] - pose[0, p], my[p] - pose[1, p]
            ex, ey = dx - distance * beam_x, dy - distance * beam_y
            p00, p01, p11 = _seen(dx, dy, pxx[p], pxy[p], pyy[p], pose_cov, p)
            spread = p00 + p11 + var_r + distance * distance * var_b
            if ex * ex + ey * ey > 2.0 * new_gate * spread:  # far outside: most pairs end here
                continue
            _, _, _, _, _, nis, det = fit(dx, dy, p00, p01, p11, distance, beam_x, beam_y, var_r, var_b)
            nearest[p] = min(nearest[p], nis)
            if nis <= match_gate:
                value = nis + math.log(det)
                if value < cost[p]:
                    cost[p], slot[p] = value, j
    share = 0.0
    for p in range(slot.size):
        share += w[p] if as_target[p] < cost[p] else 0.0
    return share


@inline
def _seen(dx, dy, pxx, pxy, pyy, pose_cov, p):
    """A landmark's covariance as one particle sees it: with its pose's, where that is not a point."""
    if pose_cov.shape[0] == 0:
        return pxx, pxy, pyy
    return displacement_cov(
        dx, dy, pxx, pxy, pyy, pose_cov[0, p], pose_cov[1, p], pose_cov[2, p], pose_cov[3, p], pose_cov[4, p],
        pose_cov[5, p],
    )  # fmt: skip


@subroutine
def _propose(
    lane, n_z, ranges, bearings, model, state, pose, pose_cov, maps, target, log_w, w, scratch, normals, cost, slot
):
    """FastSLAM 2: condition every pose on what its particle has matched, weigh it, draw it.

    Returns whether the target's return is in it.
    """
    told = False
    for k in range(n_z):
        if slot[k, 0] == TO_TARGET and state[lane].hypotheses == 1:
            p00, p01, p11 = position_rows(target[0])
            told = condition_on_point(
                pose, pose_cov, target[0, 0], target[0, 1], p00, p01, p11, w, scratch, scratch[2:4], ranges[k],
                bearings[k], model, model.reinitialise_nis,
            )  # fmt: skip
            if told:
                gather_weights(log_w, scratch[2], scratch[3])
    for k in range(n_z):
        range_std, bearing_std = noise_std(model, ranges[k])
        var_r, var_b = range_std * range_std, bearing_std * bearing_std
        cb, sb = math.cos(bearings[k]), math.sin(bearings[k])
        for p in range(w.size):
            j = slot[k, p]
            if j < 0 or not _wins(k, p, n_z, cost, slot):
                continue
            beam_x, beam_y = cb * scratch[0, p] - sb * scratch[1, p], sb * scratch[0, p] + cb * scratch[1, p]
            dx, dy = maps[j, 0, p] - pose[0, p], maps[j, 1, p] - pose[1, p]
            p00, p01, p11 = _seen(dx, dy, maps[j, 2, p], maps[j, 3, p], maps[j, 4, p], pose_cov, p)
            b0, b1, a00, a01, a11, nis, det = fit(dx, dy, p00, p01, p11, ranges[k], beam_x, beam_y, var_r, var_b)
            (
                step_x, step_y, step_h, pose_cov[0, p], pose_cov[1, p], pose_cov[2, p], pose_cov[3, p], pose_cov[4, p],
                pose_cov[5, p],
            ) = conditioned(
                dx, dy, pose_cov[0, p], pose_cov[1, p], pose_cov[2, p], pose_cov[3, p], pose_cov[4, p], pose_cov[5, p],
                b0, b1, a00, a01, a11,
            )  # fmt: skip
            pose[0, p] += step_x
            pose[1, p] += step_y
            pose[2, p] = wrap_smooth(pose[2, p] + step_h)
            log_w[p] -= 0.5 * (nis + math.log(det)) + _LOG_TWO_PI
            scratch[1, p], scratch[0, p] = sincos(pose[2, p])
    draw_poses(state[lane].key, state[lane].step, pose, pose_cov, normals)
    trigonometry(pose[2], scratch[0], scratch[1])
    return told


@subroutine
def _propose_from_looks(
    lane, n_z, ranges, bearings, model, state, pose, pose_cov, maps, target, log_w, scratch, normals, cost, slot, kind,
    looks, samples, work, box,
):  # fmt: skip
    """Another proposal (`looks`) of what each particle has matched; returns whether the target's return is in it."""
    told = False
    for p in range(log_w.size):
        seen, landmarks = 0, 0
        for k in range(n_z):
            j = slot[k, p]
            if j == TO_TARGET and not target_waits(model, state[lane]):
                look_through(looks[seen], target[0], p)
                told = True
            elif j >= 0 and _wins(k, p, n_z, cost, slot):
                look_through(looks[seen], maps[j], p)
                landmarks += 1
            else:
                continue
            look_along(looks[seen], model, ranges[k], bearings[k])
            seen += 1
        log_w[p] += propose_one(kind, state[lane], p, pose, pose_cov, looks, seen, samples, work, box)
        log_w[p] -= landmarks * _LOG_TWO_PI
    draw_poses(state[lane].key, state[lane].step, pose, pose_cov, normals)
    trigonometry(pose[2], scratch[0], scratch[1])
    return told


@inline
def _give_to_target(n_z, share, slot):
    """The return that most weight, and more than half, takes for the target's is the target's, unless one says so."""
    best = -1
    for k in range(n_z):
        if slot[k, 0] == TO_TARGET:
            return
        if share[k] > 0.5 and (best < 0 or share[k] > share[best]):
            best = k
    if best >= 0:
        for p in range(slot.shape[1]):
            slot[best, p] = TO_TARGET


@subroutine
def _apply_all(
    lane, n_z, ranges, bearings, model, state, pose, maps, used, exists, log_w, w, scratch, cost, nearest, slot,
    new_gate, weigh, kind,
):  # fmt: skip
    """Every return into every particle's map; its likelihood into the weights if `weigh` (else it is there already)."""
    extent = model.max_range
    if not extent < math.inf:
        extent = 0.0
        for k in range(n_z):
            extent = max(extent, ranges[k])
    log_nothing = -math.log(extent * model.field_of_view)
    for k in range(n_z):
        if slot[k, 0] == STRUCK or slot[k, 0] == TO_TARGET:
            continue
        range_std, bearing_std = noise_std(model, ranges[k])
        var_r, var_b = range_std * range_std, bearing_std * bearing_std
        cb, sb = math.cos(bearings[k]), math.sin(bearings[k])
        full, left = 0, 0.0
        for p in range(w.size):
            x, y = pose[0, p], pose[1, p]
            beam_x, beam_y = cb * scratch[0, p] - sb * scratch[1, p], sb * scratch[0, p] + cb * scratch[1, p]
            j = slot[k, p]
            if j >= 0 and _wins(k, p, n_z, cost, slot):
                log_likelihood = _update_one(maps[j], p, x, y, ranges[k], beam_x, beam_y, var_r, var_b, kind)
                log_w[p] += log_likelihood if weigh else 0.0
                if exists.shape[0] > 0:
                    exists[j, p] = log_odds_seen(model, exists[j, p], ranges[k], log_likelihood)
                continue
            log_w[p] += log_nothing
            if nearest[k, p] <= new_gate:
                left += w[p]
            elif used[p] == maps.shape[0]:
                full = 1
            else:
                _start_one(maps[used[p]], p, x, y, ranges[k], beam_x, beam_y, var_r, var_b, kind)
                if exists.shape[0] > 0:
                    exists[used[p], p] = log_odds_at_first(model)
                used[p] += 1
                state[lane].count = max(state[lane].count, used[p])
        state[lane].overflow += full
        state[lane].dropped += left > 0.5


@inline
def _wins(k, p, n_z, cost, slot):
    """Whether no other return fits this particle's landmark better."""
    for other in range(n_z):
        if other != k and slot[other, p] == slot[k, p]:
            if cost[other, p] < cost[k, p] or (cost[other, p] == cost[k, p] and other < k):
                return False
    return True


@inline
def _update_one(m, p, x, y, distance, beam_x, beam_y, var_r, var_b, kind):
    """One landmark's filter in one particle; returns the return's log likelihood."""
    dx, dy = m[0, p] - x, m[1, p] - y
    if kind == UNSCENTED:
        step_x, step_y, m[2, p], m[3, p], m[4, p], nis, det = assimilate_unscented(
            dx, dy, m[2, p], m[3, p], m[4, p], distance, beam_x, beam_y, var_r, var_b
        )
    else:
        step_x, step_y, m[2, p], m[3, p], m[4, p], nis, det = assimilate(
            dx, dy, m[2, p], m[3, p], m[4, p], distance, beam_x, beam_y, var_r, var_b
        )
    m[0, p] += step_x
    m[1, p] += step_y
    return -0.5 * (nis + math.log(det)) - _LOG_TWO_PI


@inline
def _start_one(m, p, x, y, distance, beam_x, beam_y, var_r, var_b, kind):
    """A landmark's first sighting in one particle."""
    if kind == UNSCENTED:
        dx, dy, m[2, p], m[3, p], m[4, p] = first_sighting_unscented(beam_x, beam_y, distance, var_r, var_b)
    else:
        dx, dy = distance * beam_x, distance * beam_y
        m[2, p], m[3, p], m[4, p] = beam_cov(beam_x, beam_y, distance, var_r, var_b)
    m[0, p], m[1, p] = x + dx, y + dy
