"""The unscented transform in a particle: sigma points through motion, sensor and first sighting, no Jacobian.

With n variables, D1 and D2 the half differences and half second differences of f at +-sqrt(n) columns of the Cholesky
factor (alpha = 1, beta = 0, kappa = 0, as `ukf` by default):

    e = sum D2 / n,   mean f(x) + e,   covariance sum (D1 D1' + D2 D2') / n - e e',   Cov(x, f) = sum L_i D1' / sqrt(n)
"""

import math

from estimators.kernels.elementary import angle_between, sincos, wrap_smooth
from estimators.kernels.jit import inline, subroutine
from estimators.kernels.linalg import semidefinite_cholesky
from estimators.kernels.motion import calibrated, control_std, displacement

_ROOT_2, _ROOT_5 = math.sqrt(2.0), math.sqrt(5.0)
_CLOSEST = 1e-6  # [m]


@subroutine
def predict_poses_unscented(pose, cov, model, control_v, control_w, dt, work):
    """Mean and covariance of every pose through one step; variables: the pose and both controls. work: [11, 3]."""
    v, w = calibrated(model, control_v, control_w)
    sv, sw = control_std(model, v, w, dt)
    L, D1, D2 = work[0:3], work[3:8], work[8:11]
    for p in range(pose.shape[1]):
        _factor(cov, p, L)
        heading = pose[2, p]
        x0, y0, turn0 = displacement(model, v, w, dt, heading)
        e0, e1, e2 = 0.0, 0.0, 0.0
        for i in range(3):
            for j in range(i, 3):
                D2[i, j] = 0.0
        for c in range(5):
            a, b, h = (_ROOT_5 * L[0, c], _ROOT_5 * L[1, c], _ROOT_5 * L[2, c]) if c < 3 else (0.0, 0.0, 0.0)
            dv = _ROOT_5 * sv if c == 3 else 0.0
            dw = _ROOT_5 * sw if c == 4 else 0.0
            xp, yp, tp = displacement(model, v + dv, w + dw, dt, heading + h)
            xm, ym, tm = displacement(model, v - dv, w - dw, dt, heading - h)
            D1[c, 0], D1[c, 1], D1[c, 2] = a + 0.5 * (xp - xm), b + 0.5 * (yp - ym), h + 0.5 * (tp - tm)
            s0, s1, s2 = 0.5 * (xp + xm) - x0, 0.5 * (yp + ym) - y0, 0.5 * (tp + tm) - turn0
            e0, e1, e2 = e0 + 0.2 * s0, e1 + 0.2 * s1, e2 + 0.2 * s2
            D2[0, 0] += s0 * s0
            D2[0, 1] += s0 * s1
            D2[0, 2] += s0 * s2
            D2[1, 1] += s1 * s1
            D2[1, 2] += s1 * s2
            D2[2, 2] += s2 * s2
        pose[0, p] += x0 + e0
        pose[1, p] += y0 + e1
        pose[2, p] = wrap_smooth(heading + turn0 + e2)
        row = 0
        for i in range(3):
            ei = e0 if i == 0 else (e1 if i == 1 else e2)
            for j in range(i, 3):
                ej = e0 if j == 0 else (e1 if j == 1 else e2)
                total = D2[i, j]
                for c in range(5):
                    total += D1[c, i] * D1[c, j]
                cov[row, p] = 0.2 * total - ei * ej
                row += 1


@inline
def _factor(cov, p, L):
    """Lower Cholesky factor [3, 3] of one pose's covariance, of any rank."""
    row = 0
    for i in range(3):
        for j in range(i, 3):
            L[j, i] = cov[row, p]
            row += 1
    semidefinite_cholesky(L, 3)


@inline
def _ray(dx, dy, ux, uy):
    """Range of a displacement and its angle from the direction (ux, uy)."""
    r = max(math.sqrt(dx * dx + dy * dy), _CLOSEST)
    return r, angle_between((ux * dx + uy * dy) / r, (ux * dy - uy * dx) / r, 1.0)


