"""One landmark in all particles: a column of small EKFs, started and updated in one vectorised pass.

A particle knows its pose, so a landmark's EKF sees S = A P A' + R, A = dh/d(landmark), and nothing else.
"""

import math

from estimators.kernels.elementary import angle_between, log
from estimators.kernels.jit import disjoint, inline

CLOSEST = 1e-6  # [m] below this distance the bearing's gradient is taken at it


@inline
def sight(dx, dy, beam_x, beam_y):
    """Predicted range of a point at D = (dx, dy) from the robot, and by how much a return's bearing differs.

    beam_x, beam_y: the measured bearing as a unit vector in the world's axes.
    """
    square = dx * dx + dy * dy
    r = math.sqrt(square if square > CLOSEST * CLOSEST else CLOSEST * CLOSEST)
    return r, angle_between(dx * beam_x + dy * beam_y, dx * beam_y - dy * beam_x, r)


@inline
def displace(dx, dy, r, nu_b, distance, var_r, var_b):
    """A return as a measurement of the point itself: innovation nu and noise W in the world's axes.

    Along u = D/r lies the range, across it, v = J u, r times the bearing: nu = u nu_r + v r nu_b and
    W = var_r u u' + r^2 var_b v v', written with D = r u and J D = r v. In these axes A = dh/dD is the identity, and
    S = P + W.

    Args:
        r, nu_b: see `sight`; distance: measured range. var_r, var_b: the sensor's variances.

    Returns:
        nu (x, y), W (xx, xy, yy), det W, 1/r^2: what turns det S into the sensor's units.
    """
    inverse = 1.0 / r
    along, units = (distance - r) * inverse, inverse * inverse
    of_d = var_r * units
    xx, xy, yy = dx * dx, dx * dy, dy * dy
    return (
        along * dx - nu_b * dy,
        along * dy + nu_b * dx,
        of_d * xx + var_b * yy,
        (of_d - var_b) * xy,
        of_d * yy + var_b * xx,
        var_r * var_b * (r * r),
        units,
    )


@inline
def fit_sighted(dx, dy, p00, p01, p11, r, nu_b, distance, var_r, var_b):
    """`fit` of a return whose `sight` is given."""
    nu_x, nu_y, w00, w01, w11, det_w, units = displace(dx, dy, r, nu_b, distance, var_r, var_b)
    det = p00 * p11 - p01 * p01 + det_w + p00 * w11 + p11 * w00 - 2.0 * p01 * w01
    scale = 1.0 / det
    i00, i01, i11 = (p11 + w11) * scale, -(p01 + w01) * scale, (p00 + w00) * scale
    b0, b1 = i00 * nu_x + i01 * nu_y, i01 * nu_x + i11 * nu_y
    return b0, b1, i00, i01, i11, nu_x * b0 + nu_y * b1, det * units


@inline
def fit(dx, dy, p00, p01, p11, distance, beam_x, beam_y, var_r, var_b):
    """Innovation of one return against a point at D = (dx, dy) from the robot with covariance P.

    With A = dh/dD the update of anything correlated with the point is mean += C b and cov -= C A2 C', C its
    covariance with the point: b = A' S^-1 nu, A2 = A' S^-1 A. Eqs. (14) and (18), Wu and Sun 2013.

    Args:
        distance: measured range; beam_x, beam_y: measured bearing as a unit vector in the world's axes.
        var_r, var_b: the sensor's variances.

    Returns:
        b0, b1, a00, a01, a11, nu' S^-1 nu, det S.
    """
    r, nu_b = sight(dx, dy, beam_x, beam_y)
    return fit_sighted(dx, dy, p00, p01, p11, r, nu_b, distance, var_r, var_b)


@inline
def assimilate_sighted(dx, dy, p00, p01, p11, r, nu_b, distance, var_r, var_b):
    """`assimilate` a return whose `sight` is given.

    With S = P + W the mean moves by P S^-1 nu, and the posterior covariance P S^-1 W is
    (det W P + det P W) / det S: the same as (I - K H) P, without a cancellation and in half the operations.
    """
    nu_x, nu_y, w00, w01, w11, det_w, units = displace(dx, dy, r, nu_b, distance, var_r, var_b)
    det_p = p00 * p11 - p01 * p01
    det = det_p + det_w + p00 * w11 + p11 * w00 - 2.0 * p01 * w01
    scale = 1.0 / det
    b0 = ((p11 + w11) * nu_x - (p01 + w01) * nu_y) * scale
    b1 = ((p00 + w00) * nu_y - (p01 + w01) * nu_x) * scale
    of_p, of_w = det_w * scale, det_p * scale
    return (
        p00 * b0 + p01 * b1,
        p01 * b0 + p11 * b1,
        of_p * p00 + of_w * w00,
        of_p * p01 + of_w * w01,
        of_p * p11 + of_w * w11,
        nu_x * b0 + nu_y * b1,
        det * units,
    )


