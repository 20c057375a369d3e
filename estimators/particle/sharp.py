"""A target's update by a return far sharper than what was known: in factors, where the plain form loses all digits.

P - C S^-1 C' subtracts numbers that agree in all their digits where a target of unknown heading, a sector of the circle
wide, is seen within micrometres: what is left is rounding, soon of either sign. So such a particle's covariance is
factorised, P = U D U' with U unit upper triangular, and takes the return's two numbers one after the other, along the
beam and across it. D stays non-negative by construction. Bierman, "Factorization methods for discrete sequential
estimation", 1977, chapter V.
"""

import math

from estimators.kernels.iterated import linearised, refine
from estimators.kernels.jit import inline, subroutine
from estimators.particle.columns import CLOSEST

SHARP = 1e7  # variance of the target's position over the return's, above which an update is done here


@subroutine
def sharpen(rows, n_t, terms, work, x, y, cosine, sine, distance, cb, sb, var_r, var_b, spread):
    """The whole update of one hypothesis in those particles for which the return is sharp.

    Args:
        rows: [F, N] mean and covariance, see `layout`. terms: [7, N] `columns.fit`'s; here none is left to be done,
            and nu' S^-1 nu and det S come out anew. work: [8, N] scratch.
        spread: position spread per distance above which the update is iterated.
    """
    limit = SHARP * min(var_r, distance * distance * var_b)
    iterate = (spread * distance) ** 2
    first, last = triangle(n_t, 0, 0), triangle(n_t, 1, 1)
    for p in range(x.size):
        size = rows[first, p] + rows[last, p]
        if not size > limit:
            continue
        beam_x, beam_y = cb * cosine[p] - sb * sine[p], sb * cosine[p] + cb * sine[p]
        dx, dy = rows[0, p] - x[p], rows[1, p] - y[p]
        p00, p01, p11 = rows[first, p], rows[first + 1, p], rows[last, p]
        ex, ey = dx, dy
        if size > iterate:
            ex, ey = refine(dx, dy, p00, p01, p11, distance, beam_x, beam_y, var_r, var_b)
        if not ex * ex + ey * ey > CLOSEST * CLOSEST:
            ex, ey = CLOSEST * beam_x, CLOSEST * beam_y
        r = math.sqrt(ex * ex + ey * ey)
        ux, uy, _, _, nu_r, nu_b, _, _, _ = linearised(
            ex, ey, dx, dy, p00, p01, p11, distance, beam_x, beam_y, var_r, var_b
        )
        factorise(rows, n_t, p)
        s_along = take_number(rows, n_t, p, work, ux, uy, nu_r, var_r)
        nu_t = r * nu_b + uy * (rows[0, p] - x[p] - dx) - ux * (rows[1, p] - y[p] - dy)
        s_across = take_number(rows, n_t, p, work, -uy, ux, nu_t, r * r * var_b)
        multiply(rows, n_t, p)
        for term in range(5):
            terms[term, p] = 0.0
        terms[5, p] = nu_r * nu_r / s_along + nu_t * nu_t / s_across
        terms[6, p] = s_along * s_across / (r * r)


@inline
def triangle(n_t, i, j):
    """Row of covariance element (i, j), i <= j."""
    return n_t + i * n_t - i * (i - 1) // 2 + j - i


@subroutine
def factorise(rows, n_t, p):
    """P = U D U' of one particle in its place: D on the diagonal, U above; a pivot that rounding made negative is 0."""
    for j in range(n_t - 1, -1, -1):
        d = max(rows[triangle(n_t, j, j), p], 0.0)
        rows[triangle(n_t, j, j), p] = d
        for i in range(j - 1, -1, -1):
            u = rows[triangle(n_t, i, j), p] / d if d > 0.0 else 0.0
            for k in range(i, j):
                # The elements (k, j) with k > i are U's already, (i, j) itself still P's.
                other = u if k == i else rows[triangle(n_t, k, j), p]
                rows[triangle(n_t, i, k), p] -= u * other * d
            rows[triangle(n_t, i, j), p] = u


@subroutine
def take_number(rows, n_t, p, work, hx, hy, nu, variance):
    """One number, a measurement hx x + hy y of the position: mean, U and D in place; returns its variance S."""
    total = variance
    for j in range(n_t):
        f = hx if j == 0 else hx * rows[triangle(n_t, 0, j), p]
        f += hy if j == 1 else (hy * rows[triangle(n_t, 1, j), p] if j > 1 else 0.0)
        d = rows[triangle(n_t, j, j), p]
        g, before = d * f, total
        total += f * g
        rows[triangle(n_t, j, j), p] = d * (before / total)
        for i in range(j):
            row = triangle(n_t, i, j)
            u = rows[row, p]
            rows[row, p] = u - work[i, p] * (f / before)
            work[i, p] += u * g
        work[j, p] = g
    for i in range(n_t):
        rows[i, p] += work[i, p] * (nu / total)
    return total


@subroutine
def multiply(rows, n_t, p):
    """P from its factors, in their place."""
    for i in range(n_t):
        for j in range(i, n_t):
            total = 0.0
            for k in range(j, n_t):
                ui = 1.0 if k == i else rows[triangle(n_t, i, k), p]
                uj = 1.0 if k == j else rows[triangle(n_t, j, k), p]
                total += ui * uj * rows[triangle(n_t, k, k), p]
            rows[triangle(n_t, i, j), p] = total
