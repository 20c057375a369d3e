"""The part of a joint Gaussian that waits: what a compressed filter does when a landmark comes back, and when all do.

A sweep looks at few landmarks. Let a be robot, target and the landmarks looked at since some moment 0 (the active
ones), b all others. As long as nothing looks at b, it changes through a alone: b = C z + what is independent of a,
where z = L^-1 a(0) is the past of a and P_aa(0) = L L'. So a filter of (a, z) is enough (the compressed filter of
Guivant and Nebot 2001, whose phi and psi are cov(a, z) and -cov(z, z) with z = P_aa(0)^-1 a(0)). It starts with
cov(a, z) = L and, as only changes of z matter, cov(z, z) = 0, z = 0. At any later moment, exactly,

    C = P_ba(0) L'^-1,   mean of b = mean(0) + C z,   P_ab = cov(a, z) C',   P_bb = P_bb(0) + C cov(z, z) C'.

A landmark of b joins a by these equations for its own rows, and its rows of L, (c, sqrt(P_jj(0) - c c')): no other row
moves. Returns see differences of positions, whose covariances are far smaller than those of the positions themselves:
P_aa(0) is nearly singular. Its root is less so, and z, of changes no larger than a standard deviation, loses few
digits. Where nothing more was uncertain, L has a pivot and a column of zeros, and so has C.

In memory: `mu`, `P` are the whole state, of which what concerns b is as it was at moment 0. `a_mu`, `a_P` are (a, z):
robot, target, then slots of two rows each as in the whole state, those of z with the id `PAST`. `roots` [L, rows of z,
rows of z] is L. `whole` [L, S] says which landmark of the whole state a slot is, or is the past of; the first
`past_slots` are the past of robot and target. `live` [L, M] is a landmark's slot, or `ASLEEP`.

`rows` [4, >= rows of (a, z)] is scratch: the rows of z in (a, z); of each, whose past it is in the whole state; the
rows of a in (a, z) and in the whole state.
"""

import math

from estimators.gaussian.belief import relative
from estimators.kernels.borrow import borrow
from estimators.kernels.gaussian import ROBOT, rows_in_use
from estimators.kernels.jit import inline, jit
from estimators.kernels.simd import subtract_rows

PAST = -9  # an id that no return carries
ASLEEP = -1  # a landmark outside the active ones
STRIP = 64  # columns of P that are worked on together: they stay in the first cache
_MEAN, _VARIANCE, _NEXT, SUMS = ROBOT, ROBOT + 1, ROBOT + 2, ROBOT + 3  # rows of sums; the first are with the robot
_RANK_FLOOR = 1e-16  # of a diagonal entry (and per row, in `factor`): a pivot below it counts as zero


@inline
def past_slots(n_t):
    """Slots that hold the past of robot and target."""
    return (ROBOT + n_t + 1) // 2


@inline
def append_root(lane, P, roots, rows, k):
    """Row k of L by Cholesky's method, from the row of the whole state that `rows` names: C's row, and what is left."""
    row = rows[1, k]
    left = P[lane, row, row]
    for q in range(k):
        value = P[lane, row, rows[1, q]]
        for i in range(q):
            value -= roots[lane, q, i] * roots[lane, k, i]
        roots[lane, k, q] = value / roots[lane, q, q] if roots[lane, q, q] > 0.0 else 0.0
        left -= roots[lane, k, q] * roots[lane, k, q]
    roots[lane, k, k] = math.sqrt(left) if left > _RANK_FLOOR * P[lane, row, row] else 0.0


@jit
def restart(lane, mu, P, a_mu, a_P, n_t, a_count, a_ids, live, roots, rows):
    """Robot and target of the whole state, and nobody else, are active from now on."""
    first, n = ROBOT + n_t, rows_in_use(n_t, a_count[lane])
    for i in range(n):
        a_mu[lane, i] = 0.0
        for j in range(n):
            a_P[lane, i, j] = 0.0
    for i in range(first):
        a_mu[lane, i], rows[1, i] = mu[lane, i], i
        for j in range(first):
            a_P[lane, i, j] = P[lane, i, j]
        append_root(lane, P, roots, rows, i)
        for j in range(i + 1):
            a_P[lane, i, first + j] = a_P[lane, first + j, i] = roots[lane, i, j]
    a_count[lane] = past_slots(n_t)
    for slot in range(a_ids.shape[1]):
        a_ids[lane, slot] = PAST if slot < a_count[lane] else -1
    for slot in range(live.shape[1]):
        live[lane, slot] = ASLEEP


