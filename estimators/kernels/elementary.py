"""Branch-free elementary functions for the particle loops: straight arithmetic, so that the compiler vectorises them.

libm calls do not vectorise (10 ns for a sine and a cosine); these cost 0.5-1 ns per element inside a loop over
particles. Accurate to a few 1e-16 for the arguments they are meant for; the plain functions of `math` are the oracle
in the tests.
"""

import math

import numpy as np

from estimators.kernels.jit import inline

TWO_PI = 2.0 * math.pi
_HALF_PI = 0.5 * math.pi
_TAN_PI_8 = math.sqrt(2.0) - 1.0
_TINY = 1e-300
_TINY_SINE = 1e-290
_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_LOG2_E = 1.44269504088896338700e00
_SQRT_HALF = math.sqrt(0.5)
_ROUND = 6755399441055744.0  # 1.5 x 2^52: added to a small number, its integer part stands in the low bits
_MANTISSA, _ONE, _TWO_52 = np.int64(0x000FFFFFFFFFFFFF), np.int64(0x3FF0000000000000), np.int64(0x4330000000000000)
_BIAS, _SHIFT = np.int64(1023), np.int64(52)


@inline
def _sincos_core(r):
    """Sine and cosine for |r| <= pi/4: the polynomials of fdlibm's k_sin and k_cos."""
    z = r * r
    s = -2.50507602534068634195e-08 + z * 1.58969099521155010221e-10
    s = -1.98412698298579493134e-04 + z * (2.75573137070700676789e-06 + z * s)
    s = r + r * z * (-1.66666666666666324348e-01 + z * (8.33333333332248946124e-03 + z * s))
    c = -2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)
    c = -1.38888888888741095749e-03 + z * (2.48015872894767294178e-05 + z * c)
    c = 1.0 - 0.5 * z + z * z * (4.16666666666666019037e-02 + z * c)
    return s, c


@inline
def _quadrant(quarter, s, c):
    """Turn (sine, cosine) by a whole number of quarter turns."""
    q = quarter - 4.0 * np.floor(0.25 * quarter)
    odd = (q == 1.0) | (q == 3.0)
    sine = c if odd else s
    cosine = s if odd else c
    return (-sine if q >= 2.0 else sine), (-cosine if (q == 1.0) | (q == 2.0) else cosine)


@inline
def sincos(x):
    """Sine and cosine of an angle of at most a few turns (radians)."""
    quarter = np.floor(x * (1.0 / _HALF_PI) + 0.5)
    s, c = _sincos_core(x - quarter * _HALF_PI)
    return _quadrant(quarter, s, c)


@inline
def sincos_turn(u):
    """Sine and cosine of u whole turns, 0 <= u <= 1."""
    quarter = np.floor(4.0 * u + 0.5)
    s, c = _sincos_core((4.0 * u - quarter) * _HALF_PI)
    return _quadrant(quarter, s, c)


@inline
def wrap_smooth(angle):
    """The same direction in [-pi, pi), without a branch (see `angles.wrap`)."""
    wrapped = angle - TWO_PI * np.floor((angle + math.pi) * (1.0 / TWO_PI))
    return wrapped if wrapped < math.pi else -math.pi


@inline
def angle_between(dot, cross, length):
    """The angle whose cosine is `dot` / `length` and whose sine is `cross` / `length`, in [-pi, pi].

    2 atan(cross / (length + dot)), by the half angle: one division, then an odd polynomial on |t| <= tan(pi/8).
    The length need not be right to the last digit: it enters with half its relative error.
    """
    a = abs(cross) + _TINY_SINE  # so that exactly opposite directions are half a turn apart, not none
    b = length + dot
    b = b if b > _TINY else _TINY
    # atan(a/b) = m pi/4 + atan(t), m in 0, 1, 2, with |t| <= tan(pi/8)
    low = a <= _TAN_PI_8 * b
    high = b < _TAN_PI_8 * a
    numerator = a if low else (-b if high else a - b)
    denominator = b if low else (a if high else a + b)
    base = 0.0 if low else (math.pi if high else _HALF_PI)
    t = numerator / denominator
    angle = base + 2.0 * _atan_small(t)
    return -angle if cross < 0.0 else angle


@inline
def _atan_small(t):
    """Arc tangent for |t| <= tan(pi/8), by fdlibm's polynomial (its range is |t| < 7/16)."""
    z = t * t
    w = z * z
    odd = 4.97687799461593236017e-02 + w * 1.62858201153657823623e-02
    odd = 9.09088713343650656196e-02 + w * (6.66107313738753120669e-02 + w * odd)
    odd = z * (3.33333333333329318027e-01 + w * (1.42857142725034663711e-01 + w * odd))
    even = -5.83357013379057348645e-02 + w * -3.65315727442169155270e-02
    even = w * (-1.11111104054623557880e-01 + w * (-7.69187620504482999495e-02 + w * even))
    even = w * (-1.99999999998764832476e-01 + even)
    return t - t * (odd + even)


@inline
def log(x):
    """Natural logarithm of a normal positive number; NaN for anything else. fdlibm's polynomial."""
    bits = np.float64(x).view(np.int64)
    exponent = np.int64((bits >> _SHIFT) | _TWO_52).view(np.float64) - (4503599627370496.0 + 1023.0)
    m = np.int64((bits & _MANTISSA) | _ONE).view(np.float64)
    large = m > 2.0 * _SQRT_HALF
    m = 0.5 * m if large else m
    k = exponent + 1.0 if large else exponent
    f = m - 1.0
    s = f / (2.0 + f)
    z = s * s
    r = 1.818357216161805012e-01 + z * (1.531383769920937332e-01 + z * 1.479819860511658591e-01)
    r = 2.857142874366239149e-01 + z * (2.222219843214978396e-01 + z * r)
    r = z * (6.666666666666735130e-01 + z * (3.999999999940941908e-01 + z * r))
    half = 0.5 * f * f
    value = k * _LN2_HIGH - ((half - (s * (half + r) + k * _LN2_LOW)) - f)
    return value if (x >= 2.2250738585072014e-308) & (x < math.inf) else math.nan


@inline
def exp_nonpositive(x):
    """e^x for x <= 0; zero below -700. fdlibm's polynomial."""
    small = x < -700.0
    y = -700.0 if small else x
    k = np.floor(y * _LOG2_E + 0.5)
    r = (y - k * _LN2_HIGH) - k * _LN2_LOW
    z = r * r
    c = -1.65339022054652515390e-06 + z * 4.13813679705723846039e-08
    c = -2.77777777770155933842e-03 + z * (6.61375632143793436117e-05 + z * c)
    c = r - z * (1.66666666666666019037e-01 + z * c)
    value = 1.0 + (r + r * c / (2.0 - c))
    power = np.int64((np.float64(k + _ROUND).view(np.int64) + _BIAS) << _SHIFT).view(np.float64)
    return 0.0 if small else value * power
