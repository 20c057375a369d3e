"""One sweep of the range-bearing sensor: who is visible, what is reported, and from whom it really came."""

import math

from estimators.interface import TARGET, UNKNOWN
from estimators.kernels.angles import wrap
from estimators.kernels.jit import inline, jit
from estimators.kernels.random import normal4, uniform4
from slam_gym.world_geometry import hidden, in_view
from slam_gym.world_numbers import DRAW_CLUTTER, DRAW_DETECTION, DRAW_SENSOR, NONE

FALSE_ALARM = -1  # `origin` of a return that nothing caused
MISSED = -3  # instead of a label: no return
QUADRATURE = 1  # position in RANGE_LAWS
MIN_RETURN = 1e-3  # [m], noise never reports less


@jit
def sense(
    lanes, numbers, key, episode, step, pose, body, landmarks, radius, count, errors, ranges, bearings, labels, returns,
    origin, due, visible, detected, since,
):  # fmt: skip
    """Take a sweep where one is due, and say whether the target could be seen; see `World` for the shapes.

    errors: [L, N + 1, 2] unit-variance first-order errors of each landmark's and the target's range and bearing.
    """
    for n in range(lanes.shape[0]):
        lane = lanes[n]
        w = numbers[lane]
        c, s = math.cos(pose[lane, 2]), math.sin(pose[lane, 2])
        cos_half = math.cos(min(0.5 * w.sensor_field_of_view, math.pi))
        visible[lane] = w.target_kind != NONE and _visible(
            lane, w, c, s, cos_half, body[lane, 0], body[lane, 1], -1, pose, landmarks, radius, count
        )
        due[lane] = step[lane] % w.sensor_period == 0
        detected[lane] = False
        since[lane] += w.dt
        if not due[lane]:
            continue
        _correlate(lane, w, key, episode, step, count, errors)
        k = 0
        for j in range(count[lane]):
            x, y = landmarks[lane, j, 0], landmarks[lane, j, 1]
            if not _visible(lane, w, c, s, cos_half, x, y, j, pose, landmarks, radius, count):
                continue
            label = _detect(lane, w, key, episode, step, j, count)
            if label != MISSED:
                _report(lane, k, j, w, key, episode, step, x, y, pose, errors, ranges, bearings)
                labels[lane, k] = label if w.landmarks_labelled == 1 else UNKNOWN
                origin[lane, k] = j
                k += 1
        if visible[lane] and _detect(lane, w, key, episode, step, landmarks.shape[1], count) != MISSED:
            _report(lane, k, landmarks.shape[1], w, key, episode, step, body[lane, 0], body[lane, 1], pose, errors,
                    ranges, bearings)  # fmt: skip
            labels[lane, k] = TARGET if w.landmarks_labelled == 1 else UNKNOWN
            origin[lane, k] = TARGET
            detected[lane] = True
            since[lane] = 0.0
            k += 1
        if w.sensor_clutter_rate > 0.0:
            k = _clutter(lane, k, w, key, episode, step, count, ranges, bearings, labels, origin)
        returns[lane] = k


@inline
def _visible(lane, w, c, s, cos_half, x, y, skip, pose, landmarks, radius, count):
    """In range, in the field of view, and in line of sight."""
    dx, dy = x - pose[lane, 0], y - pose[lane, 1]
    if not in_view(dx, dy, c, s, w.sensor_min_range, w.sensor_max_range, cos_half):
        return False
    if w.landmarks_opaque == 0:
        return True
    return not hidden(lane, pose[lane, 0], pose[lane, 1], x, y, skip, landmarks, radius, count)


@inline
def _detect(lane, w, key, episode, step, item, count):
    """The label that the return of source `item` carries, MISSED where there is none."""
    if w.sensor_detection_probability >= 1.0 and w.sensor_mislabel_probability == 0.0:
        return item
    u0, u1, u2, _ = uniform4(key[lane], episode[lane], step[lane], DRAW_DETECTION, item)
    if u0 >= w.sensor_detection_probability:
        return MISSED
    if u1 < w.sensor_mislabel_probability and item < count[lane]:
        return int(u2 * count[lane])
    return item


@inline
def _report(lane, k, item, w, key, episode, step, x, y, pose, errors, ranges, bearings):
    """Range and bearing of (x, y) with this item's errors of this sweep."""
    dx, dy = x - pose[lane, 0], y - pose[lane, 1]
    r = math.hypot(dx, dy)
    if w.sensor_error_time_constant > 0.0:
        n0, n1 = errors[lane, item, 0], errors[lane, item, 1]
    else:
        n0, n1, _, _ = normal4(key[lane], episode[lane], step[lane], DRAW_SENSOR, item)
    a, b = w.sensor_range_std, w.sensor_range_std_per_range * r
    std = math.sqrt(a * a + b * b) if w.sensor_range_law == QUADRATURE else a + b
    ranges[lane, k] = max(r + std * n0, MIN_RETURN)
    bearings[lane, k] = wrap(math.atan2(dy, dx) - pose[lane, 2] + w.sensor_bearing_std * n1)


@inline
def _correlate(lane, w, key, episode, step, count, errors):
    """Every source's errors move on, seen or not: e <- f e + sqrt(1 - f^2) n, f = exp(-period / time constant)."""
    if w.sensor_error_time_constant <= 0.0:
        return
    f = math.exp(-w.dt * w.sensor_period / w.sensor_error_time_constant)
    if step[lane] <= w.sensor_period:
        f = 0.0  # the first sweep: from the stationary distribution
    fresh = math.sqrt(1.0 - f * f)
    last = errors.shape[1] - 1
    for j in range(errors.shape[1]):
        if j < count[lane] or j == last:
            n0, n1, _, _ = normal4(key[lane], episode[lane], step[lane], DRAW_SENSOR, j)
            errors[lane, j, 0] = f * errors[lane, j, 0] + fresh * n0
            errors[lane, j, 1] = f * errors[lane, j, 1] + fresh * n1


@inline
def _clutter(lane, k, w, key, episode, step, count, ranges, bearings, labels, origin):
    """A Poisson number of false returns, uniform over the sensor's area."""
    u0, _, _, _ = uniform4(key[lane], episode[lane], step[lane], DRAW_CLUTTER, 0)
    probability = math.exp(-w.sensor_clutter_rate)
    total, number = probability, 0
    while u0 > total and number < ranges.shape[1] - k:
        number += 1
        probability *= w.sensor_clutter_rate / number
        total += probability
    for i in range(number):
        u0, u1, u2, _ = uniform4(key[lane], episode[lane], step[lane], DRAW_CLUTTER, 1 + i)
        near, far = w.sensor_min_range, w.sensor_max_range
        ranges[lane, k] = max(math.sqrt(near * near + u0 * (far * far - near * near)), MIN_RETURN)
        bearings[lane, k] = wrap((u1 - 0.5) * w.sensor_field_of_view)
        # A labelling sensor gives every return a label: a false one looks like some landmark's.
        labelled = w.landmarks_labelled == 1 and count[lane] > 0
        labels[lane, k] = int(u2 * count[lane]) if labelled else UNKNOWN
        origin[lane, k] = FALSE_ALARM
        k += 1
    return k
