"""The first-estimates-Jacobian EKF: every Jacobian keeps to one set of points, so it gains no heading out of nothing.

`anchor` [L, 2 + n_t]: the robot's last PREDICTED position p_{k|k-1} and the target's last predicted state; a
landmark's first estimate is `first`. The unobservable directions N = [I, J p_anchor; 0, 1; I, J l_first] (with the
target: J p_T,anchor, and J v_T,anchor or 1 for its heading) then hold H N = 0 and F N_k = N_{k+1} exactly.
"""

import math
from typing import ClassVar

from estimators.gaussian.anchor import A_T, ROUGH_NIS, STALE, TORN, has_shifted, linear_point, renew
from estimators.gaussian.growth import advance_pending, grow
from estimators.gaussian.layout import Call, GaussianEstimator
from estimators.gaussian.sweep import UNLIKELY, UNUSABLE, USED, associate, limit_of, note
from estimators.gaussian.vague_target import FIRST
from estimators.interface import Floats, Ints, Scan
from estimators.kernels.angles import wrap
from estimators.kernels.association import KNOWN, TARGET_SLOT
from estimators.kernels.bound import LATER
from estimators.kernels.gaussian import (
    ROBOT,
    drift_velocity,
    move_heading_body,
    move_robot,
    nis_and_log_det,
    rows_in_use,
    shear,
)
from estimators.kernels.jit import inline, jit
from estimators.kernels.left_looking import ROWS, collect, settle, spread
from estimators.kernels.motion import calibrated, control_noise, control_std, displacement, unicycle, unicycle_noise
from estimators.kernels.range_bearing import gradient, measure, noise_std
from estimators.kernels.rounding import blunted_by_distance
from estimators.kernels.velocity_target import bend, half_bend
from estimators.models import TWIST


@inline
def predict_robot(mu, P, lane, n, model, anchor, v, w, dt):
    """Move the robot; heading column of F: J(p_{k+1|k} - p_{k|k-1}). Eq. (32), Geng 2024."""
    v, w = calibrated(model, v, w)
    sv, sw = control_std(model, v, w, dt)
    heading = mu[lane, 2]
    dx, dy, turn = displacement(model, v, w, dt, heading)
    q00, q01, q02, q11, q12, q22 = control_noise(model, v, w, dt, heading, sv, sw)
    x, y = mu[lane, 0] + dx, mu[lane, 1] + dy
    move_robot(P, lane, n, anchor[lane, 1] - y, x - anchor[lane, 0], q00, q01, q02, q11, q12, q22)
    mu[lane, 0], mu[lane, 1], mu[lane, 2] = x, y, wrap(heading + turn)
    anchor[lane, 0], anchor[lane, 1] = x, y


@inline
def predict_velocity_target(mu, P, lane, n, model, anchor, dt):
    """Constant velocity; the corrections of the anchor ride on the robot's heading.

    Its column of F carries J(p_T,k+1|k - p_T,k|k-1 - dt v_T,k|k-1) and J(v_T,k+1|k - v_T,k|k-1), where v_T,k|k-1 has
    been bent as the velocity is (`estimators.kernels.velocity_target`). Called before the
    robot's own noise is added: F acts on the covariance of the step's start.
    """
    c, s = half_bend(model, dt)
    bend(mu, P, lane, n, c, s)
    vx, vy = anchor[lane, A_T + 2], anchor[lane, A_T + 3]
    vx, vy = c * vx - s * vy, s * vx + c * vy
    drift_velocity(mu, P, lane, n, model.acceleration_density, dt)
    away_x = mu[lane, 3] - anchor[lane, A_T] - dt * vx
    away_y = mu[lane, 4] - anchor[lane, A_T + 1] - dt * vy
    shear(P, lane, n, 3, 2, -away_y)
    shear(P, lane, n, 4, 2, away_x)
    shear(P, lane, n, 5, 2, vy - mu[lane, 6])
    shear(P, lane, n, 6, 2, mu[lane, 5] - vx)
    bend(mu, P, lane, n, c, s)


@inline
def predict_twist_target(mu, P, lane, n, model, anchor, dt):
    """A unicycle of its own heading; heading column J(p_T,k+1|k - p_T,k|k-1), as the robot's."""
    speed, turn_rate, heading = model.target_speed, model.target_turn_rate, mu[lane, 5]
    dx, dy, turn = unicycle(speed, turn_rate, dt, heading)
    q00, q01, q02, q11, q12, q22 = unicycle_noise(
        speed, turn_rate, dt, heading, model.target_speed_std, model.target_turn_std
    )
    x, y = mu[lane, 3] + dx, mu[lane, 4] + dy
    hx, hy = anchor[lane, A_T + 1] - y, x - anchor[lane, A_T]
    move_heading_body(P, lane, n, ROBOT, hx, hy, q00, q01, q02, q11, q12, q22)
    mu[lane, 3], mu[lane, 4], mu[lane, 5] = x, y, wrap(heading + turn)


