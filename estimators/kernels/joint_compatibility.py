"""JCBB: the largest set of pairings that is compatible as a whole (Neira and Tardos, IEEE T-RA 17(6), 2001).

Each return may fit a landmark by itself while all together contradict each other: a pose error moves every return the
same way, which only the correlations between the innovations tell. A hypothesis of m pairings is compatible if

    D^2 = nu' C^-1 nu <= chi^2(2 m),   C = H P H' + R over all its pairings,

at the level that `match_gate` means for two degrees of freedom. Returns are decided one after the other, depth first,
the best fitting landmark first and "none" last; C's Cholesky factor grows by two rows per pairing. A branch is left
where it cannot have more pairings than the best hypothesis so far, or as many with a smaller D^2.

The number of nodes is bounded; a search that is cut takes the best found by then, which the first descent makes
sequential nearest neighbour under the joint test.

What it buys: nothing where landmarks are far apart against the pose's error (`slamto`, 400 runs: both cost 1 % of the
robot's error against known labels). With 80 landmarks, a sweep every 0.8 s and odometry noise of 1 m/s and 1 rad/s,
200 runs of `ekf` on the same data: 0.20 m with labels, 0.79 m with "nearest", 0.24 m with "jcbb" (paired difference
-0.55 +- 0.06 m), though almost half of the searches were cut.

Where landmarks are independent given the pose, as in a particle, C is block diagonal: JCBB is then nothing but nearest
neighbour with mutual exclusion (up to the sum's gate), which the particle filters' "nearest" is.

Scratch `cost` [4 K + 16, max(M + 1, 2 K + 2)] for K returns, rows:

    0 ... K            NIS of return k with each column (landmarks' slots, then the target)
    K ... K + 6        by column: A (a00, a01, a10, a11), predicted range and bearing
    K + 6 ... 2 K + 6  by return: its columns, best first
    2 K + 6 ...        the lists named below
    2 K + 15 ...       rows of the Cholesky factor
"""

import math

import numpy as np

from estimators.kernels.angles import wrap
from estimators.kernels.association import FAR, TARGET_SLOT, fit_pairs
from estimators.kernels.gaussian import ROBOT, nis_and_log_det
from estimators.kernels.jit import inline, subroutine
from estimators.kernels.range_bearing import gradient, measure, noise_std

MAX_NODES = 5000  # of the search tree, per sweep
OPTIONS, UNDECIDED, TRIED, CHOSEN, BEST, INNOVATION, DISTANCE, TAKEN, PAIRED = range(9)
"""Lists: number of columns per return; the returns with any; per level: options tried, column chosen, column of the
best hypothesis; innovations whitened by the factor; D^2 by number of pairings; whether a column is taken; column by
pairing."""
_LISTS, _COLUMN_ROWS, _NONE = 9, 6, -1.0


def scratch_shape(num_returns, max_landmarks):
    """Shape of `cost`."""
    return 4 * num_returns + _COLUMN_ROWS + _LISTS + 1, max(max_landmarks + 1, 2 * num_returns + 2)


def joint_gates(match_gate, pairings):
    """[pairings] bound of D^2 for 1, 2, ... pairings: chi-square of 2 m dof at the level of match_gate for 2."""
    from scipy.special import gammainccinv

    return 2.0 * gammainccinv(np.arange(1.0, pairings + 1.0), math.exp(-0.5 * match_gate))


@subroutine
def jcbb(
    lane, mu, P, model, n_t, count, target_known, ranges, bearings, labels, num_returns, match_gate, new_gate, joint,
    cost, slots,
):  # fmt: skip
    """Association of one lane's sweep, written into `slots` as `nearest` does; whether the search ran to its end.

    Args:
        joint: [>= min(K, count + 1)] from `joint_gates`. cost: scratch, see `scratch_shape`.
    """
    fit_pairs(
        lane, mu, P, model, n_t, count, target_known, ranges, bearings, labels, num_returns, match_gate, new_gate, 0.0,
        cost, slots,
    )  # fmt: skip
    K = num_returns
    columns, options = cost[K : K + _COLUMN_ROWS], cost[K + _COLUMN_ROWS : 2 * K + _COLUMN_ROWS]
    lists, factor = cost[2 * K + _COLUMN_ROWS :], cost[2 * K + _COLUMN_ROWS + _LISTS :]
    undecided = _sort_options(K, count, cost, options, lists)
    _predict_columns(mu, lane, n_t, count, lists, columns)
    complete = _search(lane, P, model, n_t, count, ranges, bearings, undecided, joint, columns, options, lists, factor)
    for level in range(undecided):
        column = int(lists[BEST, level])
        if column >= 0:
            slots[lane, int(lists[UNDECIDED, level])] = TARGET_SLOT if column == count else column
    return complete


