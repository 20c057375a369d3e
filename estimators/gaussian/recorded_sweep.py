"""A sweep of a recorded robot: what is known is corrected and weighted, what is new or was mis-read starts anew."""

import math

from estimators.gaussian.growth import grow
from estimators.gaussian.invariant import retract_rows
from estimators.gaussian.recorded_motion import BEARING_BIAS, EXTRA, RANGE_SCALE
from estimators.gaussian.recorded_returns import observe
from estimators.gaussian.sweep import (
    DROPPED_RETURN,
    GATE_REJECTED,
    NOT_POSITIVE,
    REINITIALISED,
    UNUSABLE,
    USED,
    associate,
    forget_target,
    limit_of,
)
from estimators.kernels.angles import wrap
from estimators.kernels.association import DROPPED, KNOWN, TARGET_SLOT
from estimators.kernels.borrow import borrow
from estimators.kernels.gaussian import ROBOT, append_point, clear_rows, rows_in_use, shear
from estimators.kernels.jit import inline, jit
from estimators.kernels.left_looking import CORRECTION
from estimators.kernels.range_bearing import noise_std, offset, offset_noise
from estimators.models import TWIST

SHORTEST_AGE = 1e-6  # [s] between two returns of one label


@inline
def gate_of(own, gates):
    """The robot's own gate where it has one, else the filter's."""
    return own if own < math.inf else gates[0]


@inline
def correct_returns(mu, lane, extra, ranges, bearings, num_returns, corrected):
    """The sweep without the sensor's estimated scale and bias, into `corrected` [2, L, K]."""
    for k in range(num_returns):
        corrected[0, lane, k] = ranges[lane, k] / (1.0 + mu[lane, extra + RANGE_SCALE])
        corrected[1, lane, k] = wrap(bearings[lane, k] - mu[lane, extra + BEARING_BIAS])


@inline
def persistent(rejected, lane, item, x, y, errors):
    """Note a rejected return at a world point; whether as many as `restart_after` in a row lay near each other."""
    off_x, off_y = x - rejected[lane, item, 1], y - rejected[lane, item, 2]
    near = off_x * off_x + off_y * off_y <= errors.restart_radius * errors.restart_radius
    rejected[lane, item, 0] = rejected[lane, item, 0] + 1.0 if near else 1.0
    rejected[lane, item, 1], rejected[lane, item, 2] = x, y
    return errors.restart_after > 0.0 and rejected[lane, item, 0] >= errors.restart_after


@inline
def restart_landmark(mu, P, lane, n, j, model, distance, bearing):
    """Forget a landmark that was rejected too often, and start it from this return."""
    dx, dy = offset(distance, bearing, mu[lane, 2])
    range_std, bearing_std = noise_std(model, distance)
    n00, n01, n11 = offset_noise(dx, dy, range_std, bearing_std)
    clear_rows(mu, P, lane, n, j, 2)
    append_point(mu, P, lane, n, j, mu[lane, 0] + dx, mu[lane, 1] + dy, -dy, dx, n00, n01, n11)


@inline
def lean_on_sensor(mu, P, lane, n, j, extra):
    """A point just entered depends on range scale and bearing bias too: its offset D by them is -D and -J D."""
    dx, dy = mu[lane, j] - mu[lane, 0], mu[lane, j + 1] - mu[lane, 1]
    scale, bias = extra + RANGE_SCALE, extra + BEARING_BIAS
    shear(P, lane, n, j, scale, -dx)
    shear(P, lane, n, j + 1, scale, -dy)
    shear(P, lane, n, j, bias, dy)
    shear(P, lane, n, j + 1, bias, -dx)