@subroutine
def condition_unscented(pose, cov, p, looks, n_z, work):
    """One particle's pose conditioned on one return after the other; variables: the pose and the point.

    Args:
        looks: [K, 10] see `looks`. work: [12, 3] scratch.

    Returns:
        Sum of the returns' log densities, each without its log 2 pi.
    """
    L, cross = work[0:3], work[3:5]
    log_likelihood = 0.0
    for k in range(n_z):
        look = looks[k]
        _factor(cov, p, L)
        m00 = math.sqrt(max(look[2], 0.0))
        m10 = look[3] / m00 if m00 > 0.0 else 0.0
        m11 = math.sqrt(max(look[4] - m10 * m10, 0.0))
        dx, dy = look[0] - pose[0, p], look[1] - pose[1, p]
        r0 = max(math.sqrt(dx * dx + dy * dy), _CLOSEST)
        ux, uy = dx / r0, dy / r0
        e0, e1, s00, s01, s11 = 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(3):
            cross[0, i] = cross[1, i] = 0.0
        for c in range(5):
            a, b, h = (L[0, c], L[1, c], L[2, c]) if c < 3 else (0.0, 0.0, 0.0)
            gx = (m00 if c == 3 else 0.0) - a
            gy = (m10 if c == 3 else (m11 if c == 4 else 0.0)) - b
            rp, bp = _ray(dx + _ROOT_5 * gx, dy + _ROOT_5 * gy, ux, uy)
            rm, bm = _ray(dx - _ROOT_5 * gx, dy - _ROOT_5 * gy, ux, uy)
            d0, d1 = 0.5 * (rp - rm), 0.5 * (bp - bm) - _ROOT_5 * h
            q0, q1 = 0.5 * (rp + rm) - r0, 0.5 * (bp + bm)
            e0, e1 = e0 + 0.2 * q0, e1 + 0.2 * q1
            s00 += 0.2 * (d0 * d0 + q0 * q0)
            s01 += 0.2 * (d0 * d1 + q0 * q1)
            s11 += 0.2 * (d1 * d1 + q1 * q1)
            for i in range(3 if c < 3 else 0):
                cross[0, i] += L[i, c] * d0 / _ROOT_5
                cross[1, i] += L[i, c] * d1 / _ROOT_5
        s00, s01, s11 = s00 - e0 * e0 + look[8], s01 - e0 * e1, s11 - e1 * e1 + look[9]
        sine, cosine = sincos(pose[2, p])
        beam_x, beam_y = look[6] * cosine - look[7] * sine, look[7] * cosine + look[6] * sine
        nu0 = look[5] - r0 - e0
        nu1 = wrap_smooth(angle_between(ux * beam_x + uy * beam_y, ux * beam_y - uy * beam_x, 1.0) - e1)
        det = s00 * s11 - s01 * s01
        i00, i01, i11 = s11 / det, -s01 / det, s00 / det
        w0, w1 = i00 * nu0 + i01 * nu1, i01 * nu0 + i11 * nu1
        for i in range(3):
            pose[i, p] += cross[0, i] * w0 + cross[1, i] * w1
        pose[2, p] = wrap_smooth(pose[2, p])
        row = 0
        for i in range(3):
            g0, g1 = cross[0, i] * i00 + cross[1, i] * i01, cross[0, i] * i01 + cross[1, i] * i11
            for j in range(i, 3):
                cov[row, p] -= g0 * cross[0, j] + g1 * cross[1, j]
                row += 1
        log_likelihood -= 0.5 * (nu0 * w0 + nu1 * w1 + math.log(det))
    return log_likelihood


