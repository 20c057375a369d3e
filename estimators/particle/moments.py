"""What a cloud of particles amounts to: means and covariances of the mixture, in the world's and the robot's frame.

Headings: the weighted mean direction with one wrapped correction; covariances from wrapped deviations. A component's
own covariance is part of the mixture's: sum w (P_i + d_i d_i'). A particle of weight zero is passed over, so that what
it holds cannot spoil the rest. All rows are [N]; sums over them vectorise.
"""

import math

from estimators.kernels.angles import wrap
from estimators.kernels.elementary import sincos, wrap_smooth
from estimators.kernels.jit import inline, jit


@inline
def average(share, row):
    """Sum of share times row."""
    total = 0.0
    for p in range(share.size):
        total += share[p] * (row[p] if share[p] > 0.0 else 0.0)
    return total


@inline
def average_product(share, a, b):
    """Sum of share times a b."""
    total = 0.0
    for p in range(share.size):
        total += share[p] * (a[p] * b[p] if share[p] > 0.0 else 0.0)
    return total


@inline
def deviate(row, centre, out):
    """Deviations from a centre."""
    for p in range(row.size):
        out[p] = row[p] - centre


@inline
def deviate_angle(row, centre, out):
    """Wrapped deviations from a direction."""
    for p in range(row.size):
        out[p] = wrap_smooth(row[p] - centre)


@jit
def pose_moments(pose, pose_cov, w, cosine, sine, work, mean, cov):
    """Mean [3] and covariance [3, 3] of weighted poses [3, N].

    pose_cov: [6 or 0, N] each pose's own covariance. work: [3, N] scratch.
    """
    centre = math.atan2(average(w, sine), average(w, cosine))
    mean[0], mean[1] = average(w, pose[0]), average(w, pose[1])
    deviate(pose[0], mean[0], work[0])
    deviate(pose[1], mean[1], work[1])
    deviate_angle(pose[2], centre, work[2])
    correction = average(w, work[2])
    mean[2] = wrap(centre + correction)
    for i in range(3):
        for j in range(i, 3):
            cov[i, j] = cov[j, i] = average_product(w, work[i], work[j])
    cov[2, 2] = max(cov[2, 2] - correction * correction, 0.0)
    row = 0
    if pose_cov.shape[0] > 0:
        for i in range(3):
            for j in range(i, 3):
                cov[i, j] += average(w, pose_cov[row])
                cov[j, i] = cov[i, j]
                row += 1


@jit
def shares(log_hypothesis, hypotheses, w, share):
    """Weight of every hypothesis of every particle: [G, N]."""
    for g in range(hypotheses):
        for p in range(w.size):
            share[g, p] = w[p] if hypotheses == 1 else w[p] * math.exp(log_hypothesis[g, p])


@jit
def target_moments(target, hypotheses, share, twist, work, mean, cov):
    """Mean [n_t] and covariance [n_t, n_t] of the target over particles and hypotheses; work: [4, N] scratch."""
    n_t = mean.size
    for i in range(n_t):
        mean[i] = 0.0
        for g in range(hypotheses):
            mean[i] += average(share[g], target[g, i])
    if twist:
        mean[2] = _mean_direction(target, hypotheses, share)
    correction = 0.0
    for g in range(hypotheses):
        for i in range(n_t):
            if twist and i == 2:
                deviate_angle(target[g, i], mean[i], work[i])
                correction += average(share[g], work[i])
            else:
                deviate(target[g, i], mean[i], work[i])
        row = n_t
        for i in range(n_t):
            for j in range(i, n_t):
                part = average(share[g], target[g, row]) + average_product(share[g], work[i], work[j])
                cov[i, j] = part if g == 0 else cov[i, j] + part
                row += 1
    if twist:
        cov[2, 2] -= correction * correction
        mean[2] = wrap(mean[2] + correction)
    for i in range(n_t):
        for j in range(i):
            cov[i, j] = cov[j, i]


@inline
def _mean_direction(target, hypotheses, share):
    cosine, sine = 0.0, 0.0
    for g in range(hypotheses):
        for p in range(share.shape[1]):
            s, c = sincos(target[g, 2, p])
            live = share[g, p] > 0.0
            cosine += share[g, p] * (c if live else 0.0)
            sine += share[g, p] * (s if live else 0.0)
    return math.atan2(sine, cosine)


@jit
def velocity_moments(target, hypotheses, share, cosine, sine, speed, work, mean, cov, relative):
    """A twist target's velocity: mean [2], covariance [2, 2] in the world, mean [2] along the robot's axes.

    work: [6, N] scratch.
    """
    vx, vy, along, left, across = work[0], work[1], work[2], work[3], work[4]
    for i in range(2):
        mean[i] = relative[i] = 0.0
    s00, s01, s11 = 0.0, 0.0, 0.0
    for g in range(hypotheses):
        heading, variance = target[g, 2], target[g, 8]
        for p in range(cosine.size):
            s, c = sincos(heading[p])
            vx[p], vy[p] = speed * c, speed * s
            along[p], left[p] = cosine[p] * vx[p] + sine[p] * vy[p], cosine[p] * vy[p] - sine[p] * vx[p]
            across[p] = math.sqrt(max(variance[p], 0.0))
        mean[0] += average(share[g], vx)
        mean[1] += average(share[g], vy)
        relative[0] += average(share[g], along)
        relative[1] += average(share[g], left)
        s00 += average_product(share[g], vx, vx)
        s01 += average_product(share[g], vx, vy)
        s11 += average_product(share[g], vy, vy)
        for p in range(cosine.size):  # the heading's own variance moves the velocity across itself
            along[p], left[p] = -vy[p] * across[p], vx[p] * across[p]
        s00 += average_product(share[g], along, along)
        s01 += average_product(share[g], along, left)
        s11 += average_product(share[g], left, left)
    cov[0, 0], cov[1, 1] = max(s00 - mean[0] * mean[0], 0.0), max(s11 - mean[1] * mean[1], 0.0)
    cov[0, 1] = cov[1, 0] = s01 - mean[0] * mean[1]


