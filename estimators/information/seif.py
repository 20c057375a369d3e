"""The sparse extended information filter: kernels first, the class below them.

Beside the family's `mu` and `P` it keeps

    Omega [L, n_max, n_max]        the information matrix; P is its inverse
    active [L, M], unseen [L, M]   landmarks linked with robot or target; sweeps since each was seen
    held [L]                       what Omega holds of the target: NOTHING, a POINT seen once (twist), the whole STATE;
                                   ROUNDED where Omega is to be worked out anew from P
    widened [L]                    sweeps that held more landmarks than may be active
"""

import math
from typing import Any, ClassVar, Literal

import numpy as np

from estimators.gaussian.ekf import predict as predict_gaussian
from estimators.gaussian.gate import pass_gate
from estimators.gaussian.growth import grow
from estimators.gaussian.layout import MATCH_GATE, NEW_GATE, Call, GaussianEstimator
from estimators.gaussian.sweep import associate
from estimators.information.sparsify import deactivate, keep_active
from estimators.interface import Floats, Ints, Scan
from estimators.kernels.angles import wrap
from estimators.kernels.association import KNOWN, TARGET_SLOT
from estimators.kernels.bound import LATER
from estimators.kernels.gaussian import ROBOT, rows_in_use
from estimators.kernels.information import add_sighting, diffuse, factorise, invert, shear_information, solve
from estimators.kernels.jit import inline, jit, subroutine
from estimators.kernels.motion import (
    acceleration_noise,
    calibrated,
    control_noise,
    control_std,
    displacement,
    unicycle,
    unicycle_noise,
)
from estimators.kernels.range_bearing import gradient, measure, noise_std
from estimators.kernels.rounding import independent_variances, offset_variance
from estimators.kernels.simd import aligned_zeros
from estimators.models import TWIST, MotionModel, SensorModel, TargetModel

ROUNDED, NOTHING, POINT, STATE = -1, 0, 1, 2
# What has no information matrix that numbers could hold: a prior that is more certain, and a return whose variance is a
# smaller share of H diag(P) H', the robot and the point that it shows taken as independent.
PRIOR_FLOOR = 1e-4  # [m], [rad], [m/s]
RETURN_FLOOR = 1e-11
MOTION_FLOOR = 1e-6  # of a body's information: what a motion has to leave of it, or the rest is mostly rounding


@inline
def noise_matrix(Q, q00, q01, q02, q11, q12, q22):
    """Fill Q [>= 3, >= 3]."""
    Q[0, 0], Q[0, 1], Q[0, 2] = q00, q01, q02
    Q[1, 0], Q[1, 1], Q[1, 2] = q01, q11, q12
    Q[2, 0], Q[2, 1], Q[2, 2] = q02, q12, q22


@inline
def move_robot_information(mu, Omega, work, Q, lane, n, model, v, w, dt):
    """The robot's motion: Phi = G^-T Omega G^-1, then the control's noise."""
    v, w = calibrated(model, v, w)
    sv, sw = control_std(model, v, w, dt)
    heading = mu[lane, 2]
    dx, dy, _ = displacement(model, v, w, dt, heading)
    shear_information(Omega, lane, n, 0, 2, -dy)
    shear_information(Omega, lane, n, 1, 2, dx)
    q00, q01, q02, q11, q12, q22 = control_noise(model, v, w, dt, heading, sv, sw)
    noise_matrix(Q, q00, q01, q02, q11, q12, q22)
    diffuse(Omega, work, lane, n, 0, ROBOT, Q)


@inline
def move_target_information(mu, Omega, work, Q, lane, n, model, dt):
    """The target's motion by its own model."""
    if model.target_kind == TWIST:
        speed, turn_rate, heading = model.target_speed, model.target_turn_rate, mu[lane, 5]
        dx, dy, _ = unicycle(speed, turn_rate, dt, heading)
        shear_information(Omega, lane, n, ROBOT, ROBOT + 2, -dy)
        shear_information(Omega, lane, n, ROBOT + 1, ROBOT + 2, dx)
        q00, q01, q02, q11, q12, q22 = unicycle_noise(
            speed, turn_rate, dt, heading, model.target_speed_std, model.target_turn_std
        )
        noise_matrix(Q, q00, q01, q02, q11, q12, q22)
        diffuse(Omega, work, lane, n, ROBOT, 3, Q)
        return
    shear_information(Omega, lane, n, ROBOT, ROBOT + 2, dt)
    shear_information(Omega, lane, n, ROBOT + 1, ROBOT + 3, dt)
    position, cross, velocity = acceleration_noise(model.acceleration_density, dt)
    for i in range(4):
        for k in range(4):
            Q[i, k] = 0.0
    for i in range(2):
        Q[i, i], Q[i + 2, i + 2], Q[i, i + 2], Q[i + 2, i] = position, velocity, cross, cross
    diffuse(Omega, work, lane, n, ROBOT, 4, Q)


