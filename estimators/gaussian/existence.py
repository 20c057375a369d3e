"""Unlabelled landmarks that should have been seen and were not are let go; doubtful ones are kept out of the belief.

Log odds of existence stand beside each landmark's first estimate, `first[lane, slot, EXISTENCE]`; see
`kernels.existence`. A landmark is missed by a complete sweep if it is well inside range and view, no mapped pillar may
hide it, and no return was left undecided near it.
"""

import math

from estimators.gaussian.sweep import REMOVED
from estimators.kernels.angles import wrap
from estimators.kernels.association import DROPPED, predicted_fit
from estimators.kernels.existence import (
    MARGIN,
    SHOWN,
    expected_log_likelihood,
    log_odds_at_first,
    log_odds_missed,
    log_odds_seen,
    may_cover,
    should_be_seen,
)
from estimators.kernels.gaussian import ROBOT, remove_landmark
from estimators.kernels.jit import inline, jit, subroutine
from estimators.kernels.range_bearing import measure, noise_std

EXISTENCE = 2  # column of `first`
FRESH = 0.0  # what stands there when a landmark has just been created


@jit
def revise_map(
    mu, P, models, n_t, count, ids, first, counters, ranges, bearings, num_returns, complete, new_gate, limit, slots,
    lanes,
):  # fmt: skip
    """After an update of the named lanes: new log odds for every landmark, the unlikely ones marginalised out.

    Args:
        slots: [L, K] the landmark of each return, negative where it is none's.
        limit: log odds of existence below which a landmark goes.
    """
    for i in range(lanes.size):
        lane = lanes[i]
        for k in range(num_returns[lane]):
            if slots[lane, k] >= 0:
                _note_seen(mu, P, lane, models[lane], n_t, first, slots[lane, k], ranges[lane, k], bearings[lane, k])
        if not complete[lane]:
            continue
        for slot in range(count[lane]):
            if _is_seen(slots, lane, num_returns[lane], slot):
                continue
            if _is_missed(
                mu, P, lane, models[lane], n_t, count[lane], slot, ranges, bearings, num_returns[lane], new_gate, slots
            ):
                first[lane, slot, EXISTENCE] = log_odds_missed(models[lane], first[lane, slot, EXISTENCE])
        for slot in range(count[lane] - 1, -1, -1):
            if first[lane, slot, EXISTENCE] < limit:
                remove_landmark(mu, P, count, ids, first, lane, slot, n_t)
                counters[lane, REMOVED] += 1


@inline
def _note_seen(mu, P, lane, model, n_t, first, slot, distance, bearing):
    """One return that was taken for a landmark's, after the update."""
    if first[lane, slot, EXISTENCE] == FRESH:
        first[lane, slot, EXISTENCE] = log_odds_at_first(model)
        return
    log_det = predicted_fit(mu, P, model, lane, ROBOT + n_t + 2 * slot, distance, bearing)[1]
    if log_det == log_det:
        first[lane, slot, EXISTENCE] = log_odds_seen(
            model, first[lane, slot, EXISTENCE], distance, expected_log_likelihood(log_det)
        )


@inline
def _is_seen(slots, lane, num_returns, slot):
    for k in range(num_returns):
        if slots[lane, k] == slot:
            return True
    return False


@inline
def _is_missed(mu, P, lane, model, n_t, count, slot, ranges, bearings, num_returns, new_gate, slots):
    """Whether this sweep should have held a return of the landmark."""
    j = ROBOT + n_t + 2 * slot
    dx, dy = mu[lane, j] - mu[lane, 0], mu[lane, j + 1] - mu[lane, 1]
    r, b = measure(dx, dy, mu[lane, 2])
    spread = _spread(P, lane, j)
    range_std, bearing_std = noise_std(model, r)
    turn_std = math.sqrt(max(P[lane, 2, 2], 0.0))
    if not r > spread or not should_be_seen(model, r, wrap(b), range_std + spread, bearing_std + turn_std + spread / r):
        return False
    for other in range(count if model.landmark_radius > 0.0 else 0):
        m = ROBOT + n_t + 2 * other
        ex, ey = mu[lane, m] - mu[lane, 0], mu[lane, m + 1] - mu[lane, 1]
        if other != slot and may_cover(dx, dy, ex, ey, model.landmark_radius + MARGIN * _spread(P, lane, m)):
            return False
    for k in range(num_returns):
        if slots[lane, k] == DROPPED:
            if predicted_fit(mu, P, model, lane, j, ranges[lane, k], bearings[lane, k])[0] <= new_gate:
                return False
    return True


@inline
def _spread(P, lane, j):
    """Deviation [m] of a point's position relative to the robot's, along the axis where it is largest at most."""
    xx = P[lane, j, j] - 2.0 * P[lane, j, 0] + P[lane, 0, 0]
    yy = P[lane, j + 1, j + 1] - 2.0 * P[lane, j + 1, 1] + P[lane, 1, 1]
    return math.sqrt(max(xx + yy, 0.0))


@subroutine
def hide_doubtful(first, count, landmark_count, landmark_id, landmark_mapped, mean, cov, rel, rel_cov, lanes):
    """Take landmarks that are not likely to exist out of a filled belief; their slots look empty."""
    for index in range(lanes.size):
        lane = lanes[index]
        for slot in range(count[lane]):
            if first[lane, slot, EXISTENCE] > SHOWN:
                continue
            landmark_count[lane] -= 1
            landmark_id[lane, slot] = -1
            landmark_mapped[lane, slot] = False
            for i in range(2):
                mean[lane, slot, i] = rel[lane, slot, i] = 0.0
                for k in range(2):
                    cov[lane, slot, i, k] = rel_cov[lane, slot, i, k] = 0.0