@inline
def past_rows(lane, n_t, a_count, a_ids, whole, rows):
    """Fill the first two of `rows`; how many rows z has."""
    first, count = ROBOT + n_t, 0
    for slot in range(a_count[lane]):
        if a_ids[lane, slot] != PAST:
            continue
        own = slot < past_slots(n_t)
        for d in range(2):
            of = 2 * slot + d if own else first + 2 * whole[lane, slot] + d
            if own and of >= first:
                continue
            rows[0, count], rows[1, count] = first + 2 * slot + d, of
            count += 1
    return count


@inline
def load_past(P, lane, rows, z, roots, start, width, block):
    """The transpose of C for `width` rows of the whole state from `start` on."""
    for k in range(z):
        of, pivot = rows[1, k], roots[lane, k, k]
        scale = 1.0 / pivot if pivot > 0.0 else 0.0
        for i in range(width):
            block[k, i] = P[lane, of, start + i]
        for q in range(k):
            weight = roots[lane, k, q]
            for i in range(width):
                block[k, i] -= weight * block[q, i]
        for i in range(width):
            block[k, i] *= scale


@inline
def active_rows(lane, n_t, a_count, a_ids, whole, rows):
    """Fill the last two of `rows`; how many rows a has."""
    count = ROBOT + n_t
    for i in range(count):
        rows[2, i] = rows[3, i] = i
    for slot in range(a_count[lane]):
        if a_ids[lane, slot] == PAST:
            continue
        for d in range(2):
            rows[2, count], rows[3, count] = ROBOT + n_t + 2 * slot + d, ROBOT + n_t + 2 * whole[lane, slot] + d
            count += 1
    return count


@jit
def join(lane, landmark, mu, P, a_mu, a_P, n_t, a_count, a_ids, whole, live, ids, roots, rows):
    """A landmark becomes active: two rows of a, two of z."""
    z = past_rows(lane, n_t, a_count, a_ids, whole, rows)
    slot, first = a_count[lane], ROBOT + n_t
    old, g, r = rows_in_use(n_t, slot), first + 2 * landmark, first + 2 * slot
    for d in range(2):
        rows[1, z + d] = g + d
        append_root(lane, P, roots, rows, z + d)
        mean = mu[lane, g + d]
        for k in range(z):
            gain, row = roots[lane, z + d, k], rows[0, k]
            mean += gain * a_mu[lane, row]
            for i in range(old):
                a_P[lane, r + d, i] += gain * a_P[lane, row, i]
        a_mu[lane, r + d] = mean
    for d in range(2):
        for i in range(r):
            a_P[lane, i, r + d] = a_P[lane, r + d, i]
    for d in range(2):
        for e in range(d + 1):
            value = P[lane, g + d, g + e]
            for k in range(z):
                value += roots[lane, z + d, k] * a_P[lane, rows[0, k], r + e]
            a_P[lane, r + d, r + e] = a_P[lane, r + e, r + d] = value
    for d in range(2):  # this landmark's rows of L
        for k in range(z):
            a_P[lane, r + d, rows[0, k]] += roots[lane, z + d, k]
            a_P[lane, rows[0, k], r + d] += roots[lane, z + d, k]
        for e in range(d + 1):
            a_P[lane, r + d, r + 2 + e] = a_P[lane, r + 2 + e, r + d] = roots[lane, z + d, z + e]
    a_ids[lane, slot], a_ids[lane, slot + 1] = ids[lane, landmark], PAST
    whole[lane, slot] = whole[lane, slot + 1] = landmark
    live[lane, landmark] = slot
    a_count[lane] = slot + 2


@inline
def adopt(lane, before, count, ids, first, a_count, a_ids, a_first, whole, live):
    """Give the landmarks that entered the active part from slot `before` on a place in the whole state."""
    for slot in range(before, a_count[lane]):
        landmark = count[lane]
        count[lane] = landmark + 1
        ids[lane, landmark] = a_ids[lane, slot]
        for d in range(first.shape[2]):
            first[lane, landmark, d] = a_first[lane, slot, d]
        whole[lane, slot], live[lane, landmark] = landmark, slot


