"""The extended Kalman filter over robot, target and landmarks: kernels first, the class below them."""

import math
from typing import ClassVar

from estimators.gaussian.growth import advance_pending, grow
from estimators.gaussian.layout import Call, GaussianEstimator
from estimators.gaussian.sweep import UNLIKELY, UNUSABLE, USED, associate, limit_of, note
from estimators.interface import Floats, Scan
from estimators.kernels.angles import wrap
from estimators.kernels.association import KNOWN, TARGET_SLOT
from estimators.kernels.borrow import borrow
from estimators.kernels.bound import LATER
from estimators.kernels.gaussian import (
    ROBOT,
    move_heading_body,
    move_robot,
    nis_and_log_det,
    rows_in_use,
)
from estimators.kernels.jit import inline, jit
from estimators.kernels.left_looking import ROWS, collect, settle, spread
from estimators.kernels.motion import calibrated, control_noise, control_std, displacement, unicycle, unicycle_noise
from estimators.kernels.range_bearing import gradient, measure, noise_std
from estimators.kernels.rounding import blunted_by_distance
from estimators.kernels.velocity_target import move_velocity_target
from estimators.models import TWIST


@inline
def predict_robot(mu, P, lane, n, model, v, w, dt):
    """Move the robot; heading column of F: J(p_{k+1|k} - p_{k|k})."""
    v, w = calibrated(model, v, w)
    sv, sw = control_std(model, v, w, dt)
    heading = mu[lane, 2]
    dx, dy, turn = displacement(model, v, w, dt, heading)
    q00, q01, q02, q11, q12, q22 = control_noise(model, v, w, dt, heading, sv, sw)
    move_robot(P, lane, n, -dy, dx, q00, q01, q02, q11, q12, q22)
    mu[lane, 0] += dx
    mu[lane, 1] += dy
    mu[lane, 2] = wrap(heading + turn)


@inline
def predict_target(mu, P, lane, n, model, target_known, pending, dt):
    """Move the target by its own model; a point held from a first sighting stays where it is."""
    if not target_known[lane]:
        if pending[lane, 0] > 0.0:
            advance_pending(pending, lane, model.target_speed * dt, model.target_turn_rate * dt)
        return
    if model.target_kind != TWIST:
        move_velocity_target(mu, P, lane, n, model, dt)
        return
    speed, turn_rate, heading = model.target_speed, model.target_turn_rate, mu[lane, 5]
    dx, dy, turn = unicycle(speed, turn_rate, dt, heading)
    q00, q01, q02, q11, q12, q22 = unicycle_noise(
        speed, turn_rate, dt, heading, model.target_speed_std, model.target_turn_std
    )
    move_heading_body(P, lane, n, ROBOT, -dy, dx, q00, q01, q02, q11, q12, q22)
    mu[lane, 3] += dx
    mu[lane, 4] += dy
    mu[lane, 5] = wrap(heading + turn)


@jit
def predict(mu, P, models, n_t, count, target_known, pending, control, dt, last_dt, lanes):
    """One step of the named lanes: two rows and columns of P for the robot, two for the target, O(n)."""
    mu, P, pending = borrow(mu), borrow(P), borrow(pending)
    for i in range(lanes.size):
        lane = lanes[i]
        step = dt[lane]
        if not step > 0.0:
            continue
        n = rows_in_use(n_t, count[lane])
        predict_robot(mu, P, lane, n, models[lane], control[lane, 0], control[lane, 1], step)
        if n_t > 0:
            predict_target(mu, P, lane, n, models[lane], target_known, pending, step)
        last_dt[lane] = step


@inline
def observe(mu, P, work, lane, n, rows, j, model, distance, bearing, limit):
    """Update by one return of the point at row j, linearised at the current mean; (what became of it, its NIS).

    Where it was used, two more than `rows` rows are collected in `work`.
    """
    dx, dy = mu[lane, j] - mu[lane, 0], mu[lane, j + 1] - mu[lane, 1]
    if not dx * dx + dy * dy > 0.0:
        return UNUSABLE, 0.0
    r, b = measure(dx, dy, mu[lane, 2])
    a00, a01, a10, a11 = gradient(dx, dy)
    range_std, bearing_std = noise_std(model, r)
    range_std, bearing_std = blunted_by_distance(P, work, lane, n, j, r, 0.0, -1.0, range_std, bearing_std)
    s00, s01, s11 = spread(P, work, lane, n, rows, j, a00, a01, a10, a11, 0.0, -1.0)
    s00, s11 = s00 + range_std * range_std, s11 + bearing_std * bearing_std
    y0, y1 = distance - r, wrap(bearing - b)
    nis = nis_and_log_det(s00, s01, s11, y0, y1)[0]
    if not nis <= limit:
        return (UNUSABLE if math.isnan(nis) else UNLIKELY), nis
    collect(mu, lane, work, n, rows, y0, y1, s00, s01, s11)
    mu[lane, 2] = wrap(mu[lane, 2])
    return USED, nis


