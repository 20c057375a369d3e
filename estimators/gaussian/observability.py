"""The observability-constrained EKF: points of linearisation that are consistent, and as near the estimates as can be.

`fej-ekf` holds on to first estimates. Any other choice p* of the robot's position in F keeps the unobservable
directions too, if the points in H follow: l* = l_first - D, D the running sum of p_{j|j-1} - p*_j. The directions are
those of FEJ seen from `anchor` = p_{k|k-1} + D: N = [I, J anchor; 0, 1; I, J l_first], H N = 0, F N_k = N_{k+1}, so
that its kernels serve here with another `anchor`; a target's points are shifted by D likewise.

`pull` [L, 3]: the sum of r_i over the landmarks seen last, and their number (see `constrain`).
"""

from typing import ClassVar

from estimators.gaussian.anchor import A_T
from estimators.gaussian.fej import FEJEKF, take_returns
from estimators.gaussian.growth import advance_pending, grow
from estimators.gaussian.layout import Call
from estimators.gaussian.sweep import associate
from estimators.interface import Floats, Ints, Scan
from estimators.kernels.angles import wrap
from estimators.kernels.association import KNOWN
from estimators.kernels.bound import LATER
from estimators.kernels.gaussian import ROBOT, drift_velocity, move_heading_body, move_robot, rows_in_use, shear
from estimators.kernels.jit import inline, jit
from estimators.kernels.motion import calibrated, control_noise, control_std, displacement, unicycle, unicycle_noise
from estimators.models import TWIST


@inline
def constrain(mu, lane, pull):
    """p*, which with l_i* = l_first,i - D lies nearest to the estimates of robot and landmarks seen.

    min |p - p*|^2 + sum |l_i - l_i*|^2 over p*, by its multipliers (1 1' + I) lam = 2 r, p* = p + sum lam / 2, with
    r_i = (l_i - l_first,i) - (p_{k|k} - anchor): the mean of the n + 1 positions that the estimates ask for.
    """
    share = 1.0 / (pull[lane, 2] + 1.0)
    x, y = mu[lane, 0] + share * pull[lane, 0], mu[lane, 1] + share * pull[lane, 1]
    pull[lane, 0] = pull[lane, 1] = pull[lane, 2] = 0.0
    return x, y


@inline
def note_pull(mu, lane, n_t, first, anchor, slots, num_returns, pull):
    """Sum r_i over the landmarks seen."""
    for d in range(3):
        pull[lane, d] = 0.0
    for k in range(num_returns):
        slot = slots[lane, k]
        if slot >= 0:
            j = ROBOT + n_t + 2 * slot
            for d in range(2):
                pull[lane, d] += mu[lane, j + d] - first[lane, slot, d] - mu[lane, d] + anchor[lane, d]
            pull[lane, 2] += 1.0


@inline
def predict_robot(mu, P, lane, n, model, anchor, star_x, star_y, v, w, dt):
    """Move the robot; heading column of F: J(p_{k+1|k} - p*), by which the anchor moves too."""
    v, w = calibrated(model, v, w)
    sv, sw = control_std(model, v, w, dt)
    heading = mu[lane, 2]
    dx, dy, turn = displacement(model, v, w, dt, heading)
    q00, q01, q02, q11, q12, q22 = control_noise(model, v, w, dt, heading, sv, sw)
    mu[lane, 0] += dx
    mu[lane, 1] += dy
    mu[lane, 2] = wrap(heading + turn)
    way_x, way_y = mu[lane, 0] - star_x, mu[lane, 1] - star_y
    move_robot(P, lane, n, -way_y, way_x, q00, q01, q02, q11, q12, q22)
    anchor[lane, 0] += way_x
    anchor[lane, 1] += way_y


