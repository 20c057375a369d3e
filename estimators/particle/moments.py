"""What a cloud of particles amounts to: means and covariances of the mixture, in the world's and the robot's frame.

Headings: the weighted mean direction with one wrapped correction; covariances from wrapped deviations, all taken from
the corrected mean: sums of squares, which no rounding makes negative, however small a weight. A component's own
covariance is part of the mixture's: sum w (P_i + d_i d_i'). A particle of weight zero is passed over, so that what it
holds cannot spoil the rest. All rows are [N]; sums over them vectorise.
"""

import math

from estimators.kernels.angles import wrap
from estimators.kernels.elementary import sincos, wrap_smooth
from estimators.kernels.jit import inline, subroutine
from estimators.kernels.linalg import nearest_covariance


@subroutine
def average(share, row):
    """Sum of share times row."""
    total = 0.0
    for p in range(share.size):
        total += share[p] * (row[p] if share[p] > 0.0 else 0.0)
    return total


@subroutine
def average_product(share, a, b):
    """Sum of share times a b."""
    total = 0.0
    for p in range(share.size):
        total += share[p] * (a[p] * b[p] if share[p] > 0.0 else 0.0)
    return total


@subroutine
def deviate(row, centre, out):
    """Deviations from a centre."""
    for p in range(row.size):
        out[p] = row[p] - centre


@subroutine
def deviate_angle(row, centre, turn, out):
    """Wrapped deviations from a direction, less their mean."""
    for p in range(row.size):
        out[p] = wrap_smooth(row[p] - centre) - turn


@subroutine
def mean_turn(share, row, centre):
    """Mean of the wrapped deviations from a direction."""
    total = 0.0
    for p in range(share.size):
        total += share[p] * (wrap_smooth(row[p] - centre) if share[p] > 0.0 else 0.0)
    return total


@subroutine
def pose_moments(pose, pose_cov, w, cosine, sine, mean, cov):
    """Mean [3] and covariance [3, 3] of weighted poses [3, N]; pose_cov: [6 or 0, N] each pose's own covariance."""
    x, y, heading = pose[0], pose[1], pose[2]
    c, s, mx, my = 0.0, 0.0, 0.0, 0.0
    for p in range(w.size):
        live = w[p] > 0.0
        c += w[p] * (cosine[p] if live else 0.0)
        s += w[p] * (sine[p] if live else 0.0)
        mx += w[p] * (x[p] if live else 0.0)
        my += w[p] * (y[p] if live else 0.0)
    centre = math.atan2(s, c)
    turn = mean_turn(w, heading, centre)
    s00, s01, s02, s11, s12, s22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for p in range(w.size):
        live = w[p] > 0.0
        dx, dy = (x[p] - mx if live else 0.0), (y[p] - my if live else 0.0)
        dh = wrap_smooth(heading[p] - centre) - turn if live else 0.0
        s00 += w[p] * dx * dx
        s01 += w[p] * dx * dy
        s02 += w[p] * dx * dh
        s11 += w[p] * dy * dy
        s12 += w[p] * dy * dh
        s22 += w[p] * dh * dh
    mean[0], mean[1], mean[2] = mx, my, wrap(centre + turn)
    cov[0, 0], cov[0, 1], cov[0, 2], cov[1, 1], cov[1, 2], cov[2, 2] = s00, s01, s02, s11, s12, s22
    row = 0
    for i in range(3):
        for j in range(i, 3):
            cov[i, j] += average(w, pose_cov[row]) if pose_cov.shape[0] > 0 else 0.0
            cov[j, i] = cov[i, j]
            row += 1


@subroutine
def shares(log_hypothesis, hypotheses, w, share):
    """Weight of every hypothesis of every particle: [G, N]."""
    for g in range(hypotheses):
        for p in range(w.size):
            share[g, p] = w[p] if hypotheses == 1 else w[p] * math.exp(log_hypothesis[g, p])