@inline
def assimilate(dx, dy, p00, p01, p11, distance, beam_x, beam_y, var_r, var_b):
    """A landmark's whole EKF update.

    Args: as `fit`.

    Returns:
        The step of the mean (x, y), the posterior covariance (xx, xy, yy), nu' S^-1 nu, det S.
    """
    r, nu_b = sight(dx, dy, beam_x, beam_y)
    return assimilate_sighted(dx, dy, p00, p01, p11, r, nu_b, distance, var_r, var_b)


@inline
def beam_cov(beam_x, beam_y, distance, var_r, var_b):
    """Covariance (xx, xy, yy) of the point that a return shows, seen from a known pose."""
    across = distance * distance * var_b
    return (
        var_r * beam_x * beam_x + across * beam_y * beam_y,
        (var_r - across) * beam_x * beam_y,
        var_r * beam_y * beam_y + across * beam_x * beam_x,
    )


@disjoint
def start_column(mx, my, pxx, pxy, pyy, x, y, cosine, sine, distance, cb, sb, var_r, var_b):
    """A landmark's first sighting, in every particle. All rows [N]; cb, sb: cosine and sine of the bearing."""
    for p in range(mx.size):
        beam_x, beam_y = cb * cosine[p] - sb * sine[p], sb * cosine[p] + cb * sine[p]
        mx[p] = x[p] + distance * beam_x
        my[p] = y[p] + distance * beam_y
        pxx[p], pxy[p], pyy[p] = beam_cov(beam_x, beam_y, distance, var_r, var_b)


@disjoint
def sight_column(mx, my, x, y, cosine, sine, cb, sb, r, nu_b):
    """`sight` in every particle, all rows [N]; r, nu_b: written.

    A pass of its own: what needs roots and angles waits long for each result, and short loops overlap in the processor.
    """
    for p in range(mx.size):
        beam_x, beam_y = cb * cosine[p] - sb * sine[p], sb * cosine[p] + cb * sine[p]
        r[p], nu_b[p] = sight(mx[p] - x[p], my[p] - y[p], beam_x, beam_y)


@disjoint
def fit_column(mx, my, p00, p01, p11, x, y, t0, t1, t2, t3, t4, t5, t6, distance, var_r, var_b):
    """`fit` in every particle, all rows [N]. t0 to t6: its terms, written; t0 and t1 come from `sight_column`."""
    for p in range(mx.size):
        t0[p], t1[p], t2[p], t3[p], t4[p], t5[p], t6[p] = fit_sighted(
            mx[p] - x[p], my[p] - y[p], p00[p], p01[p], p11[p], t0[p], t1[p], distance, var_r, var_b
        )


@disjoint
def update_column(mx, my, pxx, pxy, pyy, x, y, r, nu_b, nis_sum, det_product, distance, var_r, var_b):
    """A landmark seen again: its EKF in every particle, and its share of the weight.

    All rows [N]. r, nu_b: from `sight_column`. nis_sum and det_product gather nu' S^-1 nu and det S over the sweep's
    returns.
    """
    for p in range(mx.size):
        step_x, step_y, pxx[p], pxy[p], pyy[p], nis, det = assimilate_sighted(
            mx[p] - x[p], my[p] - y[p], pxx[p], pxy[p], pyy[p], r[p], nu_b[p], distance, var_r, var_b
        )
        mx[p] += step_x
        my[p] += step_y
        nis_sum[p] += nis
        det_product[p] *= det


@disjoint
def share_outside(mx, my, pxx, pxy, pyy, x, y, cosine, sine, w, distance, cb, sb, var_r, var_b, gate):
    """Weight of the particles in which a return's NIS exceeds the gate."""
    share = 0.0
    for p in range(mx.size):
        beam_x, beam_y = cb * cosine[p] - sb * sine[p], sb * cosine[p] + cb * sine[p]
        nis = fit(mx[p] - x[p], my[p] - y[p], pxx[p], pxy[p], pyy[p], distance, beam_x, beam_y, var_r, var_b)[5]
        share += 0.0 if nis <= gate else w[p]
    return share


@disjoint
def gather_weights(log_w, nis_sum, det_product):
    """Put the gathered likelihoods into the log weights, and start gathering anew. Eq. (13), Wu and Sun 2013."""
    for p in range(log_w.size):
        log_w[p] -= 0.5 * (nis_sum[p] + log(det_product[p]))
        nis_sum[p] = 0.0
        det_product[p] = 1.0