@jit
def turned_velocity(vx, vy, share, cosine, sine, work, relative):
    """Mean [2] of velocities given per particle, along the robot's axes."""
    for p in range(vx.size):
        work[0, p], work[1, p] = cosine[p] * vx[p] + sine[p] * vy[p], cosine[p] * vy[p] - sine[p] * vx[p]
    relative[0], relative[1] = average(share, work[0]), average(share, work[1])


@jit
def relative_moments(tx, ty, p00, p01, p11, hypotheses, share, pose, pose_cov, cosine, sine, work, mean, cov):
    """A point given per particle, in each particle's own frame: mean [2], covariance [2, 2] of the mixture.

    tx ... p11, share: [G, N], the hypotheses' positions, covariances and weights (G = 1 for a landmark). work: [5, N].
    pose_cov: [6 or 0, N]; a pose that is uncertain itself adds to the point's covariance in its frame.
    """
    u, v, q00, q01, q11 = work[0], work[1], work[2], work[3], work[4]
    m0, m1, s00, s01, s11 = 0.0, 0.0, 0.0, 0.0, 0.0
    x0 = cosine[0] * (tx[0, 0] - pose[0, 0]) + sine[0] * (ty[0, 0] - pose[1, 0])
    y0 = cosine[0] * (ty[0, 0] - pose[1, 0]) - sine[0] * (tx[0, 0] - pose[0, 0])
    if not x0 + y0 == x0 + y0:  # NaN in a particle without weight
        x0, y0 = 0.0, 0.0
    for g in range(hypotheses):
        ax, ay, a, b, d, part = tx[g], ty[g], p00[g], p01[g], p11[g], share[g]
        for p in range(cosine.size):
            c, s = cosine[p], sine[p]
            dx, dy = ax[p] - pose[0, p], ay[p] - pose[1, p]
            u[p], v[p] = c * dx + s * dy - x0, c * dy - s * dx - y0  # about one of the cloud: no digits are lost
            q00[p] = c * c * a[p] + 2.0 * c * s * b[p] + s * s * d[p]
            q01[p] = c * s * (d[p] - a[p]) + (c * c - s * s) * b[p]
            q11[p] = s * s * a[p] - 2.0 * c * s * b[p] + c * c * d[p]
        if pose_cov.shape[0] > 0:
            _add_pose_cov(pose_cov, cosine, sine, x0, y0, u, v, q00, q01, q11)
        m0, m1 = m0 + average(part, u), m1 + average(part, v)
        s00 += average(part, q00) + average_product(part, u, u)
        s01 += average(part, q01) + average_product(part, u, v)
        s11 += average(part, q11) + average_product(part, v, v)
    mean[0], mean[1] = x0 + m0, y0 + m1
    cov[0, 0], cov[1, 1] = s00 - m0 * m0, s11 - m1 * m1
    cov[0, 1] = cov[1, 0] = s01 - m0 * m1


@inline
def _add_pose_cov(pose_cov, cosine, sine, x0, y0, u, v, q00, q01, q11):
    """J P J' with J = [-R', (v, -u)]: how a point at (x0 + u, y0 + v) in the robot's frame moves with the pose."""
    for p in range(u.size):
        c, s = cosine[p], sine[p]
        a, b, d = pose_cov[0, p], pose_cov[1, p], pose_cov[3, p]
        along, left, turn = (
            c * pose_cov[2, p] + s * pose_cov[4, p],
            c * pose_cov[4, p] - s * pose_cov[2, p],
            pose_cov[5, p],
        )
        rx, ry = x0 + u[p], y0 + v[p]
        q00[p] += c * c * a + 2.0 * c * s * b + s * s * d - 2.0 * ry * along + ry * ry * turn
        q01[p] += c * s * (d - a) + (c * c - s * s) * b + rx * along - ry * left - rx * ry * turn
        q11[p] += s * s * a - 2.0 * c * s * b + c * c * d + 2.0 * rx * left + rx * rx * turn


@jit
def landmark_moments(mx, my, pxx, pxy, pyy, w, work, mean, cov):
    """Mean [2] and covariance [2, 2] of one landmark over the particles, in the world's frame; work: [2, N]."""
    mean[0], mean[1] = average(w, mx), average(w, my)
    deviate(mx, mean[0], work[0])
    deviate(my, mean[1], work[1])
    cov[0, 0] = average(w, pxx) + average_product(w, work[0], work[0])
    cov[1, 1] = average(w, pyy) + average_product(w, work[1], work[1])
    cov[0, 1] = cov[1, 0] = average(w, pxy) + average_product(w, work[0], work[1])


@jit
def direction_variance(vx, vy, c00, c01, c11):
    """Variance of the direction of an uncertain velocity, at most that of a uniform one."""
    square = vx * vx + vy * vy
    uniform = math.pi * math.pi / 3.0
    if not square > 0.0:
        return uniform
    return min(uniform, (vy * vy * c00 - 2.0 * vx * vy * c01 + vx * vx * c11) / (square * square))
