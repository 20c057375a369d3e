"""A return of a recorded robot: errors that last for seconds, a range scale and a bearing bias, labels mis-read."""

import math

from estimators.gaussian.recorded_motion import BEARING_BIAS, RANGE_SCALE
from estimators.gaussian.sweep import UNLIKELY, UNUSABLE, USED
from estimators.kernels.angles import wrap
from estimators.kernels.gaussian import nis_and_log_det
from estimators.kernels.jit import inline
from estimators.kernels.left_looking import CORRECTION, settle
from estimators.kernels.range_bearing import gradient, measure, noise_std, offset
from estimators.kernels.rounding import FLOOR, lift, offset_variance


@inline
def slowed(correlation):
    """What white noise must be multiplied by to carry the information rate of a first-order process: (1+f)/(1-f)."""
    return (1.0 + correlation) / (1.0 - correlation)


@inline
def return_noise(model, errors, distance, age):
    """Variances of a return whose label was last seen `age` seconds ago."""
    range_std, bearing_std = noise_std(model, distance)
    r00, r11 = range_std * range_std, bearing_std * bearing_std
    if errors.range_time > 0.0:
        r00 *= slowed(math.exp(-age / errors.range_time))
    if errors.bearing_time > 0.0:
        correlated = errors.bearing_correlated_std * errors.bearing_correlated_std
        r11 *= slowed(math.exp(-age / errors.bearing_time) * correlated / (correlated + r11))
    return r00, r11


@inline
def project(P, work, lane, n, j, extra, a00, a01, a10, a11, c0, c1, distance):
    """H P into rows 0 and 1 of the scratch; H = [-A, c, A] over position, heading, point; and scale and bias."""
    scale, bias = extra + RANGE_SCALE, extra + BEARING_BIAS
    for i in range(n):
        dx, dy = P[lane, j, i] - P[lane, 0, i], P[lane, j + 1, i] - P[lane, 1, i]
        turn = P[lane, 2, i]
        work[0, i] = a00 * dx + a01 * dy + c0 * turn + distance * P[lane, scale, i]
        work[1, i] = a10 * dx + a11 * dy + c1 * turn + P[lane, bias, i]


@inline
def along(x, row, j, a0, a1, c, which, factor):
    """One row of H times a row of the scratch."""
    return a0 * (x[row, j] - x[row, 0]) + a1 * (x[row, j + 1] - x[row, 1]) + c * x[row, 2] + factor * x[row, which]


@inline
def take(P, work, lane, n, y0, y1, s00, s01, s11):
    """Collect the correction and P -= W W', from H P in rows 0 and 1."""
    l00 = math.sqrt(s00)
    l10 = s01 / l00
    l11 = math.sqrt(s11 - l10 * l10)
    e0 = y0 / l00
    e1 = (y1 - l10 * e0) / l11
    for i in range(n):
        w0 = work[0, i] / l00
        w1 = (work[1, i] - l10 * w0) / l11
        work[0, i] = w0
        work[1, i] = w1
        work[CORRECTION, i] += w0 * e0 + w1 * e1
    settle(P, work, lane, n, 2)


@inline
def observe(mu, P, work, lane, n, j, extra, model, errors, distance, bearing, age, measured, limit, dof):
    """Collect the correction by one return, linearised at the mean before the sweep or where it was measured.

    At l, the point's offset there, A = grad h(l); the heading's column -A J (p - p_r) keeps to the means, so that
    turning everything stays unobservable. Returns below the gate are weighted by (dof + 2) / (dof + NIS).
    """
    dx, dy = mu[lane, j] - mu[lane, 0], mu[lane, j + 1] - mu[lane, 1]
    lx, ly = offset(distance, bearing, mu[lane, 2]) if measured else (dx, dy)
    if not lx * lx + ly * ly > 0.0:
        return UNUSABLE, 0.0
    r, b = measure(lx, ly, mu[lane, 2])
    a00, a01, a10, a11 = gradient(lx, ly)
    c0, c1 = a00 * dy - a01 * dx, a10 * dy - a11 * dx
    scale, bias = extra + RANGE_SCALE, extra + BEARING_BIAS
    project(P, work, lane, n, j, extra, a00, a01, a10, a11, c0, c1, r)
    p00 = along(work, 0, j, a00, a01, c0, scale, r)
    s01 = along(work, 0, j, a10, a11, c1, bias, 1.0)
    p11 = along(work, 1, j, a10, a11, c1, bias, 1.0)
    y0 = distance - r - a00 * (dx - lx) - a01 * (dy - ly) - along(work, CORRECTION, j, a00, a01, c0, scale, r)
    y1 = wrap(bearing - b) - a10 * (dx - lx) - a11 * (dy - ly) - along(work, CORRECTION, j, a10, a11, c1, bias, 1.0)
    r00, r11 = return_noise(model, errors, r, age)
    spread, turn = offset_variance(P, lane, j), P[lane, 2, 2]
    least_range = FLOOR * (spread + c0 * c0 * turn + r * r * P[lane, scale, scale])
    least_bearing = FLOOR * (spread / (r * r) + c1 * c1 * turn + P[lane, bias, bias])
    if least_range > r00 or least_bearing > r11:
        lift(P, work, lane, n)
        r00, r11 = max(r00, least_range), max(r11, least_bearing)
    nis = nis_and_log_det(p00 + r00, s01, p11 + r11, y0, y1)[0]
    if not nis <= limit:
        return (UNUSABLE if math.isnan(nis) else UNLIKELY), nis
    weight = (dof + 2.0) / (dof + nis) if dof > 0.0 else 1.0
    take(P, work, lane, n, y0, y1, p00 + r00 / weight, s01, p11 + r11 / weight)
    return USED, nis
