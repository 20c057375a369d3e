"""CDKF-SLAM: a joint Gaussian propagated through Stirling's interpolation instead of Jacobians.

Eqs. (13)-(31), Tian et al. 2010, sequential over the returns of a sweep, on the kernels of `interpolation`.
"""

import math
from typing import Any

import numpy as np

from estimators.gaussian.growth import advance_pending, start_target
from estimators.gaussian.interpolation import (
    ROBOT_MOVES,
    TARGET_MOVES,
    append_by_points,
    downdate_by_points,
    move_body,
    row_of,
    spread_return,
)
from estimators.gaussian.layout import Call, GaussianEstimator
from estimators.gaussian.sweep import (
    DROPPED_RETURN,
    OVERFLOW,
    UNLIKELY,
    UNUSABLE,
    USED,
    associate,
    limit_of,
    note,
)
from estimators.interface import Floats, Ints, Scan
from estimators.kernels.angles import wrap
from estimators.kernels.association import KNOWN, NEW, TARGET_SLOT, slot_of
from estimators.kernels.bound import LATER
from estimators.kernels.gaussian import ROBOT, nis_and_log_det, rows_in_use
from estimators.kernels.jit import inline, jit
from estimators.kernels.motion import calibrated, control_std
from estimators.kernels.range_bearing import noise_std, offset, offset_noise
from estimators.kernels.rounding import blunted
from estimators.kernels.velocity_target import move_velocity_target
from estimators.models import TWIST, MotionModel, SensorModel, TargetModel

GAUSSIAN_STEP = math.sqrt(3.0)  # h, Tian et al. 2010: matches the fourth moment of a Gaussian


@inline
def body_inputs(model, body, v, w, dt):
    """What moves the robot (body 0) or a twist target (body 1): first row, kind, two rates and their deviations."""
    if body == 0:
        v, w = calibrated(model, v, w)
        sv, sw = control_std(model, v, w, dt)
        return 0, ROBOT_MOVES, v, w, sv, sw
    return (
        ROBOT, TARGET_MOVES, model.target_speed, model.target_turn_rate, model.target_speed_std, model.target_turn_std
    )  # fmt: skip


@jit
def predict(mu, P, models, n_t, count, target_known, pending, control, dt, last_dt, lanes, rule, scratch, order):
    """One step of the named lanes. Eqs. (9)-(18).

    A constant-velocity target moves linearly, where sigma points give exactly the textbook's prediction.
    """
    C, D1, D2, E = scratch[0], scratch[1], scratch[2], scratch[3]
    for i in range(lanes.size):
        lane = lanes[i]
        step = dt[lane]
        if not step > 0.0:
            continue
        model = models[lane]
        n = rows_in_use(n_t, count[lane])
        bodies = 2 if n_t > 0 and target_known[lane] and model.target_kind == TWIST else 1
        for body in range(bodies):
            j, kind, v, w, sv, sw = body_inputs(model, body, control[lane, 0], control[lane, 1], step)
            move_body(mu, P, lane, n, j, kind, model, v, w, sv, sw, step, rule, C, D1, D2, E, order)
        if n_t > 0 and bodies == 1:
            if target_known[lane]:
                move_velocity_target(mu, P, lane, n, model, step)
            elif pending[lane, 0] > 0.0:
                advance_pending(pending, lane, model.target_speed * step, model.target_turn_rate * step)
        last_dt[lane] = step