@inline
def predict_target(mu, P, lane, n, n_t, model, anchor, shift_x, shift_y, dt):
    """Move the target, to be linearised at its prediction shifted by D; its F carries the step between the points.

    A constant-velocity target's in the robot's heading column, as in `fej`; a twist target's in its own.
    """
    if model.target_kind == TWIST:
        speed, turn_rate, heading = model.target_speed, model.target_turn_rate, mu[lane, 5]
        dx, dy, turn = unicycle(speed, turn_rate, dt, heading)
        q00, q01, q02, q11, q12, q22 = unicycle_noise(
            speed, turn_rate, dt, heading, model.target_speed_std, model.target_turn_std
        )
        mu[lane, 3] += dx
        mu[lane, 4] += dy
        mu[lane, 5] = wrap(heading + turn)
        way_x, way_y = mu[lane, 3] + shift_x - anchor[lane, A_T], mu[lane, 4] + shift_y - anchor[lane, A_T + 1]
        move_heading_body(P, lane, n, ROBOT, -way_y, way_x, q00, q01, q02, q11, q12, q22)
        return
    drift_velocity(mu, P, lane, n, model.acceleration_density, dt)
    away_x = mu[lane, 3] + shift_x - anchor[lane, A_T] - dt * anchor[lane, A_T + 2]
    away_y = mu[lane, 4] + shift_y - anchor[lane, A_T + 1] - dt * anchor[lane, A_T + 3]
    shear(P, lane, n, 3, 2, -away_y)
    shear(P, lane, n, 4, 2, away_x)
    shear(P, lane, n, 5, 2, anchor[lane, A_T + 3] - mu[lane, 6])
    shear(P, lane, n, 6, 2, mu[lane, 5] - anchor[lane, A_T + 2])


@inline
def anchor_target(mu, lane, n_t, anchor, shift_x, shift_y):
    """Linearise the target at its estimate shifted by D from now on."""
    for i in range(n_t):
        anchor[lane, A_T + i] = mu[lane, ROBOT + i]
    anchor[lane, A_T] += shift_x
    anchor[lane, A_T + 1] += shift_y


@jit
def predict(mu, P, models, n_t, count, anchor, pull, target_known, pending, control, dt, last_dt, lanes):
    """One step of the named lanes; the target first: F acts on the covariance of the step's start."""
    for i in range(lanes.size):
        lane = lanes[i]
        step, model = dt[lane], models[lane]
        if not step > 0.0:
            continue
        n = rows_in_use(n_t, count[lane])
        star_x, star_y = constrain(mu, lane, pull)
        shift_x, shift_y = anchor[lane, 0] - star_x, anchor[lane, 1] - star_y
        if n_t > 0 and target_known[lane]:
            predict_target(mu, P, lane, n, n_t, model, anchor, shift_x, shift_y, step)
            anchor_target(mu, lane, n_t, anchor, shift_x, shift_y)
        elif n_t > 0 and pending[lane, 0] > 0.0:
            advance_pending(pending, lane, model.target_speed * step, model.target_turn_rate * step)
        predict_robot(mu, P, lane, n, model, anchor, star_x, star_y, control[lane, 0], control[lane, 1], step)
        last_dt[lane] = step