@subroutine
def agree(P, Omega, work, C, lane, n, n_t, count, active, target_known, pending, held):
    """Bring Omega in line with P where the target has entered it or was forgotten (marginalised) there, or is ROUNDED.

    What rounding then leaves of the passive landmarks' links is not struck out but deactivated: where returns are
    sharp, it is large enough for Omega to lose its definiteness with it.
    """
    state = STATE if target_known[lane] else POINT if pending[lane, 0] > 0.0 else NOTHING
    if state == held[lane]:
        return
    held[lane] = state
    if state != NOTHING:
        widen(P, lane, ROBOT)
    invert(P, lane, n, Omega, C)
    for slot in range(count):
        if not active[lane, slot]:
            deactivate(Omega, work, lane, n, n_t, count, active, slot)


@jit
def predict(
    mu, P, Omega, models, n_t, count, active, target_known, pending, held, control, dt, last_dt, work, Q, C, lanes
):
    """One step of the named lanes, in both forms: P stays Omega's inverse."""
    for i in range(lanes.size):
        lane = lanes[i]
        if not dt[lane] > 0.0:
            continue
        n = rows_in_use(n_t, count[lane])
        agree(P, Omega, work, C, lane, n, n_t, count[lane], active, target_known, pending, held)
        for j in range(ROBOT + n_t):
            C[0, j] = Omega[lane, j, j]
        move_robot_information(mu, Omega, work, Q, lane, n, models[lane], control[lane, 0], control[lane, 1], dt[lane])
        if n_t > 0 and target_known[lane]:
            move_target_information(mu, Omega, work, Q, lane, n, models[lane], dt[lane])
        for j in range(ROBOT + n_t):
            if Omega[lane, j, j] < MOTION_FLOOR * C[0, j]:
                held[lane] = ROUNDED
    predict_gaussian(mu, P, models, n_t, count, target_known, pending, control, dt, last_dt, lanes)


@inline
def floored(P, lane, j, r, range_std, bearing_std):
    """Deviations of a return that Omega can hold beside what was known: R at least RETURN_FLOOR of H diag(P) H'."""
    h0, h1 = independent_variances(P, lane, j, r, 0.0, -1.0)
    return (
        math.sqrt(max(range_std * range_std, RETURN_FLOOR * h0)),
        math.sqrt(max(bearing_std * bearing_std, RETURN_FLOOR * h1)),
    )


@inline
def widen(P, lane, j):
    """The floor for a point that has just entered P by its first return, at row j: its variances are raised by it."""
    least = RETURN_FLOOR * offset_variance(P, lane, j)
    for i in range(j, j + 2):
        P[lane, i, i] += least


@inline
def take_in(mu, P, Omega, b, lane, j, model, distance, bearing):
    """Omega += H' R^-1 H and b += H' R^-1 y of one return, everything at the mean before the sweep."""
    dx, dy = mu[lane, j] - mu[lane, 0], mu[lane, j + 1] - mu[lane, 1]
    r, expected = measure(dx, dy, mu[lane, 2])
    a00, a01, a10, a11 = gradient(dx, dy)
    range_std, bearing_std = noise_std(model, r)
    range_std, bearing_std = floored(P, lane, j, r, range_std, bearing_std)
    add_sighting(Omega, lane, j, a00, a01, a10, a11, 0.0, -1.0, range_std, bearing_std)
    y0 = (distance - r) / (range_std * range_std)
    y1 = wrap(bearing - expected) / (bearing_std * bearing_std)
    gx, gy = a00 * y0 + a10 * y1, a01 * y0 + a11 * y1
    b[0] -= gx
    b[1] -= gy
    b[2] -= y1
    b[j] += gx
    b[j + 1] += gy


@inline
def link_new(mu, P, Omega, lane, n_t, model, ranges, bearings, slots, num_returns, before, count):
    """A new landmark has no prior: its first return is all its information."""
    for slot in range(before, count):
        for k in range(num_returns):
            if slots[lane, k] == slot:
                j = ROBOT + n_t + 2 * slot
                a00, a01, a10, a11 = gradient(mu[lane, j] - mu[lane, 0], mu[lane, j + 1] - mu[lane, 1])
                range_std, bearing_std = noise_std(model, ranges[lane, k])
                range_std, bearing_std = floored(P, lane, j, ranges[lane, k], range_std, bearing_std)
                add_sighting(Omega, lane, j, a00, a01, a10, a11, 0.0, -1.0, range_std, bearing_std)
                break


