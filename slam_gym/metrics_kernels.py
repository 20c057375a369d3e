"""One belief against the truth, lane by lane: the arithmetic behind `slam_gym.metrics.Meter`.

Regularisation of every NEES: the covariance's diagonal is raised by 1e-9 of its own scale (positions share the trace
of their block, an angle uses its own variance), and never by more than 1e-6. A covariance of exactly zero (a start
known without doubt) has no NEES: NaN. A covariance that is not positive semi-definite, or an estimate that is not
finite, has an infinite one: a filter that breaks is counted, never dropped. No alignment before any of them.
"""

import math

import numpy as np

from estimators.kernels.angles import wrap
from estimators.kernels.jit import inline, jit, subroutine

REGULARISATION = 1e-9  # relative to the covariance's own scale
REGULARISATION_LIMIT = 1e-6  # [m^2] or [rad^2]

METRIC = np.dtype(
    [
        ("robot_error", np.float64),  # [m], position, world frame
        ("heading_error", np.float64),  # [rad], absolute, wrapped
        ("target_error", np.float64),  # [m], position, world frame
        ("target_error_rel", np.float64),  # [m], position in the robot's frame, each with its own pose
        ("target_velocity_error", np.float64),  # [m/s], world frame
        ("target_heading_error", np.float64),  # [rad], absolute, wrapped
        ("landmark_error", np.float64),  # [m], root mean square over the matched landmarks
        ("landmark_gospa", np.float64),  # [m], against all landmarks of the world; under unknown association only
        ("pose_nees", np.float64),  # 3 degrees of freedom
        ("target_nees", np.float64),  # position, 2
        ("target_state_nees", np.float64),  # the model's own coordinates, n_t
        ("landmark_nees", np.float64),  # mean over the matched landmarks, 2
        ("landmark_count", np.float64),  # landmarks in the map
    ]
)
"""What is measured of one lane at one instant; NaN where undefined (target not yet known, map empty)."""

# A structured array costs a kernel call 1 us more than its plain view [L, number of fields].
(
    _ROBOT_ERROR, _HEADING_ERROR, _TARGET_ERROR, _TARGET_ERROR_REL, _TARGET_VELOCITY_ERROR, _TARGET_HEADING_ERROR,
    _LANDMARK_ERROR, _LANDMARK_GOSPA, _POSE_NEES, _TARGET_NEES, _TARGET_STATE_NEES, _LANDMARK_NEES, _LANDMARK_COUNT,
) = range(len(METRIC.names or ()))  # fmt: skip
COORDINATES = {"x": 0, "y": 1, "heading": 2, "velocity_x": 3, "velocity_y": 4, "speed": 5}
_HEADING = COORDINATES["heading"]


@inline
def _raise(scale):
    """What is added to a diagonal element of that scale; see the module's docstring."""
    return min(REGULARISATION * scale, REGULARISATION_LIMIT)


@inline
def _valid(value):
    """A quadratic form, infinite where its covariance is not positive definite."""
    return value if value >= 0.0 and value < math.inf else math.inf


@inline
def _nees2(x, y, p00, p01, p11):
    """NEES of a 2-vector through the Cholesky factor; NaN for a zero covariance."""
    if p00 == 0.0 and p01 == 0.0 and p11 == 0.0:
        return math.nan
    add = _raise(p00 + p11)
    l00 = math.sqrt(p00 + add)
    l10 = p01 / l00
    s0 = x / l00
    s1 = (y - l10 * s0) / math.sqrt(p11 + add - l10 * l10)
    return _valid(s0 * s0 + s1 * s1)


@inline
def _nees3(x, y, phi, p00, p01, p02, p11, p12, p22):
    """NEES of (x, y, heading); NaN for a zero covariance."""
    if p00 == 0.0 and p11 == 0.0 and p22 == 0.0 and p01 == 0.0 and p02 == 0.0 and p12 == 0.0:
        return math.nan
    if p22 == 0.0 and p02 == 0.0 and p12 == 0.0 and phi == 0.0:  # a heading known without doubt
        return _nees2(x, y, p00, p01, p11)
    add = _raise(p00 + p11)
    l00 = math.sqrt(p00 + add)
    l10 = p01 / l00
    l20 = p02 / l00
    l11 = math.sqrt(p11 + add - l10 * l10)
    l21 = (p12 - l20 * l10) / l11
    l22 = math.sqrt(p22 + _raise(p22) - l20 * l20 - l21 * l21)
    s0 = x / l00
    s1 = (y - l10 * s0) / l11
    s2 = (phi - l20 * s0 - l21 * s1) / l22
    return _valid(s0 * s0 + s1 * s1 + s2 * s2)


