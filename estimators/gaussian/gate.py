"""A sweep's returns held against the prior, before any of them is used: for filters that take a sweep in at once."""

from estimators.gaussian.sweep import UNLIKELY, limit_of, note
from estimators.kernels.association import DROPPED, TARGET_SLOT, predicted_fit
from estimators.kernels.gaussian import ROBOT, rows_in_use
from estimators.kernels.jit import inline


@inline
def pass_gate(lane, k, mu, P, model, n_t, count, target_known, pending, counters, distance, bearing, gate, slots):
    """Drop a return of what is known, where it is too unlikely; a target that could not have caused it is forgotten."""
    slot = slots[lane, k]
    is_target = slot == TARGET_SLOT
    j = ROBOT if is_target else ROBOT + n_t + 2 * slot
    nis = predicted_fit(mu, P, model, lane, j, distance, bearing)[0]
    if nis <= limit_of(gate, model, is_target):
        return
    n = rows_in_use(n_t, count[lane])
    note(UNLIKELY, nis, is_target, mu, P, lane, n, n_t, model, target_known, pending, counters)
    if not is_target or target_known[lane]:
        slots[lane, k] = DROPPED