@jit
def factor(lane, a_P, rows, z, C, left):
    """C [z, rank] with C C' = -cov(z, z), by Cholesky's method with pivots; its rank. left [2, z] is scratch."""
    for i in range(z):
        variance = -a_P[lane, rows[0, i], rows[0, i]]
        left[0, i] = 1.0 if variance > 0.0 else 0.0
        left[1, i] = math.sqrt(variance) if variance > 0.0 else 0.0
    for r in range(z):
        best, most = 0, _RANK_FLOOR * z
        for i in range(z):
            if left[0, i] > most:
                best, most = i, left[0, i]
        if not left[0, best] > _RANK_FLOOR * z:
            return r
        root, scale = math.sqrt(most), left[1, best]
        for i in range(z):
            if not left[0, i] > 0.0:
                C[i, r] = 0.0
                continue
            value = -a_P[lane, rows[0, i], rows[0, best]] / scale
            for q in range(r):
                value -= C[i, q] * C[best, q] / scale
            C[i, r] = value / root
            left[0, i] -= C[i, r] * C[i, r] / (left[1, i] * left[1, i])
        left[0, best] = 0.0
    return z


@inline
def combine(block, z, width, weights, w, out):
    """Write sum over k of weights[w, k] block[k] into `out`, `width` columns."""
    for i in range(width):
        out[i] = 0.0
    for k in range(z):
        weight = weights[w, k]
        for i in range(width):
            out[i] += weight * block[k, i]


@jit
def awaken(
    lane, mu, P, a_mu, a_P, n_t, count, a_count, a_ids, whole, roots, rows, C, weights, block, line, low_rank
):  # fmt: skip
    """Bring the whole state up to date: O(a n^2), as much as a sweep of a / 2 returns costs the full filter.

    Args:
        C: with weights [.., >= rows of z], block [.., STRIP], line [STRIP] and low_rank [.., n_max], scratch.
    """
    mu, P, a_mu, a_P, rows, C = borrow(mu), borrow(P), borrow(a_mu), borrow(a_P), borrow(rows), borrow(C)
    weights, block, line, low_rank = borrow(weights), borrow(block), borrow(line), borrow(low_rank)
    z, a = past_rows(lane, n_t, a_count, a_ids, whole, rows), active_rows(lane, n_t, a_count, a_ids, whole, rows)
    n = rows_in_use(n_t, count[lane])
    rank = factor(lane, a_P, rows, z, C, weights)
    for k in range(z):  # weights: the factor's transpose, then cov(a, z), then the mean of z
        for r in range(rank):
            weights[r, k] = C[k, r]
        for i in range(a):
            weights[rank + i, k] = a_P[lane, rows[2, i], rows[0, k]]
        weights[rank + a, k] = a_mu[lane, rows[0, k]]
    for start in range(0, n, STRIP):
        width = min(STRIP, n - start)
        load_past(P, lane, rows, z, roots, start, width, block)
        for i in range(a):
            at = rows[3, i] - start
            if at >= 0 and at < width:
                for k in range(z):
                    block[k, at] = 0.0
        for r in range(rank):
            combine(block, z, width, weights, r, line)
            for i in range(width):
                low_rank[r, start + i] = line[i]
        for r in range(a):
            combine(block, z, width, weights, rank + r, line)
            for i in range(width):
                P[lane, rows[3, r], start + i] = line[i]
        combine(block, z, width, weights, rank + a, line)
        for i in range(width):
            mu[lane, start + i] += line[i]
    for i in range(a):
        mu[lane, rows[3, i]] = a_mu[lane, rows[2, i]]
        for j in range(a):
            P[lane, rows[3, i], rows[3, j]] = a_P[lane, rows[2, i], rows[2, j]]
    for j in range(n):
        for i in range(a):
            P[lane, j, rows[3, i]] = P[lane, rows[3, i], j]
    if rank > 0:
        subtract_rows(P, lane, n, low_rank, rank, 0)


@jit
def bring_up(
    lane, mu, P, a_mu, a_P, n_t, count, a_count, a_ids, whole, live, roots, rows, C, weights, block, line, low_rank
):  # fmt: skip
    """Bring the whole state up to date (`awaken`), and count from now on (`restart`)."""
    awaken(lane, mu, P, a_mu, a_P, n_t, count, a_count, a_ids, whole, roots, rows, C, weights, block, line, low_rank)
    restart(lane, mu, P, a_mu, a_P, n_t, a_count, a_ids, live, roots, rows)