@inline
def anchor_target(mu, lane, n_t, anchor):
    """Linearise the target here from now on."""
    for i in range(n_t):
        anchor[lane, A_T + i] = mu[lane, ROBOT + i]


@inline
def predict_target(mu, P, lane, n, n_t, model, anchor, target_known, pending, dt):
    """Move the target by its own model; a point held from a first sighting stays where it is."""
    if not target_known[lane]:
        if pending[lane, 0] > 0.0:
            advance_pending(pending, lane, model.target_speed * dt, model.target_turn_rate * dt)
        return
    if model.target_kind == TWIST:
        predict_twist_target(mu, P, lane, n, model, anchor, dt)
    else:
        predict_velocity_target(mu, P, lane, n, model, anchor, dt)
    anchor_target(mu, lane, n_t, anchor)


@jit
def predict(mu, P, models, n_t, count, anchor, target_known, pending, control, dt, last_dt, lanes):
    """One step of the named lanes."""
    for i in range(lanes.size):
        lane = lanes[i]
        step = dt[lane]
        if not step > 0.0:
            continue
        n = rows_in_use(n_t, count[lane])
        if n_t > 0:
            predict_target(mu, P, lane, n, n_t, models[lane], anchor, target_known, pending, step)
        predict_robot(mu, P, lane, n, models[lane], anchor, control[lane, 0], control[lane, 1], step)
        last_dt[lane] = step


@inline
def observe(mu, P, work, lane, n, rows, j, model, anchor, first_x, first_y, distance, bearing, limit):
    """Update by one return of the point at row j. Eq. (33), Geng 2024.

    H = A [-I, -J(l_first - p_{k|k-1}), I] with A = dh/dD at the newest estimate, where the residual is taken too.
    Where it was used, two more than `rows` rows are collected in `work`.
    """
    dx, dy = mu[lane, j] - mu[lane, 0], mu[lane, j + 1] - mu[lane, 1]
    if not dx * dx + dy * dy > 0.0:
        return UNUSABLE, 0.0
    r, b = measure(dx, dy, mu[lane, 2])
    a00, a01, a10, a11 = gradient(dx, dy)
    g0, g1 = anchor[lane, 1] - first_y, first_x - anchor[lane, 0]
    c0, c1 = -(a00 * g0 + a01 * g1), -(a10 * g0 + a11 * g1)
    range_std, bearing_std = noise_std(model, r)
    range_std, bearing_std = blunted_by_distance(P, work, lane, n, j, r, c0, c1, range_std, bearing_std)
    s00, s01, s11 = spread(P, work, lane, n, rows, j, a00, a01, a10, a11, c0, c1)
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
    lane, mu, P, model, n_t, count, first, anchor, target_known, pending, counters, ranges, bearings, num_returns,
    gates, slots, work,
):  # fmt: skip
    """The returns of one lane's sweep that belong to what is in the state, one after the other."""
    n, rows = rows_in_use(n_t, count[lane]), 0
    for k in range(num_returns):
        slot = slots[lane, k]
        is_target = slot == TARGET_SLOT and target_known[lane]
        if slot < 0 and not is_target:
            continue
        j = ROBOT if is_target else ROBOT + n_t + 2 * slot
        first_x, first_y = linear_point(lane, slot, is_target, first, anchor)
        if has_shifted(mu, lane, j, anchor, first_x, first_y, STALE):
            renew(mu, lane, n_t, count[lane], first, anchor)
            first_x, first_y = linear_point(lane, slot, is_target, first, anchor)
        limit = limit_of(gates[0], model, is_target)
        distance, bearing = ranges[lane, k], bearings[lane, k]
        if rows == ROWS:
            settle(P, work, lane, n, rows)
            rows = 0
        outcome, nis = observe(mu, P, work, lane, n, rows, j, model, anchor, first_x, first_y, distance, bearing, limit)
        if outcome == USED:
            rows += 2
            if nis > ROUGH_NIS and has_shifted(mu, lane, j, anchor, first_x, first_y, TORN):
                renew(mu, lane, n_t, count[lane], first, anchor)
        else:
            settle(P, work, lane, n, rows)
            rows = 0
            note(outcome, nis, is_target, mu, P, lane, n, n_t, model, target_known, pending, counters)
    settle(P, work, lane, n, rows)
    if n_t > 0 and model.target_kind == TWIST:
        mu[lane, 5] = wrap(mu[lane, 5])