@inline
def _sort_options(num_returns, count, cost, options, lists):
    """Each return's columns inside the gate, best first; returns how many returns have any. Notes columns in TAKEN."""
    undecided = 0
    for column in range(count + 1):
        lists[TAKEN, column] = 1.0  # until a return may want it
    for k in range(num_returns):
        found = 0
        for column in range(count + 1):
            if not cost[k, column] < FAR:
                continue
            lists[TAKEN, column] = 0.0
            i = found
            while i > 0 and cost[k, int(options[k, i - 1])] > cost[k, column]:
                options[k, i] = options[k, i - 1]
                i -= 1
            options[k, i] = column
            found += 1
        lists[OPTIONS, k] = found
        if found > 0:
            lists[UNDECIDED, undecided] = k
            lists[BEST, undecided] = _NONE
            undecided += 1
    return undecided


@inline
def _predict_columns(mu, lane, n_t, count, lists, columns):
    """Predicted return and its gradient for every column that a return may want."""
    for column in range(count + 1):
        if lists[TAKEN, column] != 0.0:
            continue
        j = _row(column, n_t, count)
        dx, dy = mu[lane, j] - mu[lane, 0], mu[lane, j + 1] - mu[lane, 1]
        columns[0, column], columns[1, column], columns[2, column], columns[3, column] = gradient(dx, dy)
        columns[4, column], columns[5, column] = measure(dx, dy, mu[lane, 2])


@inline
def _row(column, n_t, count):
    """Where a column's point stands in the state."""
    return ROBOT if column == count else ROBOT + n_t + 2 * column


@inline
def _search(lane, P, model, n_t, count, ranges, bearings, undecided, joint, columns, options, lists, factor):
    """Depth first through the interpretation tree; leaves the best hypothesis in BEST; whether it was not cut."""
    level, pairs, nodes, best_pairs, best_distance = 0, 0, 0, 0, 0.0
    lists[TRIED, 0] = lists[DISTANCE, 0] = 0.0
    while level >= 0:
        if level == undecided:  # a whole hypothesis, better than the best: nothing else gets here
            best_pairs, best_distance = pairs, lists[DISTANCE, pairs]
            for i in range(undecided):
                lists[BEST, i] = lists[CHOSEN, i]
        k = int(lists[UNDECIDED, level]) if level < undecided else 0
        if level == undecided or lists[TRIED, level] > lists[OPTIONS, k]:
            level -= 1
            if level >= 0 and lists[CHOSEN, level] != _NONE:
                pairs -= 1
                lists[TAKEN, int(lists[CHOSEN, level])] = 0.0
            continue
        option = int(lists[TRIED, level])
        lists[TRIED, level] += 1.0
        nodes += 1
        if nodes > MAX_NODES:
            return False
        none = option == lists[OPTIONS, k]
        column = -1 if none else int(options[k, option])
        possible = pairs + undecided - level - (1 if none else 0)
        if possible < best_pairs or (not none and lists[TAKEN, column] != 0.0):
            continue
        if not none and not _extend(
            lane, P, model, n_t, count, ranges[lane, k], bearings[lane, k], column, pairs, joint, columns, lists, factor
        ):
            continue
        after = pairs if none else pairs + 1
        if possible == best_pairs > 0 and lists[DISTANCE, after] >= best_distance:
            continue
        lists[CHOSEN, level] = column
        if not none:
            lists[TAKEN, column] = 1.0
        pairs = after
        level += 1
        lists[TRIED, level] = 0.0
    return True


