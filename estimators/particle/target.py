"""The target inside each particle: an EKF given its pose, or a small Gaussian sum while the heading is open.

A first sighting tells where the target is, not where it heads. An EKF with a heading variance of pi^2/3 is badly
overconfident (and its likelihood, in the weight, damages the robot); a Gaussian sum of `HEADINGS` directions is
consistent at once. Once the directions agree they are merged into one EKF.
"""

import math

import numpy as np

from estimators.kernels.borrow import borrow
from estimators.kernels.elementary import log, sincos, wrap_smooth
from estimators.kernels.iterated import linearised, refine
from estimators.kernels.jit import disjoint, inline, jit, subroutine
from estimators.models import TWIST
from estimators.particle.columns import beam_cov, fit_column, sight_column
from estimators.particle.layout import HEADINGS
from estimators.particle.sharp import triangle

SETTLED = 0.98  # mean length of the particles' resultant direction above which the hypotheses are merged


@jit
def predict_twist_lanes(lanes, dt, models, state, target):
    """Eqs. (16) and (17), Wu and Sun 2013, in every hypothesis of every particle. target: [L, G, 9, N]; dt: [L]."""
    target = borrow(target)
    for lane in lanes:
        for g in range(state[lane].hypotheses if dt[lane] > 0.0 else 0):
            t = target[lane, g]
            _predict_twist(t[0], t[1], t[2], t[3], t[4], t[5], t[6], t[7], t[8], models[lane], dt[lane])


@jit
def predict_velocity_lanes(lanes, dt, models, state, target):
    """White acceleration over dt in every particle. target: [L, 1, 14, N]; dt: [L]."""
    target = borrow(target)
    for lane in lanes:
        if dt[lane] > 0.0 and state[lane].hypotheses > 0:
            t = target[lane, 0]
            _predict_velocity(
                t[0], t[1], t[2], t[3], t[4], t[5], t[6], t[7], t[8], t[9], t[10], t[11], t[12], t[13], models[lane],
                dt[lane],
            )  # fmt: skip


@disjoint
def _predict_twist(x, y, heading, p00, p01, p02, p11, p12, p22, model, dt):
    way, turn = model.target_speed * dt, model.target_turn_rate * dt
    qv, qw = (model.target_speed_std * dt) ** 2, (model.target_turn_std * dt) ** 2
    for p in range(x.size):
        end = heading[p] + turn
        s, c = sincos(end)
        f0, f1 = -way * s, way * c
        x[p] += way * c
        y[p] += way * s
        heading[p] = wrap_smooth(end)
        # The turn's noise enters as the heading's does: the heading's variance may be raised first.
        a02, a12, a22 = p02[p], p12[p], p22[p] + qw
        p00[p] += 2.0 * f0 * a02 + f0 * f0 * a22 + qv * c * c
        p01[p] += f0 * a12 + f1 * a02 + f0 * f1 * a22 + qv * c * s
        p11[p] += 2.0 * f1 * a12 + f1 * f1 * a22 + qv * s * s
        p02[p] = a02 + f0 * a22
        p12[p] = a12 + f1 * a22
        p22[p] = a22


@disjoint
def _predict_velocity(x, y, vx, vy, p00, p01, p02, p03, p11, p12, p13, p22, p23, p33, model, dt):
    q = model.acceleration_density * model.acceleration_density
    q_pp, q_pv, q_vv = q * dt * dt * dt / 3.0, q * dt * dt / 2.0, q * dt
    for p in range(x.size):
        x[p] += dt * vx[p]
        y[p] += dt * vy[p]
        p00[p] += dt * (2.0 * p02[p] + dt * p22[p]) + q_pp
        p01[p] += dt * (p03[p] + p12[p] + dt * p23[p])
        p11[p] += dt * (2.0 * p13[p] + dt * p33[p]) + q_pp
        p02[p] += dt * p22[p] + q_pv
        p03[p] += dt * p23[p]
        p12[p] += dt * p23[p]
        p13[p] += dt * p33[p] + q_pv
        p22[p] += q_vv
        p33[p] += q_vv


@subroutine
def start_target(target, log_hypothesis, model, x, y, cosine, sine, distance, cb, sb, var_r, var_b):
    """A first sighting; returns the number of hypotheses now in use."""
    twist = model.target_kind == TWIST
    hypotheses = HEADINGS if twist else 1
    sector = 2.0 * math.pi / HEADINGS
    for g in range(hypotheses):
        rows = target[g]
        for p in range(x.size):
            beam_x, beam_y = cb * cosine[p] - sb * sine[p], sb * cosine[p] + cb * sine[p]
            c00, c01, c11 = beam_cov(beam_x, beam_y, distance, var_r, var_b)
            for row in range(2, rows.shape[0]):
                rows[row, p] = 0.0
            rows[0, p], rows[1, p] = x[p] + distance * beam_x, y[p] + distance * beam_y
            log_hypothesis[g, p] = -math.log(float(hypotheses))
            if twist:
                rows[2, p] = -math.pi + (g + 0.5) * sector
                rows[3, p], rows[4, p], rows[6, p] = c00, c01, c11
                rows[8, p] = sector * sector / 12.0
            else:
                rows[4, p], rows[5, p], rows[8, p] = c00, c01, c11
                rows[11, p] = rows[13, p] = model.initial_speed_std**2
    return hypotheses


