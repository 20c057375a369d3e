"""Lines of sight and pillars, as scalar helpers of the world's kernels."""

import math

from estimators.kernels.jit import inline


@inline
def in_view(dx, dy, cos_heading, sin_heading, min_range, max_range, cos_half_view):
    """Whether a point at (dx, dy) from the sensor lies within range and field of view. No atan2: a dot product."""
    square = dx * dx + dy * dy
    if square > max_range * max_range or square < min_range * min_range or square == 0.0:
        return False
    return dx * cos_heading + dy * sin_heading >= math.sqrt(square) * cos_half_view


@inline
def hidden(lane, x, y, px, py, skip, landmarks, radius, count):
    """Whether a pillar other than `skip` stands on the segment from (x, y) to (px, py)."""
    dx, dy = px - x, py - y
    length = dx * dx + dy * dy
    for j in range(count[lane]):
        if j == skip:
            continue
        r = radius[lane, j]
        ex, ey = landmarks[lane, j, 0] - x, landmarks[lane, j, 1] - y
        along = ex * dx + ey * dy
        if along <= 0.0 or along >= length:
            continue
        cross = ex * dy - ey * dx
        if cross * cross < r * r * length:
            return True
    # A pillar whose centre lies beyond the point may still cover it with its rim.
    for j in range(count[lane]):
        r = radius[lane, j]
        gx, gy = landmarks[lane, j, 0] - px, landmarks[lane, j, 1] - py
        if j != skip and gx * gx + gy * gy < r * r:
            return True
    return False


@inline
def pushed_out(lane, x, y, body, landmarks, radius, count):
    """The nearest place outside all pillars for a disc of radius `body`; moves at most once per pillar."""
    for j in range(count[lane]):
        reach = radius[lane, j] + body
        dx, dy = x - landmarks[lane, j, 0], y - landmarks[lane, j, 1]
        square = dx * dx + dy * dy
        if square < reach * reach:
            distance = math.sqrt(square)
            if distance > 0.0:
                x = landmarks[lane, j, 0] + dx * reach / distance
                y = landmarks[lane, j, 1] + dy * reach / distance
            else:
                x = landmarks[lane, j, 0] + reach
    return x, y


@inline
def touching(lane, x, y, body, landmarks, radius, count):
    """Whether a disc of radius `body` overlaps a pillar."""
    for j in range(count[lane]):
        reach = radius[lane, j] + body
        dx, dy = x - landmarks[lane, j, 0], y - landmarks[lane, j, 1]
        if dx * dx + dy * dy < reach * reach:
            return True
    return False
