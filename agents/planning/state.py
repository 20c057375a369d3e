"""The few rows of a belief that a plan is about: robot, target, and the landmarks in reach.

x [n], P [n, n]: robot (x, y, heading), target (x, y, velocity_x, velocity_y), then (x, y) of each landmark that
matters, the nearest first. Rows that nothing in the plan can change or be changed by are left out.
"""

import math

from estimators.kernels.jit import inline, jit

TARGET, VELOCITY, MARK = 3, 5, 7  # first rows of the target, of its velocity, of the landmarks
_SINGULAR = 1e-12  # [m^2] added to variances that are divided by


@inline
def _nearest(pillars, count, px, py, reach, order):
    """Indices of the landmarks nearest to (px, py) within `reach`, into `order`; returns how many."""
    found = 0
    for j in range(count):
        square = (pillars[j, 0] - px) ** 2 + (pillars[j, 1] - py) ** 2
        if square > reach * reach:
            continue
        at = min(found, order.size - 1)
        if found == order.size:
            worst = order[at]
            if square >= (pillars[worst, 0] - px) ** 2 + (pillars[worst, 1] - py) ** 2:
                continue
        else:
            found += 1
        while at > 0 and square < (pillars[order[at - 1], 0] - px) ** 2 + (pillars[order[at - 1], 1] - py) ** 2:
            order[at] = order[at - 1]
            at -= 1
        order[at] = j
    return found


@jit
def from_joint(lane, mean, cov, n_t, velocity, velocity_cov, reach, order, rows, pillars, x, P):
    """The rows of a joint Gaussian; where its target has no velocity rows, those of the marginal.

    Args:
        lane: whose velocity marginals are read.
        mean, cov: [m], [m, m] of robot, target (n_t rows, position first) and all landmarks.
        n_t: 4: position and velocity; otherwise the velocity comes from `velocity` [L, 2], `velocity_cov` [L, 2, 2].
        reach: [m], farther landmarks do not matter.
        order: [K] scratch: numbers of the landmarks that matter.
        rows: [7 + 2 K] scratch.
        pillars: [M, 2], written: all landmarks.
        x, P: written.

    Returns:
        n, rows in use, and the number of pillars.
    """
    first = 3 + n_t
    count = (mean.size - first) // 2
    for j in range(count):
        pillars[j, 0], pillars[j, 1] = mean[first + 2 * j], mean[first + 2 * j + 1]
    found = _nearest(pillars, count, mean[0], mean[1], reach, order)
    for i in range(MARK):
        rows[i] = i if i < VELOCITY or n_t == 4 else -1
    for k in range(found):
        rows[MARK + 2 * k] = first + 2 * order[k]
        rows[MARK + 2 * k + 1] = first + 2 * order[k] + 1
    n = MARK + 2 * found
    for i in range(n):
        x[i] = mean[rows[i]] if rows[i] >= 0 else velocity[lane, i - VELOCITY]
        for k in range(n):
            P[i, k] = cov[rows[i], rows[k]] if rows[i] >= 0 and rows[k] >= 0 else 0.0
    if n_t != 4:
        for i in range(2):
            for k in range(2):
                P[VELOCITY + i, VELOCITY + k] = velocity_cov[lane, i, k]
    return n, count


@inline
def _couple(at, x, pose_cov, c00, c01, c11, relative, G, P):
    """Share a point's covariance C between what it has in common with the pose and what is its own.

    With J the point's Jacobian by the pose when it is fixed in the robot's frame, and Q = J P_pose J', the point's
    error is taken as lambda J (pose's error) plus an independent one. lambda makes the trace of the covariance
    relative to the robot, C + Q - 2 lambda Q, what the belief says, and is at most what leaves the own part
    C - lambda^2 Q positive. Fills G's rows with lambda J and P's block with the own part.
    """
    east, north = x[at] - x[0], x[at + 1] - x[1]
    a0 = pose_cov[0, 0] - north * pose_cov[0, 2]
    a1 = pose_cov[0, 1] - north * pose_cov[1, 2]
    a2 = pose_cov[0, 2] - north * pose_cov[2, 2]
    b1 = pose_cov[1, 1] + east * pose_cov[1, 2]
    b2 = pose_cov[1, 2] + east * pose_cov[2, 2]
    q00, q01, q11 = a0 - north * a2, a1 + east * a2, b1 + east * b2
    trace = max(q00 + q11, _SINGULAR)
    share = min(max(0.5 * (c00 + c11 + trace - relative) / trace, 0.0), 1.0)
    det = max(c00 * c11 - c01 * c01, _SINGULAR * _SINGULAR)
    half = 0.5 * (c11 * q00 - 2.0 * c01 * q01 + c00 * q11) / det
    largest = half + math.sqrt(max(half * half - (q00 * q11 - q01 * q01) / det, 0.0))  # eigenvalue of C^-1 Q
    if share * share * largest > 1.0:
        share = 1.0 / math.sqrt(largest)
    G[at, 0], G[at, 1], G[at, 2] = share, 0.0, -share * north
    G[at + 1, 0], G[at + 1, 1], G[at + 1, 2] = 0.0, share, share * east
    own = share * share
    P[at, at], P[at + 1, at + 1] = c00 - own * q00, c11 - own * q11
    P[at, at + 1] = P[at + 1, at] = c01 - own * q01


@jit
def from_marginals(
    lane, pose, pose_cov, position, position_cov, velocity, velocity_cov, target_rel_cov, mapped, landmarks,
    landmark_cov, landmark_rel_cov, reach, order, numbers, pillars, G, x, P,
):  # fmt: skip
    """The same rows where the family has no joint Gaussian: from marginals and covariances relative to the robot.

    What two points have in common is what each has in common with the pose (see `_couple`); the velocity is
    independent of all else. Arrays as in `estimators.interface.Belief`, with the lane axis; numbers [M], G [n, 3]
    scratch; the rest and the result as in `from_joint`.
    """
    count = 0
    for j in range(mapped.shape[1]):
        if mapped[lane, j]:
            pillars[count, 0], pillars[count, 1] = landmarks[lane, j, 0], landmarks[lane, j, 1]
            numbers[count] = j
            count += 1
    found = _nearest(pillars, count, pose[lane, 0], pose[lane, 1], reach, order)
    n = MARK + 2 * found
    P[:n, :n] = 0.0
    G[:n] = 0.0
    for i in range(3):
        x[i], G[i, i] = pose[lane, i], 1.0
    for i in range(2):
        x[TARGET + i], x[VELOCITY + i] = position[lane, i], velocity[lane, i]
        for k in range(2):
            P[VELOCITY + i, VELOCITY + k] = velocity_cov[lane, i, k]
    C, relative = position_cov[lane], target_rel_cov[lane, 0, 0] + target_rel_cov[lane, 1, 1]
    _couple(TARGET, x, pose_cov[lane], C[0, 0], C[0, 1], C[1, 1], relative, G, P)
    for k in range(found):
        j, at = numbers[order[k]], MARK + 2 * k
        x[at], x[at + 1] = landmarks[lane, j, 0], landmarks[lane, j, 1]
        C, relative = landmark_cov[lane, j], landmark_rel_cov[lane, j, 0, 0] + landmark_rel_cov[lane, j, 1, 1]
        _couple(at, x, pose_cov[lane], C[0, 0], C[0, 1], C[1, 1], relative, G, P)
    for i in range(n):
        for k in range(n):
            for a in range(3):
                for b in range(3):
                    P[i, k] += G[i, a] * pose_cov[lane, a, b] * G[k, b]
    return n, count
