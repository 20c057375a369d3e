"""Right-invariant filters that take a return over the whole spread of the belief, not by its derivative at the mean.

With D = point - robot and th the heading's error, the right-invariant errors of point and robot differ by
eta = dD - J D th. Through the retraction, q+ = R(th) q + V(th) xi_q, a return depends on eta and th alone,

    h = (|D + V(-th) eta|, atan2(D + V(-th) eta) - heading),            R(-th) V(th) = V(-th),

so of the five numbers in (pose, point), with eta put first, two Cholesky columns matter: the third, th's own, moves no
return. Its slope G by eta is H = G [-I, -J D, I], which knows nothing of the unobservable directions whatever G is.
"""

import math
from typing import Any, ClassVar

from estimators.gaussian.ekf import predict
from estimators.gaussian.growth import grow
from estimators.gaussian.invariant import retract
from estimators.gaussian.layout import Call, GaussianEstimator
from estimators.gaussian.sigma_point import GAUSSIAN_STEP
from estimators.gaussian.sweep import UNLIKELY, UNUSABLE, USED, associate, limit_of, note
from estimators.gaussian.taylor_net import fit_net, from_beam, root_of, seen, slopes, to_beam, turned
from estimators.gaussian.vague_target import TURNING
from estimators.interface import Floats, Scan
from estimators.kernels.angles import wrap
from estimators.kernels.association import KNOWN, TARGET_SLOT
from estimators.kernels.bound import LATER
from estimators.kernels.gaussian import ROBOT, nis_and_log_det, rows_in_use
from estimators.kernels.jit import inline, jit, subroutine
from estimators.kernels.left_looking import CORRECTION, collect, spread
from estimators.kernels.range_bearing import measure, noise_std
from estimators.kernels.rounding import blunted, offset_variance
from estimators.models import TWIST, MotionModel, SensorModel, TargetModel

NET = 0.0  # in the place of a step h: fit the Taylor net


@inline
def spread_of(P, lane, j, r, ux, uy):
    """Covariance (e00, e01, e11) of eta in the beam's axes, and that (f0, f1) of eta with the heading.

    Along the beam eta is dD, across it dD - r th.
    """
    e00, e01, e11 = to_beam(
        ux,
        uy,
        P[lane, j, j] - 2.0 * P[lane, j, 0] + P[lane, 0, 0],
        P[lane, j, j + 1] - P[lane, j, 1] - P[lane, j + 1, 0] + P[lane, 0, 1],
        P[lane, j + 1, j + 1] - 2.0 * P[lane, j + 1, 1] + P[lane, 1, 1],
    )
    t0, t1, turn = P[lane, j, 2] - P[lane, 0, 2], P[lane, j + 1, 2] - P[lane, 1, 2], P[lane, 2, 2]
    along, across = ux * t0 + uy * t1, ux * t1 - uy * t0
    return e00, e01 - r * along, e11 - r * (2.0 * across - r * turn), along, across - r * turn


@inline
def differences(r0, x, y, turn):
    """D1 and D2 of (range, bearing) for one column: eta = +-(x, y), th = +-turn. Eq. (9), Tian et al. 2010."""
    ox, oy = turned(x, y, turn)
    r_up, b_up = seen(r0 + ox, oy)
    ox, oy = turned(x, y, -turn)
    r_down, b_down = seen(r0 - ox, -oy)
    return 0.5 * (r_up - r_down), 0.5 * (b_up - b_down), 0.5 * (r_up + r_down) - r0, 0.5 * (b_up + b_down)


@subroutine
def interpolate(r0, l00, l10, l11, t0, t1, h):
    """Stirling's interpolation of a return over the spread L of eta; results as those of `fit_net`."""
    ur, ub, pr, pb = differences(r0, h * l00, h * l10, h * t0)
    vr, vb, qr, qb = differences(r0, 0.0, h * l11, h * t1)
    g00, g01, g10, g11 = slopes(l00, l10, l11, ur / h, ub / h, vr / h, vb / h)
    square = h * h
    curved = (square - 1.0) / (square * square)
    return (
        (pr + qr) / square, (pb + qb) / square, g00, g01, g10, g11, curved * (pr * pr + qr * qr),
        curved * (pr * pb + qr * qb), curved * (pb * pb + qb * qb),
    )  # fmt: skip


