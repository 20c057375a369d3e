"""One sweep of the range-bearing sensor: who is visible, what is reported, and from whom it really came."""

import math

import numpy as np

from estimators.interface import TARGET, UNKNOWN
from estimators.kernels.angles import wrap
from estimators.kernels.elementary import angle_between, wrap_smooth
from estimators.kernels.jit import inline
from estimators.kernels.random import normal_pair, uniform4
from slam_gym.world_draws import DRAW_CLUTTER, DRAW_SENSOR, FIRST, NOBODY, TARGET_ITEM
from slam_gym.world_geometry import cos_half_view, hidden, in_view
from slam_gym.world_numbers import NONE, QUADRATURE
from slam_gym.world_state import (
    BEARINGS,
    COUNT,
    DETECTED,
    DUE,
    EPISODE,
    ERRORS,
    KEY,
    LABELS,
    LANDMARKS,
    NUM_LANDMARKS,
    NUM_RETURNS,
    ORIGIN,
    OVERFLOW,
    POSE,
    RADIUS,
    RANGES,
    RETURNS,
    SINCE_SEEN,
    STEP,
    TARGET_STATE,
    VECTOR,
    VISIBLE,
)

FALSE_ALARM = -1  # `origin` of a return that nothing caused
MIN_RETURN = 1e-3  # [m], noise never reports less


@inline
def sense(lane, w, x, k, b):
    """Whether the target could be seen now; a sweep, where one is due."""
    at = k[POSE] + 3 * lane
    px, py, heading = x[at], x[at + 1], x[at + 2]
    c, s, cos_half = math.cos(heading), math.sin(heading), cos_half_view(w.sensor_field_of_view)
    body = k[TARGET_STATE] + 4 * lane
    visible = w.target_kind != NONE and is_visible(lane, w, px, py, c, s, cos_half, x[body], x[body + 1], NOBODY, x, k)
    b[k[VISIBLE] + lane] = visible
    b[k[DETECTED] + lane] = False
    x[k[SINCE_SEEN] + lane] += w.dt
    due = k[k[STEP] + lane] % w.sensor_period == 0
    b[k[DUE] + lane] = due
    if not due:
        return
    if w.sensor_error_time_constant > 0.0:
        _correlate(lane, w, x, k)
    n = _gather(lane, w, px, py, c, s, cos_half, visible, x, k, b)
    if w.sensor_error_time_constant > 0.0:
        _report_correlated(lane, n, w, c, s, x, k)
    else:
        _report_white(lane, n, w, c, s, x, k)
    k[k[RETURNS] + lane] = n + _clutter(lane, n, w, x, k) if w.sensor_clutter_rate > 0.0 else n


@inline
def _gather(lane, w, px, py, c, s, cos_half, target_visible, x, k, b):
    """List what is detected, landmarks by id, then the target; says how many.

    Where a return's range and bearing will stand, its offset (dx, dy) from the sensor stands first: all of a sweep's
    errors are then drawn in one plain loop.
    """
    count, last = k[k[COUNT] + lane], k[NUM_LANDMARKS]
    at, first = k[NUM_RETURNS] * lane, k[LANDMARKS] + 2 * last * lane
    certain = w.sensor_detection_probability >= 1.0 and w.sensor_mislabel_probability == 0.0
    n = FIRST
    for j in range(count + 1):
        is_target = j == count
        mark = k[TARGET_STATE] + 4 * lane if is_target else first + 2 * j
        if is_target:
            seen = target_visible
        else:
            seen = is_visible(lane, w, px, py, c, s, cos_half, x[mark], x[mark + 1], j, x, k)
        if not seen:
            continue
        u3 = 1.0
        if not certain:
            _, _, u2, u3 = _draw(lane, TARGET_ITEM if is_target else j, k)
            if u2 >= w.sensor_detection_probability:
                continue
        x[k[RANGES] + at + n], x[k[BEARINGS] + at + n] = x[mark] - px, x[mark + 1] - py
        k[k[ORIGIN] + at + n] = TARGET if is_target else j
        k[k[LABELS] + at + n] = TARGET if is_target else _label(j, u3, w, count)
        n += 1
        if is_target:
            b[k[DETECTED] + lane] = True
            x[k[SINCE_SEEN] + lane] = 0.0
    return n


@inline
def is_visible(lane, w, px, py, c, s, cos_half, to_x, to_y, skip, x, k):
    """In range, in the field of view, and in line of sight from (px, py)."""
    if not in_view(to_x - px, to_y - py, c, s, w.sensor_min_range, w.sensor_max_range, cos_half):
        return False
    if w.landmarks_opaque == 0:
        return True
    first = k[NUM_LANDMARKS] * lane
    count = k[k[COUNT] + lane]
    return not hidden(px, py, to_x, to_y, skip, x, k[LANDMARKS] + 2 * first, k[RADIUS] + first, count)


@inline
def _draw(lane, item, k):
    """Four uniforms of one source in this sweep: two for its errors, then detection and label."""
    return uniform4(k[k[KEY] + lane], k[k[EPISODE] + lane], k[k[STEP] + lane], DRAW_SENSOR, item)


