"""Small dense linear algebra for kernels: symmetric 2x2 and 3x3 blocks, written out."""

import math

from estimators.kernels.jit import inline


@inline
def chol2(a00, a01, a11):
    """Lower Cholesky factor (l00, l10, l11) of a symmetric 2x2; NaN where it is not positive definite."""
    l00 = math.sqrt(a00)
    l10 = a01 / l00
    return l00, l10, math.sqrt(a11 - l10 * l10)


@inline
def inv2(a00, a01, a11):
    """Inverse (i00, i01, i11) and determinant of a symmetric 2x2."""
    det = a00 * a11 - a01 * a01
    return a11 / det, -a01 / det, a00 / det, det


@inline
def quad2(i00, i01, i11, x, y):
    """The quadratic form [x y] I [x y]' of a symmetric 2x2."""
    return i00 * x * x + 2.0 * i01 * x * y + i11 * y * y


@inline
def quad3_inverse(a00, a01, a02, a11, a12, a22, x, y, z):
    """The form v' A^-1 v of a symmetric 3x3 through its Cholesky factor; NaN where A is not positive definite."""
    l00 = math.sqrt(a00)
    l10 = a01 / l00
    l20 = a02 / l00
    l11 = math.sqrt(a11 - l10 * l10)
    l21 = (a12 - l20 * l10) / l11
    l22 = math.sqrt(a22 - l20 * l20 - l21 * l21)
    s0 = x / l00
    s1 = (y - l10 * s0) / l11
    s2 = (z - l20 * s0 - l21 * s1) / l22
    return s0 * s0 + s1 * s1 + s2 * s2
