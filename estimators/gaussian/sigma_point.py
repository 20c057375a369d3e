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
    spread_return,
)
from estimators.gaussian.layout import GaussianEstimator
from estimators.gaussian.sweep import (
    DROPPED_RETURN,
    GATE_REJECTED,
    NOT_POSITIVE,
    OVERFLOW,
    REINITIALISED,
    associate,
    forget_target,
)
from estimators.interface import Floats, Ints, Scan
from estimators.kernels.angles import wrap
from estimators.kernels.association import NEAREST, NEW, TARGET_SLOT, slot_of
from estimators.kernels.gaussian import ROBOT, drift_velocity, nis_and_log_det, rows_in_use
from estimators.kernels.jit import inline, jit
from estimators.kernels.motion import calibrated, control_std
from estimators.kernels.range_bearing import noise_std, offset, offset_noise
from estimators.models import TWIST, MotionModel, SensorModel, TargetModel

GAUSSIAN_STEP = math.sqrt(3.0)  # h, Tian et al. 2010: matches the fourth moment of a Gaussian


@inline
def predict_target(mu, P, lane, n, model, target_known, pending, dt, h, C, D1, D2, E):
    """Move the target: a twist by sigma points; constant velocity is linear, where sigma points are exact."""
    if target_known[lane] and model.target_kind == TWIST:
        move_body(
            mu, P, lane, n, ROBOT, TARGET_MOVES, model, model.target_speed, model.target_turn_rate,
            model.target_speed_std, model.target_turn_std, dt, h, C, D1, D2, E,
        )  # fmt: skip
    elif target_known[lane]:
        drift_velocity(mu, P, lane, n, model.acceleration_density, dt)
    elif pending[lane, 0] > 0.0:
        advance_pending(pending, lane, model.target_speed * dt, model.target_turn_rate * dt)


@jit
def predict(mu, P, models, n_t, count, target_known, pending, control, dt, last_dt, lanes, h, scratch):
    """One step of the named lanes. Eqs. (9)-(18)."""
    C, D1, D2, E = scratch[0], scratch[1], scratch[2], scratch[3]
    for i in range(lanes.size):
        lane = lanes[i]
        step = dt[lane]
        if not step > 0.0:
            continue
        model = models[lane]
        n = rows_in_use(n_t, count[lane])
        v, w = calibrated(model, control[lane, 0], control[lane, 1])
        sv, sw = control_std(model, v, w, step)
        move_body(mu, P, lane, n, 0, ROBOT_MOVES, model, v, w, sv, sw, step, h, C, D1, D2, E)
        if n_t > 0:
            predict_target(mu, P, lane, n, model, target_known, pending, step, h, C, D1, D2, E)
        last_dt[lane] = step


@inline
def observe(mu, P, W, lane, n, j, model, distance, bearing, limit, h, C, D1, E):
    """Update by one return of the point at row j; the codes are those of the EKF's `observe`."""
    r0, r, b, s00, s01, s11 = spread_return(mu, P, lane, j, h, C, D1, E)
    range_std, bearing_std = noise_std(model, r0)
    s00 += range_std * range_std
    s11 += bearing_std * bearing_std
    y0, y1 = distance - r, wrap(bearing - b)
    nis = nis_and_log_det(s00, s01, s11, y0, y1)[0]
    if not nis <= limit:
        return 1 if math.isnan(nis) else 2
    downdate_by_points(mu, P, W, lane, n, j, E, y0, y1, s00, s01, s11)
    mu[lane, 2] = wrap(mu[lane, 2])
    return 0


