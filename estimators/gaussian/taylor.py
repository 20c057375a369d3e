"""The FEJ-EKF with the Taylor net's slopes and moments of a return, held to FEJ's observability structure.

Geng 2024, section 5, made precise. With D = point - robot, g = J(l_first - p_{k|k-1}) and B = [-I, -g, I] over robot
position, heading and point, the net's slopes G by D give H_SL = [-G, -e2, G] = G B + k e_phi', k = G g - e2. Of all
H = A B, which know nothing of the unobservable directions, the nearest under the belief P is the regression

    A = H_SL P B' (B P B')^-1 = G + k q',       q = (B P B')^-1 B P e_phi,

and what it leaves, (H_SL - H) P (H_SL - H)' = k k' var(heading | B x), joins the noise: S = H P H' + R + R_2 + that.
"""

import math
from typing import ClassVar

from estimators.gaussian.anchor import A_T, ROUGH_NIS, STALE, TORN, has_shifted, linear_point, renew
from estimators.gaussian.fej import FEJEKF, anchor_target
from estimators.gaussian.growth import grow
from estimators.gaussian.layout import Call
from estimators.gaussian.sweep import UNLIKELY, UNUSABLE, USED, associate, limit_of, note
from estimators.gaussian.taylor_net import fit_net, from_beam, root_of, to_beam
from estimators.interface import Scan
from estimators.kernels.angles import wrap
from estimators.kernels.association import KNOWN, TARGET_SLOT
from estimators.kernels.bound import LATER
from estimators.kernels.gaussian import ROBOT, downdate, nis_and_log_det, rows_in_use
from estimators.kernels.jit import inline, jit
from estimators.kernels.range_bearing import measure, noise_std
from estimators.kernels.rounding import blunted, offset_variance
from estimators.models import TWIST


@inline
def constrain(e00, e01, e11, f0, f1, turn, ga, gb, g00, g01, g10, g11, distance):
    """The constrained slopes A (a00, a01, a10, a11), k and var(heading | B x), and B P B' (b00, b01, b11).

    Args:
        e00: with e01, e11, covariance of D; f0, f1: that of D with the heading; turn: the heading's variance.
        ga: with gb, g. g00: with g01, g10, g11, the net's slopes G. All in the beam's axes.
    """
    w0, w1 = f0 - turn * ga, f1 - turn * gb
    b00 = e00 - ga * (f0 + w0)
    b01 = e01 - ga * f1 - gb * w0
    b11 = e11 - gb * (f1 + w1)
    m00, m10, m11 = root_of(b00, b01, b11, distance)
    v0 = w0 / m00
    v1 = (w1 - m10 * v0) / m11
    q1 = v1 / m11
    q0 = (v0 - m10 * q1) / m00
    k0, k1 = g00 * ga + g01 * gb, g10 * ga + g11 * gb - 1.0
    rest = max(turn - v0 * v0 - v1 * v1, 0.0)
    return g00 + k0 * q0, g01 + k0 * q1, g10 + k1 * q0, g11 + k1 * q1, k0, k1, rest, b00, b01, b11


@inline
def observe(mu, P, W, lane, n, j, model, anchor, first_x, first_y, distance, bearing, limit):
    """Update by one return of the point at row j; (what became of it, its NIS)."""
    dx, dy = mu[lane, j] - mu[lane, 0], mu[lane, j + 1] - mu[lane, 1]
    r, b = measure(dx, dy, mu[lane, 2])
    if not r > 0.0:
        return UNUSABLE, 0.0
    ux, uy = dx / r, dy / r
    e00, e01, e11 = to_beam(
        ux,
        uy,
        P[lane, j, j] - 2.0 * P[lane, j, 0] + P[lane, 0, 0],
        P[lane, j, j + 1] - P[lane, j, 1] - P[lane, j + 1, 0] + P[lane, 0, 1],
        P[lane, j + 1, j + 1] - 2.0 * P[lane, j + 1, 1] + P[lane, 1, 1],
    )
    t0, t1 = P[lane, j, 2] - P[lane, 0, 2], P[lane, j + 1, 2] - P[lane, 1, 2]
    l00, l10, l11 = root_of(e00, e01, e11, r)
    mr, mb, g00, g01, g10, g11, s00, s01, s11 = fit_net(r, l00, l10, l11, 0.0, 0.0)
    gx, gy = anchor[lane, 1] - first_y, first_x - anchor[lane, 0]
    ga, gb = ux * gx + uy * gy, ux * gy - uy * gx
    a00, a01, a10, a11, k0, k1, rest, b00, b01, b11 = constrain(
        e00, e01, e11, ux * t0 + uy * t1, ux * t1 - uy * t0, P[lane, 2, 2], ga, gb, g00, g01, g10, g11, r
    )
    c0, c1 = -(a00 * ga + a01 * gb), -(a10 * ga + a11 * gb)
    spread, turn = offset_variance(P, lane, j), P[lane, 2, 2]
    range_std, bearing_std = noise_std(model, r)
    range_std, bearing_std = blunted(
        P, W, lane, n, (a00 * a00 + a01 * a01) * spread + c0 * c0 * turn,
        (a10 * a10 + a11 * a11) * spread + c1 * c1 * turn, range_std, bearing_std,
    )  # fmt: skip
    h00, h01, h10, h11 = a00 * b00 + a01 * b01, a00 * b01 + a01 * b11, a10 * b00 + a11 * b01, a10 * b01 + a11 * b11
    s00 += h00 * a00 + h01 * a01 + k0 * k0 * rest + range_std * range_std
    s01 += h00 * a10 + h01 * a11 + k0 * k1 * rest
    s11 += h10 * a10 + h11 * a11 + k1 * k1 * rest + bearing_std * bearing_std
    y0, y1 = distance - r - mr, wrap(bearing - b - mb)
    nis = nis_and_log_det(s00, s01, s11, y0, y1)[0]
    if not nis <= limit:
        return (UNUSABLE if math.isnan(nis) else UNLIKELY), nis
    a00, a01, a10, a11 = from_beam(ux, uy, a00, a01, a10, a11)
    downdate(mu, lane, P, W, lane, n, j, a00, a01, a10, a11, c0, c1, y0, y1, s00, s01, s11)
    mu[lane, 2] = wrap(mu[lane, 2])
    return USED, nis


