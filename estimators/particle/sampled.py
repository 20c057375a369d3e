"""The improved proposal of Wang et al. 2019: each particle samples the sweep's posterior around its mode.

What a particle looks at is a list of returns with the points that it takes them for, see `looks`.
"""

import math

from estimators.kernels.elementary import sincos, wrap_smooth
from estimators.kernels.jit import inline, subroutine
from estimators.kernels.linalg import semidefinite_cholesky
from estimators.kernels.random import normal4, uniform4
from estimators.particle.columns import fit
from estimators.particle.layout import DRAW_SAMPLES

GAUSS_NEWTON_STEPS = 3  # the first is the EKF's, two more find the mode
FARTHEST = 1e3  # [standard deviations of the motion]: a mode beyond them is none, and the next one would be farther
BOX_FLOOR = 1e-6  # [m^2, rad^2] added to the motion's variances where a box is sampled: densities need full rank
WORK_ROWS = 12


@subroutine
def improve(key, step, p, pose, cov, looks, n_z, samples, work, box):
    """One particle's proposal, written over its Gaussian; returns log eta, Eq. (11).

    Poses are x = x_minus + L s, L L' the motion's covariance of any rank: s is standard normal a priori.
    """
    L, info, mode = work[0:3], work[3:6], work[6]
    boxed = box[0] > 0.0
    row = 0
    for i in range(3):
        for j in range(i, 3):
            L[j, i] = cov[row, p] + (BOX_FLOOR if boxed and i == j else 0.0)
            row += 1
    semidefinite_cholesky(L, 3)
    find_mode(pose, p, L, looks, n_z, info, mode, work)
    top = -math.inf
    for j in range(samples.shape[0]):
        s = samples[j]
        item = p * samples.shape[0] + j
        if boxed:
            log_q = _sample_box(key, step, item, L, mode, box, s)
        else:
            log_q = _sample_whitened(key, step, item, info, mode, s)
        s[3] = log_likelihood(pose, p, L, s, looks, n_z) - 0.5 * (s[0] * s[0] + s[1] * s[1] + s[2] * s[2]) - log_q
        s[3] = s[3] if s[3] == s[3] else -math.inf
        top = max(top, s[3])
    return _moments(pose, cov, p, L, samples, top, work[7], work[8:11])


@inline
def pose_at(pose, p, L, s0, s1, s2):
    """X = x_minus + L s."""
    return (
        pose[0, p] + L[0, 0] * s0,
        pose[1, p] + L[1, 0] * s0 + L[1, 1] * s1,
        pose[2, p] + L[2, 0] * s0 + L[2, 1] * s1 + L[2, 2] * s2,
    )


@inline
def look_at(look, x, y, cosine, sine):
    """`fit` of one return from one pose, and the displacement."""
    dx, dy = look[0] - x, look[1] - y
    beam_x, beam_y = look[6] * cosine - look[7] * sine, look[7] * cosine + look[6] * sine
    return dx, dy, fit(dx, dy, look[2], look[3], look[4], look[5], beam_x, beam_y, look[8], look[9])


@subroutine
def log_likelihood(pose, p, L, s, looks, n_z):
    """Log p(z | m, x) at x = x_minus + L s, the landmarks integrated out, up to a constant."""
    x, y, heading = pose_at(pose, p, L, s[0], s[1], s[2])
    sine, cosine = sincos(heading)
    total = 0.0
    for i in range(n_z):
        _, _, (_, _, _, _, _, nis, det) = look_at(looks[i], x, y, cosine, sine)
        total -= 0.5 * (nis + math.log(det))
    return total