@subroutine
def target_moments(target, hypotheses, share, twist, work, mean, cov):
    """Mean [n_t] and covariance [n_t, n_t] of the target over particles and hypotheses; work: [4, N] scratch."""
    n_t = mean.size
    for i in range(n_t):
        mean[i] = 0.0
        for g in range(hypotheses):
            mean[i] += average(share[g], target[g, i])
    if twist:
        mean[2] = _mean_direction(target, hypotheses, share)
    turn = 0.0
    for g in range(hypotheses if twist else 0):
        turn += mean_turn(share[g], target[g, 2], mean[2])
    for g in range(hypotheses):
        for i in range(n_t):
            if twist and i == 2:
                deviate_angle(target[g, i], mean[i], turn, work[i])
            else:
                deviate(target[g, i], mean[i], work[i])
        row = n_t
        for i in range(n_t):
            for j in range(i, n_t):
                part = average(share[g], target[g, row]) + average_product(share[g], work[i], work[j])
                cov[i, j] = part if g == 0 else cov[i, j] + part
                row += 1
    if twist:
        mean[2] = wrap(mean[2] + turn)
    for i in range(n_t):
        for j in range(i):
            cov[i, j] = cov[j, i]


@subroutine
def _mean_direction(target, hypotheses, share):
    cosine, sine = 0.0, 0.0
    for g in range(hypotheses):
        for p in range(share.shape[1]):
            s, c = sincos(target[g, 2, p])
            live = share[g, p] > 0.0
            cosine += share[g, p] * (c if live else 0.0)
            sine += share[g, p] * (s if live else 0.0)
    return math.atan2(sine, cosine)


@subroutine
def velocity_moments(target, hypotheses, share, cosine, sine, speed, mean, cov, relative):
    """A twist target's velocity: mean [2], covariance [2, 2] in the world, mean [2] along the robot's axes."""
    mx, my, along, left, s00, s01, s11 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for g in range(hypotheses):
        heading, variance, part = target[g, 2], target[g, 8], share[g]
        for p in range(cosine.size):
            live = part[p] > 0.0
            s, c = sincos(heading[p] if live else 0.0)
            var = max(variance[p] if live else 0.0, 0.0)
            vx, vy = part[p] * c, part[p] * s
            mx, my = mx + vx, my + vy
            along += (cosine[p] * vx + sine[p] * vy) if live else 0.0
            left += (cosine[p] * vy - sine[p] * vx) if live else 0.0
            # The heading's own variance moves the velocity across itself.
            s00 += vx * c + vy * s * var
            s01 += vx * s - vx * s * var
            s11 += vy * s + vx * c * var
    mean[0], mean[1], relative[0], relative[1] = speed * mx, speed * my, speed * along, speed * left
    square = speed * speed
    cov[0, 0], cov[1, 1] = square * max(s00 - mx * mx, 0.0), square * max(s11 - my * my, 0.0)
    cov[0, 1] = cov[1, 0] = square * (s01 - mx * my)


@subroutine
def turned_velocity(vx, vy, share, cosine, sine, relative):
    """Mean [2] of velocities given per particle, along the robot's axes."""
    along, left = 0.0, 0.0
    for p in range(vx.size):
        live = share[p] > 0.0
        along += share[p] * (cosine[p] * vx[p] + sine[p] * vy[p] if live else 0.0)
        left += share[p] * (cosine[p] * vy[p] - sine[p] * vx[p] if live else 0.0)
    relative[0], relative[1] = along, left


@inline
def relative_origin(x, y, pose, cosine, sine):
    """Where the first particle sees a point: the mean is summed about it, so that no digits are lost."""
    dx, dy = x - pose[0, 0], y - pose[1, 0]
    u, v = cosine[0] * dx + sine[0] * dy, cosine[0] * dy - sine[0] * dx
    return (u, v) if u + v == u + v else (0.0, 0.0)  # NaN in a particle without weight


@subroutine
def relative_mean(tx, ty, share, pose, cosine, sine, x0, y0):
    """Mean, less (x0, y0), of a point given per particle, in each particle's own frame. All rows [N]."""
    mx, my = 0.0, 0.0
    for p in range(share.size):
        live = share[p] > 0.0
        dx, dy = tx[p] - pose[0, p], ty[p] - pose[1, p]
        mx += share[p] * (cosine[p] * dx + sine[p] * dy - x0 if live else 0.0)
        my += share[p] * (cosine[p] * dy - sine[p] * dx - y0 if live else 0.0)
    return mx, my


