"""One landmark in all particles: a column of small EKFs, started and updated in one vectorised pass.

A particle knows its pose, so a landmark's EKF sees S = A P A' + R, A = dh/d(landmark), and nothing else.
"""

import math

from estimators.kernels.elementary import angle_between, log
from estimators.kernels.jit import inline, subroutine

CLOSEST = 1e-6  # [m] below this distance the bearing's gradient is taken at it


@inline
def fit(dx, dy, p00, p01, p11, distance, beam_x, beam_y, var_r, var_b):
    """Innovation of one return against a point at (dx, dy) from the robot with covariance P, in unit vectors.

    With u = D/|D| and A = dh/dD = [u', (Ju)'/|D|], the update of anything correlated with the point is
    mean += C b and cov -= C A2 C', C its covariance with the point:
    b = A' S^-1 nu, A2 = A' S^-1 A. Eqs. (14) and (18), Wu and Sun 2013.

    Args:
        distance: measured range; beam_x, beam_y: measured bearing as a unit vector in the world's axes.
        var_r, var_b: the sensor's variances.

    Returns:
        b0, b1, a00, a01, a11, nu' S^-1 nu, det S.
    """
    square = dx * dx + dy * dy
    square = square if square > CLOSEST * CLOSEST else CLOSEST * CLOSEST
    inverse = 1.0 / math.sqrt(square)
    ux, uy = dx * inverse, dy * inverse
    vx, vy = -uy * inverse, ux * inverse
    nu_r = distance - square * inverse
    nu_b = angle_between(ux * beam_x + uy * beam_y, ux * beam_y - uy * beam_x)
    f0, f1 = p00 * ux + p01 * uy, p01 * ux + p11 * uy
    g0, g1 = p00 * vx + p01 * vy, p01 * vx + p11 * vy
    s00 = ux * f0 + uy * f1 + var_r
    s01 = ux * g0 + uy * g1
    s11 = vx * g0 + vy * g1 + var_b
    det = s00 * s11 - s01 * s01
    scale = 1.0 / det
    i00, i01, i11 = s11 * scale, -s01 * scale, s00 * scale
    e0, e1 = i00 * nu_r + i01 * nu_b, i01 * nu_r + i11 * nu_b
    q0, q1 = i00 * ux + i01 * vx, i01 * ux + i11 * vx
    r0, r1 = i00 * uy + i01 * vy, i01 * uy + i11 * vy
    return (
        ux * e0 + vx * e1,
        uy * e0 + vy * e1,
        ux * q0 + vx * q1,
        ux * r0 + vx * r1,
        uy * r0 + vy * r1,
        nu_r * e0 + nu_b * e1,
        det,
    )


@inline
def assimilate(dx, dy, p00, p01, p11, distance, beam_x, beam_y, var_r, var_b):
    """A landmark's whole EKF update, written along and across the line of sight, where R is diagonal.

    With P turned into those axes (rr, rt, tt), the bearing's innovation and noise in metres at the landmark
    (nu_t = r nu_b, var_t = r^2 var_b) and D = det P + rr var_t + tt var_r + var_r var_t, the posterior is
    rr = var_r (det P + rr var_t) / D, rt = var_r var_t rt / D, tt = var_t (det P + tt var_r) / D: the same as
    (I - K H) P, without a cancellation and in half the operations.

    Args: as `fit`.

    Returns:
        The step of the mean (x, y), the posterior covariance (xx, xy, yy), nu' S^-1 nu, det S.
    """
    square = dx * dx + dy * dy
    square = square if square > CLOSEST * CLOSEST else CLOSEST * CLOSEST
    inverse = 1.0 / math.sqrt(square)
    r = square * inverse
    ux, uy = dx * inverse, dy * inverse
    nu_r = distance - r
    nu_t = r * angle_between(ux * beam_x + uy * beam_y, ux * beam_y - uy * beam_x)
    var_t = square * var_b
    cc, cs, ss = ux * ux, ux * uy, uy * uy
    rr = cc * p00 + 2.0 * cs * p01 + ss * p11
    rt = cs * (p11 - p00) + (cc - ss) * p01
    tt = ss * p00 - 2.0 * cs * p01 + cc * p11
    det_p = p00 * p11 - p01 * p01
    along, across = det_p + rr * var_t, det_p + tt * var_r
    det = along + var_r * (tt + var_t)
    scale = 1.0 / det
    step_r = (along * nu_r + rt * var_r * nu_t) * scale
    step_t = (rt * var_t * nu_r + across * nu_t) * scale
    nis = (nu_r * nu_r * (tt + var_t) - 2.0 * nu_r * nu_t * rt + nu_t * nu_t * (rr + var_r)) * scale
    new_rr, new_rt, new_tt = var_r * along * scale, var_r * var_t * rt * scale, var_t * across * scale
    return (
        ux * step_r - uy * step_t,
        uy * step_r + ux * step_t,
        cc * new_rr - 2.0 * cs * new_rt + ss * new_tt,
        cs * (new_rr - new_tt) + (cc - ss) * new_rt,
        ss * new_rr + 2.0 * cs * new_rt + cc * new_tt,
        nis,
        det * (inverse * inverse),
    )


