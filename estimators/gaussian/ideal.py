"""The ideal EKF: every Jacobian at the truth. A reference for benchmarks; no robot can run it."""

import math
from typing import ClassVar

import numpy as np

from estimators.gaussian.growth import admits, advance_pending, enter
from estimators.gaussian.layout import Call, GaussianEstimator
from estimators.gaussian.sweep import UNLIKELY, UNUSABLE, USED, associate, limit_of, note
from estimators.interface import BoundCalls, Floats, Ints, Scan, TruthAware
from estimators.kernels.angles import wrap
from estimators.kernels.association import KNOWN, TARGET_SLOT
from estimators.kernels.bound import LATER
from estimators.kernels.gaussian import (
    ROBOT,
    downdate,
    innovation_cov,
    move_heading_body,
    move_robot,
    nis_and_log_det,
    rows_in_use,
)
from estimators.kernels.jit import inline, jit
from estimators.kernels.motion import calibrated, control_noise, control_std, displacement, unicycle, unicycle_noise
from estimators.kernels.range_bearing import gradient, measure, noise_std, offset, offset_noise
from estimators.kernels.rounding import blunted_by_distance
from estimators.kernels.velocity_target import move_velocity_target
from estimators.models import TWIST


@inline
def predict_robot(mu, P, lane, n, model, truth, past, v, w, dt):
    """Move the robot; heading column of F: J of the true displacement, noise at the true heading."""
    v, w = calibrated(model, v, w)
    sv, sw = control_std(model, v, w, dt)
    dx, dy, turn = displacement(model, v, w, dt, mu[lane, 2])
    q00, q01, q02, q11, q12, q22 = control_noise(model, v, w, dt, past[lane, 2], sv, sw)
    hx, hy = past[lane, 1] - truth[lane, 1], truth[lane, 0] - past[lane, 0]
    move_robot(P, lane, n, hx, hy, q00, q01, q02, q11, q12, q22)
    mu[lane, 0] += dx
    mu[lane, 1] += dy
    mu[lane, 2] = wrap(mu[lane, 2] + turn)


@inline
def predict_target(mu, P, lane, n, model, target_known, pending, truth, past, dt):
    """Move the target. Constant velocity is linear; a twist's Jacobians are taken at the truth.

    Before the second `set_truth` of an episode the true displacement is not known: the estimate's stands in.
    """
    if not target_known[lane]:
        if pending[lane, 0] > 0.0:
            advance_pending(pending, lane, model.target_speed * dt, model.target_turn_rate * dt)
        return
    if model.target_kind != TWIST:
        move_velocity_target(mu, P, lane, n, model, dt)
        return
    speed, turn_rate, heading = model.target_speed, model.target_turn_rate, mu[lane, 5]
    dx, dy, turn = unicycle(speed, turn_rate, dt, heading)
    true_dx, true_dy, true_heading = dx, dy, heading
    if not math.isnan(past[lane, 0]):
        true_dx, true_dy = truth[lane, 0] - past[lane, 0], truth[lane, 1] - past[lane, 1]
        backwards = -1.0 if speed < 0.0 else 1.0
        true_heading = math.atan2(backwards * past[lane, 3], backwards * past[lane, 2])
    q00, q01, q02, q11, q12, q22 = unicycle_noise(
        speed, turn_rate, dt, true_heading, model.target_speed_std, model.target_turn_std
    )
    move_heading_body(P, lane, n, ROBOT, -true_dy, true_dx, q00, q01, q02, q11, q12, q22)
    mu[lane, 3] += dx
    mu[lane, 4] += dy
    mu[lane, 5] = wrap(heading + turn)


@jit
def predict(
    mu, P, models, n_t, count, target_known, pending, control, dt, last_dt, lanes, pose, past_pose, target, past_target
):
    """One step of the named lanes; the truth at its end becomes the past."""
    for i in range(lanes.size):
        lane = lanes[i]
        step = dt[lane]
        if step > 0.0:
            n = rows_in_use(n_t, count[lane])
            v, w = control[lane, 0], control[lane, 1]
            predict_robot(mu, P, lane, n, models[lane], pose, past_pose, v, w, step)
            if n_t > 0:
                predict_target(mu, P, lane, n, models[lane], target_known, pending, target, past_target, step)
            last_dt[lane] = step
        for k in range(ROBOT):
            past_pose[lane, k] = pose[lane, k]
        for k in range(target.shape[1]):
            past_target[lane, k] = target[lane, k]


