"""What every filter's update shares: association before it, and the book-keeping of returns that were not used."""

import math
from typing import Any

import numba
from numba.extending import overload

from estimators.kernels.association import DROPPED, JCBB, KNOWN, NEAREST, TARGET_SLOT, nearest, slot_by_label
from estimators.kernels.gaussian import ROBOT, clear_rows
from estimators.kernels.jit import inline
from estimators.kernels.joint_compatibility import jcbb

COUNTERS = (
    "gate_rejected",  # a labelled return outside `gate`
    "not_positive",  # an update skipped: innovation covariance not positive definite, or the point at the robot
    "overflow",  # a new landmark beyond `max_landmarks`
    "reinitialised",  # the target started anew: a return beyond `reinitialise_nis`, or no covariance left of it
    "dropped",  # a return not used: not finite, ambiguous, without a usable label, a second one of a new landmark
    "search_cut",  # a sweep in which "jcbb" ran out of nodes and took the best association found by then
    "removed",  # an unlabelled landmark that should have been seen again and again and was not
)
GATE_REJECTED, NOT_POSITIVE, OVERFLOW, REINITIALISED, DROPPED_RETURN, SEARCH_CUT, REMOVED = range(len(COUNTERS))

WITHHELD = -5  # in the last column of `slots`: the target's returns are taken by themselves; and the slot they then get
USED, UNUSABLE, UNLIKELY = 0, 1, 2  # what became of a return

_ABSORBED: Any = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "forceinline": True}


def search(
    code, lane, mu, P, model, n_t, count, target_known, ranges, bearings, labels, num_returns, gates, cost, slots
):  # fmt: skip
    """The search that `code` stands for, see `nearest` and `jcbb`; whether it ran to its end. For kernels only."""
    raise NotImplementedError


@overload(search, jit_options=_ABSORBED)
def _search(
    code, lane, mu, P, model, n_t, count, target_known, ranges, bearings, labels, num_returns, gates, cost, slots
):  # fmt: skip
    """Told by the type of the code, so that a filter compiles the search that it uses and no other."""

    def by_labels(
        code, lane, mu, P, model, n_t, count, target_known, ranges, bearings, labels, num_returns, gates, cost, slots
    ):  # fmt: skip
        return True

    def one_by_one(
        code, lane, mu, P, model, n_t, count, target_known, ranges, bearings, labels, num_returns, gates, cost, slots
    ):  # fmt: skip
        nearest(
            lane, mu, P, model, n_t, count, target_known, ranges, bearings, labels, num_returns, gates[1], gates[2],
            cost, slots,
        )  # fmt: skip
        return True

    def jointly(
        code, lane, mu, P, model, n_t, count, target_known, ranges, bearings, labels, num_returns, gates, cost, slots
    ):  # fmt: skip
        return jcbb(
            lane, mu, P, model, n_t, count, target_known, ranges, bearings, labels, num_returns, gates[1], gates[2],
            gates[3:], cost, slots,
        )  # fmt: skip

    found: dict[Any, Any] = {numba.typeof(NEAREST): one_by_one, numba.typeof(JCBB): jointly}
    return found.get(code, by_labels)


@inline
def associate(
    lane, mu, P, model, n_t, count, ids, target_known, counters, ranges, bearings, labels, num_returns, code, gates,
    cost, slots,
):  # fmt: skip
    """Fill `slots` for one lane's sweep, before anything is updated.

    gates: (gate, match_gate, new_gate), for "jcbb" with `joint_gates` behind them.
    """
    if code == KNOWN:
        for k in range(num_returns):
            slots[lane, k] = slot_by_label(
                ids, lane, count[lane], labels[lane, k], ranges[lane, k], bearings[lane, k], n_t > 0
            )
    else:
        complete = search(
            code, lane, mu, P, model, n_t, count[lane], target_known[lane], ranges, bearings, labels, num_returns,
            gates, cost, slots,
        )  # fmt: skip
        counters[lane, SEARCH_CUT] += not complete
    withheld = slots[lane, slots.shape[1] - 1] == WITHHELD
    for k in range(num_returns):
        if slots[lane, k] == DROPPED:
            counters[lane, DROPPED_RETURN] += 1
        elif withheld and slots[lane, k] == TARGET_SLOT:
            slots[lane, k] = WITHHELD


@inline
def forget_target(mu, P, lane, n, n_t, target_known, pending):
    """Back to a target not yet seen."""
    clear_rows(mu, P, lane, n, ROBOT, n_t)
    target_known[lane] = False
    pending[lane, 0] = 0.0


@inline
def limit_of(gate, model, is_target):
    """The NIS above which a return is `UNLIKELY`."""
    return min(gate, model.reinitialise_nis) if is_target else gate


@inline
def note(outcome, nis, is_target, mu, P, lane, n, n_t, model, target_known, pending, counters):
    """Count a return that was not used; a target that could not have caused it is forgotten, to start anew.

    So is one of which rounding has left no covariance, NIS NaN: its rows cannot be mended, and it is seen just now.
    """
    lost = is_target and (math.isnan(nis) or nis > model.reinitialise_nis)
    if outcome == UNUSABLE:
        counters[lane, NOT_POSITIVE] += 1
    elif not lost:
        counters[lane, GATE_REJECTED] += 1
    if lost:
        counters[lane, REINITIALISED] += 1
        forget_target(mu, P, lane, n, n_t, target_known, pending)
