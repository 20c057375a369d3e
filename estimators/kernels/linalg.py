"""Small dense linear algebra for kernels."""

import math

from estimators.kernels.jit import inline, subroutine

PIVOT_FLOOR = 1e-14  # a pivot below this share of the largest diagonal entry counts as zero


@inline
def semidefinite_cholesky(A, n):
    """Lower Cholesky factor of a positive semidefinite matrix, in place of A[:n, :n], zeros above the diagonal.

    A pivot that is zero, up to rounding, gives a column of zeros: a known start (P = 0) and an offset along one
    direction (rank 1) are legal. Only the lower triangle is read.
    """
    largest = 0.0
    for j in range(n):
        largest = max(largest, A[j, j])
    floor = PIVOT_FLOOR * largest
    for j in range(n):
        pivot = A[j, j]
        for k in range(j):
            pivot -= A[j, k] * A[j, k]
            A[k, j] = 0.0
        if not pivot > floor:
            for i in range(j, n):
                A[i, j] = 0.0
            continue
        root = math.sqrt(pivot)
        A[j, j] = root
        for i in range(j + 1, n):
            value = A[i, j]
            for k in range(j):
                value -= A[i, k] * A[j, k]
            A[i, j] = value / root


@subroutine
def pivoted_cholesky(A, n, C, order):
    """C with A = C C' for a semidefinite A of any rank, to rounding: the largest pivot that is left comes first.

    Otherwise a pivot may be rounding and count as zero, or nearly, and be divided by: slopes over it would be vast.

    Args:
        A: [n, n] both triangles, overwritten.
        C: row i belongs to row i of A; its column p is zero in the rows order[:p], and all of it where A has no more.
        order: [n] the rows in the order of their pivots.
    """
    for p in range(n):
        order[p] = p
    largest = 0.0
    for p in range(n):
        for q in range(p + 1, n):
            if A[order[q], order[q]] > A[order[p], order[p]]:
                order[p], order[q] = order[q], order[p]
        v = order[p]
        largest = max(largest, A[v, v])
        root = math.sqrt(A[v, v]) if A[v, v] > PIVOT_FLOOR * largest else 0.0
        for q in range(n):
            w = order[q]
            C[w, p] = A[w, v] / root if root > 0.0 and q >= p else 0.0
        for q in range(p + 1, n):
            for k in range(p + 1, n):
                A[order[q], order[k]] -= C[order[q], p] * C[order[k], p]


@inline
def solve_transposed(C, n, D, row, out, order):
    """Solve out[row] C = D[row] (rows of n numbers) for a factor of pivots in that order: zero where one is zero."""
    for p in range(n - 1, -1, -1):
        v = order[p]
        if C[v, p] == 0.0:
            out[row, v] = 0.0
            continue
        value = D[row, p]
        for q in range(p + 1, n):
            value -= C[order[q], p] * out[row, order[q]]
        out[row, v] = value / C[v, p]


@inline
def nearest_covariance(xx, xy, yy):
    """The positive semidefinite 2x2 matrix nearest to (xx, xy, yy): itself where it is one, bit for bit.

    A small difference of large variances is known to their rounding only and may come out indefinite: its negative
    part is rounding and is taken off.
    """
    if xx >= 0.0 and yy >= 0.0 and xy * xy <= xx * yy:
        return xx, xy, yy
    mean, half = 0.5 * (xx + yy), 0.5 * (xx - yy)
    radius = math.sqrt(half * half + xy * xy)
    large = mean + radius
    if large <= 0.0:
        return 0.0, 0.0, 0.0
    scale = 0.5 * large / radius  # along the eigenvector of `large`, which alone is left
    return scale * (radius + half), scale * xy, scale * (radius - half)