@inline
def _report_white(lane, n, w, c, s, x, k):
    """Turn the first n offsets into ranges and bearings with fresh errors.

    No branches and unsigned indices, so that it runs on vectors; whole ones, beyond n into the buffer's padding.
    """
    key, episode, step = k[k[KEY] + lane], k[k[EPISODE] + lane], k[k[STEP] + lane]
    at = k[NUM_RETURNS] * lane
    ranges, bearings, origin = np.uint64(k[RANGES] + at), np.uint64(k[BEARINGS] + at), np.uint64(k[ORIGIN] + at)
    noise = w.sensor_range_std, w.sensor_range_std_per_range, w.sensor_range_law == QUADRATURE, w.sensor_bearing_std
    for i in range((n + VECTOR - 1) // VECTOR * VECTOR):
        u = np.uint64(i)
        source = k[origin + u]
        item = source if source >= 0 else TARGET_ITEM
        u0, u1, _, _ = uniform4(key, episode, step, DRAW_SENSOR, item)
        n0, n1 = normal_pair(u0, u1)
        x[ranges + u], x[bearings + u] = _measured(x[ranges + u], x[bearings + u], c, s, n0, n1, noise)


@inline
def _report_correlated(lane, n, w, c, s, x, k):
    """The same with the errors that `_correlate` keeps of every source."""
    at, rows = k[NUM_RETURNS] * lane, k[NUM_LANDMARKS] + 1
    noise = w.sensor_range_std, w.sensor_range_std_per_range, w.sensor_range_law == QUADRATURE, w.sensor_bearing_std
    for i in range(n):
        source = k[k[ORIGIN] + at + i]
        error = k[ERRORS] + 2 * (rows * lane + (source if source >= 0 else rows - 1))
        to_r, to_b = k[RANGES] + at + i, k[BEARINGS] + at + i
        x[to_r], x[to_b] = _measured(x[to_r], x[to_b], c, s, x[error], x[error + 1], noise)


@inline
def _measured(dx, dy, c, s, n0, n1, noise):
    """Range and bearing of a point at (dx, dy) from a sensor that looks along (c, s), with errors n0, n1."""
    range_std, range_std_per_range, quadrature, bearing_std = noise
    r = max(math.sqrt(dx * dx + dy * dy), MIN_RETURN)
    growing = range_std_per_range * r
    root = math.sqrt(range_std * range_std + growing * growing)
    std = root if quadrature else range_std + growing
    bearing = angle_between((dx * c + dy * s) / r, (dy * c - dx * s) / r, 1.0)
    return max(r + std * n0, MIN_RETURN), wrap_smooth(bearing + bearing_std * n1)


@inline
def _label(item, u, w, count):
    """What the sensor says a landmark's return is from; the target it always tells from landmarks."""
    if w.landmarks_labelled == 0:
        return UNKNOWN
    if u < w.sensor_mislabel_probability and count > 1:
        other = min(int(u / w.sensor_mislabel_probability * (count - 1)), count - 2)
        return other + 1 if other >= item else other
    return item


@inline
def _correlate(lane, w, x, k):
    """Every source's errors move on, seen or not: e <- f e + sqrt(1 - f^2) n, f = exp(-period / time constant)."""
    f = math.exp(-w.dt * w.sensor_period / w.sensor_error_time_constant)
    if k[k[STEP] + lane] <= w.sensor_period:
        f = 0.0  # the first sweep: from the stationary distribution
    fresh = math.sqrt(1.0 - f * f)
    last = k[NUM_LANDMARKS]
    for row in range(last + 1):
        u0, u1, _, _ = _draw(lane, TARGET_ITEM if row == last else row, k)
        n0, n1 = normal_pair(u0, u1)
        at = k[ERRORS] + 2 * ((last + 1) * lane + row)
        x[at] = f * x[at] + fresh * n0
        x[at + 1] = f * x[at + 1] + fresh * n1


@inline
def _clutter(lane, n, w, x, k):
    """Write false returns from the n-th on, Poisson in number, uniform over the area swept; says how many."""
    key, episode, step = k[k[KEY] + lane], k[k[EPISODE] + lane], k[k[STEP] + lane]
    u0, _, _, _ = uniform4(key, episode, step, DRAW_CLUTTER, FIRST)
    probability = math.exp(-w.sensor_clutter_rate)
    total, number = probability, 0
    while u0 > total and probability > 0.0:
        number += 1
        probability *= w.sensor_clutter_rate / number
        total += probability
    room = k[NUM_RETURNS] - n
    if number > room:
        k[k[OVERFLOW] + lane] += number - room
        number = room
    near, far, count = w.sensor_min_range, w.sensor_max_range, k[k[COUNT] + lane]
    for i in range(number):
        u0, u1, u2, _ = uniform4(key, episode, step, DRAW_CLUTTER, 1 + i)
        at = k[NUM_RETURNS] * lane + n + i
        x[k[RANGES] + at] = max(math.sqrt(near * near + u0 * (far * far - near * near)), MIN_RETURN)
        x[k[BEARINGS] + at] = wrap((u1 - 0.5) * w.sensor_field_of_view)
        # A labelling sensor gives every return a label: a false one looks like some landmark's.
        k[k[LABELS] + at] = int(u2 * count) if w.landmarks_labelled == 1 and count > 0 else UNKNOWN
        k[k[ORIGIN] + at] = FALSE_ALARM
    return number