@inline
def observe(mu, P, W, lane, n, j, model, distance, bearing, limit, rule, C, D1, E, order):
    """Update by one return of the point at row j; (what became of it, its NIS)."""
    r0, r, b, s00, s01, s11 = spread_return(mu, P, lane, j, rule, C, D1, E, order)
    range_std, bearing_std = noise_std(model, r0)
    h0 = h1 = 0.0
    for p in range(5):
        variance = P[lane, row_of(p, 0, j), row_of(p, 0, j)]
        h0, h1 = h0 + E[0, p] * E[0, p] * variance, h1 + E[1, p] * E[1, p] * variance
    range_std, bearing_std = blunted(P, W, lane, n, h0, h1, range_std, bearing_std)
    s00 += range_std * range_std
    s11 += bearing_std * bearing_std
    y0, y1 = distance - r, wrap(bearing - b)
    nis = nis_and_log_det(s00, s01, s11, y0, y1)[0]
    if not nis <= limit:
        return (UNUSABLE if math.isnan(nis) else UNLIKELY), nis
    downdate_by_points(mu, P, W, lane, n, j, E, y0, y1, s00, s01, s11)
    mu[lane, 2] = wrap(mu[lane, 2])
    return USED, nis


@inline
def open_slot(lane, count, ids, next_id, counters, label):
    """A free slot for a new landmark of that label; -1, counted, where there is none or it was just filled."""
    if slot_of(ids, lane, count[lane], label) != NEW:
        counters[lane, DROPPED_RETURN] += 1  # seen twice in its first sweep
        return -1
    slot = count[lane]
    if slot == ids.shape[1]:
        counters[lane, OVERFLOW] += 1
        return -1
    count[lane] = slot + 1
    next_id[lane] += 1
    ids[lane, slot] = label
    return slot


@inline
def grow_by_points(
    lane, mu, P, model, n_t, count, ids, first, next_id, target_known, pending, counters, ranges, bearings, labels,
    num_returns, nearest, slots, dt, rule, C, D1, D2, E, order,
):  # fmt: skip
    """Take in the returns of one lane's sweep that are not yet in the state; see `growth.grow`.

    A twist target's heading comes from the chord of two sightings, to first order, as in every filter of the family.
    """
    for k in range(num_returns):
        slot, distance, bearing = slots[lane, k], ranges[lane, k], bearings[lane, k]
        std_r, std_b = noise_std(model, distance)
        starts_target = slot == TARGET_SLOT and not target_known[lane]
        j = ROBOT
        if starts_target and model.target_kind == TWIST:
            dx, dy = offset(distance, bearing, mu[lane, 2])
            n00, n01, n11 = offset_noise(dx, dy, std_r, std_b)
            start_target(
                mu, P, lane, rows_in_use(n_t, count[lane]), model, target_known, pending, dx, dy, -dy, dx, n00, n01,
                n11, mu[lane, 3], mu[lane, 4], dt,
            )  # fmt: skip
            continue
        if not starts_target:
            if slot != NEW:
                continue
            slot = open_slot(lane, count, ids, next_id, counters, next_id[lane] if nearest else labels[lane, k])
            if slot < 0:
                continue
            slots[lane, k] = slot
            j = ROBOT + n_t + 2 * slot
        n = rows_in_use(n_t, count[lane])
        append_by_points(mu, P, lane, n, j, distance, bearing, std_r, std_b, model, rule, C, D1, D2, E, order)
        if starts_target:
            P[lane, 5, 5] = P[lane, 6, 6] = model.initial_speed_std * model.initial_speed_std
            target_known[lane] = True
        else:
            first[lane, slot, 0], first[lane, slot, 1] = mu[lane, j], mu[lane, j + 1]