@inline
def grow_by_points(
    lane, mu, P, model, n_t, count, ids, first, next_id, target_known, pending, counters, scan_ranges, scan_bearings,
    scan_labels, num_returns, nearest, slots, dt, h, C, D1, D2, E,
):  # fmt: skip
    """Take in the returns of one lane's sweep that are not yet in the state; see `growth.grow`.

    A twist target's heading comes from the chord of two sightings, to first order, as in every filter of the family.
    """
    for k in range(num_returns):
        slot, distance, bearing = slots[lane, k], scan_ranges[lane, k], scan_bearings[lane, k]
        std_r, std_b = noise_std(model, distance)
        if slot == TARGET_SLOT and not target_known[lane]:
            n = rows_in_use(n_t, count[lane])
            if model.target_kind == TWIST:
                dx, dy = offset(distance, bearing, mu[lane, 2])
                n00, n01, n11 = offset_noise(dx, dy, std_r, std_b)
                start_target(
                    mu, P, lane, n, model, target_known, pending, dx, dy, -dy, dx, n00, n01, n11, mu[lane, 3],
                    mu[lane, 4], dt,
                )  # fmt: skip
            else:
                append_by_points(mu, P, lane, n, ROBOT, distance, bearing, std_r, std_b, model, h, C, D1, D2, E)
                P[lane, 5, 5] = P[lane, 6, 6] = model.initial_speed_std * model.initial_speed_std
                target_known[lane] = True
        elif slot == NEW:
            label = next_id[lane] if nearest else scan_labels[lane, k]
            if slot_of(ids, lane, count[lane], label) != NEW:
                counters[lane, DROPPED_RETURN] += 1  # seen twice in its first sweep
                continue
            if count[lane] == ids.shape[1]:
                counters[lane, OVERFLOW] += 1
                continue
            slot = count[lane]
            count[lane] = slot + 1
            n, j = rows_in_use(n_t, slot + 1), ROBOT + n_t + 2 * slot
            append_by_points(mu, P, lane, n, j, distance, bearing, std_r, std_b, model, h, C, D1, D2, E)
            ids[lane, slot] = label
            first[lane, slot, 0], first[lane, slot, 1] = mu[lane, j], mu[lane, j + 1]
            slots[lane, k] = slot
            next_id[lane] += 1


@jit
def update(
    mu, P, W, models, n_t, count, ids, first, next_id, target_known, pending, counters, ranges, bearings, labels,
    num_returns, code, gates, cost, slots, last_dt, lanes, h, scratch,
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
        gate = math.inf if code == NEAREST else gates[0]
        for k in range(K):
            slot = slots[lane, k]
            is_target = slot == TARGET_SLOT and target_known[lane]
            if slot < 0 and not is_target:
                continue
            j = ROBOT if is_target else ROBOT + n_t + 2 * slot
            limit = min(gate, model.reinitialise_nis) if is_target else gate
            outcome = observe(mu, P, W, lane, n, j, model, ranges[lane, k], bearings[lane, k], limit, h, C, D1, E)
            if outcome == 1:
                counters[lane, NOT_POSITIVE] += 1
            elif outcome == 2 and is_target and model.reinitialise_nis <= gate:
                forget_target(mu, P, lane, n, n_t, target_known, pending)
                counters[lane, REINITIALISED] += 1
            elif outcome == 2:
                counters[lane, GATE_REJECTED] += 1
        if n_t > 0 and models[lane].target_kind == TWIST:
            mu[lane, 5] = wrap(mu[lane, 5])
        grow_by_points(
            lane, mu, P, model, n_t, count, ids, first, next_id, target_known, pending, counters, ranges, bearings,
            labels, K, code == NEAREST, slots, last_dt[lane], h, C, D1, D2, E,
        )  # fmt: skip


class CDKF(GaussianEstimator):
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
        self.scratch: Floats = np.zeros((4, 5, 5))

    def _predict(self, control: Floats, dt: Floats, lanes: Ints) -> None:
        predict(
            self.mu, self.P, self.models, self.n_t, self.count, self.target_known, self.pending, control, dt,
            self.last_dt, lanes, self.h, self.scratch,
        )  # fmt: skip

    def _update(self, scan: Scan, lanes: Ints) -> None:
        update(
            self.mu, self.P, self.work, self.models, self.n_t, self.count, self.ids, self.first, self.next_id,
            self.target_known, self.pending, self.counters, scan.ranges, scan.bearings, scan.labels, scan.count,
            self.association_code, self.gates, self.cost, self.slots, self.last_dt, lanes, self.h, self.scratch,
        )  # fmt: skip