def target_rows(mean, cov):
    """A prior, mean [n_t] and covariance [n_t, n_t], as one column of a hypothesis: [F]."""
    upper = np.triu_indices(len(mean))
    return np.concatenate([mean, (0.5 * (cov + cov.T))[upper]])


@inline
def position_rows(rows):
    """The rows of P00, P01 and P11 of a landmark (5 rows) or of a target of either model."""
    if rows.shape[0] == 5:
        return rows[2], rows[3], rows[4]
    if rows.shape[0] == 9:
        return rows[3], rows[4], rows[6]
    return rows[4], rows[5], rows[8]


@subroutine
def is_too_vague(target, log_hypothesis, hypotheses, w, limit):
    """Whether the target's position spreads beyond `limit` [m]: root of the summed variances over the mixture."""
    if hypotheses == 0 or limit == math.inf:
        return False
    m0, m1, square = 0.0, 0.0, 0.0
    x0, y0 = target[0, 0, 0], target[0, 1, 0]
    for g in range(hypotheses):
        p00, _, p11 = position_rows(target[g])
        for p in range(w.size):
            share = w[p] * math.exp(log_hypothesis[g, p])
            dx, dy = target[g, 0, p] - x0, target[g, 1, p] - y0
            m0, m1 = m0 + share * dx, m1 + share * dy
            square += share * (p00[p] + p11[p] + dx * dx + dy * dy)
    return square - m0 * m0 - m1 * m1 > limit * limit


@subroutine
def fit_point(tx, ty, p00, p01, p11, terms, x, y, cosine, sine, distance, cb, sb, var_r, var_b, spread):
    """`fit` of a return against one point in every particle, all rows [N]. terms: [7, N], written (see `fit`).

    Where the position's deviation is above `spread` times the distance, the update is iterated: Gauss-Newton on the
    position, whose last linearisation gives the terms.
    """
    t0, t1, t2, t3, t4, t5, t6 = terms[0], terms[1], terms[2], terms[3], terms[4], terms[5], terms[6]
    sight_column(tx, ty, x, y, cosine, sine, cb, sb, t0, t1)
    fit_column(tx, ty, p00, p01, p11, x, y, t0, t1, t2, t3, t4, t5, t6, distance, var_r, var_b)
    limit = (spread * distance) ** 2
    if largest_sum(p00, p11) > limit:
        for p in range(x.size):
            if p00[p] + p11[p] > limit:
                beam_x, beam_y = cb * cosine[p] - sb * sine[p], sb * cosine[p] + cb * sine[p]
                t0[p], t1[p], t2[p], t3[p], t4[p], t5[p], t6[p] = _iterate(
                    tx[p] - x[p], ty[p] - y[p], p00[p], p01[p], p11[p], distance, beam_x, beam_y, var_r, var_b
                )


@disjoint
def largest_sum(a, b):
    """The largest of a + b, rows [N]."""
    largest = -math.inf
    for p in range(a.size):
        largest = max(largest, a[p] + b[p])
    return largest


@subroutine
def _iterate(dx, dy, p00, p01, p11, distance, beam_x, beam_y, var_r, var_b):
    """Terms (see `fit`) of the iterated update, linearised where the posterior is."""
    ex, ey = refine(dx, dy, p00, p01, p11, distance, beam_x, beam_y, var_r, var_b)
    ux, uy, vx, vy, nu_r, nu_b, s00, s01, s11 = linearised(
        ex, ey, dx, dy, p00, p01, p11, distance, beam_x, beam_y, var_r, var_b
    )
    det = s00 * s11 - s01 * s01
    i00, i01, i11 = s11 / det, -s01 / det, s00 / det
    e0, e1 = i00 * nu_r + i01 * nu_b, i01 * nu_r + i11 * nu_b
    a00 = ux * (i00 * ux + i01 * vx) + vx * (i01 * ux + i11 * vx)
    a01 = ux * (i00 * uy + i01 * vy) + vx * (i01 * uy + i11 * vy)
    a11 = uy * (i00 * uy + i01 * vy) + vy * (i01 * uy + i11 * vy)
    return ux * e0 + vx * e1, uy * e0 + vy * e1, a00, a01, a11, nu_r * e0 + nu_b * e1, det