@inline
def take_returns(
    lane, mu, P, model, n_t, n_between, count, target_known, pending, counters, ranges, bearings, num_returns, gates,
    slots, work,
):  # fmt: skip
    """The returns of one lane's sweep that belong to what is in the state, one after the other.

    n_between: rows between the robot's and the landmarks', the target's n_t first.
    """
    n, rows = rows_in_use(n_between, count[lane]), 0
    for k in range(num_returns):
        slot = slots[lane, k]
        is_target = slot == TARGET_SLOT and target_known[lane]
        if slot < 0 and not is_target:
            continue
        j = ROBOT if is_target else ROBOT + n_between + 2 * slot
        limit = limit_of(gates[0], model, is_target)
        if rows == ROWS:
            settle(P, work, lane, n, rows)
            rows = 0
        outcome, nis = observe(mu, P, work, lane, n, rows, j, model, ranges[lane, k], bearings[lane, k], limit)
        if outcome == USED:
            rows += 2
        else:
            settle(P, work, lane, n, rows)
            rows = 0
            note(outcome, nis, is_target, mu, P, lane, n, n_t, model, target_known, pending, counters)
    settle(P, work, lane, n, rows)
    if n_t > 0 and model.target_kind == TWIST:
        mu[lane, 5] = wrap(mu[lane, 5])


@inline
def update_one(
    lane, mu, P, model, n_t, count, ids, first, next_id, target_known, pending, counters, last_dt, ranges, bearings,
    labels, num_returns, code, gates, slots, cost, work,
):  # fmt: skip
    """One lane's sweep: what is in the state first, one return after the other, then what is new."""
    associate(
        lane, mu, P, model, n_t, count, ids, target_known, counters, ranges, bearings, labels, num_returns, code, gates,
        cost, slots,
    )  # fmt: skip
    take_returns(
        lane, mu, P, model, n_t, n_t, count, target_known, pending, counters, ranges, bearings, num_returns, gates,
        slots, work,
    )  # fmt: skip
    grow(
        lane, mu, P, model, n_t, count, ids, first, next_id, target_known, pending, counters, ranges, bearings, labels,
        num_returns, code != KNOWN, slots, mu[lane, 0], mu[lane, 1], mu[lane, ROBOT], mu[lane, ROBOT + 1],
        last_dt[lane],
    )  # fmt: skip


@jit
def update(
    mu, P, models, n_t, count, ids, first, next_id, target_known, pending, counters, last_dt, ranges, bearings, labels,
    counts, code, gates, slots, cost, work, lanes,
):  # fmt: skip
    """One sweep of the named lanes: see `update_one`."""
    mu, P, work, count, ids, slots = borrow(mu), borrow(P), borrow(work), borrow(count), borrow(ids), borrow(slots)
    first, next_id, target_known, pending = borrow(first), borrow(next_id), borrow(target_known), borrow(pending)
    counters, ranges, bearings, labels = borrow(counters), borrow(ranges), borrow(bearings), borrow(labels)
    gates, cost = borrow(gates), borrow(cost)
    for i in range(lanes.size):
        lane = lanes[i]
        update_one(
            lane, mu, P, models[lane], n_t, count, ids, first, next_id, target_known, pending, counters, last_dt,
            ranges, bearings, labels, counts[lane], code, gates, slots, cost, work,
        )  # fmt: skip


class EKF(GaussianEstimator):
    """Joint extended Kalman filter of robot, target and landmarks, with every cross covariance.

    **Motion.** The robot's mean moves by its model (unicycle, Eq. (16) of Wu and Sun 2013, heading at the END of the
    step; bicycle, Eq. (15) of Tian et al. 2010) under the calibrated control. The Jacobian differs from the identity
    only in the heading column, J(p_{k+1|k} - p_{k|k}) with J = [[0, -1], [1, 0]]; noise enters through the control's
    Jacobian. The target moves by its own model. Only their rows and columns of P change.

    **Measurement.** With D = l - p: h = (|D|, atan2(D) - heading), A = dh/dD, H = [-A, (0, -1), A] over position,
    heading and point. Returns are taken in one after the other, each linearised at the mean that the ones before it
    left; P -= W W' with W = P H' chol(S)^-T, once for all of them (`estimators.kernels.left_looking`), keeps P
    symmetric.

    **Growth.** After the update, a new landmark enters with the Jacobian [I, J(l - p)] of the pose and all its cross
    covariances. So does the target: constant-velocity with velocity zero and `initial_speed_std`, twist from two
    sightings (`estimators.gaussian.growth`).

    Args:
        motion: how the robot moves. sensor, target: see `GaussianEstimator`, as all options.

    When to use: the baseline of everything; accurate and fast where headings are known to a few degrees.

    Known weakness: overconfident. Its Jacobians, taken at different estimates of the same point, make the absolute
    heading look observable; its NEES grows with noise and time (`fej-ekf` and `ri-ekf` cure this).

    Reference: Smith, Self and Cheeseman, "Estimating uncertain spatial relationships in robotics", 1990; Huang,
    Mourikis and Roumeliotis, "Observability-based rules for designing consistent EKF SLAM estimators", IJRR 2010.
    """

    name: ClassVar[str] = "ekf"
    summary: ClassVar[str] = "joint extended Kalman filter of robot, target and landmarks"

    def _prediction(self, control: Floats, dt: Floats) -> Call:
        return (
            predict, self.mu, self.P, self.models, self.n_t, self.count, self.target_known, self.pending, control, dt,
            self.last_dt, LATER,
        )  # fmt: skip

    def _correction(self, scan: Scan) -> Call:
        return (
            update, self.mu, self.P, self.models, self.n_t, self.count, self.ids, self.first, self.next_id,
            self.target_known, self.pending, self.counters, self.last_dt, scan.ranges, scan.bearings, scan.labels,
            scan.count, self.association_code, self.gates, self.slots, self.cost, self.work, LATER,
        )  # fmt: skip
