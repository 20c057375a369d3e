"""The right-invariant EKF of a recorded robot: correlated errors, scales and biases, mis-read labels."""

import math
from collections.abc import Mapping
from typing import Any, ClassVar, Literal

import numpy as np

from estimators.gaussian.growth import grow
from estimators.gaussian.invariant import retract_rows
from estimators.gaussian.layout import MATCH_GATE, NEW_GATE, Call, GaussianEstimator
from estimators.gaussian.recorded_motion import (
    BEARING_BIAS,
    EXTRA,
    RANGE_SCALE,
    SPEED_SCALE,
    TURN_BIAS,
    TURN_SCALE,
    predict,
)
from estimators.gaussian.robot_errors import RobotErrors
from estimators.gaussian.sweep import (
    DROPPED_RETURN,
    GATE_REJECTED,
    NOT_POSITIVE,
    REINITIALISED,
    UNLIKELY,
    UNUSABLE,
    USED,
    associate,
    forget_target,
    limit_of,
)
from estimators.interface import Floats, Ints, Scan
from estimators.kernels.angles import wrap
from estimators.kernels.association import DROPPED, KNOWN, TARGET_SLOT
from estimators.kernels.borrow import borrow
from estimators.kernels.bound import LATER
from estimators.kernels.gaussian import ROBOT, append_point, clear_rows, nis_and_log_det, rows_in_use, shear
from estimators.kernels.jit import inline, jit
from estimators.kernels.left_looking import CORRECTION, settle
from estimators.kernels.range_bearing import gradient, measure, noise_std, offset, offset_noise
from estimators.models import TWIST, MotionModel, SensorModel, TargetModel

SHORTEST_AGE = 1e-6  # [s] between two returns of one label


@inline
def slowed(correlation):
    """What white noise must be multiplied by to carry the information rate of a first-order process: (1+f)/(1-f)."""
    return (1.0 + correlation) / (1.0 - correlation)


@inline
def return_noise(model, errors, distance, age):
    """Variances of a return whose label was last seen `age` seconds ago."""
    range_std, bearing_std = noise_std(model, distance)
    r00, r11 = range_std * range_std, bearing_std * bearing_std
    if errors.range_time > 0.0:
        r00 *= slowed(math.exp(-age / errors.range_time))
    if errors.bearing_time > 0.0:
        correlated = errors.bearing_correlated_std * errors.bearing_correlated_std
        r11 *= slowed(math.exp(-age / errors.bearing_time) * correlated / (correlated + r11))
    return r00, r11


@inline
def project(P, work, lane, n, j, extra, a00, a01, a10, a11, c0, c1, distance):
    """H P into rows 0 and 1 of the scratch; H = [-A, c, A] over position, heading, point; and scale and bias."""
    scale, bias = extra + RANGE_SCALE, extra + BEARING_BIAS
    for i in range(n):
        dx, dy = P[lane, j, i] - P[lane, 0, i], P[lane, j + 1, i] - P[lane, 1, i]
        turn = P[lane, 2, i]
        work[0, i] = a00 * dx + a01 * dy + c0 * turn + distance * P[lane, scale, i]
        work[1, i] = a10 * dx + a11 * dy + c1 * turn + P[lane, bias, i]


@inline
def along(x, row, j, a0, a1, c, which, factor):
    """One row of H times a row of the scratch."""
    return a0 * (x[row, j] - x[row, 0]) + a1 * (x[row, j + 1] - x[row, 1]) + c * x[row, 2] + factor * x[row, which]


@inline
def take(P, work, lane, n, y0, y1, s00, s01, s11):
    """Collect the correction and P -= W W', from H P in rows 0 and 1."""
    l00 = math.sqrt(s00)
    l10 = s01 / l00
    l11 = math.sqrt(s11 - l10 * l10)
    e0 = y0 / l00
    e1 = (y1 - l10 * e0) / l11
    for i in range(n):
        w0 = work[0, i] / l00
        w1 = (work[1, i] - l10 * w0) / l11
        work[0, i] = w0
        work[1, i] = w1
        work[CORRECTION, i] += w0 * e0 + w1 * e1
    settle(P, work, lane, n, 2)


