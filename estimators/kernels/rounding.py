"""Returns sharper than a covariance can hold: neither may be believed beyond the rounding of its entries.

Double precision keeps an entry of P to 1e-16 of itself. A filter that has run off by kilometres may hold square
kilometres in P and see to a tenth of a millimetre: then P less what a return says of it is rounding, and no covariance.
So where a return's variance R is below `FLOOR` times H diag(P) H', diag(P) being P without its correlations,

    P <- P + LIFT diag(P),                 R <- max(R, FLOOR H diag(P) H'),

once per return, before it leaves P: P - W W' is a covariance but for rounding, a thousandth of LIFT diag(P), whatever
the correlations were. W and H P H' may be from before or after P is lifted: FLOOR has room for both. Elsewhere nothing
changes, to the last bit. A change of coordinates that leaves little of a variance asks for it too: `lifted_if_shrunk`.
"""

import math

from estimators.kernels.jit import inline, subroutine
from estimators.kernels.left_looking import TURN

LIFT = 1e-12  # of each variance: what is added to it
FLOOR = 2.0 * LIFT  # of H diag(P) H': the least variance of a return
SHRUNK = 1e-3  # of a variance left by a change of coordinates, below which rounding of what it was may tell


@subroutine
def lift(P, work, lane, n):
    """P <- P + LIFT diag(P), and the heading's row that is kept beside P where rows have been collected.

    What is no variance, an entry below zero, is left alone.
    """
    work[TURN, 2] += LIFT * max(P[lane, 2, 2], 0.0)
    for i in range(n):
        P[lane, i, i] += LIFT * max(P[lane, i, i], 0.0)


@inline
def lifted_if_shrunk(variance, made_of):
    """A variance that is the difference of larger ones: lifted by LIFT of what it was made of where little is left."""
    return variance + LIFT * made_of if variance < SHRUNK * made_of else variance


@inline
def offset_variance(P, lane, j):
    """The trace of the covariance of D = point - robot, were the two independent; the point is at row j."""
    return P[lane, j, j] + P[lane, j + 1, j + 1] + P[lane, 0, 0] + P[lane, 1, 1]


@subroutine
def blunted(P, work, lane, n, h0, h1, range_std, bearing_std):
    """The deviations that a return may have, h0 and h1 being H diag(P) H'; P is lifted where they are not its own."""
    least_range, least_bearing = math.sqrt(max(FLOOR * h0, 0.0)), math.sqrt(max(FLOOR * h1, 0.0))
    if least_range > range_std or least_bearing > bearing_std:
        lift(P, work, lane, n)
        return max(range_std, least_range), max(bearing_std, least_bearing)
    return range_std, bearing_std


@inline
def independent_variances(P, lane, j, r, c0, c1):
    """H diag(P) H' (h0, h1) of a point at row j, r away, for H = [-A, (c0, c1), A], A the gradient: at most that."""
    spread, turn = offset_variance(P, lane, j), P[lane, 2, 2]
    return spread + c0 * c0 * turn, spread / (r * r) + c1 * c1 * turn


@inline
def blunted_by_distance(P, work, lane, n, j, r, c0, c1, range_std, bearing_std):
    """The same for H = [-A, (c0, c1), A], A the gradient at a point r away: one comparison where nothing changes."""
    spread = offset_variance(P, lane, j)
    least, turn = min(range_std, r * bearing_std), P[lane, 2, 2]
    if FLOOR * (spread + (c0 * c0 + c1 * c1 * r * r) * turn) > least * least:
        h0, h1 = independent_variances(P, lane, j, r, c0, c1)
        return blunted(P, work, lane, n, h0, h1, range_std, bearing_std)
    return range_std, bearing_std
