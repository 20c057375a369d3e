"""A target seen again after a long absence: start it anew where a linearisation at its prior mean would be worthless.

Out of sight the target's position spreads until it is wider than the scene. A first-order update by range and bearing
at so vague a mean moves the target to places that the return rules out. The return alone then says all there is.
"""

from estimators.gaussian.sweep import REINITIALISED, forget_target
from estimators.interface import TARGET
from estimators.kernels.gaussian import ROBOT, rows_in_use
from estimators.kernels.jit import jit

_TARGET_LABEL = TARGET


@jit
def forget_vague(mu, P, models, n_t, count, target_known, pending, counters, ranges, labels, num_returns, lanes):
    """Forget the target in lanes whose sweep holds a TARGET return and whose prior is too vague for it.

    Too vague: the root of the summed position variances is above `reinitialise_spread` times the measured range.
    """
    for i in range(lanes.size):
        lane = lanes[i]
        if not target_known[lane]:
            continue
        variance = P[lane, ROBOT, ROBOT] + P[lane, ROBOT + 1, ROBOT + 1]
        for k in range(num_returns[lane]):
            limit = models[lane].reinitialise_spread * ranges[lane, k]
            if labels[lane, k] == _TARGET_LABEL and variance > limit * limit:
                counters[lane, REINITIALISED] += 1
                forget_target(mu, P, lane, rows_in_use(n_t, count[lane]), n_t, target_known, pending)
                break