@subroutine
def relative_spread(tx, ty, p00, p01, p11, share, pose, pose_cov, cosine, sine, mx, my):
    """Second moments (uu, uv, vv) of that point about its mean (mx, my), its own covariance included.

    pose_cov: [6 or 0, N]; a pose that is uncertain itself adds J P J', J = [-R', (v, -u)], to the point's covariance.
    """
    s00, s01, s11 = 0.0, 0.0, 0.0
    for p in range(share.size):
        live = share[p] > 0.0
        w, c, s = share[p], cosine[p], sine[p]
        dx, dy = tx[p] - pose[0, p], ty[p] - pose[1, p]
        u, v = c * dx + s * dy - mx, c * dy - s * dx - my
        q00, q01, q11 = turned(c * c, c * s, s * s, p00[p], p01[p], p11[p])
        s00 += w * (q00 + u * u if live else 0.0)
        s01 += w * (q01 + u * v if live else 0.0)
        s11 += w * (q11 + v * v if live else 0.0)
    if pose_cov.shape[0] == 0:
        return s00, s01, s11
    for p in range(share.size):
        live = share[p] > 0.0
        w, c, s = share[p], cosine[p], sine[p]
        dx, dy = tx[p] - pose[0, p], ty[p] - pose[1, p]
        u, v = c * dx + s * dy, c * dy - s * dx
        along, left = c * pose_cov[2, p] + s * pose_cov[4, p], c * pose_cov[4, p] - s * pose_cov[2, p]
        turn = pose_cov[5, p]
        q00, q01, q11 = turned(c * c, c * s, s * s, pose_cov[0, p], pose_cov[1, p], pose_cov[3, p])
        s00 += w * (q00 - 2.0 * v * along + v * v * turn if live else 0.0)
        s01 += w * (q01 + u * along - v * left - u * v * turn if live else 0.0)
        s11 += w * (q11 + 2.0 * u * left + u * u * turn if live else 0.0)
    return s00, s01, s11


@inline
def turned(cc, cs, ss, a, b, d):
    """A covariance (xx, xy, yy) along axes turned by the angle of these products of cosine and sine."""
    return cc * a + 2.0 * cs * b + ss * d, cs * (d - a) + (cc - ss) * b, ss * a - 2.0 * cs * b + cc * d


@inline
def write_relative(mx, my, s00, s01, s11, mean, cov):
    """Mean [2] and covariance [2, 2]; seen from kilometres away, less than rounding may be left of the latter."""
    mean[0], mean[1] = mx, my
    cov[0, 0], cov[0, 1], cov[1, 1] = nearest_covariance(s00, s01, s11)
    cov[1, 0] = cov[0, 1]


@subroutine
def landmark_moments(mx, my, pxx, pxy, pyy, w, mean, cov):
    """Mean [2] and covariance [2, 2] of one landmark over the particles, in the world's frame."""
    x, y = average(w, mx), average(w, my)
    s00, s01, s11 = 0.0, 0.0, 0.0
    for p in range(w.size):
        live = w[p] > 0.0
        dx, dy = mx[p] - x, my[p] - y
        s00 += w[p] * (pxx[p] + dx * dx if live else 0.0)
        s01 += w[p] * (pxy[p] + dx * dy if live else 0.0)
        s11 += w[p] * (pyy[p] + dy * dy if live else 0.0)
    mean[0], mean[1], cov[0, 0], cov[1, 1] = x, y, s00, s11
    cov[0, 1] = cov[1, 0] = s01


@subroutine
def direction_variance(vx, vy, c00, c01, c11):
    """Variance of the direction of an uncertain velocity, at most that of a uniform one."""
    square = vx * vx + vy * vy
    uniform = math.pi * math.pi / 3.0
    if not square > 0.0:
        return uniform
    return min(uniform, (vy * vy * c00 - 2.0 * vx * vy * c01 + vx * vx * c11) / (square * square))