@jit
def fill_map(
    mu, P, a_mu, a_P, n_t, count, ids, a_count, a_ids, whole, live, roots, rows, weights, block, line, sums, point_mu,
    point_P, landmark_count, landmark_id, landmark_mapped, mean, cov, rel, rel_cov, lanes,
):  # fmt: skip
    """As `belief.fill_map`; what is asleep is worked out from z, and left as it is: O(a^2) for each landmark.

    sums: [SUMS, STRIP], point_mu: [1, 5], point_P: [1, 5, 5], the rest of the scratch as in `awaken`.
    """
    mu, P, a_mu, a_P = borrow(mu), borrow(P), borrow(a_mu), borrow(a_P)
    point_mu, point_P = borrow(point_mu), borrow(point_P)
    rows, weights, block, line, sums = borrow(rows), borrow(weights), borrow(block), borrow(line), borrow(sums)
    for index in range(lanes.size):
        lane = lanes[index]
        landmark_count[lane] = count[lane]
        c, s = math.cos(a_mu[lane, 2]), math.sin(a_mu[lane, 2])
        z = past_rows(lane, n_t, a_count, a_ids, whole, rows)
        for k in range(z):
            for i in range(z):
                weights[i, k] = a_P[lane, rows[0, i], rows[0, k]]
            for i in range(ROBOT):
                weights[z + i, k] = a_P[lane, i, rows[0, k]]
            weights[z + ROBOT, k] = a_mu[lane, rows[0, k]]
        for i in range(ROBOT):
            point_mu[0, i] = a_mu[lane, i]
            for k in range(ROBOT):
                point_P[0, i, k] = a_P[lane, i, k]
        for slot in range(ids.shape[1]):
            used = slot < count[lane]
            landmark_mapped[lane, slot] = used
            landmark_id[lane, slot] = ids[lane, slot] if used else -1
            at = 2 * slot % STRIP
            if at == 0 and used:
                _changes(P, lane, rows, z, roots, weights, ROBOT + n_t + 2 * slot, min(STRIP, 2 * (count[lane] - slot)),
                         block, line, sums)  # fmt: skip
            x, y, xx, xy, yy = 0.0, 0.0, 0.0, 0.0, 0.0
            if used:
                _point(mu, P, a_mu, a_P, lane, n_t, slot, live[lane, slot], sums, at, point_mu, point_P)
                x, y, xx, xy, yy = relative(point_mu, point_P, 0, ROBOT, c, s)
            rel[lane, slot, 0], rel[lane, slot, 1] = x, y
            rel_cov[lane, slot, 0, 0], rel_cov[lane, slot, 0, 1] = xx, xy
            rel_cov[lane, slot, 1, 0], rel_cov[lane, slot, 1, 1] = xy, yy
            for i in range(2):
                mean[lane, slot, i] = point_mu[0, ROBOT + i] if used else 0.0
                for k in range(2):
                    cov[lane, slot, i, k] = point_P[0, ROBOT + i, ROBOT + k] if used else 0.0


@inline
def _changes(P, lane, rows, z, roots, weights, start, width, block, line, sums):
    """What z adds in `width` columns of the sleeping part, by the rows of `sums` named above."""
    load_past(P, lane, rows, z, roots, start, width, block)
    for q in range(ROBOT + 1):
        combine(block, z, width, weights, z + q, sums[q])
    for i in range(width):
        sums[_VARIANCE, i] = sums[_NEXT, i] = 0.0
    for k in range(z):
        combine(block, z, width, weights, k, line)
        for i in range(width):
            sums[_VARIANCE, i] += block[k, i] * line[i]
        for i in range(width - 1):
            sums[_NEXT, i] += block[k, i] * line[i + 1]


@inline
def _point(mu, P, a_mu, a_P, lane, n_t, landmark, slot, sums, at, point_mu, point_P):
    """One landmark's mean, covariance and covariance with the robot as they are now, behind the robot's."""
    r, g = ROBOT + n_t + 2 * slot, ROBOT + n_t + 2 * landmark
    for d in range(2):
        if slot != ASLEEP:
            point_mu[0, ROBOT + d] = a_mu[lane, r + d]
            point_P[0, ROBOT + d, ROBOT + d] = a_P[lane, r + d, r + d]
        else:
            point_mu[0, ROBOT + d] = mu[lane, g + d] + sums[_MEAN, at + d]
            point_P[0, ROBOT + d, ROBOT + d] = P[lane, g + d, g + d] + sums[_VARIANCE, at + d]
        for e in range(ROBOT):
            cross = a_P[lane, r + d, e] if slot != ASLEEP else sums[e, at + d]
            point_P[0, ROBOT + d, e] = point_P[0, e, ROBOT + d] = cross
    cross = a_P[lane, r, r + 1] if slot != ASLEEP else P[lane, g, g + 1] + sums[_NEXT, at]
    point_P[0, ROBOT, ROBOT + 1] = point_P[0, ROBOT + 1, ROBOT] = cross