@inline
def _extend(lane, P, model, n_t, count, distance, bearing, column, pairs, joint, columns, lists, factor):
    """Add one pairing: two rows of C's factor and D^2. Whether the whole stays compatible."""
    top = 2 * pairs
    j = _row(column, n_t, count)
    for i in range(pairs):
        other = int(lists[PAIRED, i])
        c00, c01, c10, c11 = _cross(P, lane, j, column, _row(other, n_t, count), other, columns)
        factor[top, 2 * i], factor[top, 2 * i + 1] = c00, c01
        factor[top + 1, 2 * i], factor[top + 1, 2 * i + 1] = c10, c11
    range_std, bearing_std = noise_std(model, columns[4, column])
    s00, s01, _, s11 = _cross(P, lane, j, column, j, column, columns)
    s00, s11 = s00 + range_std * range_std, s11 + bearing_std * bearing_std
    e0, e1 = distance - columns[4, column], wrap(bearing - columns[5, column])
    for q in range(top):
        l0, l1 = factor[top, q], factor[top + 1, q]
        for r in range(q):
            l0 -= factor[top, r] * factor[q, r]
            l1 -= factor[top + 1, r] * factor[q, r]
        l0, l1 = l0 / factor[q, q], l1 / factor[q, q]
        factor[top, q], factor[top + 1, q] = l0, l1
        s00, s01, s11 = s00 - l0 * l0, s01 - l0 * l1, s11 - l1 * l1
        e0, e1 = e0 - l0 * lists[INNOVATION, q], e1 - l1 * lists[INNOVATION, q]
    more = nis_and_log_det(s00, s01, s11, e0, e1)[0]
    total = more + lists[DISTANCE, pairs]
    if not total <= joint[pairs]:
        return False
    root = math.sqrt(s00)
    factor[top, top], factor[top + 1, top] = root, s01 / root
    factor[top + 1, top + 1] = math.sqrt(s11 - factor[top + 1, top] ** 2)
    lists[INNOVATION, top] = e0 / root
    lists[INNOVATION, top + 1] = (e1 - factor[top + 1, top] * lists[INNOVATION, top]) / factor[top + 1, top + 1]
    lists[DISTANCE, pairs + 1] = total
    lists[PAIRED, pairs] = column
    return True


@inline
def _cross(P, lane, j, column, k, other, columns):
    """H P H' between the predicted returns of two points at rows j and k, H = [-A, (0, -1), A], as (00, 01, 10, 11)."""
    a00, a01, a10, a11 = columns[0, column], columns[1, column], columns[2, column], columns[3, column]
    b00, b01, b10, b11 = columns[0, other], columns[1, other], columns[2, other], columns[3, other]
    e00 = P[lane, j, k] - P[lane, j, 0] - P[lane, 0, k] + P[lane, 0, 0]
    e01 = P[lane, j, k + 1] - P[lane, j, 1] - P[lane, 0, k + 1] + P[lane, 0, 1]
    e10 = P[lane, j + 1, k] - P[lane, j + 1, 0] - P[lane, 1, k] + P[lane, 1, 0]
    e11 = P[lane, j + 1, k + 1] - P[lane, j + 1, 1] - P[lane, 1, k + 1] + P[lane, 1, 1]
    f0, f1 = P[lane, j, 2] - P[lane, 0, 2], P[lane, j + 1, 2] - P[lane, 1, 2]
    g0, g1 = P[lane, k, 2] - P[lane, 0, 2], P[lane, k + 1, 2] - P[lane, 1, 2]
    u00, u01 = a00 * e00 + a01 * e10, a00 * e01 + a01 * e11
    u10, u11 = a10 * e00 + a11 * e10, a10 * e01 + a11 * e11
    return (
        u00 * b00 + u01 * b01,
        u00 * b10 + u01 * b11 - (a00 * f0 + a01 * f1),
        u10 * b00 + u11 * b01 - (b00 * g0 + b01 * g1),
        u10 * b10 + u11 * b11 - (a10 * f0 + a11 * f1) - (b10 * g0 + b11 * g1) + P[lane, 2, 2],
    )