@inline
def observe(mu, P, work, lane, n, j, extra, model, errors, distance, bearing, age, measured, limit, dof):
    """Collect the correction by one return, linearised at the mean before the sweep or where it was measured.

    At l, the point's offset there, A = grad h(l); the heading's column -A J (p - p_r) keeps to the means, so that
    turning everything stays unobservable. Returns below the gate are weighted by (dof + 2) / (dof + NIS).
    """
    dx, dy = mu[lane, j] - mu[lane, 0], mu[lane, j + 1] - mu[lane, 1]
    lx, ly = offset(distance, bearing, mu[lane, 2]) if measured else (dx, dy)
    if not lx * lx + ly * ly > 0.0:
        return UNUSABLE, 0.0
    r, b = measure(lx, ly, mu[lane, 2])
    a00, a01, a10, a11 = gradient(lx, ly)
    c0, c1 = a00 * dy - a01 * dx, a10 * dy - a11 * dx
    scale, bias = extra + RANGE_SCALE, extra + BEARING_BIAS
    project(P, work, lane, n, j, extra, a00, a01, a10, a11, c0, c1, r)
    p00 = along(work, 0, j, a00, a01, c0, scale, r)
    s01 = along(work, 0, j, a10, a11, c1, bias, 1.0)
    p11 = along(work, 1, j, a10, a11, c1, bias, 1.0)
    y0 = distance - r - a00 * (dx - lx) - a01 * (dy - ly) - along(work, CORRECTION, j, a00, a01, c0, scale, r)
    y1 = wrap(bearing - b) - a10 * (dx - lx) - a11 * (dy - ly) - along(work, CORRECTION, j, a10, a11, c1, bias, 1.0)
    r00, r11 = return_noise(model, errors, r, age)
    nis = nis_and_log_det(p00 + r00, s01, p11 + r11, y0, y1)[0]
    if not nis <= limit:
        return (UNUSABLE if math.isnan(nis) else UNLIKELY), nis
    weight = (dof + 2.0) / (dof + nis) if dof > 0.0 else 1.0
    take(P, work, lane, n, y0, y1, p00 + r00 / weight, s01, p11 + r11 / weight)
    return USED, nis


@inline
def gate_of(own, gates):
    """The robot's own gate where it has one, else the filter's."""
    return own if own < math.inf else gates[0]


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
def correct_returns(mu, lane, extra, ranges, bearings, num_returns, corrected):
    """The sweep without the sensor's estimated scale and bias, into `corrected` [2, L, K]."""
    for k in range(num_returns):
        corrected[0, lane, k] = ranges[lane, k] / (1.0 + mu[lane, extra + RANGE_SCALE])
        corrected[1, lane, k] = wrap(bearings[lane, k] - mu[lane, extra + BEARING_BIAS])


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
    n = rows_in_use(n_t + EXTRA, count[lane])
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
    retract_rows(mu, P, work, lane, n, 0, n_t, extra + EXTRA, count[lane], own_heading)
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