@inline
def update_one(
    lane, mu, P, model, n_t, count, ids, first, next_id, anchor, target_known, pending, counters, last_dt, ranges,
    bearings, labels, num_returns, code, gates, slots, cost, work,
):  # fmt: skip
    """One lane's sweep: as the FEJ-EKF's, by this file's `observe`."""
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
        first_x, first_y = linear_point(lane, slot, is_target, first, anchor)
        if has_shifted(mu, lane, j, anchor, first_x, first_y, STALE):
            renew(mu, lane, n_t, count[lane], first, anchor)
            first_x, first_y = linear_point(lane, slot, is_target, first, anchor)
        limit = limit_of(gates[0], model, is_target)
        distance, bearing = ranges[lane, k], bearings[lane, k]
        outcome, nis = observe(mu, P, work, lane, n, j, model, anchor, first_x, first_y, distance, bearing, limit)
        if outcome != USED:
            note(outcome, nis, is_target, mu, P, lane, n, n_t, model, target_known, pending, counters)
        elif nis > ROUGH_NIS and has_shifted(mu, lane, j, anchor, first_x, first_y, TORN):
            renew(mu, lane, n_t, count[lane], first, anchor)
    held, known, held_x, held_y = pending[lane, 0] > 0.0, target_known[lane], 0.0, 0.0
    if n_t > 0:
        held_x, held_y = anchor[lane, A_T], anchor[lane, A_T + 1]
        if model.target_kind == TWIST:
            mu[lane, 5] = wrap(mu[lane, 5])
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


class TaylorEKF(FEJEKF):
    """First-estimates-Jacobian EKF with the multi-dimensional Taylor net: FEJ that knows how curved a return is.

    **Motion** and **growth** as in `FEJEKF`.

    **Measurement.** For each return, D = point - robot and its covariance S_D = L L' are taken from the belief, and
    range and bearing are fitted over that spread by a polynomial net of degree 2 (`estimators.gaussian.taylor_net`,
    Eq. (3) of Geng 2024 in an orthogonal basis). Its constant is the expected return, its slopes take the place of the
    gradient, its curvature R_2 joins the noise. The slopes are held to H = A B, B = [-I, -J(l_first - p_{k|k-1}), I],
    as Eq. (33) holds the gradient: A is their regression on B x, and what that leaves joins the noise too.

    Args:
        motion: how the robot moves. sensor, target: see `GaussianEstimator`, as all options.

    When to use: where `fej-ekf` becomes overconfident, at bearing noise of 2-3 deg over long runs.

    Known weakness: 25 evaluations for each return; its points of linearisation stay where estimates were first, and
    `ri-taylor-ekf`, which has none, is more consistent still.

    Reference: Geng 2024, Eqs. (3) and (32)-(34), section 5. The paper leaves the weights open: learned online from
    innovations they diverge, and slopes without the constraint lose what FEJ gains.
    """

    name: ClassVar[str] = "taylor-ekf"
    summary: ClassVar[str] = "FEJ-EKF with a Taylor net: slopes and noise over the whole spread of a return"

    def _correction(self, scan: Scan) -> Call:
        return (
            update, self.mu, self.P, self.models, self.n_t, self.count, self.ids, self.first, self.next_id, self.anchor,
            self.target_known, self.pending, self.counters, self.last_dt, scan.ranges, scan.bearings, scan.labels,
            scan.count, self.association_code, self.gates, self.slots, self.cost, self.work, LATER,
        )  # fmt: skip
