"""The way on which a lost target is expected to be found soonest: a beam over commands, judged by a cloud of points."""

import math

from estimators.kernels.angles import wrap
from estimators.kernels.elementary import angle_between
from estimators.kernels.jit import disjoint, inline, jit

_NOTHING = 1e-4  # weight below which a point is no longer looked for
_TINY = 1e-9  # [m]
_ALIKE, _ALIKE_TURN = 0.4, 0.4  # [m], [rad]: of plans that end nearer to each other than this only the best goes on
_WELL_IN_RANGE, _WELL_IN_VIEW = 0.8, 0.7  # shares of range and half view from which on a point is reached


@inline
def _pillars_about(x, y, cosine, sine, sensor, pillars, count, near):
    """Those pillars that may hide something in view from (x, y), into the first rows of `near`; says how many."""
    reach, found = sensor[0] + sensor[2], 0
    behind = -sensor[2] if sensor[1] >= 0.0 else -math.inf  # up to half a circle nothing behind the robot is in view
    for j in range(count):
        ex, ey = pillars[j, 0] - x, pillars[j, 1] - y
        if ex * ex + ey * ey < reach * reach and ex * cosine + ey * sine > behind:
            near[found] = pillars[j]
            found += 1
    return found


@disjoint
def _mark_in_view(xs, ys, left, x, y, cosine, sine, max_range, cos_half, marks):
    """Mark the points still looked for that are in range and in view; returns the weight of all still looked for.

    As `world_geometry.in_view` tells it; few are, and only those are then asked whether a pillar hides them.
    """
    total, reach = 0.0, max_range * max_range
    for p in range(left.size):  # no branches, so that it runs on vectors
        dx, dy = xs[p] - x, ys[p] - y
        square = dx * dx + dy * dy
        wanted = left[p] >= _NOTHING
        inside = (square <= reach) & (square > 0.0) & (dx * cosine + dy * sine >= math.sqrt(square) * cos_half)
        marks[p] = 1.0 if wanted & inside else 0.0
        total += left[p] if wanted else 0.0
    return total


@disjoint
def _hide(xs, ys, x, y, at_x, at_y, radius, shown):
    """Zero in `shown` for the points that a pillar hides from (x, y); see `world_geometry.hidden`."""
    ex, ey, r2 = at_x - x, at_y - y, radius * radius
    for i in range(xs.size):
        dx, dy = xs[i] - x, ys[i] - y
        square, along, cross = dx * dx + dy * dy, ex * dx + ey * dy, ex * dy - ey * dx
        gx, gy = ex - dx, ey - dy
        beside = (along < square) & (cross * cross < r2 * square)
        behind = (along >= square) & (gx * gx + gy * gy < r2)
        shown[i] = 0.0 if (along > 0.0) & (beside | behind) else shown[i]


@inline
def _look(pose, places, left, sensor, pillars, count, scratch):
    """Take from the weights `left` what a sweep from this pose would find; returns the weight that remains."""
    (max_range, cos_half, radius, p_d), (near, numbers, rows) = sensor, scratch
    xs, ys, shown, marks = rows[0], rows[1], rows[2], rows[3]
    x, y, cosine, sine = pose[0], pose[1], math.cos(pose[2]), math.sin(pose[2])
    found = _pillars_about(x, y, cosine, sine, sensor, pillars, count, near) if radius > 0.0 else 0
    remaining = _mark_in_view(places[0], places[1], left, x, y, cosine, sine, max_range, cos_half, marks)
    inside = 0
    for p in range(left.size):  # no branches that the processor would guess wrongly
        numbers[inside], xs[inside], ys[inside] = p, places[0, p], places[1, p]
        inside += marks[p] > 0.0
    shown[:inside] = p_d
    for j in range(found):
        _hide(xs[:inside], ys[:inside], x, y, near[j, 0], near[j, 1], radius, shown)
    for i in range(inside):
        p = numbers[i]
        remaining -= shown[i] * left[p]
        left[p] *= 1.0 - shown[i]
    return remaining


@inline
def _seconds_to_view(pose, places, left, sensor, limits):
    """Weighted seconds until each point could be in view, if the robot went straight for it: the plan's open end."""
    reach, half, total = _WELL_IN_RANGE * sensor[0], _WELL_IN_VIEW * math.acos(sensor[1]), 0.0
    cosine, sine, per_metre, per_radian = math.cos(pose[2]), math.sin(pose[2]), 1.0 / limits[0], 1.0 / limits[1]
    for p in range(left.size):  # no branches, so that it runs on vectors
        dx, dy = places[0, p] - pose[0], places[1, p] - pose[1]
        r = math.sqrt(dx * dx + dy * dy) + _TINY
        off = abs(angle_between(dx * cosine + dy * sine, dy * cosine - dx * sine, r))
        total += left[p] * (max(r - reach, 0.0) * per_metre + max(off - half, 0.0) * per_radian)
    return total


