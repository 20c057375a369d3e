"""Which return belongs to which landmark: by its label, or to the most likely one.

The answer is one integer per return: a landmark's slot, or one of the codes below.
"""

import math

import numpy as np

from estimators.interface import TARGET, UNKNOWN
from estimators.kernels.angles import wrap
from estimators.kernels.gaussian import ROBOT, innovation_cov, nis_and_log_det
from estimators.kernels.jit import inline, subroutine
from estimators.kernels.range_bearing import gradient, measure, noise_std, usable

KNOWN, NEAREST, JCBB = 0, np.uint16(1), np.uint8(2)
"""Each of a type of its own: kernels are compiled by types, so a filter has the search that it uses and no other."""
TARGET_SLOT = -2  # the return is the target's
NEW = -3  # a landmark not yet in the map
DROPPED = -4  # neither: unusable, ambiguous, or without a label that could be used
FAR = math.inf  # cost of a pair outside its gate


@inline
def slot_of(ids, lane, count, label):
    """The slot that holds this id; NEW where none does."""
    for slot in range(count):
        if ids[lane, slot] == label:
            return slot
    return NEW


@inline
def slot_by_label(ids, lane, count, label, distance, bearing, has_target):
    """Known association of one return."""
    if not usable(distance, bearing):
        return DROPPED
    if label == TARGET:
        return TARGET_SLOT if has_target else DROPPED
    if label == UNKNOWN:
        return DROPPED
    return slot_of(ids, lane, count, label)


@inline
def predicted_fit(mu, P, model, lane, j, distance, bearing):
    """NIS and log det S of a return against the point at row j, everything at the current mean."""
    dx = mu[lane, j] - mu[lane, 0]
    dy = mu[lane, j + 1] - mu[lane, 1]
    if not dx * dx + dy * dy > 0.0:
        return math.nan, math.nan
    r, b = measure(dx, dy, mu[lane, 2])
    a00, a01, a10, a11 = gradient(dx, dy)
    range_std, bearing_std = noise_std(model, r)
    s00, s01, s11 = innovation_cov(
        P, lane, j, a00, a01, a10, a11, 0.0, -1.0, range_std * range_std, bearing_std * bearing_std
    )
    return nis_and_log_det(s00, s01, s11, distance - r, wrap(bearing - b))


@subroutine
def fit_pairs(
    lane, mu, P, model, n_t, count, target_known, ranges, bearings, labels, num_returns, match_gate, new_gate,
    det_weight, cost, slots,
):  # fmt: skip
    """How well each return fits each landmark and the target; and what a return is if it finds no partner.

    Args:
        det_weight: a pair inside `match_gate` (NIS, 2 dof) costs NIS + det_weight log det S; others are `FAR`.
        cost: [K, >= count + 1] written; the last used column is the target's.
        slots: [L, K] written: TARGET_SLOT by label, DROPPED where unusable or inside `new_gate` of something, or NEW.
    """
    target_taken = False
    for k in range(num_returns):
        distance, bearing, label = ranges[lane, k], bearings[lane, k], labels[lane, k]
        slots[lane, k] = NEW
        if not usable(distance, bearing):
            slots[lane, k] = DROPPED
        elif label == TARGET:
            slots[lane, k] = TARGET_SLOT if n_t > 0 else DROPPED
            target_taken = target_taken or n_t > 0
        for column in range(count + 1):
            cost[k, column] = FAR
            if slots[lane, k] == TARGET_SLOT or (column == count and not target_known):
                continue
            j = ROBOT if column == count else ROBOT + n_t + 2 * column
            nis, log_det = predicted_fit(mu, P, model, lane, j, distance, bearing)
            if nis <= match_gate:
                cost[k, column] = nis + det_weight * log_det
            if not nis > new_gate and slots[lane, k] == NEW:
                slots[lane, k] = DROPPED
    if target_taken:
        for k in range(num_returns):
            cost[k, count] = FAR


@subroutine
def nearest(
    lane, mu, P, model, n_t, count, target_known, ranges, bearings, labels, num_returns, match_gate, new_gate, cost,
    slots,
):  # fmt: skip
    """Gated maximum likelihood with mutual exclusion; ids are not looked at, but for `TARGET`.

    A pair inside `match_gate` (NIS, 2 dof) costs NIS + log det S; pairs are taken cheapest first, each return and each
    landmark once. A return without a partner is a new landmark if it lies outside `new_gate` of everything, and
    dropped in the dead zone between the gates. An unlabelled return may be the target's where the target is known.

    Args:
        cost: [K, >= count + 1] scratch; the last used column is the target's.
        slots: [L, K] the answer.
    """
    fit_pairs(
        lane, mu, P, model, n_t, count, target_known, ranges, bearings, labels, num_returns, match_gate, new_gate, 1.0,
        cost, slots,
    )  # fmt: skip
    _cheapest_first(cost, num_returns, count, lane, slots)


@inline
def _cheapest_first(cost, num_returns, count, lane, slots):
    """Match the cheapest pair, strike its row and column, and so on."""
    for _ in range(num_returns):
        best, row, column = FAR, -1, -1
        for k in range(num_returns):
            for c in range(count + 1):
                if cost[k, c] < best:
                    best, row, column = cost[k, c], k, c
        if row < 0:
            return
        slots[lane, row] = TARGET_SLOT if column == count else column
        for c in range(count + 1):
            cost[row, c] = FAR
        for k in range(num_returns):
            cost[k, column] = FAR
