"""What rounding leaves of a covariance, against the textbook's update of it in numbers that do not round."""

from fractions import Fraction

import numpy as np
import pytest

from estimators.kernels import left_looking as ll
from estimators.kernels.gaussian import downdate
from estimators.kernels.jit import jit
from estimators.kernels.rounding import FLOOR, LIFT, SHRUNK, blunted, blunted_by_distance, lift, lifted_if_shrunk
from estimators.kernels.simd import aligned_zeros

N, J = 8, 3  # rows; the point's first


@jit
def take(P, work, guarded, dx, dy, range_std, bearing_std):
    """One return of the point at row J, the deviations blunted or not; what they are."""
    r = np.sqrt(dx * dx + dy * dy)
    a00, a01, a10, a11 = dx / r, dy / r, -dy / (r * r), dx / (r * r)
    if guarded:
        range_std, bearing_std = blunted_by_distance(P, work, 0, N, J, r, 0.0, -1.0, range_std, bearing_std)
    s00, s01, s11 = ll.spread(P, work, 0, N, 0, J, a00, a01, a10, a11, 0.0, -1.0)
    s00, s11 = s00 + range_std * range_std, s11 + bearing_std * bearing_std
    downdate(work, ll.CORRECTION, P, work, 0, N, J, a00, a01, a10, a11, 0.0, -1.0, 0.0, 0.0, s00, s01, s11)
    return range_std, bearing_std


@jit
def lifted(P, work):
    lift(P, work, 0, N)


@jit
def blunted_deviations(P, work, h0, h1, range_std, bearing_std):
    return blunted(P, work, 0, N, h0, h1, range_std, bearing_std)


def matrix(P):
    out = aligned_zeros(1, N, N)
    out[0] = P
    return out


def vast(rng, scale):
    """Kilometres of doubt, all of it shared: what lies between the rows is known to a hundred-millionth of it."""
    own = rng.uniform(0.5, 2.0, N) * scale
    loose = 1e-8 * own
    return np.outer(own, own) + np.diag(loose * loose)


def is_above(P, share, before):
    """Whether P > share diag(before), by elimination in fractions: eigenvalues would round."""
    if not np.isfinite(P).all():
        return False
    A = [[Fraction(P[i, k]) - Fraction(share) * Fraction(before[i, k]) * (i == k) for k in range(N)] for i in range(N)]
    for p in range(N):
        if A[p][p] <= 0:
            return False
        for i in range(p + 1, N):
            factor = A[i][p] / A[p][p]
            A[i] = [a - factor * b for a, b in zip(A[i], A[p], strict=True)]
    return True


@pytest.mark.parametrize("seed", range(20))
def test_a_covariance_stays_one_however_sharp_the_return(seed):
    rng = np.random.default_rng(seed)
    P, work = matrix(vast(rng, 1e4)), ll.scratch(N)
    before = P[0].copy()
    dx, dy = rng.uniform(-10.0, 10.0, 2)
    take(P, work, True, dx, dy, 1e-4, 1e-4)
    np.testing.assert_array_equal(P[0], P[0].T)
    assert is_above(P[0], LIFT / 4.0, before)


def test_without_that_it_would_not():
    failed = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        P, work = matrix(vast(rng, 1e4)), ll.scratch(N)
        before = P[0].copy()
        take(P, work, False, *rng.uniform(-10.0, 10.0, 2), 1e-4, 1e-4)
        failed += not is_above(P[0], 0.0, before)
    assert failed > 10


def test_an_ordinary_return_is_what_it_is():
    rng = np.random.default_rng(1)
    P, Q, work = matrix(vast(rng, 1e2)), matrix(np.zeros((N, N))), ll.scratch(N)
    Q[:] = P
    assert take(P, work, True, 3.0, 4.0, 1e-3, 1e-3) == (1e-3, 1e-3)
    take(Q, work, False, 3.0, 4.0, 1e-3, 1e-3)
    np.testing.assert_array_equal(P, Q)


def test_lift():
    rng = np.random.default_rng(2)
    P, work = matrix(vast(rng, 1.0)), ll.scratch(N)
    work[ll.TURN] = turn = rng.standard_normal(N)
    P[0, 5, 5] *= -1.0  # no variance
    before = P[0].copy()
    lifted(P, work)
    np.testing.assert_allclose(P[0] - before, LIFT * np.diag(np.maximum(np.diag(before), 0.0)), rtol=1e-3)
    np.testing.assert_array_equal(work[ll.TURN], turn + LIFT * before[2, 2] * (np.arange(N) == 2))


def test_either_deviation_has_its_own_floor():
    P, work = matrix(np.eye(N)), ll.scratch(N)
    assert blunted_deviations(P, work, 4.0, 9.0, 1e-3, 1e-3) == (1e-3, 1e-3)
    np.testing.assert_array_equal(P[0], np.eye(N))
    expected = 1e-3, np.sqrt(FLOOR * 9.0)
    assert blunted_deviations(P, work, 4.0, 9.0, 1e-3, 1e-9) == pytest.approx(expected, rel=1e-12)
    np.testing.assert_allclose(P[0], (1.0 + LIFT) * np.eye(N), rtol=1e-15)


def test_by_distance_is_by_the_gradient():
    """H diag(P) H', written out, where the comparison in square metres finds the return too sharp."""
    rng = np.random.default_rng(3)
    for r, c0, c1 in ((2.0, 0.0, -1.0), (0.01, 3.0, 0.5), (50.0, 0.1, -2.0)):
        P, work = matrix(np.diag(rng.uniform(1.0, 2.0, N))), ll.scratch(N)
        spread = P[0, 0, 0] + P[0, 1, 1] + P[0, J, J] + P[0, J + 1, J + 1]
        h0, h1 = spread + c0 * c0 * P[0, 2, 2], spread / r**2 + c1 * c1 * P[0, 2, 2]
        got = by_distance(P, work, r, c0, c1, 1e-9, 1e-9)
        assert got == pytest.approx((np.sqrt(FLOOR * h0), np.sqrt(FLOOR * h1)), rel=1e-12)


@jit
def by_distance(P, work, r, c0, c1, range_std, bearing_std):
    return blunted_by_distance(P, work, 0, N, J, r, c0, c1, range_std, bearing_std)


def test_a_variance_is_lifted_only_where_little_is_left_of_what_made_it():
    assert lifted_if_shrunk(0.5, 1.0) == 0.5 and lifted_if_shrunk(SHRUNK, 1.0) == SHRUNK
    assert lifted_if_shrunk(0.5 * SHRUNK, 1.0) == 0.5 * SHRUNK + LIFT
    assert lifted_if_shrunk(-1e-16, 1.0) > 0.0 and lifted_if_shrunk(0.0, 0.0) == 0.0
