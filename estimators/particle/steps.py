"""One lane's life as compiled kernels: predict, take in a sweep by its labels, resample.

Each `..._lanes` kernel loops over the lanes it is given; a lane reads and writes its own rows only, and its random
draws are functions of its own key and step, so that L lanes are L single runs bit for bit.
"""

import math

from estimators.kernels.association import DROPPED, NEW, TARGET_SLOT, slot_by_label
from estimators.kernels.borrow import borrow
from estimators.kernels.jit import jit, subroutine
from estimators.kernels.range_bearing import noise_std
from estimators.kernels.resampling import move_columns
from estimators.models import NO_TARGET, TWIST
from estimators.particle.columns import gather_weights, share_outside, sight_column, start_column, update_column
from estimators.particle.islands import draw_survivors, weigh
from estimators.particle.layout import DRAW_MOTION, HEADINGS, OPEN, REFUSED
from estimators.particle.looks import UNSCENTED
from estimators.particle.map_storage import move_particles, open_column, put_away
from estimators.particle.proposal import draw_normals, move, trigonometry
from estimators.particle.sharp import sharpen
from estimators.particle.target import (
    apply_terms,
    fit_point,
    gather_terms,
    is_too_vague,
    position_rows,
    settle,
    share_out,
    start_target,
    weigh_hypothesis,
)
from estimators.particle.unscented import start_column_unscented, update_column_unscented

FLUSH = 8  # determinants multiplied before their logarithm is taken: far from under- and overflow


@jit
def move_lanes(lanes, control, dt, models, state, pose, normals):
    """Every particle draws its own motion. control [L, 2], dt [L]."""
    pose, normals = borrow(pose), borrow(normals)
    for lane in lanes:
        if dt[lane] > 0.0:
            state[lane].step += 1
            draw_normals(state[lane].key, state[lane].step, DRAW_MOTION, normals)
            move(pose[lane], models[lane], control[lane, 0], control[lane, 1], dt[lane], normals)


@jit
def update_lanes(
    lanes, ranges, bearings, labels, count, proposed, models, state, ids, pose, maps, points, ancestors, index, target,
    log_hypothesis, log_w, w, scratch, gate, islands, threshold, kind,
):  # fmt: skip
    """Take in one sweep whose returns say what they are (known association). scratch: [23, N].

    kind: UNSCENTED (see `looks`) for landmarks by sigma points, else by Jacobians.
    proposed: [L, K] what a proposal has made of each return (see `layout`); all `OPEN` where poses are drawn blindly.
    Returns whether some lane is to be resampled.
    """
    ids, pose, maps, points, ancestors = borrow(ids), borrow(pose), borrow(maps), borrow(points), borrow(ancestors)
    index, target, log_hypothesis = borrow(index), borrow(target), borrow(log_hypothesis)
    log_w, w, scratch = borrow(log_w), borrow(w), borrow(scratch)
    is_due = False
    for lane in lanes:
        begin_sweep(pose[lane], scratch)
        taken = 0
        has_target = models[lane].target_kind != NO_TARGET
        for k in range(count[lane]):
            distance, bearing = ranges[lane, k], bearings[lane, k]
            slot = slot_by_label(ids, lane, state[lane].count, labels[lane, k], distance, bearing, has_target)
            if slot == DROPPED or proposed[lane, k] == REFUSED:
                state[lane].dropped += slot == DROPPED
                continue
            is_open = proposed[lane, k] == OPEN
            likelihood = likelihood_rows(scratch, is_open)
            if slot == TARGET_SLOT:
                told = take_target(
                    lane, distance, bearing, models[lane], state, pose[lane], target[lane], log_hypothesis[lane],
                    log_w[lane], w[lane], scratch, likelihood,
                )  # fmt: skip
            else:
                told = take_landmark(
                    lane, slot, distance, bearing, labels[lane, k], models[lane], state, ids, pose[lane], maps[lane],
                    points[lane], ancestors[lane], index[lane], w[lane], scratch, likelihood,
                    gate if is_open else math.inf, kind,
                )  # fmt: skip
            taken += told if is_open else 0
            if taken == FLUSH:
                gather_weights(log_w[lane], scratch[2], scratch[3])
                taken = 0
        if taken > 0:
            gather_weights(log_w[lane], scratch[2], scratch[3])
        finish_sweep(lane, state, target[lane], log_hypothesis[lane], log_w[lane], w[lane], islands, threshold)
        is_due = is_due or state[lane].due != 0
    return is_due


