"""What a cloud of particles amounts to: means and covariances of the mixture, in the world's and the robot's frame.

Headings: the weighted mean direction with one wrapped correction; covariances from wrapped deviations. A component's
own covariance is part of the mixture's: sum w (P_i + d_i d_i'). A particle of weight zero is passed over, so that what
it holds cannot spoil the rest.
"""

import math

from estimators.kernels.angles import wrap
from estimators.kernels.elementary import sincos, wrap_smooth
from estimators.kernels.jit import inline, jit


@jit
def pose_moments(pose, w, mean, cov):
    """Mean [3] and covariance [3, 3] of weighted poses [3, N]."""
    cosine, sine = 0.0, 0.0
    x0, y0 = 0.0, 0.0
    for p in range(w.size):
        if w[p] > 0.0:
            s, c = sincos(pose[2, p])
            cosine += w[p] * c
            sine += w[p] * s
            x0 += w[p] * pose[0, p]
            y0 += w[p] * pose[1, p]
    h0 = math.atan2(sine, cosine)
    dh = 0.0
    s00, s01, s02, s11, s12, s22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for p in range(w.size):
        if w[p] > 0.0:
            a, b, c = pose[0, p] - x0, pose[1, p] - y0, wrap_smooth(pose[2, p] - h0)
            dh += w[p] * c
            s00, s01, s02 = s00 + w[p] * a * a, s01 + w[p] * a * b, s02 + w[p] * a * c
            s11, s12, s22 = s11 + w[p] * b * b, s12 + w[p] * b * c, s22 + w[p] * c * c
    mean[0], mean[1], mean[2] = x0, y0, wrap(h0 + dh)
    _symmetric(cov, s00, s01, s02, s11, s12, s22 - dh * dh)


@inline
def _symmetric(cov, s00, s01, s02, s11, s12, s22):
    cov[0, 0], cov[1, 1], cov[2, 2] = s00, s11, s22
    cov[0, 1] = cov[1, 0] = s01
    cov[0, 2] = cov[2, 0] = s02
    cov[1, 2] = cov[2, 1] = s12


@jit
def target_moments(target, log_hypothesis, hypotheses, w, twist, mean, cov):
    """Mean [n_t] and covariance [n_t, n_t] of the target over particles and hypotheses."""
    n_t = mean.size
    _target_mean(target, log_hypothesis, hypotheses, w, twist, mean)
    correction = 0.0
    for i in range(n_t):
        for j in range(n_t):
            cov[i, j] = 0.0
    for g in range(hypotheses):
        for p in range(w.size):
            share = _share(w[p], log_hypothesis[g, p], hypotheses)
            if not share > 0.0:
                continue
            row = n_t
            for i in range(n_t):
                d_i = target[g, i, p] - mean[i]
                if twist and i == 2:
                    d_i = wrap_smooth(d_i)
                    correction += share * d_i
                for j in range(i, n_t):
                    d_j = target[g, j, p] - mean[j]
                    if twist and j == 2:
                        d_j = wrap_smooth(d_j)
                    cov[i, j] += share * (target[g, row, p] + d_i * d_j)
                    row += 1
    if twist:
        cov[2, 2] -= correction * correction
        mean[2] = wrap(mean[2] + correction)
    for i in range(n_t):
        for j in range(i):
            cov[i, j] = cov[j, i]


@inline
def _share(weight, log_hypothesis, hypotheses):
    return weight if hypotheses == 1 else weight * math.exp(log_hypothesis)


@inline
def _target_mean(target, log_hypothesis, hypotheses, w, twist, mean):
    """Weighted mean; of a heading the mean direction, still to be corrected by the wrapped deviations."""
    n_t = mean.size
    cosine, sine = 0.0, 0.0
    for i in range(n_t):
        mean[i] = 0.0
    for g in range(hypotheses):
        for p in range(w.size):
            share = _share(w[p], log_hypothesis[g, p], hypotheses)
            if not share > 0.0:
                continue
            for i in range(n_t):
                mean[i] += share * target[g, i, p]
            if twist:
                s, c = sincos(target[g, 2, p])
                cosine += share * c
                sine += share * s
    if twist:
        mean[2] = math.atan2(sine, cosine)