@subroutine
def find_mode(pose, p, L, looks, n_z, info, mode, work):
    """Eq. (9) by Gauss-Newton: mode [3] in s; info [3, 3] becomes the Hessian's factor before its last step.

    A lost particle has no mode near: it goes no farther than `FARTHEST`.
    """
    gradient = work[7]
    for i in range(3):
        mode[i] = 0.0
    for _ in range(GAUSS_NEWTON_STEPS):
        x, y, heading = pose_at(pose, p, L, mode[0], mode[1], mode[2])
        sine, cosine = sincos(heading)
        for i in range(3):
            gradient[i] = -mode[i]
            for j in range(3):
                info[i, j] = 1.0 if i == j else 0.0
        for i in range(n_z):
            dx, dy, (b0, b1, a00, a01, a11, _, _) = look_at(looks[i], x, y, cosine, sine)
            # D = m - x - (-dy, dx) heading, so its gradient by s is -(L_x - dy L_h), -(L_y + dx L_h)
            for a in range(3):
                u, v = dy * L[2, a] - L[0, a], -L[1, a] - dx * L[2, a]
                gradient[a] += u * b0 + v * b1
                for b in range(a + 1):
                    e, f = dy * L[2, b] - L[0, b], -L[1, b] - dx * L[2, b]
                    info[a, b] += u * (a00 * e + a01 * f) + v * (a01 * e + a11 * f)
        semidefinite_cholesky(info, 3)
        for i in range(3):
            info[i, i] = max(info[i, i], 1.0)  # what the prior knows, also where the returns know 1e14 times as much
        g0 = gradient[0] / info[0, 0]
        g1 = (gradient[1] - info[1, 0] * g0) / info[1, 1]
        g2 = (gradient[2] - info[2, 0] * g0 - info[2, 1] * g1) / info[2, 2]
        t0, t1, t2 = back_substitute(info, g0, g1, g2)
        mode[0], mode[1], mode[2] = mode[0] + t0, mode[1] + t1, mode[2] + t2
        length = math.sqrt(mode[0] * mode[0] + mode[1] * mode[1] + mode[2] * mode[2])
        if length > FARTHEST:
            for i in range(3):
                mode[i] *= FARTHEST / length


@inline
def back_substitute(C, g0, g1, g2):
    """Solve C' t = g for a lower triangular C."""
    t2 = g2 / C[2, 2]
    t1 = (g1 - C[2, 1] * t2) / C[1, 1]
    return (g0 - C[1, 0] * t1 - C[2, 0] * t2) / C[0, 0], t1, t2


@inline
def _sample_whitened(key, step, item, info, mode, s):
    """S from the Gaussian of the Hessian at the mode; returns its log density up to a constant common to all."""
    a, b, c, _ = normal4(key, 0, step, DRAW_SAMPLES, item)
    t0, t1, t2 = back_substitute(info, a, b, c)
    s[0], s[1], s[2] = mode[0] + t0, mode[1] + t1, mode[2] + t2
    return math.log(info[0, 0] * info[1, 1] * info[2, 2]) - 0.5 * (a * a + b * b + c * c)


@inline
def _sample_box(key, step, item, L, mode, box, s):
    """Eq. (10) as printed: x uniform in the box around the mode; returns minus the log density of p(x) by s."""
    u, v, w, _ = uniform4(key, 0, step, DRAW_SAMPLES, item)
    d0, d1, d2 = box[0] * (2.0 * u - 1.0), box[1] * (2.0 * v - 1.0), box[2] * (2.0 * w - 1.0)
    t0 = d0 / L[0, 0]
    t1 = (d1 - L[1, 0] * t0) / L[1, 1]
    t2 = (d2 - L[2, 0] * t0 - L[2, 1] * t1) / L[2, 2]
    s[0], s[1], s[2] = mode[0] + t0, mode[1] + t1, mode[2] + t2
    return math.log(L[0, 0] * L[1, 1] * L[2, 2])


@subroutine
def _moments(pose, cov, p, L, samples, top, mean, second):
    """Eqs. (11)-(13) over the samples [S, 4] (s and its log weight), written over one pose's Gaussian; log eta."""
    total = 0.0
    for i in range(3):
        mean[i] = 0.0
        for j in range(3):
            second[i, j] = 0.0
    finite = -math.inf < top < math.inf
    for j in range(samples.shape[0]):
        samples[j, 3] = math.exp(samples[j, 3] - top) if finite else 1.0
        total += samples[j, 3]
        for i in range(3):
            mean[i] += samples[j, 3] * samples[j, i]
    for i in range(3):
        mean[i] /= total
    for j in range(samples.shape[0]):
        for a in range(3):
            for b in range(3):
                second[a, b] += samples[j, 3] / total * (samples[j, a] - mean[a]) * (samples[j, b] - mean[b])
    row = 0
    for i in range(3):
        for j in range(i, 3):
            value = 0.0
            for a in range(i + 1):
                for b in range(j + 1):
                    value += L[i, a] * second[a, b] * L[j, b]
            cov[row, p] = value
            row += 1
    x, y, heading = pose_at(pose, p, L, mean[0], mean[1], mean[2])
    pose[0, p], pose[1, p], pose[2, p] = x, y, wrap_smooth(heading)
    return top + math.log(total / samples.shape[0]) if finite else -math.inf