@inline
def observe(mu, P, W, lane, n, j, model, true_dx, true_dy, distance, bearing, limit):
    """Update by one return of the point at row j: H and R at the truth, the residual at the mean."""
    dx, dy = mu[lane, j] - mu[lane, 0], mu[lane, j + 1] - mu[lane, 1]
    if not (dx * dx + dy * dy > 0.0 and true_dx * true_dx + true_dy * true_dy > 0.0):
        return UNUSABLE, 0.0
    r, b = measure(dx, dy, mu[lane, 2])
    a00, a01, a10, a11 = gradient(true_dx, true_dy)
    true_r = math.sqrt(true_dx * true_dx + true_dy * true_dy)
    range_std, bearing_std = noise_std(model, true_r)
    range_std, bearing_std = blunted_by_distance(P, W, lane, n, j, true_r, 0.0, -1.0, range_std, bearing_std)
    s00, s01, s11 = innovation_cov(
        P, lane, j, a00, a01, a10, a11, 0.0, -1.0, range_std * range_std, bearing_std * bearing_std
    )
    y0, y1 = distance - r, wrap(bearing - b)
    nis = nis_and_log_det(s00, s01, s11, y0, y1)[0]
    if not nis <= limit:
        return (UNUSABLE if math.isnan(nis) else UNLIKELY), nis
    downdate(mu, lane, P, W, lane, n, j, a00, a01, a10, a11, 0.0, -1.0, y0, y1, s00, s01, s11)
    mu[lane, 2] = wrap(mu[lane, 2])
    return USED, nis


@inline
def true_offset(lane, slot, label, pose, target, landmarks, dx, dy):
    """D of what a return belongs to, in truth; the estimate (dx, dy) where the label does not tell which that is."""
    if slot == TARGET_SLOT:
        x, y = target[lane, 0], target[lane, 1]
    elif 0 <= label < landmarks.shape[1]:
        x, y = landmarks[lane, label, 0], landmarks[lane, label, 1]
    else:
        return dx, dy
    return (dx, dy) if math.isnan(x) else (x - pose[lane, 0], y - pose[lane, 1])


@inline
def update_one(
    lane, mu, P, model, n_t, count, ids, first, next_id, target_known, pending, counters, last_dt, ranges, bearings,
    labels, num_returns, code, gates, slots, cost, work, pose, target, landmarks,
):  # fmt: skip
    """One lane's sweep: what is in the state first, one return after the other, then what is new."""
    associate(
        lane, mu, P, model, n_t, count, ids, target_known, counters, ranges, bearings, labels, num_returns, code, gates,
        cost, slots,
    )  # fmt: skip
    n = rows_in_use(n_t, count[lane])
    for k in range(num_returns):
        slot = slots[lane, k]
        is_target = slot == TARGET_SLOT and target_known[lane]
        if slot < 0 and not is_target:
            continue
        j = ROBOT if is_target else ROBOT + n_t + 2 * slot
        dx, dy = mu[lane, j] - mu[lane, 0], mu[lane, j + 1] - mu[lane, 1]
        dx, dy = true_offset(lane, slot, labels[lane, k], pose, target, landmarks, dx, dy)
        limit = limit_of(gates[0], model, is_target)
        outcome, nis = observe(mu, P, work, lane, n, j, model, dx, dy, ranges[lane, k], bearings[lane, k], limit)
        if outcome != USED:
            note(outcome, nis, is_target, mu, P, lane, n, n_t, model, target_known, pending, counters)
    if n_t > 0 and model.target_kind == TWIST:
        mu[lane, 5] = wrap(mu[lane, 5])
    for k in range(num_returns):
        slot = slots[lane, k]
        label = next_id[lane] if code != KNOWN else labels[lane, k]
        if not admits(slot, label, lane, count, ids, target_known, counters):
            continue
        dx, dy = offset(ranges[lane, k], bearings[lane, k], mu[lane, 2])
        true_dx, true_dy = true_offset(lane, slot, labels[lane, k], pose, target, landmarks, dx, dy)
        range_std, bearing_std = noise_std(model, math.sqrt(true_dx * true_dx + true_dy * true_dy))
        n00, n01, n11 = offset_noise(true_dx, true_dy, range_std, bearing_std)
        slots[lane, k] = enter(
            mu, P, lane, model, n_t, count, ids, first, next_id, target_known, pending, slot, label, dx, dy, -true_dy,
            true_dx, n00, n01, n11, mu[lane, ROBOT], mu[lane, ROBOT + 1], last_dt[lane],
        )  # fmt: skip