@subroutine
def begin_sweep(pose, scratch):
    """Rows 0 and 1 of the scratch: the headings' cosines and sines; rows 2 and 3: nothing gathered yet."""
    trigonometry(pose[2], scratch[0], scratch[1])
    for p in range(scratch.shape[1]):
        scratch[2, p] = 0.0
        scratch[3, p] = 1.0


@subroutine
def finish_sweep(lane, state, target, log_hypothesis, log_w, w, islands, threshold):
    """Normalise the weights and see whether to resample, merge a target's heading hypotheses that agree."""
    weigh(lane, state, log_w, w, islands, threshold)
    if state[lane].hypotheses == HEADINGS:
        state[lane].hypotheses = settle(target, log_hypothesis, HEADINGS, w)


@subroutine
def likelihood_rows(scratch, is_open):
    """Where a return's nu' S^-1 nu and det S are gathered: into the weights, or aside if they are there already."""
    if is_open:
        return scratch[2:4]
    for p in range(scratch.shape[1]):
        scratch[21, p] = 0.0
        scratch[22, p] = 1.0
    return scratch[21:23]


@subroutine
def take_landmark(
    lane, slot, distance, bearing, label, model, state, ids, pose, maps, points, ancestors, index, w, scratch,
    likelihood, gate, kind,
):  # fmt: skip
    """A return of a landmark: start its column or update it; tells whether something is to be gathered."""
    x, y, cosine, sine = pose[0], pose[1], scratch[0], scratch[1]
    range_std, bearing_std = noise_std(model, distance)
    var_r, var_b = range_std * range_std, bearing_std * bearing_std
    cb, sb = math.cos(bearing), math.sin(bearing)
    if slot == NEW:
        if state[lane].count == ids.shape[1]:
            state[lane].overflow += 1
            return 0
        m = open_column(state[lane].count, maps, points, ancestors, index)
        ids[lane, state[lane].count] = label
        state[lane].count += 1
        if kind == UNSCENTED:
            start_column_unscented(m[0], m[1], m[2], m[3], m[4], x, y, cosine, sine, distance, cb, sb, var_r, var_b)
        else:
            start_column(m[0], m[1], m[2], m[3], m[4], x, y, cosine, sine, distance, cb, sb, var_r, var_b)
        return 0
    m = open_column(slot, maps, points, ancestors, index)
    if gate < math.inf:
        outside = share_outside(
            m[0], m[1], m[2], m[3], m[4], x, y, cosine, sine, w, distance, cb, sb, var_r, var_b, gate
        )
        if outside > 0.5:
            state[lane].gated += 1
            return 0
    if kind == UNSCENTED:
        update_column_unscented(
            m[0], m[1], m[2], m[3], m[4], x, y, cosine, sine, likelihood[0], likelihood[1], distance, cb, sb, var_r,
            var_b,
        )  # fmt: skip
        return 1
    r, nu_b = scratch[4], scratch[5]
    sight_column(m[0], m[1], x, y, cosine, sine, cb, sb, r, nu_b)
    update_column(m[0], m[1], m[2], m[3], m[4], x, y, r, nu_b, likelihood[0], likelihood[1], distance, var_r, var_b)
    return 1