@inline
def update_one(
    lane, mu, P, Omega, model, n_t, count, ids, first, next_id, active, unseen, held, widened, target_known, pending,
    counters, last_dt, ranges, bearings, labels, num_returns, code, gates, limit, slots, cost, work, b, C,
):  # fmt: skip
    """One lane's sweep: information added, the mean recovered, landmarks deactivated, then what is new."""
    associate(
        lane, mu, P, model, n_t, count, ids, target_known, counters, ranges, bearings, labels, num_returns, code, gates,
        cost, slots,
    )  # fmt: skip
    n, before = rows_in_use(n_t, count[lane]), count[lane]
    for k in range(num_returns):
        if slots[lane, k] >= 0 or (slots[lane, k] == TARGET_SLOT and target_known[lane]):
            pass_gate(
                lane, k, mu, P, model, n_t, count, target_known, pending, counters, ranges[lane, k], bearings[lane, k],
                gates[0], slots,
            )  # fmt: skip
    agree(P, Omega, work, C, lane, n, n_t, before, active, target_known, pending, held)
    for i in range(n):
        b[i] = 0.0
    for slot in range(before):
        unseen[lane, slot] += 1
    used = False
    for k in range(num_returns):
        slot = slots[lane, k]
        is_target = slot == TARGET_SLOT and target_known[lane]
        if slot < 0 and not is_target:
            continue
        used = True
        take_in(mu, P, Omega, b, lane, ROBOT if is_target else ROBOT + n_t + 2 * slot, model, ranges[lane, k],
                bearings[lane, k])  # fmt: skip
        if slot >= 0:
            active[lane, slot], unseen[lane, slot] = True, 0
    if used:
        factorise(Omega, lane, n, C)
        solve(C, n, b)
        for i in range(n):
            mu[lane, i] += b[i]
        mu[lane, 2] = wrap(mu[lane, 2])
        if n_t > 0 and model.target_kind == TWIST:
            mu[lane, 5] = wrap(mu[lane, 5])
        keep_active(Omega, work, lane, n, n_t, before, active, unseen, limit)
        invert(Omega, lane, n, P, C)
    grow(
        lane, mu, P, model, n_t, count, ids, first, next_id, target_known, pending, counters, ranges, bearings, labels,
        num_returns, code != KNOWN, slots, mu[lane, 0], mu[lane, 1], mu[lane, ROBOT], mu[lane, ROBOT + 1],
        last_dt[lane],
    )  # fmt: skip
    n = rows_in_use(n_t, count[lane])
    link_new(mu, P, Omega, lane, n_t, model, ranges, bearings, slots, num_returns, before, count[lane])
    for slot in range(before, count[lane]):
        active[lane, slot], unseen[lane, slot] = True, 0
        widen(P, lane, ROBOT + n_t + 2 * slot)
    agree(P, Omega, work, C, lane, n, n_t, count[lane], active, target_known, pending, held)
    if count[lane] > before:
        widened[lane] += keep_active(Omega, work, lane, n, n_t, count[lane], active, unseen, limit) > 0
        invert(Omega, lane, n, P, C)


@jit
def update(
    mu, P, Omega, models, n_t, count, ids, first, next_id, active, unseen, held, widened, target_known, pending,
    counters, last_dt, ranges, bearings, labels, counts, code, gates, limit, slots, cost, work, b, C, lanes,
):  # fmt: skip
    """One sweep of the named lanes: see `update_one`."""
    for i in range(lanes.size):
        lane = lanes[i]
        update_one(
            lane, mu, P, Omega, models[lane], n_t, count, ids, first, next_id, active, unseen, held, widened,
            target_known, pending, counters, last_dt, ranges, bearings, labels, counts[lane], code, gates, limit, slots,
            cost, work, b, C,
        )  # fmt: skip


@jit
def start(mu, P, Omega, n_t, target_known, held, C, lanes):
    """Omega of a prior; P takes on the floor that makes it invertible."""
    for i in range(lanes.size):
        lane = lanes[i]
        size = ROBOT + n_t if target_known[lane] else ROBOT
        for k in range(size):
            P[lane, k, k] += PRIOR_FLOOR * PRIOR_FLOOR
        held[lane] = STATE if target_known[lane] else NOTHING
        invert(P, lane, rows_in_use(n_t, 0), Omega, C)


