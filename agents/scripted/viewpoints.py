"""From which place, facing which way, the most of a target cloud is seen soonest."""

import math

from agents.scripted.driving import ARRIVED, clip
from estimators.kernels.angles import wrap
from estimators.kernels.jit import inline, jit
from slam_gym.world_draws import NOBODY
from slam_gym.world_geometry import hidden

RINGS, DIRECTIONS = 3, 8  # places around the robot that are tried, at these shares of the sensor's range
RING_SHARES = (0.35, 0.8, 1.6)
CLOUD_PLACES = 6  # places in the cloud itself that are tried
HERE, HELD = 0, -1  # numbers of places: the robot's own, and the goal pursued so far
BINS = 36  # headings told apart
PLACES = 1 + RINGS * DIRECTIONS + CLOUD_PLACES
X, Y, HEADING, AGE = range(4)  # of a goal: place, heading there, decisions since it was chosen


@inline
def _seen_by_direction(px, py, points, weights, max_range, pillars, count, mass):
    """Fill `mass` [BINS]: the cloud's weight in range and line of sight of (px, py), by direction."""
    radii = pillars.size // 3 * 2
    for b in range(BINS):
        mass[b] = 0.0
    for p in range(weights.size):
        x, y = points[p, 0], points[p, 1]
        dx, dy = x - px, y - py
        near = dx * dx + dy * dy < max_range * max_range
        if near and not hidden(px, py, x, y, NOBODY, pillars, 0, radii, count):
            turns = math.atan2(dy, dx) / (2.0 * math.pi)
            mass[min(int((turns - math.floor(turns)) * BINS), BINS - 1)] += weights[p]


@inline
def _best_heading(mass, arrival, travel, window, turn_max, discount):
    """The worth of the best heading, turned to from `arrival` after `travel` seconds, and that heading.

    window: bins on either side of the heading's own that are in view. worth = mass in view x exp(-discount x seconds).
    """
    best, heading = -1.0, arrival
    for b in range(BINS):
        seen = 0.0
        for k in range(b - window, b + window + 1):
            seen += mass[k % BINS]
        facing = 2.0 * math.pi * (b + 0.5) / BINS
        seconds = travel + abs(wrap(facing - arrival)) / turn_max
        worth = seen * math.exp(-discount * seconds)
        if worth > best:
            best, heading = worth, facing
    return best, heading


@inline
def _place(number, lane, pose, points, weights, reach, goal):
    """The number-th place to try: the robot's own, rings around it, then places drawn evenly from the cloud."""
    if number == HELD:
        return goal[lane, X], goal[lane, Y]
    if number == HERE:
        return pose[lane, 0], pose[lane, 1]
    number -= 1
    if number < RINGS * DIRECTIONS:
        ring = number // DIRECTIONS
        radius = reach * RING_SHARES[ring]
        angle = pose[lane, 2] + 2.0 * math.pi * (number % DIRECTIONS + 0.5 * (ring % 2)) / DIRECTIONS
        return pose[lane, 0] + radius * math.cos(angle), pose[lane, 1] + radius * math.sin(angle)
    share, reached = (number - RINGS * DIRECTIONS + 0.5) / CLOUD_PLACES, 0.0
    for p in range(weights.size):
        reached += weights[p]
        if reached >= share:
            return points[p, 0], points[p, 1]
    return points[weights.size - 1, 0], points[weights.size - 1, 1]


@inline
def _choose(lane, pose, points, weights, sensor, limits, border, discount, bonus, pillars, count, mass, goal):
    """Write the lane's best view into `goal`."""
    max_range, half_view, _ = sensor
    window = min(int(half_view / (2.0 * math.pi) * BINS), (BINS - 1) // 2)
    x, y, heading = pose[lane, 0], pose[lane, 1], pose[lane, 2]
    best, best_x, best_y, best_heading = -1.0, x, y, heading
    for number in range(HELD if goal[lane, AGE] >= 0.0 else HERE, PLACES):
        px, py = _place(number, lane, pose, points, weights, max_range, goal)
        px, py = clip(px, -border[0], border[0]), clip(py, -border[1], border[1])
        distance = math.hypot(px - x, py - y)
        arrival = math.atan2(py - y, px - x) if distance > ARRIVED else heading
        travel = abs(wrap(arrival - heading)) / limits[2] + distance / limits[1]
        _seen_by_direction(px, py, points, weights, max_range, pillars, count, mass)
        worth, facing = _best_heading(mass, arrival, travel, window, limits[2], discount)
        worth *= bonus if number == HELD else 1.0
        if worth > best:
            best, best_x, best_y, best_heading = worth, px, py, facing
    goal[lane, X], goal[lane, Y], goal[lane, HEADING], goal[lane, AGE] = best_x, best_y, best_heading, 0.0


@jit
def choose_views(
    lost, pose, points, weights, mapped, landmarks, sensor, limits, border, discount, keep, bonus, pillars, mass, goal
):
    """A new plan in the lanes that are lost and where it is due: turn, drive straight to a place, turn on there.

    Args:
        lost: [L].
        pose: [L, 3].
        points: [L, N, 2] of the cloud.
        weights: [L, N] of the cloud.
        mapped: [L, M].
        landmarks: [L, M, 2] the pillars' places.
        sensor: (range [m], half the field of view [rad], pillars' radius [m]).
        limits: (lowest, highest speed [m/s], highest turn rate [rad/s]).
        border: half the arena's width and height [m].
        discount: [1/s] by which what is seen later is worth less.
        keep: decisions between two choices.
        bonus: factor in favour of the plan pursued so far.
        pillars: [3 M] scratch: their places, then their radii.
        mass: [BINS] scratch.
        goal: [L, 4] the plans (X, Y, HEADING, AGE; negative age: none), written.
    """
    pillars[2 * mapped.shape[1] :] = sensor[2]
    for lane in range(lost.size):
        if not lost[lane]:
            goal[lane, AGE] = -1.0
            continue
        if 0.0 <= goal[lane, AGE] < keep:
            goal[lane, AGE] += 1.0
            continue
        count = 0
        for j in range(mapped.shape[1] if sensor[2] > 0.0 else 0):
            if mapped[lane, j]:
                pillars[2 * count], pillars[2 * count + 1] = landmarks[lane, j, 0], landmarks[lane, j, 1]
                count += 1
        _choose(
            lane, pose, points[lane], weights[lane], sensor, limits, border, discount, bonus, pillars, count,
            mass, goal,
        )  # fmt: skip
