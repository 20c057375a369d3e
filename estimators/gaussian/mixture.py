"""A few joint Gaussians of one lane as a mixture: its moments, its weights, and their exchange under a Markov chain.

The members of lane L lie in the rows L G ... L G + G - 1 of one array each, mu [L G, n_max] and P [L G, n_max, n_max].
Their maps have the same slots. Headings are averaged by wrapped deviations; a covariance is sum w (P_g + d_g d_g'), the
spread of the means included, so every cross covariance of the mixture is right.
"""

import math

from estimators.gaussian.vague_target import is_vague, iterate, lever
from estimators.interface import TARGET
from estimators.kernels.angles import wrap
from estimators.kernels.association import predicted_fit
from estimators.kernels.gaussian import ROBOT, rows_in_use
from estimators.kernels.jit import inline, jit
from estimators.kernels.range_bearing import usable
from estimators.models import TWIST

NOWHERE = 1e9  # [m] a member's own spread beyond which all start anew: mixing would hand it on until it overflows
TINY = 1e-300  # a weight never falls below, so that its logarithm exists
_TARGET_LABEL = TARGET


@inline
def mean_direction(mu, base, share, column):
    """Direction of the members' mean unit vector."""
    c, s = 0.0, 0.0
    for g in range(share.size):
        c += share[g] * math.cos(mu[base + g, column])
        s += share[g] * math.sin(mu[base + g, column])
    return math.atan2(s, c)


@inline
def _add_part(row, own, away, share, d, n):
    for j in range(n):
        row[j] += share * (own[j] + d * away[j])


@inline
def combine(mu, P, base, share, n, own_heading, to_mu, to_P, to, dev):
    """Moments of a mixture with weights `share` [G] into row `to`. dev: [G + 1, n_max] scratch.

    own_heading: whether row 5 is the target's heading.
    """
    size = share.size
    middle = dev[size]
    for i in range(n):
        middle[i] = mu[base, i]
    if own_heading:
        middle[ROBOT + 2] = mean_direction(mu, base, share, ROBOT + 2)
    for i in range(n):
        mean = 0.0
        for g in range(size):
            away = mu[base + g, i] - middle[i]
            if i == 2 or (own_heading and i == ROBOT + 2):
                away = wrap(away)
            dev[g, i] = away
            mean += share[g] * away
        to_mu[to, i] = middle[i] + mean
        for g in range(size):
            dev[g, i] -= mean
    to_mu[to, 2] = wrap(to_mu[to, 2])
    if own_heading:
        to_mu[to, ROBOT + 2] = wrap(to_mu[to, ROBOT + 2])
    for i in range(n):
        row = to_P[to, i]
        for j in range(n):
            row[j] = 0.0
        for g in range(size):
            _add_part(row, P[base + g, i], dev[g], share[g], dev[g, i], n)


@jit
def collapse(mu, P, w, models, n_t, count, to_mu, to_P, dev, lanes):
    """The mixture's moments of the named lanes. count: [L G]; w: [L, G]; to_mu: [L, n_max], to_P: [L, n_max, n_max]."""
    size = w.shape[1]
    for i in range(lanes.size):
        lane = lanes[i]
        own = models[lane * size].target_kind == TWIST
        combine(mu, P, lane * size, w[lane], rows_in_use(n_t, count[lane * size]), own, to_mu, to_P, lane, dev)


@jit
def exchange(mu, P, w, chances, n_t, count, mixed_mu, mixed_P, share, dev, lanes):
    """One switch of the Markov chain: mixing of the members and prediction of their weights.

    Eqs. (3)-(5), Blom and Bar-Shalom 1988: member j becomes the mixture with weights p_ij w_i / c_j, its own weight
    c_j = sum_i p_ij w_i.

    Args:
        chances: [L, G, G] p_ij, all positive, from mode i to mode j since the last switch.
        mixed_mu: [G, n_max], with mixed_P [G, n_max, n_max], share [2, G], dev: scratch.
    """
    size = w.shape[1]
    for i in range(lanes.size):
        lane = lanes[i]
        base = lane * size
        n = rows_in_use(n_t, count[base])
        for j in range(size):
            share[1, j] = 0.0
            for g in range(size):
                share[0, g] = chances[lane, g, j] * w[lane, g]
                share[1, j] += share[0, g]
            for g in range(size):
                share[0, g] /= share[1, j]
            combine(mu, P, base, share[0], n, False, mixed_mu, mixed_P, j, dev)
        for j in range(size):
            w[lane, j] = share[1, j]
            for a in range(n):
                mu[base + j, a] = mixed_mu[j, a]
                for b in range(n):
                    P[base + j, a, b] = mixed_P[j, a, b]


@inline
def spread_beyond(mu, P, w, lane, limit):
    """Whether the mixture's target position spreads beyond `limit` [m], or any member's own beyond `NOWHERE`."""
    size = w.shape[1]
    base = lane * size
    m0, m1, square, widest = 0.0, 0.0, 0.0, 0.0
    for g in range(size):
        dx, dy = mu[base + g, ROBOT] - mu[base, ROBOT], mu[base + g, ROBOT + 1] - mu[base, ROBOT + 1]
        m0, m1 = m0 + w[lane, g] * dx, m1 + w[lane, g] * dy
        own = P[base + g, ROBOT, ROBOT] + P[base + g, ROBOT + 1, ROBOT + 1]
        square += w[lane, g] * (own + dx * dx + dy * dy)
        widest = max(widest, own)
    return square - m0 * m0 - m1 * m1 > limit * limit or widest > NOWHERE * NOWHERE


@inline
def fit(mu, P, models, member, points, at, distance, bearing):
    """NIS and log det S of a return under one member, iterated where its target is vague."""
    g0, g1 = lever(points, member, at)
    if is_vague(P, member, models[member], g0, g1, distance):
        nis, log_det, _, _, _, _, _, _, _, _ = iterate(mu, P, member, models[member], g0, g1, distance, bearing)
        return nis, log_det
    return predicted_fit(mu, P, models[member], member, ROBOT, distance, bearing)


@jit
def weigh(mu, P, models, outer, w, points, at, ranges, bearings, labels, num_returns, restart, score, lanes):
    """Bayes' rule for the members' weights, by the TARGET returns of a sweep that is about to be taken.

    Args:
        outer: [L] the owner's models, whose limits say when the target starts anew.
        points: with `at`, see `vague_target.lever`. restart: [L] written. score: [G] scratch.
    """
    size = w.shape[1]
    for i in range(lanes.size):
        lane = lanes[i]
        restart[lane] = False
        for k in range(num_returns[lane]):
            distance, bearing = ranges[lane, k], bearings[lane, k]
            if labels[lane, k] != _TARGET_LABEL or not usable(distance, bearing):
                continue
            outside, top = 0.0, -math.inf
            for g in range(size):
                nis, log_det = fit(mu, P, models, lane * size + g, points, at, distance, bearing)
                outside += w[lane, g] if nis > outer[lane].reinitialise_nis else 0.0
                score[g] = -math.inf if math.isnan(nis) else math.log(max(w[lane, g], TINY)) - 0.5 * (nis + log_det)
                top = max(top, score[g])
            too_wide = spread_beyond(mu, P, w, lane, outer[lane].reinitialise_spread * distance)
            restart[lane] = too_wide or outside > 0.5
            if restart[lane] or top == -math.inf:
                break
            for g in range(size):
                score[g] = math.exp(score[g] - top)
            total = 0.0  # summed apart from any storing: beside it the sum would round by where the arrays lie
            for g in range(size):
                total += score[g]
            for g in range(size):
                w[lane, g] = score[g] / total