@jit
def update(
    mu, P, models, n_t, count, ids, first, next_id, target_known, pending, counters, last_dt, ranges, bearings, labels,
    counts, code, gates, slots, cost, work, lanes, pose, target, landmarks,
):  # fmt: skip
    """One sweep of the named lanes: see `update_one`."""
    for i in range(lanes.size):
        lane = lanes[i]
        update_one(
            lane, mu, P, models[lane], n_t, count, ids, first, next_id, target_known, pending, counters, last_dt,
            ranges, bearings, labels, counts[lane], code, gates, slots, cost, work, pose, target, landmarks,
        )  # fmt: skip


class IdealEKF(GaussianEstimator, TruthAware):
    """The EKF with every Jacobian at the truth: what consistency costs when linearisation is perfect.

    As `EKF`, but F, H, R, the control noise and the initialisation Jacobian [I, J(l - p)] are evaluated at the true
    poses, landmarks and target that `set_truth` brings; means and residuals stay the filter's own. The truth is that at
    the END of the step: call `set_truth` before each predict with what the robot will have reached, and before each
    update. Linearised at the estimate all the same: the chord of a twist target's first two sightings, and returns
    whose label does not index the true landmarks (`association="nearest"` without labels).

    Args:
        motion: how the robot moves. sensor, target: see `GaussianEstimator`, as all options.

    When to use: as the reference curve in comparisons; ANEES near its dimension shows that the noise model is right.

    Known weakness: not usable on a robot, and no upper bound: at large noise it can diverge as any linearised filter.

    Reference: Huang, Mourikis and Roumeliotis, "Observability-based rules for designing consistent EKF SLAM
    estimators", IJRR 2010.
    """

    name: ClassVar[str] = "ideal-ekf"
    summary: ClassVar[str] = "EKF with every Jacobian at the truth: a reference for benchmarks only"

    def _allocate(self) -> None:
        super()._allocate()
        L = self.num_lanes
        self.true_pose: Floats = np.zeros((L, 3))
        self.past_pose: Floats = np.zeros((L, 3))
        self.true_target: Floats = np.full((L, 4), np.nan)
        self.past_target: Floats = np.full((L, 4), np.nan)
        self.landmarks: Floats | None = None

    def _after_reset(self, lanes: Ints) -> None:
        self.past_pose[lanes] = self.mu[lanes, :ROBOT]
        self.past_target[lanes] = np.nan

    def set_truth(self, pose: Floats, target: Floats, landmarks: Floats) -> None:
        """See `TruthAware.set_truth`; the truth at the end of the step that follows or has just been predicted."""
        self.true_pose[...] = pose
        self.true_target[...] = target
        self.landmarks = np.ascontiguousarray(landmarks, dtype=np.float64)
        if self.bank is not None and self.bank.members is not None:
            size = self.bank.size
            self.bank.members.set_truth(*(np.repeat(array, size, 0) for array in (pose, target, landmarks)))

    def bound_calls(self, control: Floats, dt: Floats, scan: Scan) -> BoundCalls | None:
        """None: the truth comes in arrays that change."""
        return None

    @property
    def _state_names(self) -> tuple[str, ...]:
        return (*super()._state_names, "past_pose", "past_target")

    def _truth(self) -> Floats:
        if self.landmarks is None:
            raise ValueError("ideal-ekf needs the truth: call set_truth before every predict and update")
        return self.landmarks

    def _prediction(self, control: Floats, dt: Floats) -> Call:
        self._truth()
        return (
            predict, self.mu, self.P, self.models, self.n_t, self.count, self.target_known, self.pending, control, dt,
            self.last_dt, LATER, self.true_pose, self.past_pose, self.true_target, self.past_target,
        )  # fmt: skip

    def _correction(self, scan: Scan) -> Call:
        landmarks = self._truth()
        return (
            update, self.mu, self.P, self.models, self.n_t, self.count, self.ids, self.first, self.next_id,
            self.target_known, self.pending, self.counters, self.last_dt, scan.ranges, scan.bearings, scan.labels,
            scan.count, self.association_code, self.gates, self.slots, self.cost, self.work, LATER, self.true_pose,
            self.true_target, landmarks,
        )  # fmt: skip