@inline
def beam_cov(beam_x, beam_y, distance, var_r, var_b):
    """Covariance (xx, xy, yy) of the point that a return shows, seen from a known pose."""
    across = distance * distance * var_b
    return (
        var_r * beam_x * beam_x + across * beam_y * beam_y,
        (var_r - across) * beam_x * beam_y,
        var_r * beam_y * beam_y + across * beam_x * beam_x,
    )


@subroutine
def start_column(mx, my, pxx, pxy, pyy, x, y, cosine, sine, distance, cb, sb, var_r, var_b):
    """A landmark's first sighting, in every particle. All rows [N]; cb, sb: cosine and sine of the bearing."""
    for p in range(mx.size):
        beam_x, beam_y = cb * cosine[p] - sb * sine[p], sb * cosine[p] + cb * sine[p]
        mx[p] = x[p] + distance * beam_x
        my[p] = y[p] + distance * beam_y
        pxx[p], pxy[p], pyy[p] = beam_cov(beam_x, beam_y, distance, var_r, var_b)


@subroutine
def update_column(mx, my, pxx, pxy, pyy, x, y, cosine, sine, nis_sum, det_product, distance, cb, sb, var_r, var_b):
    """A landmark seen again: its EKF in every particle, and its share of the weight.

    All rows [N]. nis_sum and det_product gather nu' S^-1 nu and det S over the sweep's returns.
    """
    for p in range(mx.size):
        beam_x, beam_y = cb * cosine[p] - sb * sine[p], sb * cosine[p] + cb * sine[p]
        step_x, step_y, pxx[p], pxy[p], pyy[p], nis, det = assimilate(
            mx[p] - x[p], my[p] - y[p], pxx[p], pxy[p], pyy[p], distance, beam_x, beam_y, var_r, var_b
        )
        mx[p] += step_x
        my[p] += step_y
        nis_sum[p] += nis
        det_product[p] *= det


@subroutine
def share_outside(mx, my, pxx, pxy, pyy, x, y, cosine, sine, w, distance, cb, sb, var_r, var_b, gate):
    """Weight of the particles in which a return's NIS exceeds the gate."""
    share = 0.0
    for p in range(mx.size):
        beam_x, beam_y = cb * cosine[p] - sb * sine[p], sb * cosine[p] + cb * sine[p]
        nis = fit(mx[p] - x[p], my[p] - y[p], pxx[p], pxy[p], pyy[p], distance, beam_x, beam_y, var_r, var_b)[5]
        share += 0.0 if nis <= gate else w[p]
    return share


@subroutine
def gather_weights(log_w, nis_sum, det_product):
    """Put the gathered likelihoods into the log weights, and start gathering anew. Eq. (13), Wu and Sun 2013."""
    for p in range(log_w.size):
        log_w[p] -= 0.5 * (nis_sum[p] + log(det_product[p]))
        nis_sum[p] = 0.0
        det_product[p] = 1.0
