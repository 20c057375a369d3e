"""Deactivate a landmark: cut its link with the moving bodies, Section 12.7 of Thrun, Burgard and Fox 2005.

With x the bodies (robot and target), m+ the landmarks that stay active, m0 the one to go and m- the passive ones,
p(x, m) = p(x | m+, m0, m-) p(m) is replaced by p(x | m+, m- = its mean) p(m): m0 no longer tells anything about x but
through m+. Of Omega only the elimination of x changes, from its own columns d to those c of Omega with m- conditioned
on and m0 marginalised: Omega += sum c c' - sum d d'. The mean stays.
"""

from estimators.kernels.gaussian import ROBOT
from estimators.kernels.information import eliminate
from estimators.kernels.jit import inline, subroutine
from estimators.kernels.simd import subtract_rows


@inline
def conditioned_row(Omega, work, line, lane, n, i, n_b, count, active, slot):
    """Row i of Omega, passive landmarks conditioned on and the one in `slot` marginalised, into row `line`."""
    j = n_b + 2 * slot
    s00, s01, s11 = Omega[lane, j, j], Omega[lane, j, j + 1], Omega[lane, j + 1, j + 1]
    det = s00 * s11 - s01 * s01
    p0, p1 = Omega[lane, i, j], Omega[lane, i, j + 1]
    g0, g1 = (s11 * p0 - s01 * p1) / det, (s00 * p1 - s01 * p0) / det
    for c in range(n):
        work[line, c] = 0.0
    for c in range(n_b):
        work[line, c] = Omega[lane, i, c] - g0 * Omega[lane, j, c] - g1 * Omega[lane, j + 1, c]
    for other in range(count):
        if active[lane, other] and other != slot:
            for c in range(n_b + 2 * other, n_b + 2 * other + 2):
                work[line, c] = Omega[lane, i, c] - g0 * Omega[lane, j, c] - g1 * Omega[lane, j + 1, c]


@inline
def deactivate(Omega, work, lane, n, n_t, count, active, slot):
    """Cut the links of one landmark with robot and target."""
    n_b = ROBOT + n_t
    for i in range(n_b):
        for c in range(n):
            work[i, c] = Omega[lane, i, c]
        conditioned_row(Omega, work, n_b + i, lane, n, i, n_b, count, active, slot)
    eliminate(work, 0, n_b, n)
    eliminate(work, n_b, n_b, n)
    subtract_rows(Omega, lane, n, work, n_b, n_b)
    cut(Omega, lane, n_b, slot)
    active[lane, slot] = False


@inline
def cut(Omega, lane, n_b, slot):
    """Set links that are zero but for rounding to zero."""
    for i in range(n_b):
        for c in range(n_b + 2 * slot, n_b + 2 * slot + 2):
            Omega[lane, i, c] = Omega[lane, c, i] = 0.0


@subroutine
def keep_active(Omega, work, lane, n, n_t, count, active, unseen, limit):
    """Deactivate the landmarks unseen for longest until `limit` are active; those just seen stay.

    Returns how many more than the limit stay.
    """
    number = 0
    for slot in range(count):
        number += active[lane, slot]
    while number > limit:
        oldest = -1
        for slot in range(count):
            if (
                active[lane, slot]
                and unseen[lane, slot] > 0
                and (oldest < 0 or unseen[lane, slot] > unseen[lane, oldest])
            ):
                oldest = slot
        if oldest < 0:
            break
        deactivate(Omega, work, lane, n, n_t, count, active, oldest)
        number -= 1
    return max(number - limit, 0)