@inline
def update_one(
    lane, mu, P, model, n_t, count, ids, first, next_id, anchor, pull, target_known, pending, counters, last_dt, ranges,
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
    note_pull(mu, lane, n_t, first, anchor, slots, num_returns, pull)
    shift_x, shift_y = anchor[lane, 0] - mu[lane, 0], anchor[lane, 1] - mu[lane, 1]
    held, known, before, held_x, held_y = pending[lane, 0] > 0.0, target_known[lane], count[lane], 0.0, 0.0
    if n_t > 0:
        held_x, held_y = anchor[lane, A_T] - shift_x, anchor[lane, A_T + 1] - shift_y
    grow(
        lane, mu, P, model, n_t, count, ids, first, next_id, target_known, pending, counters, ranges, bearings, labels,
        num_returns, code != KNOWN, slots, mu[lane, 0], mu[lane, 1], held_x, held_y, last_dt[lane],
    )  # fmt: skip
    for slot in range(before, count[lane]):
        first[lane, slot, 0] += shift_x
        first[lane, slot, 1] += shift_y
    if target_known[lane] != known or (pending[lane, 0] > 0.0) != held:
        anchor_target(mu, lane, n_t, anchor, shift_x, shift_y)


@jit
def update(
    mu, P, models, n_t, count, ids, first, next_id, anchor, pull, target_known, pending, counters, last_dt, ranges,
    bearings, labels, counts, code, gates, slots, cost, work, lanes,
):  # fmt: skip
    """One sweep of the named lanes: see `update_one`."""
    for i in range(lanes.size):
        lane = lanes[i]
        update_one(
            lane, mu, P, models[lane], n_t, count, ids, first, next_id, anchor, pull, target_known, pending, counters,
            last_dt, ranges, bearings, labels, counts[lane], code, gates, slots, cost, work,
        )  # fmt: skip


class OCEKF(FEJEKF):
    """Observability-constrained EKF of robot, target and landmarks: linearised near the estimates, and consistently.

    **Motion.** As `EKF`, but for the heading column of F: J(p_{k+1|k} - p*_k). Of all p* that a consistent
    linearisation allows the one nearest to the estimates is taken: with D the running sum of p_{j|j-1} - p*_j and the n
    landmarks of the last sweep, per axis, (1 1' + I) lam = 2 [(l_i - l_i,first) - (p_{k|k} - p_{k|k-1} - D)],
    p* = p_{k|k} + sum(lam) / 2. The target is linearised at its predicted state and its F corrected for the step
    between two such points: a constant-velocity target's in the robot's heading column, a twist target's in its own.

    **Measurement.** H = A [-I, -J(l* - p_{k|k-1}), I], l* = l_first - D, which is l_i - lam_i / 2; A = dh/dD and
    residual at the newest estimate, as in `fej-ekf`.

    **Growth.** As `EKF`; l_first of a landmark is its first estimate + D.

    Args:
        motion: how the robot moves. sensor, target: see `GaussianEstimator`, as all options.

    When to use: as `fej-ekf`, where first estimates are poor: its points follow the estimates.

    Known weakness: only the landmarks last seen pull p*, and all others' points move along; under noise so strong that
    estimates jump, `ri-ekf` stays consistent for longer.

    Reference: Huang, Mourikis and Roumeliotis, "Observability-based rules for designing consistent EKF SLAM
    estimators", IJRR 2010.
    """

    name: ClassVar[str] = "oc-ekf"
    summary: ClassVar[str] = "observability-constrained EKF: consistent points nearest to the estimates"
    mean_is_all: ClassVar[bool] = False

    def _allocate(self) -> None:
        super()._allocate()
        self.pull: Floats = self.anchor[:, :1].repeat(3, axis=1)

    def _after_reset(self, lanes: Ints) -> None:
        super()._after_reset(lanes)
        self.pull[lanes] = 0.0

    @property
    def _state_names(self) -> tuple[str, ...]:
        return (*super()._state_names, "pull")

    def _prediction(self, control: Floats, dt: Floats) -> Call:
        return (
            predict, self.mu, self.P, self.models, self.n_t, self.count, self.anchor, self.pull, self.target_known,
            self.pending, control, dt, self.last_dt, LATER,
        )  # fmt: skip

    def _correction(self, scan: Scan) -> Call:
        return (
            update, self.mu, self.P, self.models, self.n_t, self.count, self.ids, self.first, self.next_id, self.anchor,
            self.pull, self.target_known, self.pending, self.counters, self.last_dt, scan.ranges, scan.bearings,
            scan.labels, scan.count, self.association_code, self.gates, self.slots, self.cost, self.work, LATER,
        )  # fmt: skip
