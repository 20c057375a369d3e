"""A target cloud's life, lane by lane: born, moved, weighed, and what it learns (see `estimators.target_cloud`)."""

import math

from estimators.interface import TARGET
from estimators.kernels.cloud_evidence import detection, resample, weigh
from estimators.kernels.cloud_flight import flees, run_away
from estimators.kernels.cloud_motion import THRESHOLD, X, Y, draw_anywhere, draw_from_belief, move_points
from estimators.kernels.jit import inline, jit

FOLLOWING, LOST = 0, 1  # of a lane: the Gaussian belief says all; the points do
NEVER = -math.inf  # log odds that a target flees, where that is not learned
_TARGET_LABEL = TARGET


@jit
def begin(lanes, rows, w, key, step, mode, models, known, pose, settings):
    """A new episode: the Gaussian where there is a prior, else points anywhere."""
    for i in range(lanes.size):
        lane = lanes[i]
        step[lane] = 0
        mode[lane] = FOLLOWING
        if not known[lane]:
            _born_anywhere(lane, rows, w, key, step, mode, models, pose, settings)


@inline
def _born_anywhere(lane, rows, w, key, step, mode, models, pose, settings):
    mode[lane] = LOST
    for p in range(w.shape[1]):
        draw_anywhere(p, rows[lane], key[lane], step[lane], models[lane], pose[lane, 0], pose[lane, 1], settings)
        w[lane, p] = 1.0 / w.shape[1]


@jit
def move(lanes, rows, noise, key, step, mode, models, dt, pose, evasion, settings):
    """Points of lost targets move on."""
    for i in range(lanes.size):
        lane = lanes[i]
        step[lane] += 1
        if mode[lane] == LOST:
            if evasion[lane] > NEVER:
                run_away(evasion[lane], rows[lane], pose[lane, 0], pose[lane, 1], models[lane].max_range, settings)
            move_points(rows[lane], noise, key[lane], step[lane], models[lane], dt[lane], settings)


@jit
def foresee(lane, rows, key, step, mode, models, known, belief, dt, pose, evasion, settings, scratch, noise, ahead):
    """Positions of one lane's points at each of the coming steps, into `ahead` [T, N, 2]; the cloud stays as it is."""
    position, position_cov, velocity, velocity_cov, heading, heading_var = belief
    if mode[lane] == FOLLOWING and known[lane]:
        draw_from_belief(
            lane, scratch, key[lane], step[lane], models[lane], position, position_cov, velocity, velocity_cov,
            heading, heading_var,
        )  # fmt: skip
    else:
        scratch[:] = rows[lane]
    for t in range(ahead.shape[0]):
        if evasion[lane] > NEVER:
            run_away(evasion[lane], scratch, pose[lane, 0], pose[lane, 1], models[lane].max_range, settings)
        move_points(scratch, noise, key[lane], step[lane] + 1 + t, models[lane], dt, settings)
        for p in range(ahead.shape[1]):
            ahead[t, p, 0], ahead[t, p, 1] = scratch[X, p], scratch[Y, p]


@inline
def _is_seen(lane, labels, count):
    """Whether the target is among a sweep's returns."""
    seen = False
    for k in range(count[lane]):
        seen = seen or labels[lane, k] == _TARGET_LABEL
    return seen


@jit
def learn(lanes, labels, count, known, pose, position, velocity, since, models, evasion, settings):
    """Whether targets that are seen flee: log odds `evasion` [L], from courses; since [L] seconds since a sweep."""
    for i in range(lanes.size):
        lane = lanes[i]
        if known[lane] and _is_seen(lane, labels, count):
            evasion[lane] = flees(
                evasion[lane], pose[lane, 0], pose[lane, 1], position[lane, 0], position[lane, 1], velocity[lane, 0],
                velocity[lane, 1], models[lane].max_range, since[lane], settings,
            )  # fmt: skip
        since[lane] = 0.0


@jit
def look(labels, count, lanes, known, complete, mode, missed):
    """Sort the swept lanes: FOLLOWING where the target was seen; into `missed` where its absence says something.

    Returns:
        How many were written into `missed`.
    """
    n = 0
    for i in range(lanes.size):
        lane = lanes[i]
        if _is_seen(lane, labels, count):
            mode[lane] = FOLLOWING if known[lane] else mode[lane]
        elif complete[lane]:
            missed[n] = lane
            n += 1
    return n


@jit
def miss(
    lanes, rows, w, key, step, mode, models, known, pose, pose_cov, belief, mapped, landmark, landmark_cov, evidence,
    settings, p_d, copies, source, destination,
):  # fmt: skip
    """A sweep without a return: points of the Gaussian where the target is just lost, then weights, then resampling."""
    position, position_cov, velocity, velocity_cov, heading, heading_var = belief
    for i in range(lanes.size):
        lane = lanes[i]
        if mode[lane] == FOLLOWING and known[lane]:
            mode[lane] = LOST
            draw_from_belief(
                lane, rows[lane], key[lane], step[lane], models[lane], position, position_cov, velocity, velocity_cov,
                heading, heading_var,
            )  # fmt: skip
            w[lane, :] = 1.0 / w.shape[1]
        elif mode[lane] == FOLLOWING:
            _born_anywhere(lane, rows, w, key, step, mode, models, pose, settings)
        if not evidence:
            continue
        x, y = rows[lane, X], rows[lane, Y]
        detection(lane, x, y, pose, pose_cov, models[lane], mapped, landmark, landmark_cov, p_d)
        if weigh(w[lane], p_d, settings) < settings[THRESHOLD] * w.shape[1]:
            resample(
                rows[lane], w[lane], key[lane], step[lane], models[lane], pose[lane, 0], pose[lane, 1], settings,
                copies, source, destination,
            )  # fmt: skip


@jit
def fill(rows, w, key, step, mode, models, known, belief, scratch, points, weights):
    """Positions [L, N, 2] and weights [L, N] of every lane."""
    position, position_cov, velocity, velocity_cov, heading, heading_var = belief
    n = w.shape[1]
    for lane in range(w.shape[0]):
        follows = mode[lane] == FOLLOWING and known[lane]
        if follows:
            draw_from_belief(
                lane, scratch, key[lane], step[lane], models[lane], position, position_cov, velocity, velocity_cov,
                heading, heading_var,
            )  # fmt: skip
        source = scratch if follows else rows[lane]
        for p in range(n):
            points[lane, p, 0], points[lane, p, 1] = source[X, p], source[Y, p]
            weights[lane, p] = 1.0 / n if follows else w[lane, p]