@inline
def _clearance_cost(pose, pillars, count, radius, margin):
    """Depth into the margin around pillars, 1 at their rim."""
    total, reach = 0.0, radius + margin
    for j in range(count):
        ex, ey = pillars[j, 0] - pose[0], pillars[j, 1] - pose[1]
        square = ex * ex + ey * ey
        if square < reach * reach:
            total += (reach - math.sqrt(square)) / margin
    return total


@inline
def _segment(pose, left, command, sweeps, dt, sensor, pillars, count, settings, scratch):
    """Drive one command, with a look at each of the places `sweeps` [looks, 2, N]; returns what it costs [s]."""
    v, w, cost = command[0], command[1], 0.0
    for t in range(sweeps.shape[0]):
        middle = pose[2] + 0.5 * w * dt
        pose[0] += v * dt * math.cos(middle)
        pose[1] += v * dt * math.sin(middle)
        pose[2] = wrap(pose[2] + w * dt)
        remaining = _look(pose, sweeps[t], left, sensor, pillars, count, scratch)
        cost += dt * remaining
        if sensor[2] > 0.0 and settings[2] > 0.0:
            cost += dt * settings[1] * _clearance_cost(pose, pillars, count, sensor[2], settings[2])
    return cost


@inline
def _is_new(pose, poses, kept, found):
    """Whether none of the plans kept ends like this one."""
    for b in range(found):
        other = poses[kept[b]]
        near = abs(other[0] - pose[0]) < _ALIKE and abs(other[1] - pose[1]) < _ALIKE
        if near and abs(wrap(other[2] - pose[2])) < _ALIKE_TURN:
            return False
    return True


@inline
def _keep_best(scores, children, poses, room, kept):
    """Numbers of the `room` cheapest plans that end differently, the best first, into `kept`; says how many."""
    found = 0
    while found < room:
        best = 0
        for child in range(children):
            if scores[child] < scores[best]:
                best = child
        if scores[best] == math.inf:
            break
        if _is_new(poses[best], poses, kept, found):
            kept[found] = best
            found += 1
        scores[best] = math.inf
    return found


@jit
def best_hunt(
    pose, weights, ahead, dt, pillars, count, commands, looks, width, sensor, limits, settings, poses, lefts, costs,
    scores, firsts, keep, kept, near, numbers, rows,
):  # fmt: skip
    """Number of the command that begins the plan with the least expected time to find.

    A plan is T / looks segments of `looks` looks, each segment one command; of all plans up to a segment the `width`
    cheapest that end at different poses go on. With u(t) the weight of the points that no look up to time t would
    have reported, a plan costs

        integral of u dt + patience x sum over points of u (seconds to turn and drive straight until it is in view)
        + clearance x integral of (depth into the margin around a pillar, 1 at its rim) dt.

    Args:
        pose: [3].
        weights: [N] of the points.
        ahead: [T, 2, N] where they will be at each look, x and y in a row each.
        dt: [s] between two looks.
        pillars: [>= count, 2] that are mapped.
        count: in use.
        commands: [C, 2] speed [m/s], turn rate [rad/s].
        looks: of a segment.
        width: of the beam.
        sensor: (range [m], cosine of half the field of view, pillars' radius [m], detection probability).
        limits: (highest speed [m/s], turn rate [rad/s]).
        settings: (patience, clearance, margin [m]).
        poses, lefts, costs, firsts: [2, width C, 3], [2, width C, N], [2, width C], [2, width C] scratch: the plans of
            this segment and of the one before.
        scores: [width C] scratch.
        keep, kept: [width] scratch.
        near: [M, 2] scratch.
        numbers: [N] scratch.
        rows: [4, N] scratch.
    """
    poses[1, 0, :], lefts[1, 0, :], costs[1, 0] = pose, weights, 0.0
    keep[0], parents, segments = 0, 1, ahead.shape[0] // looks
    scratch = (near, numbers, rows)
    for depth in range(segments):
        now, before, sweeps = depth % 2, 1 - depth % 2, ahead[depth * looks : (depth + 1) * looks]
        for b in range(parents):
            for number in range(commands.shape[0]):
                child = b * commands.shape[0] + number
                y, left = poses[now, child], lefts[now, child]
                y[:], left[:] = poses[before, keep[b]], lefts[before, keep[b]]
                costs[now, child] = costs[before, keep[b]] + _segment(
                    y, left, commands[number], sweeps, dt, sensor, pillars, count, settings, scratch
                )
                scores[child] = costs[now, child] + settings[0] * _seconds_to_view(y, sweeps[-1], left, sensor, limits)
                firsts[now, child] = number if depth == 0 else firsts[before, keep[b]]
        room = width if depth < segments - 1 else 1
        parents = _keep_best(scores, parents * commands.shape[0], poses[now], room, kept)
        keep[:parents] = kept[:parents]
    return firsts[(segments - 1) % 2, keep[0]]
