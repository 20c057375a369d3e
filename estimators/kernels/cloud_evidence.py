"""What an empty sweep says about each point of a target cloud: detection probability, weights, resampling."""

import math

from estimators.kernels.cloud_motion import (
    DRAW_RESAMPLE,
    DRAW_ROUGHEN,
    MISS_FLOOR,
    ROUGHENING,
    SCATTER,
    X,
    Y,
    draw_anywhere,
    draws,
)
from estimators.kernels.elementary import angle_between
from estimators.kernels.jit import inline
from estimators.kernels.random import normal_pair
from estimators.kernels.resampling import move_columns, moves, systematic

EDGE = math.sqrt(3.0)  # half width of a uniform distribution in units of its standard deviation
SHARPEST = 1e-3  # [m] or [rad]: the narrowest edge


@inline
def share_beyond(margin, half):
    """Probability that `margin` plus an error uniform in +-half is positive."""
    share = 0.5 + 0.5 * margin / half
    return min(max(share, 0.0), 1.0)


@inline
def detection(lane, x, y, pose, pose_cov, model, mapped, landmark, landmark_cov, out):
    """Probability of a return from each of N points (x, y) [N] in the world: in range, in view, behind no pillar.

    Where the pose or a pillar's place is uncertain the edges are soft: an error with the believed deviation, taken as
    uniform, decides how likely the point is within. Pillars (`landmark` [L, M, 2] with its covariance, in the robot's
    frame) hide what lies on the far side, or inside, of a disc of `landmark_radius`. out [N]: written.
    """
    c, s = math.cos(pose[lane, 2]), math.sin(pose[lane, 2])
    variance = max(0.5 * (pose_cov[lane, 0, 0] + pose_cov[lane, 1, 1]), 0.0)
    turn_variance = max(pose_cov[lane, 2, 2], 0.0)
    range_edge = max(EDGE * math.sqrt(variance), SHARPEST)
    half_view, all_round = 0.5 * model.field_of_view, model.field_of_view >= 2.0 * math.pi - 1e-6
    for p in range(out.size):
        dx, dy = x[p] - pose[lane, 0], y[p] - pose[lane, 1]
        r = math.sqrt(dx * dx + dy * dy) + 1e-9
        share = share_beyond(model.max_range - r, range_edge)
        edge = EDGE * math.sqrt(turn_variance + variance / (r * r)) + SHARPEST
        off = abs(angle_between((c * dx + s * dy) / r, (c * dy - s * dx) / r, 1.0))
        view = 1.0 if all_round else share_beyond(half_view - off, edge)
        out[p] = model.detection_probability * share * view
    if model.landmark_radius > 0.0:
        for j in range(mapped.shape[1]):
            if mapped[lane, j]:
                _hide_behind(lane, j, x, y, c, s, pose, model, landmark, landmark_cov, out)


@inline
def _hide_behind(lane, j, x, y, c, s, pose, model, landmark, landmark_cov, out):
    """Multiply `out` by the probability that pillar j leaves each point in sight."""
    radius, lx, ly = model.landmark_radius, landmark[lane, j, 0], landmark[lane, j, 1]
    reach = model.max_range + radius
    if lx * lx + ly * ly > reach * reach:
        return
    ex, ey = c * lx - s * ly, s * lx + c * ly  # the pillar's offset in the world's axes
    variance = 0.5 * (landmark_cov[lane, j, 0, 0] + landmark_cov[lane, j, 1, 1])
    edge = max(EDGE * math.sqrt(max(variance, 0.0)), SHARPEST)
    for p in range(out.size):
        dx, dy = x[p] - pose[lane, 0], y[p] - pose[lane, 1]
        r = math.sqrt(dx * dx + dy * dy) + 1e-9
        along = (ex * dx + ey * dy) / r
        beyond = max(along - r, 0.0)  # the centre lies beyond the point by that much
        across = (ex * dy - ey * dx) / r
        distance = math.sqrt(across * across + beyond * beyond)
        hidden = share_beyond(radius - distance, edge) if along > 0.0 else 0.0
        out[p] *= 1.0 - hidden


@inline
def weigh(w, p_d, settings):
    """Bayes' rule for a sweep without a return, w <- w (1 - p_d) / sum; returns the effective number 1 / sum w^2.

    No miss counts as impossible: the factor is at least `miss_floor`, so that weights never vanish together.
    """
    total = 0.0
    for p in range(w.size):
        w[p] *= max(1.0 - p_d[p], settings[MISS_FLOOR])
    for p in range(w.size):  # a sum beside what is stored of two arrays would round by where they lie
        total += w[p]
    squares = 0.0
    for p in range(w.size):
        w[p] /= total
        squares += w[p] * w[p]
    return 1.0 / squares


@inline
def resample(rows, w, key, step, model, x, y, settings, copies, source, destination):
    """Systematic resampling with roughened copies; a share `scatter` of the points is born anew.

    Roughening: copies are moved by a deviation of `roughening` x the cloud's spread / sqrt(N) (Gordon, Salmond and
    Smith 1993).
    """
    n = w.size
    deviation = settings[ROUGHENING] * _spread(rows, w) / math.sqrt(n)
    u, _, _, _ = draws(key, step, DRAW_RESAMPLE, 0)
    systematic(w, u, copies)
    moved = moves(copies, source, destination)
    move_columns(rows, source, destination, moved)
    for i in range(moved):
        p = destination[i]
        u0, u1, _, _ = draws(key, step, DRAW_ROUGHEN, p)
        n0, n1 = normal_pair(u0, u1)
        rows[X, p] += deviation * n0
        rows[Y, p] += deviation * n1
    for p in range(n):
        w[p] = 1.0 / n
        _, _, u, _ = draws(key, step, DRAW_RESAMPLE, 1 + p)
        if u < settings[SCATTER]:
            draw_anywhere(p, rows, key, step, model, x, y, settings)


@inline
def _spread(rows, w):
    """Root of the summed position variances."""
    mx, my, square = 0.0, 0.0, 0.0
    for p in range(w.size):
        mx += w[p] * rows[X, p]
        my += w[p] * rows[Y, p]
        square += w[p] * (rows[X, p] * rows[X, p] + rows[Y, p] * rows[Y, p])
    return math.sqrt(max(square - mx * mx - my * my, 0.0))