@inline
def assimilate_unscented(dx, dy, p00, p01, p11, distance, beam_x, beam_y, var_r, var_b):
    """A landmark's whole update given the pose; variables: the point. Arguments and returns as `columns.assimilate`."""
    l00 = math.sqrt(p00)
    l10 = p01 / l00
    l11 = math.sqrt(max(p11 - l10 * l10, 0.0))
    r0 = max(math.sqrt(dx * dx + dy * dy), _CLOSEST)
    ux, uy = dx / r0, dy / r0
    rp, bp = _ray(dx + _ROOT_2 * l00, dy + _ROOT_2 * l10, ux, uy)
    rm, bm = _ray(dx - _ROOT_2 * l00, dy - _ROOT_2 * l10, ux, uy)
    a0, a1, q0, q1 = 0.5 * (rp - rm), 0.5 * (bp - bm), 0.5 * (rp + rm) - r0, 0.5 * (bp + bm)
    rp, bp = _ray(dx, dy + _ROOT_2 * l11, ux, uy)
    rm, bm = _ray(dx, dy - _ROOT_2 * l11, ux, uy)
    c0, c1, t0, t1 = 0.5 * (rp - rm), 0.5 * (bp - bm), 0.5 * (rp + rm) - r0, 0.5 * (bp + bm)
    e0, e1 = 0.5 * (q0 + t0), 0.5 * (q1 + t1)
    s00 = 0.5 * (a0 * a0 + c0 * c0 + q0 * q0 + t0 * t0) - e0 * e0 + var_r
    s01 = 0.5 * (a0 * a1 + c0 * c1 + q0 * q1 + t0 * t1) - e0 * e1
    s11 = 0.5 * (a1 * a1 + c1 * c1 + q1 * q1 + t1 * t1) - e1 * e1 + var_b
    x0, x1 = l00 * a0 / _ROOT_2, l00 * a1 / _ROOT_2
    y0, y1 = (l10 * a0 + l11 * c0) / _ROOT_2, (l10 * a1 + l11 * c1) / _ROOT_2
    nu0 = distance - r0 - e0
    nu1 = angle_between(ux * beam_x + uy * beam_y, ux * beam_y - uy * beam_x, 1.0) - e1
    det = s00 * s11 - s01 * s01
    i00, i01, i11 = s11 / det, -s01 / det, s00 / det
    w0, w1 = i00 * nu0 + i01 * nu1, i01 * nu0 + i11 * nu1
    gx0, gx1 = x0 * i00 + x1 * i01, x0 * i01 + x1 * i11
    gy0, gy1 = y0 * i00 + y1 * i01, y0 * i01 + y1 * i11
    return (
        x0 * w0 + x1 * w1,
        y0 * w0 + y1 * w1,
        p00 - gx0 * x0 - gx1 * x1,
        p01 - gx0 * y0 - gx1 * y1,
        p11 - gy0 * y0 - gy1 * y1,
        nu0 * w0 + nu1 * w1,
        det,
    )


@inline
def first_sighting_unscented(beam_x, beam_y, distance, var_r, var_b):
    """Where a return's point lies from a known pose; variables: the return. Offset (x, y) and covariance (xx, xy, yy).

    With a = sqrt(2 var_b), along the beam: mean r + e, e = r (cos a - 1) / 2, and variance var_r + e^2; across it:
    variance r^2 sin^2 a / 2.
    """
    sine, cosine = sincos(math.sqrt(2.0 * var_b))
    e = 0.5 * distance * (cosine - 1.0)
    along, across = var_r + e * e, 0.5 * (distance * sine) ** 2
    return (
        (distance + e) * beam_x,
        (distance + e) * beam_y,
        along * beam_x * beam_x + across * beam_y * beam_y,
        (along - across) * beam_x * beam_y,
        along * beam_y * beam_y + across * beam_x * beam_x,
    )


@subroutine
def start_column_unscented(mx, my, pxx, pxy, pyy, x, y, cosine, sine, distance, cb, sb, var_r, var_b):
    """A landmark's first sighting, in every particle; see `columns.start_column`."""
    for p in range(mx.size):
        beam_x, beam_y = cb * cosine[p] - sb * sine[p], sb * cosine[p] + cb * sine[p]
        dx, dy, pxx[p], pxy[p], pyy[p] = first_sighting_unscented(beam_x, beam_y, distance, var_r, var_b)
        mx[p] = x[p] + dx
        my[p] = y[p] + dy


@subroutine
def update_column_unscented(
    mx, my, pxx, pxy, pyy, x, y, cosine, sine, nis_sum, det_product, distance, cb, sb, var_r, var_b
):
    """A landmark seen again, in every particle; see `columns.update_column`."""
    for p in range(mx.size):
        beam_x, beam_y = cb * cosine[p] - sb * sine[p], sb * cosine[p] + cb * sine[p]
        step_x, step_y, pxx[p], pxy[p], pyy[p], nis, det = assimilate_unscented(
            mx[p] - x[p], my[p] - y[p], pxx[p], pxy[p], pyy[p], distance, beam_x, beam_y, var_r, var_b
        )
        mx[p] += step_x
        my[p] += step_y
        nis_sum[p] += nis
        det_product[p] *= det
