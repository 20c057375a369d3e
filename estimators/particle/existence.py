"""The same of `kernels.existence` in each particle for itself, where every particle has a map of its own.

`exists` [M, N]: log odds of the landmark in each slot of each particle's map. A particle's slots stay dense: the last
landmark moves into the place of one that is removed.
"""

import math

from estimators.kernels.elementary import angle_between
from estimators.kernels.existence import MARGIN, log_odds_missed, may_cover, should_be_seen
from estimators.kernels.jit import inline, subroutine
from estimators.kernels.range_bearing import noise_std


@subroutine
def note_missed(n_z, ranges, bearings, model, count, pose, maps, exists, used, scratch, slot, new_gate):
    """Lower the log odds of what should have been among the returns of a complete sweep; before the map takes them.

    Args:
        slot: [K, N] what each particle takes a return for. scratch: rows 0 and 1, the headings' cosines and sines.
        new_gate: a landmark with an undecided return inside this NIS, roughly, is not held to be missed.
    """
    for j in range(count):
        m = maps[j]
        for p in range(used.size):
            if j >= used[p] or _is_seen(slot, n_z, j, p):
                continue
            dx, dy = m[0, p] - pose[0, p], m[1, p] - pose[1, p]
            r = math.sqrt(dx * dx + dy * dy)
            if not 0.0 < r < model.max_range:
                continue
            ux, uy = dx / r, dy / r
            bearing = angle_between(
                ux * scratch[0, p] + uy * scratch[1, p], uy * scratch[0, p] - ux * scratch[1, p], 1.0
            )
            spread = math.sqrt(m[2, p] + m[4, p])
            range_std, bearing_std = noise_std(model, r)
            if not should_be_seen(model, r, bearing, range_std + spread, bearing_std + spread / r):
                continue
            if _may_be_hidden(model, j, p, dx, dy, pose, maps, used[p]):
                continue
            reach = new_gate * (spread * spread + range_std * range_std + r * r * bearing_std * bearing_std)
            if not _is_undecided(n_z, ranges, bearings, p, dx, dy, scratch, slot, reach):
                exists[j, p] = log_odds_missed(model, exists[j, p])


@inline
def _is_seen(slot, n_z, j, p):
    for k in range(n_z):
        if slot[k, p] == j:
            return True
    return False


@inline
def _may_be_hidden(model, j, p, dx, dy, pose, maps, used):
    """Whether a mapped pillar may stand before the landmark."""
    for other in range(used if model.landmark_radius > 0.0 else 0):
        ex, ey = maps[other, 0, p] - pose[0, p], maps[other, 1, p] - pose[1, p]
        spread = math.sqrt(maps[other, 2, p] + maps[other, 4, p])
        if other != j and may_cover(dx, dy, ex, ey, model.landmark_radius + MARGIN * spread):
            return True
    return False


@inline
def _is_undecided(n_z, ranges, bearings, p, dx, dy, scratch, slot, reach):
    """Whether a return that is no landmark's lies near (dx, dy) from the robot; reach: squared distance [m^2]."""
    for k in range(n_z):
        if slot[k, p] >= 0:
            continue
        cb, sb = math.cos(bearings[k]), math.sin(bearings[k])
        ex = ranges[k] * (cb * scratch[0, p] - sb * scratch[1, p]) - dx
        ey = ranges[k] * (sb * scratch[0, p] + cb * scratch[1, p]) - dy
        if ex * ex + ey * ey < reach:
            return True
    return False


@subroutine
def remove_unlikely(maps, exists, used, w, limit):
    """Remove landmarks whose log odds fell below the limit; the weighted mean number per particle, and the largest map.

    Args:
        used: [N] landmarks in each particle's map, lowered.
    """
    removed, largest = 0.0, 0
    for p in range(used.size):
        for j in range(used[p] - 1, -1, -1):
            if not exists[j, p] < limit:
                continue
            last = used[p] - 1
            for row in range(maps.shape[1]):
                maps[j, row, p] = maps[last, row, p]
            exists[j, p] = exists[last, p]
            used[p] = last
            removed += w[p]
        largest = max(largest, used[p])
    return removed, largest