@inline
def update_one(
    lane, mu, P, model, n_t, count, ids, first, next_id, anchor, target_known, pending, counters, last_dt, ranges,
    bearings, labels, num_returns, code, gates, slots, cost, work,
):  # fmt: skip
    """One lane's sweep: what is in the state first, one return after the other, then what is new."""
    associate(
        lane, mu, P, model, n_t, count, ids, target_known, counters, ranges, bearings, labels, num_returns, code, gates,
        cost, slots,
    )  # fmt: skip
    take_returns(
        lane, mu, P, model, n_t, count, first, anchor, target_known, pending, counters, ranges, bearings, num_returns,
        gates, slots, work,
    )  # fmt: skip
    held, known, held_x, held_y = pending[lane, 0] > 0.0, target_known[lane], 0.0, 0.0
    if n_t > 0:
        held_x, held_y = anchor[lane, A_T], anchor[lane, A_T + 1]
    # The initialisation Jacobian is taken at p_{k|k-1} too, or some runs diverge under strong noise.
    grow(
        lane, mu, P, model, n_t, count, ids, first, next_id, target_known, pending, counters, ranges, bearings, labels,
        num_returns, code != KNOWN, slots, anchor[lane, 0], anchor[lane, 1], held_x, held_y, last_dt[lane],
    )  # fmt: skip
    if target_known[lane] != known or (pending[lane, 0] > 0.0) != held:
        anchor_target(mu, lane, n_t, anchor)


@jit
def update(
    mu, P, models, n_t, count, ids, first, next_id, anchor, target_known, pending, counters, last_dt, ranges, bearings,
    labels, counts, code, gates, slots, cost, work, lanes,
):  # fmt: skip
    """One sweep of the named lanes: see `update_one`."""
    for i in range(lanes.size):
        lane = lanes[i]
        update_one(
            lane, mu, P, models[lane], n_t, count, ids, first, next_id, anchor, target_known, pending, counters,
            last_dt, ranges, bearings, labels, counts[lane], code, gates, slots, cost, work,
        )  # fmt: skip


class FEJEKF(GaussianEstimator):
    """First-estimates-Jacobian EKF of robot, target and landmarks: an EKF that learns no absolute heading.

    **Motion.** As `EKF`, but for the heading column of F: J(p_{k+1|k} - p_{k|k-1}), Eq. (32) of Geng 2024. The target
    is corrected alike: a constant-velocity target's rows carry J(p_T,k+1|k - p_T,k|k-1 - dt v_T,k|k-1) and
    J(v_T,k+1|k - v_T,k|k-1) in the robot's heading column, a twist target its own J(p_T,k+1|k - p_T,k|k-1).

    **Measurement.** H = A [-I, -J(l_first - p_{k|k-1}), I], Eq. (33), A = dh/dD and residual at the newest estimate;
    all returns of one sweep use the same p_{k|k-1}; the target's point is its predicted one.

    **Growth.** As `EKF`, with the Jacobian [I, J(l - p_{k|k-1})].

    Args:
        motion: how the robot moves. sensor, target: see `GaussianEstimator`, as all options.

    When to use: where consistency matters and bearing noise is moderate (about 1 deg and long runs, or less).

    Known weakness: its Jacobians stay where the estimates were first; at bearing noise of 2-3 deg over long runs they
    are far from the truth and it becomes overconfident, `ri-ekf` later. Where an outlier has torn the estimate away
    from them it linearises anew (`estimators.gaussian.anchor`).

    Reference: Huang, Mourikis and Roumeliotis, "A first-estimates Jacobian EKF for improving SLAM consistency", 2009;
    Geng 2024, Eqs. (32)-(33).
    """

    name: ClassVar[str] = "fej-ekf"
    summary: ClassVar[str] = "first-estimates-Jacobian EKF: keeps the heading unobservable"

    def _allocate(self) -> None:
        super()._allocate()
        self.anchor: Floats = self.mu[:, : A_T + self.n_t].copy()

    def _after_reset(self, lanes: Ints) -> None:
        self.anchor[lanes, :A_T] = self.mu[lanes, :A_T]
        self.anchor[lanes, A_T:] = self.mu[lanes, ROBOT : ROBOT + self.n_t]

    def after_change(self, lanes: Ints) -> None:
        """See `GaussianEstimator.after_change`: the target is linearised where it is now."""
        self.anchor[lanes, A_T:] = self.mu[lanes, ROBOT : ROBOT + self.n_t]

    @property
    def _state_names(self) -> tuple[str, ...]:
        return (*super()._state_names, "anchor")

    def linear_points(self) -> tuple[Floats, int, int]:
        """See `GaussianEstimator.linear_points`."""
        return self.anchor, A_T, FIRST

    def _prediction(self, control: Floats, dt: Floats) -> Call:
        return (
            predict, self.mu, self.P, self.models, self.n_t, self.count, self.anchor, self.target_known, self.pending,
            control, dt, self.last_dt, LATER,
        )  # fmt: skip

    def _correction(self, scan: Scan) -> Call:
        return (
            update, self.mu, self.P, self.models, self.n_t, self.count, self.ids, self.first, self.next_id, self.anchor,
            self.target_known, self.pending, self.counters, self.last_dt, scan.ranges, scan.bearings, scan.labels,
            scan.count, self.association_code, self.gates, self.slots, self.cost, self.work, LATER,
        )  # fmt: skip
