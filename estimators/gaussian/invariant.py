"""The right-invariant EKF: P in ordinary coordinates, corrections through the group, exact and cheap.

The error of heading and points (robot, landmarks, target, its velocity) lives on the group of one rotation and many
translations. Its update equals an ordinary stacked update, followed by (a) a retraction along the group's
exponential, q+ = R(th) q + V(th)(dq - J q th), and (b) the change of the ordinary coordinates that goes with it.
"""

import math
from typing import ClassVar

from estimators.gaussian.ekf import predict
from estimators.gaussian.growth import grow
from estimators.gaussian.layout import Call, GaussianEstimator
from estimators.gaussian.sweep import UNLIKELY, UNUSABLE, USED, associate, limit_of, note
from estimators.gaussian.vague_target import TURNING
from estimators.interface import Floats, Scan
from estimators.kernels.angles import wrap
from estimators.kernels.association import KNOWN, TARGET_SLOT
from estimators.kernels.borrow import borrow
from estimators.kernels.bound import LATER
from estimators.kernels.gaussian import ROBOT, nis_and_log_det, rows_in_use, shear
from estimators.kernels.jit import inline, jit, subroutine
from estimators.kernels.left_looking import CORRECTION, ROWS, SHIFT, TURN, collect, keep_heading, settle, spread
from estimators.kernels.range_bearing import gradient, measure, noise_std
from estimators.kernels.rounding import blunted_by_distance, lifted_if_shrunk
from estimators.kernels.simd import subtract_rows
from estimators.models import TWIST

SMALL_ANGLE = 1e-4  # [rad] below which the series of V is exact to rounding
HALF_ROOT = math.sqrt(0.5)
SURPRISE = 1e3  # NIS of a sweep, 2 a return where all is well: it moves nothing by more than its root in deviations


@inline
def observe(mu, P, work, lane, n, rows, j, model, distance, bearing, limit):
    """Collect the correction by one return; everything is linearised at the mean before the sweep.

    The innovation is what is left after the corrections so far, y - H dx: one after the other, the returns give the
    stacked update. Where it was used, two more than `rows` rows are collected in `work`.
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
    moved_x = work[CORRECTION, j] - work[CORRECTION, 0]
    moved_y = work[CORRECTION, j + 1] - work[CORRECTION, 1]
    y0 = distance - r - a00 * moved_x - a01 * moved_y
    y1 = wrap(bearing - b - a10 * moved_x - a11 * moved_y + work[CORRECTION, 2])
    nis = nis_and_log_det(s00, s01, s11, y0, y1)[0]
    if not nis <= limit:
        return (UNUSABLE if math.isnan(nis) else UNLIKELY), nis
    collect(work, CORRECTION, work, n, rows, y0, y1, s00, s01, s11)
    return USED, nis


@inline
def group_step(angle):
    """R(th) and V(th) of the exponential: cos, sin, a = sin th / th, b = (1 - cos th) / th."""
    c, s = math.cos(angle), math.sin(angle)
    if abs(angle) < SMALL_ANGLE:
        return c, s, 1.0 - angle * angle / 6.0, 0.5 * angle
    return c, s, s / angle, (1.0 - c) / angle


@inline
def retract_point(mu, work, lane, j, angle, c, s, a, b):
    """(a) for the point at rows j, j + 1; its J(q+ - q), the column of (b), goes into row SHIFT."""
    x, y = mu[lane, j], mu[lane, j + 1]
    w0 = work[CORRECTION, j] + y * angle
    w1 = work[CORRECTION, j + 1] - x * angle
    mu[lane, j] = c * x - s * y + a * w0 - b * w1
    mu[lane, j + 1] = s * x + c * y + b * w0 + a * w1
    work[SHIFT, j] = y - mu[lane, j + 1]
    work[SHIFT, j + 1] = mu[lane, j] - x


@inline
def change_coordinates(P, work, lane, n, rows):
    """Settle the rows collected, then (b): P <- M P M', M = I + d e_phi', d in row SHIFT; P is gone over once.

    The added d e' + e d', e = P_phi + P_phiphi d / 2, is written as a difference of squares: it is symmetric to the
    last bit.
    """
    keep_heading(P, work, lane, n, rows)
    half = 0.5 * work[TURN, 2]
    for i in range(n):
        d, e = work[SHIFT, i], work[TURN, i] + half * work[SHIFT, i]
        work[rows, i] = HALF_ROOT * (d - e)
        work[rows + 1, i] = HALF_ROOT * (d + e)
    subtract_rows(P, lane, n, work, rows + 1, 1)


@subroutine
def change_coordinates_far(P, work, lane, n, rows):
    """The same where d is far larger than P leads to expect: its square alone would take P's digits with it.

    What was added may be taken off again by the next correction: a variance of which little is left is lifted by more
    than rounding of what it was made of (`rounding.lifted_if_shrunk`).
    """
    settle(P, work, lane, n, rows)
    keep_heading(P, work, lane, n, 0)  # as it stands in P, to the last bit: rows kept beside P round otherwise
    half = 0.5 * work[TURN, 2]
    for i in range(n):
        d, e = work[SHIFT, i], work[TURN, i] + half * work[SHIFT, i]
        for j in range(i):
            P[lane, i, j] += d * work[TURN, j] + work[SHIFT, j] * (e + half * d)
            P[lane, j, i] = P[lane, i, j]
        was, added = P[lane, i, i], 2.0 * d * e
        P[lane, i, i] = lifted_if_shrunk(was + added, was + abs(added))


@inline
def retract(mu, P, work, lane, n, rows, n_t, count, own_heading, nis):
    """Apply the collected correction to mean and coordinates: see `retract_rows`."""
    retract_rows(mu, P, work, lane, n, rows, n_t, ROBOT + n_t, count, own_heading, nis)


@inline
def retract_rows(mu, P, work, lane, n, rows, n_t, map_row, count, own_heading, nis):
    """Apply the correction to robot, target and `count` landmarks from row `map_row` on, and settle what is collected.

    Every point turns with the robot's heading, a constant-velocity target's velocity too; a twist target
    (`own_heading`) turns with its own, as a second body. nis: the returns', all together.
    """
    angle = work[CORRECTION, 2]
    c, s, a, b = group_step(angle)
    for i in range(n):
        work[SHIFT, i] = 0.0
    retract_point(mu, work, lane, 0, angle, c, s, a, b)
    mu[lane, 2] = wrap(mu[lane, 2] + angle)
    if own_heading:
        turn = work[CORRECTION, 5]
        tc, ts, ta, tb = group_step(turn)
        retract_point(mu, work, lane, ROBOT, turn, tc, ts, ta, tb)
        mu[lane, 5] = wrap(mu[lane, 5] + turn)
        settle(P, work, lane, n, rows)
        rows = 0
        shear(P, lane, n, ROBOT, 5, work[SHIFT, ROBOT])
        shear(P, lane, n, ROBOT + 1, 5, work[SHIFT, ROBOT + 1])
        work[SHIFT, ROBOT] = work[SHIFT, ROBOT + 1] = 0.0
    else:
        for j in range(ROBOT, ROBOT + n_t - 1, 2):
            retract_point(mu, work, lane, j, angle, c, s, a, b)
    for slot in range(count):
        retract_point(mu, work, lane, map_row + 2 * slot, angle, c, s, a, b)
    if nis > SURPRISE:
        change_coordinates_far(P, work, lane, n, rows)
    else:
        change_coordinates(P, work, lane, n, rows)


@inline
def update_one(
    lane, mu, P, model, n_t, count, ids, first, next_id, target_known, pending, counters, last_dt, ranges, bearings,
    labels, num_returns, code, gates, slots, cost, work,
):  # fmt: skip
    """One lane's sweep: the stacked correction, one retraction, then what is new."""
    associate(
        lane, mu, P, model, n_t, count, ids, target_known, counters, ranges, bearings, labels, num_returns, code, gates,
        cost, slots,
    )  # fmt: skip
    n, rows, total = rows_in_use(n_t, count[lane]), 0, 0.0
    for i in range(n):
        work[CORRECTION, i] = 0.0
    for k in range(num_returns):
        slot = slots[lane, k]
        is_target = slot == TARGET_SLOT and target_known[lane]
        if slot < 0 and not is_target:
            continue
        j = ROBOT if is_target else ROBOT + n_t + 2 * slot
        limit = limit_of(gates[0], model, is_target)
        if rows == ROWS:
            settle(P, work, lane, n, rows)
            rows = 0
        outcome, nis = observe(mu, P, work, lane, n, rows, j, model, ranges[lane, k], bearings[lane, k], limit)
        if outcome == USED:
            rows += 2
            total += nis
        else:
            settle(P, work, lane, n, rows)
            rows = 0
            note(outcome, nis, is_target, mu, P, lane, n, n_t, model, target_known, pending, counters)
            if is_target and not target_known[lane]:
                for i in range(ROBOT, ROBOT + n_t):
                    work[CORRECTION, i] = 0.0
    own_heading = n_t > 0 and model.target_kind == TWIST and target_known[lane]
    retract(mu, P, work, lane, n, rows, n_t, count[lane], own_heading, total)
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


