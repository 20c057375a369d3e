"""A particle whose pose is a small Gaussian: carried from sweep to sweep, conditioned on each return, then drawn.

This is FastSLAM 2's proposal (Montemerlo et al., IJCAI 2003), which knows what the sweep says. Everything is in
Kalman form: the covariance of one odometry step has rank 2 and a known start none, so it is never inverted.

    cov [6, N]: xx, xy, xh, yy, yh, hh of each particle's pose (h: heading)
"""

import math

from estimators.kernels.elementary import sincos, wrap_smooth
from estimators.kernels.jit import disjoint, inline, subroutine
from estimators.kernels.motion import calibrated, control_std
from estimators.kernels.range_bearing import noise_std
from estimators.models import BICYCLE
from estimators.particle.layout import DRAW_POSE
from estimators.particle.proposal import draw_normals, trigonometry
from estimators.particle.target import fit_point, gather_terms

POSE_COV_ROWS = 6
_PIVOT_FLOOR = 1e-14  # a pivot below this share of its variance is rounding: the direction is known


@disjoint
def predict_poses(x, y, heading, c00, c01, c02, c11, c12, c22, model, control_v, control_w, dt):
    """Mean and covariance of every pose through one step: cov = F cov F' + G Q G', Q the noise on both rates.

    A unicycle turns by w dt before it drives (Eq. 16, Wu and Sun 2013), a bicycle drives along heading + steering
    (Eq. 15, Tian et al. 2010): both drive d metres along an angle that the turning noise shifts.
    """
    v, w = calibrated(model, control_v, control_w)
    sv, sw = control_std(model, v, w, dt)
    way = v * dt
    shift, turn, turn_v, turn_w, var_v, var_w = w * dt, w * dt, 0.0, 1.0, (sv * dt) ** 2, (sw * dt) ** 2
    if model.motion_kind == BICYCLE:
        shift, turn_v = w, math.sin(w) / model.wheelbase
        turn, turn_w, var_w = way * turn_v, way * math.cos(w) / model.wheelbase, sw * sw
    for p in range(x.size):
        s, c = sincos(heading[p] + shift)
        f0, f1 = -way * s, way * c
        x[p] += f1
        y[p] -= f0
        heading[p] = wrap_smooth(heading[p] + turn)
        a02, a12, a22 = c02[p], c12[p], c22[p]
        c00[p] += 2.0 * f0 * a02 + f0 * f0 * (a22 + var_w) + var_v * c * c
        c01[p] += f0 * a12 + f1 * a02 + f0 * f1 * (a22 + var_w) + var_v * c * s
        c11[p] += 2.0 * f1 * a12 + f1 * f1 * (a22 + var_w) + var_v * s * s
        c02[p] = a02 + f0 * (a22 + turn_w * var_w) + var_v * turn_v * c
        c12[p] = a12 + f1 * (a22 + turn_w * var_w) + var_v * turn_v * s
        c22[p] = a22 + turn_w * turn_w * var_w + var_v * turn_v * turn_v


@inline
def displacement_cov(dx, dy, p00, p01, p11, c00, c01, c02, c11, c12, c22):
    """Covariance (xx, xy, yy) of a point as an uncertain robot sees it: of m - x - (-dy, dx) heading.

    A bearing changes with the heading as with a shift of the point across the line of sight, so both of the
    innovation's parts, S = H_x P_x H_x' + H_m P_m H_m' + R, are one covariance in front of the same A = dh/dD.
    """
    return (
        p00 + c00 - 2.0 * dy * c02 + dy * dy * c22,
        p01 + c01 + dx * c02 - dy * c12 - dx * dy * c22,
        p11 + c11 + 2.0 * dx * c12 + dx * dx * c22,
    )


@subroutine
def displacement_rows(pose, cov, mx, my, p00, p01, p11, out):
    """`displacement_cov` of one point in every particle. out: [3, N], written."""
    _displacement_rows(
        pose[0], pose[1], cov[0], cov[1], cov[2], cov[3], cov[4], cov[5], mx, my, p00, p01, p11, out[0], out[1], out[2]
    )


@disjoint
def _displacement_rows(x, y, c00, c01, c02, c11, c12, c22, mx, my, p00, p01, p11, q00, q01, q11):
    for p in range(mx.size):
        q00[p], q01[p], q11[p] = displacement_cov(
            mx[p] - x[p], my[p] - y[p], p00[p], p01[p], p11[p], c00[p], c01[p], c02[p], c11[p], c12[p], c22[p]
        )


