"""The joint Gaussian by its information matrix, changed in place: the counterparts of `kernels.gaussian`.

Omega = P^-1, stored in full and exactly symmetric. Rows without information (unused, or not yet in the state) are
zero, as in P: both inversions leave them out.
"""

import math

from estimators.kernels.gaussian import shear
from estimators.kernels.jit import inline, subroutine
from estimators.kernels.linalg import semidefinite_cholesky
from estimators.kernels.simd import subtract_rows

PIVOT_SHARE = 1e-13  # of a diagonal entry: what is left of it after elimination counts as at least this much


@inline
def shear_information(Omega, lane, n, row, by, factor):
    """Omega of x' = E x, E = I + factor e_row e_by': Omega <- E^-T Omega E^-1, a shear with row and column swapped."""
    shear(Omega, lane, n, by, row, -factor)


@subroutine
def diffuse(Omega, work, lane, n, j, size, Q):
    """Noise Q on the coordinates j ... j + size - 1: Omega <- (Omega^-1 + Q)^-1, one column of Q's root at a time.

    For a column b: Omega -= (Omega b)(Omega b)' / (1 + b' Omega b); a column of zeros, a Q of any rank, is legal.
    `Q` [>= size, >= size] is overwritten.
    """
    semidefinite_cholesky(Q, size)
    for column in range(size):
        if Q[column, column] == 0.0:
            continue
        along = 1.0
        for i in range(n):
            total = 0.0
            for k in range(column, size):
                total += Q[k, column] * Omega[lane, j + k, i]
            work[0, i] = total
        for k in range(column, size):
            along += Q[k, column] * work[0, j + k]
        root = math.sqrt(along)
        for i in range(n):
            work[0, i] /= root
        subtract_rows(Omega, lane, n, work, 1, 0)


@inline
def add_sighting(Omega, lane, j, a00, a01, a10, a11, c0, c1, range_std, bearing_std):
    """Omega += H' R^-1 H of one return of the point at row j, H = [-A, c, A]."""
    for row in range(2):
        std = range_std if row == 0 else bearing_std
        hx, hy, turn = (a00 / std, a01 / std, c0 / std) if row == 0 else (a10 / std, a11 / std, c1 / std)
        H = (-hx, -hy, turn, hx, hy)
        at = (0, 1, 2, j, j + 1)
        for i in range(5):
            for k in range(5):
                Omega[lane, at[i], at[k]] += H[i] * H[k]


@subroutine
def factorise(A, lane, n, C):
    """Lower Cholesky factor of A[lane, :n, :n] into `C`; rows of A whose diagonal is zero are left out (zero in C)."""
    for j in range(n):
        for i in range(j, n):
            value = A[lane, i, j]
            for k in range(j):
                value -= C[i, k] * C[j, k]
            C[i, j] = value
        diagonal = A[lane, j, j]
        if not diagonal > 0.0:
            for i in range(j, n):
                C[i, j] = 0.0
            continue
        root = math.sqrt(max(C[j, j], PIVOT_SHARE * diagonal))
        C[j, j] = root
        for i in range(j + 1, n):
            C[i, j] /= root


@inline
def solve(C, n, b):
    """B <- A^-1 b by the factor of A; coordinates left out become zero. b: [>= n]."""
    for j in range(n):
        if C[j, j] == 0.0:
            b[j] = 0.0
            continue
        for k in range(j):
            b[j] -= C[j, k] * b[k]
        b[j] /= C[j, j]
    for j in range(n - 1, -1, -1):
        if C[j, j] == 0.0:
            continue
        for k in range(j + 1, n):
            b[j] -= C[k, j] * b[k]
        b[j] /= C[j, j]


@subroutine
def invert(A, lane, n, out, C):
    """out[lane, :n, :n] <- A[lane, :n, :n]^-1, positive semidefinite by construction; rows left out are zero.

    `C` [n, n] is scratch. With A = C C': the inverse of C in its place, then out = C^-T C^-1.
    """
    factorise(A, lane, n, C)
    for j in range(n):
        if C[j, j] == 0.0:
            continue
        C[j, j] = 1.0 / C[j, j]
        for i in range(j + 1, n):
            total = 0.0
            for k in range(j, i):
                total -= C[i, k] * C[k, j]
            C[i, j] = total / C[i, i] if C[i, i] != 0.0 else 0.0
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for k in range(i, n):
                total += C[k, i] * C[k, j]
            out[lane, i, j] = total
            out[lane, j, i] = total


@inline
def eliminate(work, first, size, n):
    """Turn the `size` rows from `first` of a symmetric matrix into the first columns of its Cholesky factor."""
    for i in range(size):
        line = first + i
        for k in range(i):
            factor = work[first + k, i]
            for c in range(n):
                work[line, c] -= factor * work[first + k, c]
        pivot = work[line, i]
        scale = 1.0 / math.sqrt(pivot) if pivot > 0.0 else 0.0
        for c in range(n):
            work[line, c] = work[line, c] * scale if c >= i else 0.0