@jit
def update(
    mu, P, W, models, n_t, count, ids, first, next_id, target_known, pending, counters, ranges, bearings, labels,
    num_returns, code, gates, cost, slots, last_dt, lanes, rule, scratch, order,
):  # fmt: skip
    """Take in one sweep: every return of something known, one after another, then what is new. Eqs. (19)-(31)."""
    C, D1, D2, E = scratch[0], scratch[1], scratch[2], scratch[3]
    for i in range(lanes.size):
        lane = lanes[i]
        model, K = models[lane], num_returns[lane]
        associate(
            lane, mu, P, model, n_t, count, ids, target_known, counters, ranges, bearings, labels, K, code, gates, cost,
            slots,
        )  # fmt: skip
        n = rows_in_use(n_t, count[lane])
        for k in range(K):
            slot = slots[lane, k]
            is_target = slot == TARGET_SLOT and target_known[lane]
            if slot < 0 and not is_target:
                continue
            j = ROBOT if is_target else ROBOT + n_t + 2 * slot
            limit = limit_of(gates[0], model, is_target)
            outcome, nis = observe(
                mu, P, W, lane, n, j, model, ranges[lane, k], bearings[lane, k], limit, rule, C, D1, E, order
            )
            if outcome != USED:
                note(outcome, nis, is_target, mu, P, lane, n, n_t, model, target_known, pending, counters)
        if n_t > 0 and model.target_kind == TWIST:
            mu[lane, 5] = wrap(mu[lane, 5])
        grow_by_points(
            lane, mu, P, model, n_t, count, ids, first, next_id, target_known, pending, counters, ranges, bearings,
            labels, K, code != KNOWN, slots, last_dt[lane], rule, C, D1, D2, E, order,
        )  # fmt: skip


class SigmaPointFilter(GaussianEstimator):
    """What the sigma-point filters share; they differ in their `rule`.

    Attributes:
        rule: [3] (h, c, d): half the distance between sigma points in standard deviations, and the factors of
            sum D2 D2' and of e e' in a covariance (see `estimators.gaussian.interpolation`).
    """

    def _allocate(self) -> None:
        super()._allocate()
        self.rule: Floats = np.zeros(3)
        self.scratch: Floats = np.zeros((4, 5, 5))
        self.order: Ints = np.zeros(5, dtype=np.int64)  # scratch

    def _scratch(self) -> tuple[Any, ...]:
        return (*super()._scratch(), self.scratch, self.order)

    def _prediction(self, control: Floats, dt: Floats) -> Call:
        return (
            predict, self.mu, self.P, self.models, self.n_t, self.count, self.target_known, self.pending, control, dt,
            self.last_dt, LATER, self.rule, self.scratch, self.order,
        )  # fmt: skip

    def _correction(self, scan: Scan) -> Call:
        return (
            update, self.mu, self.P, self.work, self.models, self.n_t, self.count, self.ids, self.first, self.next_id,
            self.target_known, self.pending, self.counters, scan.ranges, scan.bearings, scan.labels, scan.count,
            self.association_code, self.gates, self.cost, self.slots, self.last_dt, LATER, self.rule,
            self.scratch, self.order,
        )  # fmt: skip


class CDKF(SigmaPointFilter):
    """Central difference Kalman filter, Tian et al. 2010: sigma points instead of Jacobians.

    Args:
        motion, sensor, target, num_lanes, max_landmarks: see `Estimator`.
        h: half the distance between sigma points, in standard deviations; sqrt(3) is right for Gaussians. Below 1 the
            second-order part of a covariance turns negative; as h -> 0 the slopes become Jacobians.
        **options: see `GaussianEstimator`; the paper keeps a `budget` of 10 landmarks.
    """

    name = "cdkf"
    summary = "Central difference Kalman filter: sigma points instead of Jacobians, optional landmark budget"

    def __init__(
        self,
        motion: MotionModel,
        sensor: SensorModel,
        target: TargetModel | None,
        *,
        num_lanes: int = 1,
        max_landmarks: int,
        h: float = GAUSSIAN_STEP,
        **options: Any,
    ) -> None:
        super().__init__(motion, sensor, target, num_lanes=num_lanes, max_landmarks=max_landmarks, **options)
        if not 0.0 < h < math.inf:
            raise ValueError(f"h must be a positive number of standard deviations (sqrt(3) for Gaussians); got {h!r}")
        self.h = float(h)
        square = self.h * self.h
        self.rule[:] = self.h, (square - 1.0) / (square * square), 0.0

    def _own_options(self) -> dict[str, Any]:
        return {"h": self.h}