@subroutine
def take_target(lane, distance, bearing, model, state, pose, target, log_hypothesis, log_w, w, scratch, likelihood):
    """A return of the target: start it, start it anew, or update it; tells whether something is to be gathered."""
    x, y, cosine, sine = pose[0], pose[1], scratch[0], scratch[1]
    terms, work = scratch[4:11], scratch[11:21]
    range_std, bearing_std = noise_std(model, distance)
    var_r, var_b = range_std * range_std, bearing_std * bearing_std
    cb, sb = math.cos(bearing), math.sin(bearing)
    hypotheses = state[lane].hypotheses
    restart = is_too_vague(target, log_hypothesis, hypotheses, w, model.reinitialise_spread * distance)
    if hypotheses > 0 and not restart and model.reinitialise_nis < math.inf:
        outside = 0.0
        for g in range(hypotheses):
            p00, p01, p11 = position_rows(target[g])
            fit_point(
                target[g, 0], target[g, 1], p00, p01, p11, terms, x, y, cosine, sine, distance, cb, sb, var_r, var_b,
                model.iterate_spread,
            )  # fmt: skip
            for p in range(w.size):
                share = w[p] * math.exp(log_hypothesis[g, p])
                outside += 0.0 if terms[5, p] <= model.reinitialise_nis else share
        restart = outside > 0.5
    state[lane].target_restarts += restart
    if hypotheses == 0 or restart:
        state[lane].hypotheses = start_target(
            target, log_hypothesis, model, x, y, cosine, sine, distance, cb, sb, var_r, var_b
        )
        return 0
    n_t = 3 if model.target_kind == TWIST else 4
    for g in range(hypotheses):
        p00, p01, p11 = position_rows(target[g])
        fit_point(
            target[g, 0], target[g, 1], p00, p01, p11, terms, x, y, cosine, sine, distance, cb, sb, var_r, var_b,
            model.iterate_spread,
        )  # fmt: skip
        sharpen(target[g], n_t, terms, work, x, y, cosine, sine, distance, cb, sb, var_r, var_b, model.iterate_spread)
        apply_terms(target[g], n_t, terms, work)
        if hypotheses == 1:
            gather_terms(terms, likelihood)
        else:
            weigh_hypothesis(terms, log_hypothesis[g])
    if hypotheses > 1:
        share_out(log_hypothesis, hypotheses, log_w)
    return 1


@jit
def resample_lanes(
    lanes, state, pose, pose_cov, maps, points, ancestors, index, target, log_hypothesis, log_w, w, used, exists,
    places, islands,
):  # fmt: skip
    """Systematic resampling in the lanes where it is due (see `islands`).

    exists: [L, M or 0, N]. places: [3, N] integer scratch.
    """
    pose, pose_cov, maps, points, ancestors = (
        borrow(pose), borrow(pose_cov), borrow(maps), borrow(points), borrow(ancestors)
    )  # fmt: skip
    index, target, log_hypothesis, log_w, w = (
        borrow(index), borrow(target), borrow(log_hypothesis), borrow(log_w), borrow(w)
    )  # fmt: skip
    exists, places = borrow(exists), borrow(places)
    copies, source, destination = places[0], places[1], places[2]
    for lane in lanes:
        put_away(maps[lane], points[lane], ancestors[lane], index[lane])
        if state[lane].due == 0:
            continue
        count = draw_survivors(lane, state, log_w[lane], w[lane], islands, copies, source, destination)
        move_columns(pose[lane], source, destination, count)
        move_columns(pose_cov[lane], source, destination, count)
        move_particles(
            state[lane].count, maps[lane], points[lane], ancestors[lane], index[lane], source, destination, count
        )  # fmt: skip
        move_columns(exists[lane, : state[lane].count], source, destination, count)
        for g in range(state[lane].hypotheses):
            move_columns(target[lane, g], source, destination, count)
        move_columns(log_hypothesis[lane, : state[lane].hypotheses], source, destination, count)
        for i in range(count):
            used[lane, destination[i]] = used[lane, source[i]]