@inline
def conditioned(dx, dy, c00, c01, c02, c11, c12, c22, b0, b1, a00, a01, a11):
    """A pose conditioned on a return whose `fit` is given: mean += C b, cov -= C A2 C', C = Cov(pose, D).

    Returns:
        The mean's step (x, y, heading) and the new covariance (xx, xy, xh, yy, yh, hh).
    """
    k00, k01 = dy * c02 - c00, -c01 - dx * c02
    k10, k11 = dy * c12 - c01, -c11 - dx * c12
    k20, k21 = dy * c22 - c02, -c12 - dx * c22
    g00, g01 = k00 * a00 + k01 * a01, k00 * a01 + k01 * a11
    g10, g11 = k10 * a00 + k11 * a01, k10 * a01 + k11 * a11
    g20, g21 = k20 * a00 + k21 * a01, k20 * a01 + k21 * a11
    return (
        k00 * b0 + k01 * b1,
        k10 * b0 + k11 * b1,
        k20 * b0 + k21 * b1,
        c00 - g00 * k00 - g01 * k01,
        c01 - g00 * k10 - g01 * k11,
        c02 - g00 * k20 - g01 * k21,
        c11 - g10 * k10 - g11 * k11,
        c12 - g10 * k20 - g11 * k21,
        c22 - g20 * k20 - g21 * k21,
    )


@subroutine
def condition_poses(pose, cov, mx, my, terms, cosine, sine):
    """Every pose conditioned on one return of the point (mx, my); its new cosine and sine. terms: [7, N], see `fit`."""
    _condition_rows(
        pose[0], pose[1], pose[2], cov[0], cov[1], cov[2], cov[3], cov[4], cov[5], mx, my, terms[0], terms[1],
        terms[2], terms[3], terms[4],
    )  # fmt: skip
    trigonometry(pose[2], cosine, sine)


@disjoint
def _condition_rows(x, y, heading, c00, c01, c02, c11, c12, c22, mx, my, b0, b1, a00, a01, a11):
    for p in range(mx.size):
        step_x, step_y, step_h, c00[p], c01[p], c02[p], c11[p], c12[p], c22[p] = conditioned(
            mx[p] - x[p], my[p] - y[p], c00[p], c01[p], c02[p], c11[p], c12[p], c22[p],
            b0[p], b1[p], a00[p], a01[p], a11[p],
        )  # fmt: skip
        x[p] += step_x
        y[p] += step_y
        heading[p] = wrap_smooth(heading[p] + step_h)


@subroutine
def condition_on_point(
    pose, cov, mx, my, p00, p01, p11, w, scratch, likelihood, distance, bearing, model, gate
):  # fmt: skip
    """Condition every pose on a return of one point, and gather the return's likelihood.

    Args:
        mx ... p11: [N] the point's mean and covariance in each particle.
        scratch: rows 0 and 1 the headings' cosines and sines, kept up to date; rows 4 to 13 overwritten.
        likelihood: [2, N] nu' S^-1 nu and det S gathered, S with the pose's and the point's covariance.
        gate: NIS above which, in particles of more than half the weight, the return is refused.

    Returns:
        Whether it was taken.
    """
    range_std, bearing_std = noise_std(model, distance)
    terms, seen = scratch[4:11], scratch[11:14]
    displacement_rows(pose, cov, mx, my, p00, p01, p11, seen)
    fit_point(
        mx, my, seen[0], seen[1], seen[2], terms, pose[0], pose[1], scratch[0], scratch[1], distance,
        math.cos(bearing), math.sin(bearing), range_std * range_std, bearing_std * bearing_std,
        model.iterate_spread,
    )  # fmt: skip
    if gate < math.inf:
        outside = 0.0
        for p in range(w.size):
            outside += 0.0 if terms[5, p] <= gate else w[p]
        if outside > 0.5:
            return False
    condition_poses(pose, cov, mx, my, terms, scratch[0], scratch[1])
    gather_terms(terms, likelihood)
    return True


@inline
def _root(pivot, variance):
    """Square root of a pivot and its inverse, both zero where only rounding is left."""
    live = pivot > _PIVOT_FLOOR * variance
    root = math.sqrt(pivot if live else 1.0)
    return (root if live else 0.0), (1.0 / root if live else 0.0)


@subroutine
def draw_poses(key, step, pose, cov, normals):
    """Draw each pose from its Gaussian, whose covariance is zero afterwards. normals: [4, N] scratch."""
    draw_normals(key, step, DRAW_POSE, normals)
    _draw_rows(
        pose[0], pose[1], pose[2], cov[0], cov[1], cov[2], cov[3], cov[4], cov[5], normals[0], normals[1], normals[2]
    )


@disjoint
def _draw_rows(x, y, heading, c00, c01, c02, c11, c12, c22, a, b, c):
    """X += L n, L the lower Cholesky factor of the covariance, of any rank; n = (a, b, c)."""
    for p in range(x.size):
        l00, i00 = _root(c00[p], c00[p])
        l10, l20 = c01[p] * i00, c02[p] * i00
        l11, i11 = _root(c11[p] - l10 * l10, c11[p])
        l21 = (c12[p] - l10 * l20) * i11
        l22, _ = _root(c22[p] - l20 * l20 - l21 * l21, c22[p])
        x[p] += l00 * a[p]
        y[p] += l10 * a[p] + l11 * b[p]
        heading[p] = wrap_smooth(heading[p] + l20 * a[p] + l21 * b[p] + l22 * c[p])
        c00[p] = c01[p] = c02[p] = c11[p] = c12[p] = c22[p] = 0.0