@inline
def observe(mu, P, work, lane, n, j, model, distance, bearing, limit, h):
    """Find the correction by one return of the point at row j; (what became of it, its NIS)."""
    dx, dy = mu[lane, j] - mu[lane, 0], mu[lane, j + 1] - mu[lane, 1]
    r, b = measure(dx, dy, mu[lane, 2])
    if not r > 0.0:
        return UNUSABLE, 0.0
    ux, uy = dx / r, dy / r
    e00, e01, e11, f0, f1 = spread_of(P, lane, j, r, ux, uy)
    l00, l10, l11 = root_of(e00, e01, e11, r)
    t0 = f0 / l00
    t1 = (f1 - l10 * t0) / l11
    if h == NET:
        mr, mb, g00, g01, g10, g11, s00, s01, s11 = fit_net(r, l00, l10, l11, t0, t1)
    else:
        mr, mb, g00, g01, g10, g11, s00, s01, s11 = interpolate(r, l00, l10, l11, t0, t1, h)
    c0, c1 = -r * g01, -r * g11
    variance, turn = offset_variance(P, lane, j), P[lane, 2, 2]
    range_std, bearing_std = noise_std(model, r)
    range_std, bearing_std = blunted(
        P, work, lane, n, (g00 * g00 + g01 * g01) * variance + c0 * c0 * turn,
        (g10 * g10 + g11 * g11) * variance + c1 * c1 * turn, range_std, bearing_std,
    )  # fmt: skip
    k00, k01, k10, k11 = g00 * e00 + g01 * e01, g00 * e01 + g01 * e11, g10 * e00 + g11 * e01, g10 * e01 + g11 * e11
    s00 += k00 * g00 + k01 * g01 + range_std * range_std
    s01 += k00 * g10 + k01 * g11
    s11 += k10 * g10 + k11 * g11 + bearing_std * bearing_std
    y0, y1 = distance - r - mr, wrap(bearing - b - mb)
    nis = nis_and_log_det(s00, s01, s11, y0, y1)[0]
    if not nis <= limit:
        return (UNUSABLE if math.isnan(nis) else UNLIKELY), nis
    a00, a01, a10, a11 = from_beam(ux, uy, g00, g01, g10, g11)
    spread(P, work, lane, n, 0, j, a00, a01, a10, a11, c0, c1)
    collect(work, CORRECTION, work, n, 0, y0, y1, s00, s01, s11)
    return USED, nis


@inline
def update_one(
    lane, mu, P, model, n_t, count, ids, first, next_id, target_known, pending, counters, last_dt, ranges, bearings,
    labels, num_returns, code, gates, slots, cost, work, h,
):  # fmt: skip
    """One lane's sweep: each return corrects along the group, one after another; then what is new."""
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
        for i in range(n):
            work[CORRECTION, i] = 0.0
        j = ROBOT if is_target else ROBOT + n_t + 2 * slot
        limit = limit_of(gates[0], model, is_target)
        outcome, nis = observe(mu, P, work, lane, n, j, model, ranges[lane, k], bearings[lane, k], limit, h)
        if outcome == USED:
            own_heading = n_t > 0 and model.target_kind == TWIST and target_known[lane]
            retract(mu, P, work, lane, n, 2, n_t, count[lane], own_heading, nis)
        else:
            note(outcome, nis, is_target, mu, P, lane, n, n_t, model, target_known, pending, counters)
    grow(
        lane, mu, P, model, n_t, count, ids, first, next_id, target_known, pending, counters, ranges, bearings, labels,
        num_returns, code != KNOWN, slots, mu[lane, 0], mu[lane, 1], mu[lane, ROBOT], mu[lane, ROBOT + 1],
        last_dt[lane],
    )  # fmt: skip