class SEIF(GaussianEstimator):
    """Sparse extended information filter of robot, target and landmarks: Omega = P^-1 with few links.

    **Motion.** Phi = G^-T Omega G^-1, G the identity but for the robot's (and the target's) own block; then noise by
    its columns b, Omega <- Phi - (Phi b)(Phi b)' / (1 + b' Phi b), which together is Phi - Phi B (Q^-1 + B' Phi B)^-1
    B' Phi. Landmarks without a link to robot or target are not touched.

    **Measurement.** All returns of a sweep at the mean before it: Omega += sum H' R^-1 H; the mean is recovered
    exactly, mu += Omega^-1 sum H' R^-1 y. A new landmark has no prior information: its first return is all there is.

    **Sparsification.** At most `active` landmarks keep a link with the moving bodies, robot and target; the target is
    always active. The landmark unseen for longest is made passive: with x the bodies, m+ the active landmarks and m0
    the one to go, p(x | m+, m0, m-) becomes p(x | m+, m- = mu-). Of Omega only the columns d by which x is eliminated
    change, to those c with m- conditioned on and m0 marginalised: Omega += sum c c' - sum d d'. What one sweep sees
    stays active together, and the sweep is counted ("active_widened").

    Args:
        motion: how the robot moves. sensor, target, association, gate, match_gate, new_gate: see `GaussianEstimator`.
        active: largest number of active landmarks. Where no more exist nothing is cut, and the filter is an EKF with
            stacked updates.

    When to use: to see what the sparse approximation costs. In its home, thousands of landmarks, the bounded number of
    links makes an update's time constant; here maps are small, and mean and covariance (for the belief and for
    association) are recovered by dense factorisations, O(n^3).

    Known weakness: overconfident, the more so the fewer landmarks stay active: conditioning on the passive ones takes
    their uncertainty for zero. On top of that the EKF's own. A prior is widened by 1e-4 (m, rad), and no return is
    believed beyond three millionths of what was uncertain. An unlabelled false alarm stays in the map.

    Reference: Thrun, Liu, Koller, Ng, Ghahramani and Durrant-Whyte, "Simultaneous localization and mapping with sparse
    extended information filters", IJRR 2004; Thrun, Burgard and Fox, "Probabilistic Robotics", 2005, chapter 12;
    Eustice, Walter and Leonard, "Sparse extended information filters: insights into sparsification", IROS 2005.
    """

    name: ClassVar[str] = "seif"
    summary: ClassVar[str] = "sparse extended information filter: few links, overconfident for it"
    mean_is_all: ClassVar[bool] = False

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
        active: int = 8,
    ) -> None:
        if isinstance(active, bool) or not isinstance(active, int | np.integer) or active < 1:
            raise ValueError(f"active must be a whole number of landmarks, at least 1; got {active!r}")
        self.limit = int(active)
        super().__init__(
            motion, sensor, target, num_lanes=num_lanes, max_landmarks=max_landmarks, association=association,
            gate=gate, match_gate=match_gate, new_gate=new_gate, remove_below=0.0,
        )  # fmt: skip

    def _allocate(self) -> None:
        super()._allocate()
        L, M = self.num_lanes, self.max_landmarks
        self.Omega: Floats = aligned_zeros(L, self.n_max, self.n_max)
        self.active = np.zeros((L, M), dtype=np.bool_)
        self.unseen: Ints = np.zeros((L, M), dtype=np.int64)
        self.held: Ints = np.zeros(L, dtype=np.int64)
        self.widened: Ints = np.zeros(L, dtype=np.int64)
        self.factor: Floats = np.zeros((self.n_max, self.n_max))  # scratch
        self.noise: Floats = np.zeros((4, 4))  # scratch
        self.shift: Floats = np.zeros(self.n_max)  # scratch

    def _after_reset(self, lanes: Ints) -> None:
        for array in (self.Omega, self.active, self.unseen, self.held, self.widened):
            array[lanes] = 0
        start(self.mu, self.P, self.Omega, self.n_t, self.target_known, self.held, self.factor, lanes)

    def _scratch(self) -> tuple[Any, ...]:
        return (*super()._scratch(), self.factor, self.noise, self.shift)

    @property
    def _state_names(self) -> tuple[str, ...]:
        return (*super()._state_names, "Omega", "active", "unseen", "held", "widened")

    @property
    def counts(self) -> dict[str, Ints]:
        """`GaussianEstimator`'s, and "active_widened"."""
        return super().counts | {"active_widened": self.widened.copy()}

    def _prediction(self, control: Floats, dt: Floats) -> Call:
        return (
            predict, self.mu, self.P, self.Omega, self.models, self.n_t, self.count, self.active, self.target_known,
            self.pending, self.held, control, dt, self.last_dt, self.work, self.noise, self.factor, LATER,
        )  # fmt: skip

    def _correction(self, scan: Scan) -> Call:
        return (
            update, self.mu, self.P, self.Omega, self.models, self.n_t, self.count, self.ids, self.first, self.next_id,
            self.active, self.unseen, self.held, self.widened, self.target_known, self.pending, self.counters,
            self.last_dt, scan.ranges, scan.bearings, scan.labels, scan.count, self.association_code, self.gates,
            self.limit, self.slots, self.cost, self.work, self.shift, self.factor, LATER,
        )  # fmt: skip