@inline
def update_one(
    lane, mu, P, model, errors, n_t, count, ids, first, next_id, target_known, pending, counters, last_dt, clock, seen,
    rejected, ranges, bearings, labels, num_returns, code, gates, slots, cost, corrected, work,
):  # fmt: skip
    """One lane's sweep: the stacked correction, one retraction, then what is new or starts anew."""
    extra, M = ROBOT + n_t, ids.shape[1]
    correct_returns(mu, lane, extra, ranges, bearings, num_returns, corrected)
    distances, angles = corrected[0], corrected[1]
    associate(
        lane, mu, P, model, n_t + EXTRA, count, ids, target_known, counters, distances, angles, labels, num_returns,
        code, gates, cost, slots,
    )  # fmt: skip
    n, total = rows_in_use(n_t + EXTRA, count[lane]), 0.0
    for i in range(n):
        work[CORRECTION, i] = 0.0
    for k in range(num_returns):
        slot = slots[lane, k]
        if slot == TARGET_SLOT and n_t == 0:
            slots[lane, k] = DROPPED
            counters[lane, DROPPED_RETURN] += 1
            continue
        is_target = slot == TARGET_SLOT and target_known[lane]
        if slot < 0 and not is_target:
            continue
        item, j = (M, ROBOT) if is_target else (slot, extra + EXTRA + 2 * slot)
        age = max(clock[lane] - seen[lane, item], SHORTEST_AGE)
        limit = limit_of(gate_of(errors.target_gate if is_target else errors.landmark_gate, gates), model, is_target)
        measured = is_target and errors.target_fresh > 0.0 and age > errors.target_fresh
        outcome, nis = observe(
            mu, P, work, lane, n, j, extra, model, errors, distances[lane, k], angles[lane, k], age, measured,
            limit, 0.0 if is_target else errors.weight_dof,
        )  # fmt: skip
        if outcome == USED:
            seen[lane, item] = clock[lane]
            rejected[lane, item, 0] = 0.0
            total += nis
            continue
        if outcome == UNUSABLE:
            counters[lane, NOT_POSITIVE] += 1
            continue
        counters[lane, GATE_REJECTED] += 1
        dx, dy = offset(distances[lane, k], angles[lane, k], mu[lane, 2])
        again = persistent(rejected, lane, item, mu[lane, 0] + dx, mu[lane, 1] + dy, errors)
        if is_target and (again or nis > model.reinitialise_nis):
            counters[lane, REINITIALISED] += 1
            forget_target(mu, P, lane, n, n_t, target_known, pending)
            for i in range(ROBOT, ROBOT + n_t):
                work[CORRECTION, i] = 0.0
    own_heading = n_t > 0 and model.target_kind == TWIST and target_known[lane]
    for e in range(extra, extra + EXTRA):
        mu[lane, e] += work[CORRECTION, e]
    retract_rows(mu, P, work, lane, n, 0, n_t, extra + EXTRA, count[lane], own_heading, total)
    correct_returns(mu, lane, extra, ranges, bearings, num_returns, corrected)
    take_in(
        lane, mu, P, model, errors, n_t, count, ids, first, next_id, target_known, pending, counters, last_dt, clock,
        seen, rejected, distances, angles, labels, num_returns, code, slots,
    )  # fmt: skip


@inline
def take_in(
    lane, mu, P, model, errors, n_t, count, ids, first, next_id, target_known, pending, counters, last_dt, clock, seen,
    rejected, distances, angles, labels, num_returns, code, slots,
):  # fmt: skip
    """New landmarks, a target's first sightings, and landmarks rejected too often, with the sensor's states."""
    extra, M, before = ROBOT + n_t, ids.shape[1], count[lane]
    was_known, held = target_known[lane], pending[lane, 0]
    for k in range(num_returns):
        slot = slots[lane, k]
        if slot >= 0 and errors.restart_after > 0.0 and rejected[lane, slot, 0] >= errors.restart_after:
            j, n = extra + EXTRA + 2 * slot, rows_in_use(n_t + EXTRA, count[lane])
            restart_landmark(mu, P, lane, n, j, model, distances[lane, k], angles[lane, k])
            lean_on_sensor(mu, P, lane, n, j, extra)
            seen[lane, slot], rejected[lane, slot, 0] = clock[lane], 0.0
            counters[lane, REINITIALISED] += 1
    grow(
        lane, mu, P, model, n_t + EXTRA, count, ids, first, next_id, target_known, pending, counters, distances, angles,
        labels, num_returns, code != KNOWN, slots, mu[lane, 0], mu[lane, 1], mu[lane, ROBOT], mu[lane, ROBOT + 1],
        last_dt[lane],
    )  # fmt: skip
    n = rows_in_use(n_t + EXTRA, count[lane])
    for slot in range(before, count[lane]):
        lean_on_sensor(mu, P, lane, n, extra + EXTRA + 2 * slot, extra)
        seen[lane, slot], rejected[lane, slot, 0] = clock[lane], 0.0
    if n_t > 0 and ((target_known[lane] and not was_known) or (pending[lane, 0] != held)):
        lean_on_sensor(mu, P, lane, n, ROBOT, extra)
        seen[lane, M], rejected[lane, M, 0] = clock[lane], 0.0


@jit
def update(
    mu, P, models, errors, n_t, count, ids, first, next_id, target_known, pending, counters, last_dt, clock, seen,
    rejected, ranges, bearings, labels, counts, code, gates, slots, cost, corrected, work, lanes,
):  # fmt: skip
    """One sweep of the named lanes: see `update_one`."""
    mu, P, work, count, ids, slots = borrow(mu), borrow(P), borrow(work), borrow(count), borrow(ids), borrow(slots)
    for i in range(lanes.size):
        lane = lanes[i]
        update_one(
            lane, mu, P, models[lane], errors[0], n_t, count, ids, first, next_id, target_known, pending, counters,
            last_dt, clock, seen, rejected, ranges, bearings, labels, counts[lane], code, gates, slots, cost, corrected,
            work,
        )  # fmt: skip
