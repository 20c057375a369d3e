"""What each return of a sweep is, before it enters the graph: its slot, and whether it is likely enough."""

import math

from estimators.gaussian.gate import pass_gate
from estimators.gaussian.growth import admits
from estimators.gaussian.sweep import NOT_POSITIVE, associate, limit_of
from estimators.kernels.association import DROPPED, KNOWN, NEW, TARGET_SLOT
from estimators.kernels.jit import inline, jit

NEAREST_RANGE = 1e-3  # [m] below which a bearing says nothing that the solver could use


@inline
def sort_lane(
    lane, mu, P, model, n_t, count, ids, next_id, target_known, pending, counters, ranges, bearings, labels,
    num_returns, code, gates, gated, cost, slots,
):  # fmt: skip
    """One lane's sweep."""
    associate(
        lane, mu, P, model, n_t, count, ids, target_known, counters, ranges, bearings, labels, num_returns, code, gates,
        cost, slots,
    )  # fmt: skip
    target_gated = limit_of(gates[0], model, True) < math.inf
    for k in range(num_returns):
        slot = slots[lane, k]
        if slot != DROPPED and not ranges[lane, k] > NEAREST_RANGE:
            counters[lane, NOT_POSITIVE] += 1
            slots[lane, k] = DROPPED
        elif (slot >= 0 and gated) or (slot == TARGET_SLOT and target_known[lane] and target_gated):
            pass_gate(
                lane, k, mu, P, model, n_t, count, target_known, pending, counters, ranges[lane, k], bearings[lane, k],
                gates[0], slots,
            )  # fmt: skip
    for k in range(num_returns):
        label = next_id[lane] if code != KNOWN else labels[lane, k]
        if slots[lane, k] == NEW and admits(NEW, label, lane, count, ids, target_known, counters):
            slots[lane, k] = count[lane]
            ids[lane, count[lane]] = label
            count[lane] += 1
            next_id[lane] += 1


@jit
def sort_returns(
    mu, P, models, n_t, count, ids, next_id, target_known, pending, counters, ranges, bearings, labels, counts, code,
    gates, gated, cost, slots, lanes,
):  # fmt: skip
    """Fill `slots` [L, K] for the named lanes' sweeps and make room for their new landmarks.

    `mu` and `P` must hold the present: all of it where `gated`; robot and target where the model may start the target
    anew.
    """
    for i in range(lanes.size):
        lane = lanes[i]
        sort_lane(
            lane, mu, P, models[lane], n_t, count, ids, next_id, target_known, pending, counters, ranges, bearings,
            labels, counts[lane], code, gates, gated, cost, slots,
        )  # fmt: skip
