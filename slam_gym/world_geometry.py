"""Lines of sight and pillars, as scalar helpers of the world's kernels.

Pillars stand in the block `x` (see `world_state`): centres from `at`, two numbers each, radii from `radii`.
"""

import math

from estimators.kernels.jit import inline

FULL_CIRCLE = 2.0 * math.pi - 1e-6  # [rad], a field of view from which on nothing is out of it
RIM = 1.0 - 1e-9  # of a squared radius: a point on the rim is outside, on whichever side of it rounding has left it


@inline
def cos_half_view(field_of_view):
    """The cosine of the largest bearing in view; below -1 for all round, so that rounding hides nothing."""
    return -2.0 if field_of_view >= FULL_CIRCLE else math.cos(0.5 * field_of_view)


@inline
def in_view(dx, dy, cos_heading, sin_heading, min_range, max_range, cos_half):
    """Whether a point at (dx, dy) from the sensor lies within range and field of view. No atan2: a dot product."""
    square = dx * dx + dy * dy
    if square > max_range * max_range or square < min_range * min_range or square == 0.0:
        return False
    return dx * cos_heading + dy * sin_heading >= math.sqrt(square) * cos_half


@inline
def hidden(from_x, from_y, to_x, to_y, skip, x, at, radii, count):
    """Whether a pillar other than `skip` stands on the segment; one behind its beginning does not."""
    dx, dy = to_x - from_x, to_y - from_y
    square = dx * dx + dy * dy
    for j in range(count):
        ex, ey = x[at + 2 * j] - from_x, x[at + 2 * j + 1] - from_y
        along = ex * dx + ey * dy
        if along <= 0.0 or j == skip:
            continue
        r = x[radii + j]
        if along < square:
            cross = ex * dy - ey * dx
            if cross * cross < r * r * square:
                return True
        else:  # the centre lies beyond the end: its rim may still cover it
            gx, gy = ex - dx, ey - dy
            if gx * gx + gy * gy < RIM * r * r:
                return True
    return False


@inline
def pushed_out(px, py, body, x, at, radii, count):
    """The nearest place outside the pillars for a disc of radius `body`; at most one push per pillar."""
    for j in range(count):
        reach = x[radii + j] + body
        dx, dy = px - x[at + 2 * j], py - x[at + 2 * j + 1]
        square = dx * dx + dy * dy
        if square < reach * reach:
            distance = math.sqrt(square)
            if distance > 0.0:
                px = x[at + 2 * j] + dx * reach / distance
                py = x[at + 2 * j + 1] + dy * reach / distance
            else:
                px = x[at + 2 * j] + reach
    return px, py


@inline
def touching(px, py, body, x, at, radii, count):
    """Whether a disc of radius `body` overlaps a pillar."""
    for j in range(count):
        reach = x[radii + j] + body
        dx, dy = px - x[at + 2 * j], py - x[at + 2 * j + 1]
        if dx * dx + dy * dy < reach * reach:
            return True
    return False