class RIEKF(GaussianEstimator):
    """Right-invariant EKF of robot, target and landmarks: consistent at an EKF's cost.

    **Motion** as in `EKF`: in the group's coordinates the ordinary Jacobians are those of the invariant error.

    **Measurement.** All returns of a sweep are linearised at the mean before it: one stacked update gives dx. Then,
    with th = dx's heading, (a) every point q (robot, landmarks, target, velocity of a constant-velocity target) becomes
    R(th) q + V(th)(dq - J q th), V = [[a, -b], [b, a]], a = sin th / th, b = (1 - cos th) / th; and (b)
    P <- M P M' with M = I + d e_phi', d = J(q+ - q) stacked: P_ij += d_i P_phi,j + P_phi,i d_j + P_phiphi d_i d_j.
    A twist target is a second body: its point turns with its own heading.

    **Growth** as in `EKF`.

    Args:
        motion: how the robot moves. sensor, target: see `GaussianEstimator`, as all options.

    When to use: the first choice of this family. Consistent up to several degrees of bearing noise, where `fej-ekf`
    starts to leave its linearisation points behind.

    Known weakness: as every linearised filter it needs an innovation small against the distance to what is seen; a
    target lost for long and seen again nearby is better started anew (`TargetModel.reinitialise_nis`).

    Reference: Barrau and Bonnabel, "An EKF-SLAM algorithm with consistency properties", 2015; Zhang, Wu, Song, Huang
    and Dissanayake, "Convergence and consistency analysis for a 3-D invariant-EKF SLAM", RA-L 2017.
    """

    name: ClassVar[str] = "ri-ekf"
    summary: ClassVar[str] = "right-invariant EKF: consistent at an EKF's cost"

    def linear_points(self) -> tuple[Floats, int, int]:
        """See `GaussianEstimator.linear_points`."""
        return self.mu, ROBOT, TURNING

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