@jit
def motion_moments(target, log_hypothesis, hypotheses, w, pose, twist, speed, mean, cov, relative):
    """The target's velocity: mean [2] and covariance [2, 2] in the world, mean [2] along the robot's axes."""
    for i in range(2):
        mean[i], relative[i] = 0.0, 0.0
    s00, s01, s11 = 0.0, 0.0, 0.0
    for g in range(hypotheses):
        for p in range(w.size):
            share = _share(w[p], log_hypothesis[g, p], hypotheses)
            if not share > 0.0:
                continue
            if twist:
                s, c = sincos(target[g, 2, p])
                vx, vy, spread = speed * c, speed * s, speed * speed * target[g, 8, p]
                p00, p01, p11 = spread * s * s, -spread * s * c, spread * c * c
            else:
                vx, vy = target[g, 2, p], target[g, 3, p]
                p00, p01, p11 = target[g, 11, p], target[g, 12, p], target[g, 13, p]
            s, c = sincos(pose[2, p])
            mean[0] += share * vx
            mean[1] += share * vy
            relative[0] += share * (c * vx + s * vy)
            relative[1] += share * (c * vy - s * vx)
            s00, s01, s11 = s00 + share * (p00 + vx * vx), s01 + share * (p01 + vx * vy), s11 + share * (p11 + vy * vy)
    cov[0, 0], cov[1, 1] = max(s00 - mean[0] * mean[0], 0.0), max(s11 - mean[1] * mean[1], 0.0)
    cov[0, 1] = cov[1, 0] = s01 - mean[0] * mean[1]


@jit
def relative_moments(tx, ty, p00, p01, p11, log_hypothesis, hypotheses, pose, w, mean, cov):
    """A point given per particle, in each particle's own frame: mean [2], covariance [2, 2] of the mixture.

    tx ... p11: [G, N], the hypotheses' positions and covariances (G = 1 for a landmark).
    """
    first = True
    x0, y0, mx, my = 0.0, 0.0, 0.0, 0.0
    s00, s01, s11 = 0.0, 0.0, 0.0
    for g in range(hypotheses):
        for p in range(w.size):
            share = _share(w[p], log_hypothesis[g, p], hypotheses)
            if not share > 0.0:
                continue
            s, c = sincos(pose[2, p])
            dx, dy = tx[g, p] - pose[0, p], ty[g, p] - pose[1, p]
            u, v = c * dx + s * dy, c * dy - s * dx
            if first:  # sums about a point of the cloud lose no digits
                x0, y0, first = u, v, False
            u, v = u - x0, v - y0
            a, b, d = p00[g, p], p01[g, p], p11[g, p]
            mx, my = mx + share * u, my + share * v
            s00 += share * (c * c * a + 2.0 * c * s * b + s * s * d + u * u)
            s01 += share * (c * s * (d - a) + (c * c - s * s) * b + u * v)
            s11 += share * (s * s * a - 2.0 * c * s * b + c * c * d + v * v)
    mean[0], mean[1] = x0 + mx, y0 + my
    cov[0, 0], cov[1, 1] = s00 - mx * mx, s11 - my * my
    cov[0, 1] = cov[1, 0] = s01 - mx * my


@jit
def landmark_moments(mx, my, pxx, pxy, pyy, w, mean, cov):
    """Mean [2] and covariance [2, 2] of one landmark over the particles (rows [N]), in the world's frame."""
    x0, y0 = 0.0, 0.0
    for p in range(w.size):
        if w[p] > 0.0:
            x0 += w[p] * mx[p]
            y0 += w[p] * my[p]
    s00, s01, s11 = 0.0, 0.0, 0.0
    for p in range(w.size):
        if w[p] > 0.0:
            a, b = mx[p] - x0, my[p] - y0
            s00, s01, s11 = s00 + w[p] * (pxx[p] + a * a), s01 + w[p] * (pxy[p] + a * b), s11 + w[p] * (pyy[p] + b * b)
    mean[0], mean[1] = x0, y0
    cov[0, 0], cov[1, 1] = s00, s11
    cov[0, 1] = cov[1, 0] = s01


@jit
def direction_variance(vx, vy, c00, c01, c11):
    """Variance of the direction of an uncertain velocity, at most that of a uniform one."""
    square = vx * vx + vy * vy
    uniform = math.pi * math.pi / 3.0
    if not square > 0.0:
        return uniform
    return min(uniform, (vy * vy * c00 - 2.0 * vx * vy * c01 + vx * vx * c11) / (square * square))
