"""When what waits would drown in rounding: a compressed filter takes such sweeps as a whole.

P_bb = P_bb(0) + C cov(z, z) C' (`estimators.gaussian.postponed`) is a difference: of a covariance that has shrunk by as
many decades as doubles have digits nothing is left. So the whole filter takes a sweep with a return that could shrink
what it shows to less than LEAST of it, and after a sweep the whole state is brought up to date once the active part has
shrunk to less than LEAST of what it was. Together they leave four digits at least, and with the noise of ordinary
sensors neither happens.
"""

from estimators.gaussian.postponed import PAST
from estimators.interface import TARGET
from estimators.kernels.association import slot_of
from estimators.kernels.gaussian import ROBOT
from estimators.kernels.jit import inline, subroutine
from estimators.kernels.range_bearing import noise_std, usable

LEAST = 1e-6  # of a variance


@inline
def _row_of(lane, label, n_t, a_count, a_ids, target_known):
    """Of the point that a return shows in the active part; -1 where it is not there yet."""
    if label == TARGET:
        return ROBOT if n_t > 0 and target_known[lane] else -1
    slot = slot_of(a_ids, lane, a_count[lane], label)
    return ROBOT + n_t + 2 * slot if slot >= 0 else -1


@subroutine
def is_sharp(lane, a_P, model, n_t, a_count, a_ids, target_known, ranges, bearings, labels, num_returns):
    """Whether a return's variance is below LEAST of what H P H' may be, given its point and the heading by themselves.

    H P H' <= 2 (tr P_D + r^2 var(heading)) per r^2 in the bearing, D the point from the robot.
    """
    for k in range(num_returns):
        r = ranges[lane, k]
        if not usable(r, bearings[lane, k]):
            continue
        j = _row_of(lane, labels[lane, k], n_t, a_count, a_ids, target_known)
        if j < 0:
            continue
        spread = r * r * a_P[lane, 2, 2]
        for d in range(2):
            spread += a_P[lane, j + d, j + d] - 2.0 * a_P[lane, j + d, d] + a_P[lane, d, d]
        range_std, bearing_std = noise_std(model, r)
        least = min(range_std, r * bearing_std)
        if 2.0 * LEAST * spread > least * least:
            return True
    return False


@subroutine
def has_shrunk(lane, P, a_P, n_t, a_count, a_ids, whole):
    """Whether a variance of the active part is below LEAST of what it was when the others were last touched."""
    for i in range(ROBOT + n_t):
        if 0.0 < a_P[lane, i, i] < LEAST * P[lane, i, i]:  # zero is a target that has been forgotten
            return True
    for slot in range(a_count[lane] - 1):
        if a_ids[lane, slot] != PAST and a_ids[lane, slot + 1] == PAST:  # one that has waited, and its past
            for d in range(2):
                i, j = ROBOT + n_t + 2 * slot + d, ROBOT + n_t + 2 * whole[lane, slot] + d
                if a_P[lane, i, i] < LEAST * P[lane, j, j]:
                    return True
    return False
