"""A target seen again after a long absence, when a linearisation at its prior mean would be worthless.

Out of sight the target's position spreads. A first-order update by range and bearing at so vague a mean moves the
target to places that the return rules out. So where the spread is above `iterate_spread` times the distance, the update
is iterated (`estimators.kernels.iterated`); where it is wider than `reinitialise_spread` allows, the target starts
anew: the return alone then says all there is.

The iteration runs on eta = dD - J D dphi, the part of the error of D = target - robot that a return can see. It ends at
e, and one ordinary update of the joint state follows, linearised there: H = A(e) [-I, -J e, I]. A filter that keeps to
other points of linearisation than its mean (FEJ), or whose error turns with the heading (right-invariant), holds the
target's rows of P in coordinates that go with these: they are brought to e first, P <- M P M', M = I + d e_phi' with d
the shift of J D, so that the heading stays unobservable.
"""

from estimators.gaussian.considered import keep_pose, put_pose_back
from estimators.gaussian.sweep import REINITIALISED, WITHHELD, forget_target
from estimators.interface import TARGET
from estimators.kernels.angles import wrap
from estimators.kernels.gaussian import ROBOT, downdate, innovation_cov, nis_and_log_det, rows_in_use, shear
from estimators.kernels.iterated import linearised, refine
from estimators.kernels.jit import inline, jit
from estimators.kernels.range_bearing import noise_std, offset, usable
from estimators.kernels.rounding import blunted, offset_variance
from estimators.models import TWIST

AT_MEAN, TURNING, FIRST, CONSIDERED = 0, 1, 2, 3
"""How a filter's covariance goes with the heading: EKF, sigma points; right-invariant; first-estimates Jacobians; and a
filter at its mean whose pose is not to be corrected."""
_KEPT = 2  # row of the scratch from which on the pose is kept

_TARGET_LABEL = TARGET


@inline
def seen_spread(P, lane, g0, g1):
    """Covariance (e00, e01, e11) of eta = dD - g dphi of the target."""
    j = ROBOT
    e00 = P[lane, j, j] - 2.0 * P[lane, j, 0] + P[lane, 0, 0]
    e01 = P[lane, j, j + 1] - P[lane, j, 1] - P[lane, j + 1, 0] + P[lane, 0, 1]
    e11 = P[lane, j + 1, j + 1] - 2.0 * P[lane, j + 1, 1] + P[lane, 1, 1]
    f0, f1, turn = P[lane, j, 2] - P[lane, 0, 2], P[lane, j + 1, 2] - P[lane, 1, 2], P[lane, 2, 2]
    return (
        e00 - 2.0 * g0 * f0 + g0 * g0 * turn,
        e01 - g0 * f1 - g1 * f0 + g0 * g1 * turn,
        (e11 - 2.0 * g1 * f1 + g1 * g1 * turn),
    )


@inline
def iterate(mu, P, lane, model, g0, g1, distance, bearing):
    """The iterated fit of a return to the target: e, A(e) = (a00, a01, a10, a11), the innovation (y0, y1).

    Preceded by NIS and log det S (nan where S is not positive definite).
    """
    dx, dy = mu[lane, ROBOT] - mu[lane, 0], mu[lane, ROBOT + 1] - mu[lane, 1]
    e00, e01, e11 = seen_spread(P, lane, g0, g1)
    range_std, bearing_std = noise_std(model, distance)
    ox, oy = offset(distance, bearing, mu[lane, 2])
    bx, by = ox / distance, oy / distance
    var_r, var_b = range_std * range_std, bearing_std * bearing_std
    ex, ey = refine(dx, dy, e00, e01, e11, distance, bx, by, var_r, var_b)
    a00, a01, a10, a11, y0, y1, s00, s01, s11 = linearised(
        ex, ey, dx, dy, e00, e01, e11, distance, bx, by, var_r, var_b
    )
    nis, log_det = nis_and_log_det(s00, s01, s11, y0, y1)
    return nis, log_det, ex, ey, a00, a01, a10, a11, y0, y1


@inline
def is_vague(P, lane, model, g0, g1, distance):
    """Whether a return from that distance calls for an iterated update."""
    e00, _, e11 = seen_spread(P, lane, g0, g1)
    limit = model.iterate_spread * distance
    return e00 + e11 > limit * limit