@jit
def update(
    mu, P, models, n_t, count, ids, first, next_id, target_known, pending, counters, last_dt, ranges, bearings, labels,
    counts, code, gates, slots, cost, work, lanes, h,
):  # fmt: skip
    """One sweep of the named lanes: see `update_one`. h: half the distance between sigma points, or `NET`."""
    for i in range(lanes.size):
        lane = lanes[i]
        update_one(
            lane, mu, P, models[lane], n_t, count, ids, first, next_id, target_known, pending, counters, last_dt,
            ranges, bearings, labels, counts[lane], code, gates, slots, cost, work, h,
        )  # fmt: skip


class _OverTheSpread(GaussianEstimator):
    """What both filters share: a right-invariant filter whose `h` says how a return is taken."""

    h: float = NET

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
            scan.count, self.association_code, self.gates, self.slots, self.cost, self.work, LATER, self.h,
        )  # fmt: skip


class RICDKF(_OverTheSpread):
    """Right-invariant central difference Kalman filter: sigma points along the group, consistent where `cdkf` is not.

    **Motion** as in `RIEKF`. On the group a pose's error passes through a motion unchanged, so interpolation over the
    pose gives the ordinary prediction exactly; the control's noise enters to first order.

    **Measurement.** One return after another. Its sigma points lie in the right-invariant error, P5 -> T^-1 P5 T^-T
    with dq = xi_q + J q dphi, and go through the group's retraction: two columns, four evaluations (see
    `estimators.gaussian.invariant_points`). Slopes, mean and covariance follow Eqs. (9)-(12) and (23)-(31) of Tian et
    al. 2010; the correction then goes through the group, (a) and (b) of `RIEKF`.

    **Growth** as in `RIEKF`: a new point's invariant error is the robot's plus the return's noise, to first order.

    Args:
        motion: how the robot moves. sensor, target: see `GaussianEstimator`, as all options.
        h: half the distance between sigma points, in standard deviations; sqrt(3) is right for Gaussians. As h -> 0 the
            slopes become Jacobians.
        **options: see `GaussianEstimator`; with `budget=10` it keeps the map of the CDKF paper at its cost.

    When to use: a small map of fixed size (`budget`) on a long way, without the overconfidence of `cdkf`.

    Known weakness: corrections one by one cost twice the covariance work of `ri-ekf`, whose accuracy it hardly
    surpasses unless points are as near as they are uncertain.

    Reference: Tian et al. 2010 for the interpolation; Barrau and Bonnabel, "An EKF-SLAM algorithm with consistency
    properties", 2015, for the error.
    """

    name: ClassVar[str] = "ri-cdkf"
    summary: ClassVar[str] = "right-invariant CDKF: sigma points along the group, consistent where cdkf is not"

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

    def _own_options(self) -> dict[str, Any]:
        return {"h": self.h}


class RITaylorEKF(_OverTheSpread):
    """Right-invariant EKF with the Taylor net's moments of a return.

    **Motion** and **growth** as in `RIEKF`.

    **Measurement.** One return after another: slopes, mean and the curvature's covariance R_2 of a return come from a
    polynomial net of degree 2 over the spread of eta, its right-invariant error (`estimators.gaussian.taylor_net`),
    S = G S_eta G' + R_2 + R; the correction goes through the group, (a) and (b) of `RIEKF`. Slopes by eta know nothing
    of the unobservable directions, so none needs to be constrained, as those of `taylor-ekf` do.

    Args:
        motion: how the robot moves. sensor, target: see `GaussianEstimator`, as all options.

    When to use: strong noise (bearings of 2-3 deg, points nearby) over long runs: the most consistent of this family.

    Known weakness: 25 evaluations for each return; with small noise it is `ri-ekf` at a higher price.

    Reference: Geng 2024, section 5, for the net.
    """

    name: ClassVar[str] = "ri-taylor-ekf"
    summary: ClassVar[str] = "right-invariant EKF with a Taylor net: the most consistent under strong noise"
