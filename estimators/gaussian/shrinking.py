"""When what waits would drown in rounding: a compressed filter takes such sweeps as a whole.

P_bb = P_bb(0) + C cov(z, z) C' (`estimators.gaussian.postponed`) is a difference: of a covariance that has shrunk by as
many decades as doubles have digits nothing is left. So the whole filter takes a sweep with a return that could shrink
its row by more than LEAST, and the whole state is brought up to date once the active part has shrunk by that much.
Ordinary sensors do neither in a run.
"""

from estimators.gaussian.postponed import PAST
from estimators.interface import TARGET
from estimators.kernels.association import slot_of
from estimators.kernels.gaussian import ROBOT
from estimators.kernels.jit import inline, subroutine
from estimators.kernels.range_bearing import noise_std, usable

LEAST = 1e-6  # of a variance: what has to be left of it


@inline
def _variance_of(lane, label, waiting, P, a_P, n_t, a_count, a_ids, target_known):
    """Of x and y together at the point that a return shows, at least; -1 where it is in no state yet."""
    if waiting >= 0:
        j = ROBOT + n_t + 2 * waiting
        return P[lane, j, j] + P[lane, j + 1, j + 1]  # since then it has only become less
    slot = slot_of(a_ids, lane, a_count[lane], label)
    j = ROBOT if label == TARGET else ROBOT + n_t + 2 * slot
    known = n_t > 0 and target_known[lane] if label == TARGET else slot >= 0
    return a_P[lane, j, j] + a_P[lane, j + 1, j + 1] if known else -1.0


@subroutine
def is_sharp(lane, P, a_P, model, n_t, a_count, a_ids, target_known, ranges, bearings, labels, num_returns, slots):
    """Whether a return's variance is below LEAST of H diag(P) H', its point and the robot taken as independent.

    slots [L, >= num_returns]: the landmarks of the whole state that returns awaken, negative for the other returns.
    """
    robot = a_P[lane, 0, 0] + a_P[lane, 1, 1]
    for k in range(num_returns):
        r = ranges[lane, k]
        if not usable(r, bearings[lane, k]):
            continue
        point = _variance_of(lane, labels[lane, k], slots[lane, k], P, a_P, n_t, a_count, a_ids, target_known)
        range_std, bearing_std = noise_std(model, r)
        least = min(range_std, r * bearing_std)
        if point >= 0.0 and LEAST * (point + robot + r * r * a_P[lane, 2, 2]) > least * least:
            return True
    return False


@subroutine
def has_shrunk(lane, P, a_P, n_t, a_count, a_ids, whole):
    """Whether a variance of the active part is below LEAST of what it was when the others were last touched."""
    for i in range(ROBOT + n_t):
        if a_P[lane, i, i] < LEAST * P[lane, i, i]:
            return True
    for slot in range(a_count[lane] - 1):
        if a_ids[lane, slot] != PAST and a_ids[lane, slot + 1] == PAST:  # one that has waited, and its past
            for d in range(2):
                i, j = ROBOT + n_t + 2 * slot + d, ROBOT + n_t + 2 * whole[lane, slot] + d
                if a_P[lane, i, i] < LEAST * P[lane, j, j]:
                    return True
    return False