@subroutine
def apply_terms(rows, n_t, terms, work):
    """Mean += C b, cov -= C A2 C', C = cov[:, :2]: the update of one hypothesis in every particle.

    work: [10, N] scratch: C' column by column, then one row pair of C A2.
    """
    m0, m1 = work[8], work[9]
    for i in range(n_t):
        _copy(work[2 * i], rows[triangle(n_t, 0, i)])
        _copy(work[2 * i + 1], rows[triangle(n_t, min(i, 1), max(i, 1))])
    for i in range(n_t):
        _gain(rows[i], work[2 * i], work[2 * i + 1], terms[0], terms[1], terms[2], terms[3], terms[4], m0, m1)
        for j in range(i, n_t):
            _downdate(rows[triangle(n_t, i, j)], m0, m1, work[2 * j], work[2 * j + 1])


@disjoint
def _gain(mean, c0, c1, b0, b1, a00, a01, a11, m0, m1):
    for p in range(mean.size):
        mean[p] += c0[p] * b0[p] + c1[p] * b1[p]
        m0[p] = c0[p] * a00[p] + c1[p] * a01[p]
        m1[p] = c0[p] * a01[p] + c1[p] * a11[p]


@disjoint
def _copy(to, source):
    for p in range(to.size):
        to[p] = source[p]


@disjoint
def _downdate(row, m0, m1, d0, d1):
    for p in range(row.size):
        row[p] -= m0[p] * d0[p] + m1[p] * d1[p]


@subroutine
def gather_terms(terms, likelihood):
    """A return's likelihood in every particle, kept until `gather_weights`. likelihood: [2, N]."""
    for p in range(terms.shape[1]):
        likelihood[0, p] += terms[5, p]
        likelihood[1, p] *= terms[6, p]


@subroutine
def weigh_hypothesis(terms, log_hypothesis):
    """A return's likelihood under one hypothesis of every particle, into its log weight [N]."""
    for p in range(terms.shape[1]):
        log_hypothesis[p] -= 0.5 * (terms[5, p] + log(terms[6, p]))


@subroutine
def share_out(log_hypothesis, hypotheses, log_w):
    """Normalise the hypotheses within each particle; what they summed to is the particle's likelihood."""
    for p in range(log_w.size):
        top = log_hypothesis[0, p]
        for g in range(1, hypotheses):
            top = max(top, log_hypothesis[g, p])
        total = 0.0
        for g in range(hypotheses):
            total += math.exp(log_hypothesis[g, p] - top)
        evidence = top + math.log(total)
        for g in range(hypotheses):
            log_hypothesis[g, p] -= evidence
        log_w[p] += evidence


@subroutine
def settle(target, log_hypothesis, hypotheses, w):
    """Merge the heading hypotheses of every particle once they agree; returns the number in use afterwards."""
    agreement = 0.0
    for p in range(w.size):
        agreement += w[p] * _resultant(target, log_hypothesis, hypotheses, p)[0]
    if not agreement > SETTLED:
        return hypotheses
    for p in range(w.size):
        _merge(target, log_hypothesis, hypotheses, p)
    return 1


@subroutine
def _resultant(target, log_hypothesis, hypotheses, p):
    """Length and direction of the hypotheses' mean direction."""
    cosine, sine = 0.0, 0.0
    for g in range(hypotheses):
        share = math.exp(log_hypothesis[g, p])
        cosine += share * math.cos(target[g, 2, p])
        sine += share * math.sin(target[g, 2, p])
    return math.sqrt(cosine * cosine + sine * sine), math.atan2(sine, cosine)


@subroutine
def _merge(target, log_hypothesis, hypotheses, p):
    """Moments of one particle's hypotheses (twist: x, y, heading), written over the first."""
    centre = _resultant(target, log_hypothesis, hypotheses, p)[1]
    x0, y0 = target[0, 0, p], target[0, 1, p]
    m0, m1, m2 = 0.0, 0.0, 0.0
    s00, s01, s02, s11, s12, s22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for g in range(hypotheses):
        share = math.exp(log_hypothesis[g, p])
        d0, d1, d2 = target[g, 0, p] - x0, target[g, 1, p] - y0, wrap_smooth(target[g, 2, p] - centre)
        m0, m1, m2 = m0 + share * d0, m1 + share * d1, m2 + share * d2
        s00 += share * (target[g, 3, p] + d0 * d0)
        s01 += share * (target[g, 4, p] + d0 * d1)
        s02 += share * (target[g, 5, p] + d0 * d2)
        s11 += share * (target[g, 6, p] + d1 * d1)
        s12 += share * (target[g, 7, p] + d1 * d2)
        s22 += share * (target[g, 8, p] + d2 * d2)
    target[0, 0, p], target[0, 1, p], target[0, 2, p] = x0 + m0, y0 + m1, wrap_smooth(centre + m2)
    target[0, 3, p], target[0, 4, p], target[0, 5, p] = s00 - m0 * m0, s01 - m0 * m1, s02 - m0 * m2
    target[0, 6, p], target[0, 7, p], target[0, 8, p] = s11 - m1 * m1, s12 - m1 * m2, s22 - m2 * m2
    log_hypothesis[0, p] = 0.0