class RecordedRIEKF(GaussianEstimator):
    """Right-invariant EKF that is honest on recorded robots: scales, biases, slow errors, mis-read labels.

    **State.** As `ri-ekf`, and five constants with priors: errors of the odometry's speed and turn scale (dv, dw), a
    turn bias b, the sensor's range scale s and bearing bias beta. Zero at the start; not part of `Belief.joint`.

    **Motion.** ds = v dt (1 + dv), dheading = w dt (1 + dw) + b dt, b while the robot is commanded to move, v and w
    after the motion model's calibration. To the motion model's noise come the sideways variance `lateral_noise` |ds|
    and the heading variance `turn_noise` |dheading|; a robot commanded to stand gets `still_noise` times the model's.
    A constant-velocity target wanders: dv = (-v / tau - kappa (p - c)) dt + white acceleration.

    **Measurement.** h = [rho (1 + s), atan2(D) - heading + beta]. An error that changes slowly says little new: with
    D the seconds since this label was last seen, the variances are multiplied by (1 + f) / (1 - f), f = exp(-D / tau_r)
    for the range, f = exp(-D / tau_b) sab^2 / (sab^2 + sb^2) for the bearing: the information rate of a first-order
    process, without a state. A target out of sight for more than `target_fresh` is linearised where it is MEASURED,
    A = grad h there, with the heading's column -A J (p - p_r). Update and retraction as in `ri-ekf`.

    **Labels.** Returns beyond the gates are rejected; landmark returns within are weighted by (4 + 2) / (4 + NIS) (for
    `weight_dof` = 4). A label rejected `restart_after` times in a row at about the same place starts anew there.

    Args:
        motion: how the robot moves. sensor, target: see `GaussianEstimator`, as all options but `budget` and
            `remove_below`.
        errors: a `RobotErrors` or its numbers by name; the defaults add nothing to `ri-ekf`.

    When to use: recorded robots (`slam-gym replay --calibration`; `docs/recorded_robots.md`).

    Known weakness: the numbers must have been fitted (`slam-gym calibrate`). What is common to all landmarks seen
    together is modelled only as a constant. `TargetModel.reinitialise_spread` is not used.

    Reference: as `ri-ekf`; Student t weights: Lange, Little and Taylor, "Robust statistical modeling using the t
    distribution", JASA 84(408), 1989.
    """

    name: ClassVar[str] = "recorded-ri-ekf"
    summary: ClassVar[str] = "right-invariant EKF for recorded robots: scales, biases, slow errors, mis-read labels"
    mean_is_all: ClassVar[bool] = False
    extra_states: ClassVar[int] = EXTRA

    def __init__(
        self,
        motion: MotionModel,
        sensor: SensorModel,
        target: TargetModel | None,
        *,
        num_lanes: int = 1,
        max_landmarks: int,
        association: Literal["known", "nearest", "jcbb"] = "known",
        gate: float = math.inf,
        match_gate: float = MATCH_GATE,
        new_gate: float = NEW_GATE,
        errors: RobotErrors | Mapping[str, float] | None = None,
    ) -> None:
        try:
            self.errors = errors if isinstance(errors, RobotErrors) else RobotErrors(**(errors or {}))
        except TypeError as error:
            names = ", ".join(RobotErrors.__dataclass_fields__)
            raise ValueError(f"errors must be a RobotErrors or a mapping of its numbers ({names}); {error}") from error
        super().__init__(
            motion, sensor, target, num_lanes=num_lanes, max_landmarks=max_landmarks, association=association,
            gate=gate, match_gate=match_gate, new_gate=new_gate, remove_below=0.0,
        )  # fmt: skip

    def _allocate(self) -> None:
        super()._allocate()
        L, M = self.num_lanes, self.max_landmarks
        self.packed = self.errors.pack()
        self.clock: Floats = np.zeros(L)
        self.seen: Floats = np.full((L, M + 1), -np.inf)  # [s] by slot, the target last
        self.rejected: Floats = np.zeros((L, M + 1, 3))  # how often in a row, and where
        self.corrected: Floats = np.zeros((2, L, 0))  # scratch

    def _after_reset(self, lanes: Ints) -> None:
        self.clock[lanes], self.seen[lanes], self.rejected[lanes] = 0.0, -np.inf, 0.0
        for which, std in (
            (SPEED_SCALE, self.errors.speed_scale_std),
            (TURN_SCALE, self.errors.turn_scale_std),
            (TURN_BIAS, self.errors.turn_bias_std),
            (RANGE_SCALE, self.errors.range_scale_std),
            (BEARING_BIAS, self.errors.bearing_bias_std),
        ):
            row = ROBOT + self.n_t + which
            self.P[lanes, row, row] = std * std

    def make_room(self, width: int) -> None:
        """See `GaussianEstimator.make_room`."""
        super().make_room(width)
        if width > self.corrected.shape[2]:
            self.corrected = np.zeros((2, self.num_lanes, width))

    def _corrections(self, scan: Scan) -> list[Call]:
        return [self._correction(scan)]  # a vague target is linearised where it is measured, not forgotten

    def _prediction(self, control: Floats, dt: Floats) -> Call:
        return (
            predict, self.mu, self.P, self.models, self.packed, self.n_t, self.count, self.target_known, self.pending,
            self.clock, control, dt, self.last_dt, LATER,
        )  # fmt: skip

    def _correction(self, scan: Scan) -> Call:
        return (
            update, self.mu, self.P, self.models, self.packed, self.n_t, self.count, self.ids, self.first, self.next_id,
            self.target_known, self.pending, self.counters, self.last_dt, self.clock, self.seen, self.rejected,
            scan.ranges, scan.bearings, scan.labels, scan.count, self.association_code, self.gates, self.slots,
            self.cost, self.corrected, self.work, LATER,
        )  # fmt: skip

    @property
    def constants(self) -> dict[str, Floats]:
        """The five constants' estimates [L] and, under `..._std`, their deviations."""
        names, found = ("speed_scale", "turn_scale", "turn_bias", "range_scale", "bearing_bias"), {}
        for row, name in enumerate(names, start=ROBOT + self.n_t):
            found[name], found[f"{name}_std"] = self.mu[:, row].copy(), np.sqrt(self.P[:, row, row])
        return found

    @property
    def _state_names(self) -> tuple[str, ...]:
        return (*super()._state_names, "clock", "seen", "rejected")

    def joint(self, lane: int) -> tuple[Floats, Floats]:
        """See `GaussianEstimator.joint`; without the five constants."""
        mean, cov = super().joint(lane)
        start = ROBOT + (self.n_t if self.target_known[lane] else 0)
        rows: Any = np.r_[:start, start + EXTRA : len(mean)]
        return mean[rows], cov[np.ix_(rows, rows)]