@inline
def lever(points, lane, at):
    """J D at the points of linearisation: the robot's at column 0 of `points`, the target's at column `at`."""
    return points[lane, 1] - points[lane, at + 1], points[lane, at] - points[lane, 0]


@jit
def sort_out(
    mu, P, models, n_t, count, target_known, pending, counters, slots, points, at, gate, ranges, bearings, labels,
    num_returns, lanes,
):  # fmt: skip
    """Look at the TARGET returns of a sweep before it is taken: withhold those that are left to `take_back`.

    Too vague for their return, or unable to have caused it after all: such targets are forgotten, to start anew.

    Args:
        slots: [L, K + 1] the last column is written, see `sweep.WITHHELD`.
        points: with `at`, see `lever`. gate: NIS above which a labelled return is rejected, as everywhere.
    """
    flag = slots.shape[1] - 1
    for i in range(lanes.size):
        lane = lanes[i]
        slots[lane, flag] = 0
        if not target_known[lane]:
            continue
        model = models[lane]
        for k in range(num_returns[lane]):
            distance, bearing = ranges[lane, k], bearings[lane, k]
            if labels[lane, k] != _TARGET_LABEL or not usable(distance, bearing):
                continue
            g0, g1 = lever(points, lane, at)
            limit = model.reinitialise_spread * distance
            impossible = P[lane, ROBOT, ROBOT] + P[lane, ROBOT + 1, ROBOT + 1] > limit * limit
            if not impossible and is_vague(P, lane, model, g0, g1, distance):
                nis = iterate(mu, P, lane, model, g0, g1, distance, bearing)[0]
                impossible = nis > model.reinitialise_nis
                if nis <= min(gate, model.reinitialise_nis):
                    slots[lane, flag] = WITHHELD
            if impossible:
                counters[lane, REINITIALISED] += 1
                forget_target(mu, P, lane, rows_in_use(n_t, count[lane]), n_t, target_known, pending)
            break


@jit
def take_back(
    mu, P, work, models, n_t, count, slots, points, at, kind, ranges, bearings, labels, num_returns, lanes
):  # fmt: skip
    """Update targets by their returns that were withheld, iterated; the rest of the sweep has been taken before."""
    for i in range(lanes.size):
        lane = lanes[i]
        if slots[lane, slots.shape[1] - 1] != WITHHELD:
            continue
        model, n = models[lane], rows_in_use(n_t, count[lane])
        for k in range(num_returns[lane]):
            distance, bearing = ranges[lane, k], bearings[lane, k]
            if labels[lane, k] != _TARGET_LABEL or not usable(distance, bearing):
                continue
            g0, g1 = lever(points, lane, at)
            _, _, ex, ey, a00, a01, a10, a11, y0, y1 = iterate(mu, P, lane, model, g0, g1, distance, bearing)
            if kind == TURNING or kind == FIRST:
                shear(P, lane, n, ROBOT, 2, -ey - g0)
                shear(P, lane, n, ROBOT + 1, 2, ex - g1)
            if kind == FIRST:
                points[lane, at], points[lane, at + 1] = points[lane, 0] + ex, points[lane, 1] + ey
            range_std, bearing_std = noise_std(model, distance)
            variance = offset_variance(P, lane, ROBOT)
            range_std, bearing_std = blunted(
                P, work, lane, n, (a00 * a00 + a01 * a01) * variance,
                (a10 * a10 + a11 * a11) * variance + P[lane, 2, 2], range_std, bearing_std,
            )  # fmt: skip
            s00, s01, s11 = innovation_cov(
                P, lane, ROBOT, a00, a01, a10, a11, 0.0, -1.0, range_std * range_std, bearing_std * bearing_std
            )
            kept = work[_KEPT : _KEPT + ROBOT + 1]
            keep_pose(mu, P, lane, kept)
            if s00 > 0.0 and s00 * s11 - s01 * s01 > 0.0:
                downdate(mu, lane, P, work, lane, n, ROBOT, a00, a01, a10, a11, 0.0, -1.0, y0, y1, s00, s01, s11)
            if kind == CONSIDERED:
                put_pose_back(mu, P, lane, kept)
        mu[lane, 2] = wrap(mu[lane, 2])
        if model.target_kind == TWIST:
            mu[lane, 5] = wrap(mu[lane, 5])
