"""Importance weights in the log domain, and systematic resampling that leaves survivors where they are.

Densities of many landmarks overflow float64 long before they underflow (products of 400 do in a quarter of the
steps), so weights are kept as logarithms with the largest at zero.
"""

import math

from estimators.kernels.elementary import exp_nonpositive
from estimators.kernels.jit import subroutine


@subroutine
def normalise(log_w, w):
    """Re-centre log weights in place and write the normalised weights.

    NaN and -inf become weight zero; where nothing is left, or a weight is +inf, all become equal.

    Args:
        log_w: [N] log weights up to a constant; on return the largest is zero.
        w: [N] normalised weights, written.

    Returns:
        Effective number of particles 1 / sum w^2 (Eq. 14, Wang et al. 2019), the number of weights that were NaN,
        and whether all had collapsed (no finite one was left).
    """
    top, bad = -math.inf, 0
    for p in range(log_w.size):
        bad += log_w[p] != log_w[p]
        if log_w[p] > top:  # false for NaN
            top = log_w[p]
    if not (-math.inf < top < math.inf):
        for p in range(log_w.size):
            log_w[p] = 0.0
            w[p] = 1.0 / log_w.size
        return float(log_w.size), bad, True
    for p in range(log_w.size):
        log_w[p] = log_w[p] - top if log_w[p] == log_w[p] else -math.inf
        w[p] = exp_nonpositive(log_w[p])
    total, squares = 0.0, 0.0
    for p in range(log_w.size):  # a sum beside what is stored into two arrays would round by where they lie
        total += w[p]
    for p in range(log_w.size):
        w[p] /= total
        squares += w[p] * w[p]
    return 1.0 / squares, bad, False


@subroutine
def systematic(w, u, copies):
    """Systematic resampling: how often each particle is drawn, floor(N w) or one more, N w on average.

    Args:
        w: [N] normalised weights.
        u: one uniform in [0, 1).
        copies: [N] integers, written; they sum to N.
    """
    n = w.size
    reached, drawn, last = 0.0, 0, 0
    for p in range(n):
        reached += w[p] * n
        now = min(math.ceil(reached - u), n)  # how many of u, 1 + u, 2 + u, ... lie below
        copies[p] = now - drawn
        drawn = now
        last = p if w[p] > 0.0 else last
    copies[last] += n - drawn  # the sum of the weights fell short of one by rounding


@subroutine
def moves(copies, source, destination):
    """Turn copy counts into the fewest moves: each survivor stays, its further copies go to the places of the dead.

    Args:
        copies: [N] from `systematic`.
        source, destination: [N] integers, written up to the returned number of moves.

    Returns:
        Number of moves; no source is a destination, so they may be done in place and in any order.
    """
    count, dead = 0, 0
    for p in range(copies.size):
        destination[dead] = p  # stays if p is dead, else the next one is written over it
        dead += copies[p] == 0
        for _ in range(copies[p] - 1):
            source[count] = p
            count += 1
    return count


@subroutine
def move_columns(rows, source, destination, count):
    """Apply moves to a block of rows [R, N] (one row per quantity, particle innermost), in place."""
    for r in range(rows.shape[0]):
        row = rows[r]
        for i in range(count):
            row[destination[i]] = row[source[i]]