@subroutine
def _state_nees(lane, mean, cov, codes, truth, work):
    """NEES of the target's own coordinates. truth [6] in `COORDINATES`' order; work [n_t + 1, n_t] scratch."""
    n = codes.shape[0]
    trace_xy, trace_v, biggest = 0.0, 0.0, 0.0
    for i in range(n):
        if codes[i] < 2:
            trace_xy += cov[lane, i, i]
        elif codes[i] == 3 or codes[i] == 4:
            trace_v += cov[lane, i, i]
        biggest = max(biggest, abs(cov[lane, i, i]))
    if biggest == 0.0:
        return math.nan
    total = 0.0
    for i in range(n):  # row-wise Cholesky in work[:n], solved as it goes; the solution in work[n]
        code = codes[i]
        scale = trace_xy if code < 2 else (trace_v if code == 3 or code == 4 else cov[lane, i, i])
        for j in range(i + 1):
            value = cov[lane, i, j] + (_raise(scale) if i == j else 0.0)
            for k in range(j):
                value -= work[i, k] * work[j, k]
            work[i, j] = math.sqrt(value) if i == j else value / work[j, j]
        error = mean[lane, i] - truth[code]
        if code == _HEADING:
            error = wrap(error)
        for k in range(i):
            error -= work[i, k] * work[n, k]
        work[n, i] = error / work[i, i]
        total += work[n, i] * work[n, i]
    return _valid(total)


@jit
def measure(
    lanes, pose, P, known, mean, cov, position, position_cov, velocity, heading, rel,
    truth_pose, truth_target, truth_heading, codes, truth, work, out,
):  # fmt: skip
    """Everything but the map, for the lanes named; `truth` [6] and `work` are scratch."""
    for index in range(lanes.shape[0]):
        lane = lanes[index]
        dx = pose[lane, 0] - truth_pose[lane, 0]
        dy = pose[lane, 1] - truth_pose[lane, 1]
        dphi = wrap(pose[lane, 2] - truth_pose[lane, 2])
        out[lane, _ROBOT_ERROR] = math.hypot(dx, dy)
        out[lane, _HEADING_ERROR] = abs(dphi)
        out[lane, _POSE_NEES] = _nees3(
            dx, dy, dphi, P[lane, 0, 0], P[lane, 0, 1], P[lane, 0, 2], P[lane, 1, 1], P[lane, 1, 2], P[lane, 2, 2]
        )
        if not known[lane]:
            for field in range(_TARGET_ERROR, _TARGET_HEADING_ERROR + 1):
                out[lane, field] = math.nan
            out[lane, _TARGET_NEES] = math.nan
            out[lane, _TARGET_STATE_NEES] = math.nan
            continue
        x, y, vx, vy = truth_target[lane, 0], truth_target[lane, 1], truth_target[lane, 2], truth_target[lane, 3]
        dx, dy = position[lane, 0] - x, position[lane, 1] - y
        out[lane, _TARGET_ERROR] = math.hypot(dx, dy)
        c, s = math.cos(truth_pose[lane, 2]), math.sin(truth_pose[lane, 2])
        rx, ry = x - truth_pose[lane, 0], y - truth_pose[lane, 1]
        out[lane, _TARGET_ERROR_REL] = math.hypot(rel[lane, 0] - (c * rx + s * ry), rel[lane, 1] - (c * ry - s * rx))
        out[lane, _TARGET_VELOCITY_ERROR] = math.hypot(velocity[lane, 0] - vx, velocity[lane, 1] - vy)
        out[lane, _TARGET_HEADING_ERROR] = abs(wrap(heading[lane] - truth_heading[lane]))
        out[lane, _TARGET_NEES] = _nees2(
            dx, dy, position_cov[lane, 0, 0], position_cov[lane, 0, 1], position_cov[lane, 1, 1]
        )
        truth[0], truth[1], truth[2], truth[3], truth[4] = x, y, truth_heading[lane], vx, vy
        truth[5] = math.hypot(vx, vy)
        state_nees = _state_nees(lane, mean, cov, codes, truth, work) if codes.shape[0] > 0 else math.nan
        out[lane, _TARGET_STATE_NEES] = state_nees


@jit
def measure_map(lanes, mapped, mean, cov, match, landmarks, landmark_count, out):
    """Landmark errors and NEES. match [L, M]: the true landmark of each slot; outside 0..count-1: none."""
    for index in range(lanes.shape[0]):
        lane = lanes[index]
        total, matched, square, nees, with_nees = 0, 0, 0.0, 0.0, 0
        for slot in range(mapped.shape[1]):
            if not mapped[lane, slot]:
                continue
            total += 1
            j = match[lane, slot]
            if j < 0 or j >= landmark_count[lane]:
                continue
            dx = mean[lane, slot, 0] - landmarks[lane, j, 0]
            dy = mean[lane, slot, 1] - landmarks[lane, j, 1]
            matched += 1
            square += dx * dx + dy * dy
            value = _nees2(dx, dy, cov[lane, slot, 0, 0], cov[lane, slot, 0, 1], cov[lane, slot, 1, 1])
            if not math.isnan(value):
                nees += value
                with_nees += 1
        out[lane, _LANDMARK_COUNT] = total
        out[lane, _LANDMARK_ERROR] = math.sqrt(square / matched) if matched > 0 else math.nan
        out[lane, _LANDMARK_NEES] = nees / with_nees if with_nees > 0 else math.nan
