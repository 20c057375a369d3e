"""One step of the target, by its kind; then back inside the walls and out of the pillars."""

import math

from estimators.kernels.angles import wrap
from estimators.kernels.jit import inline
from estimators.kernels.motion import unicycle
from estimators.kernels.random import normal_pair, uniform4
from slam_gym.world_draws import DRAW_TARGET, FIRST
from slam_gym.world_geometry import pushed_out, touching
from slam_gym.world_numbers import CONSTANT_VELOCITY, EVASIVE, RECORDED, TWIST
from slam_gym.world_state import (
    COUNT,
    EPISODE,
    GOAL,
    KEY,
    LANDMARKS,
    NUM_LANDMARKS,
    NUM_ROWS,
    PATH,
    POSE,
    RADIUS,
    STEP,
    TARGET_HEADING,
    TARGET_STATE,
)

ARRIVED = 0.5  # [m] from a waypoint: the target takes a new one
BERTH = 0.3  # [m] between a waypoint and a pillar's rim
DEPTH = 1e-9  # [m] within a rim
SIDE_STEP = 0.6  # [rad], by which a fleeing target turns off a wall or a dead end
SIDE_STEPS = 12  # ways that it looks at, alternately left and right


@inline
def move_target(lane, w, x, k):
    """Advance the target by dt: x, y, velocity and heading."""
    step = k[k[STEP] + lane]
    if w.target_kind == RECORDED:
        follow_path(lane, w, step + 1, x, k)
        return
    u0, u1, u2, _ = uniform4(k[k[KEY] + lane], k[k[EPISODE] + lane], step, DRAW_TARGET, FIRST)
    if w.target_kind == CONSTANT_VELOCITY:
        _drift(lane, w, u0, u1, x, k)
    else:
        _drive(lane, w, u0, u1, u2, x, k)


@inline
def _drift(lane, w, u0, u1, x, k):
    """Straight on; white acceleration changes the velocity, and walls reflect it."""
    n0, n1 = normal_pair(u0, u1)
    at = k[TARGET_STATE] + 4 * lane
    kick = w.target_acceleration_density * math.sqrt(w.dt)
    px, py, mirror_x, mirror_y = _reached(lane, w, x[at] + w.dt * x[at + 2], x[at + 1] + w.dt * x[at + 3], x, k)
    x[at], x[at + 1] = px, py
    x[at + 2] = mirror_x * x[at + 2] + kick * n0
    x[at + 3] = mirror_y * x[at + 3] + kick * n1
    x[k[TARGET_HEADING] + lane] = wrap(math.atan2(x[at + 3], x[at + 2]))


@inline
def _drive(lane, w, u0, u1, u2, x, k):
    """A unicycle: with a constant twist and noise, Eq. (17) of Wu and Sun 2013, or steering to where it wants."""
    at = k[TARGET_STATE] + 4 * lane
    heading = x[k[TARGET_HEADING] + lane]
    if w.target_kind == TWIST:
        n0, n1 = normal_pair(u0, u1)
        v, turn = w.target_speed + w.target_speed_std * n0, w.target_turn_rate + w.target_turn_std * n1
    else:
        off = wrap(_wanted_heading(lane, w, u0, u1, u2, x, k) - heading)
        v, turn = w.target_speed, min(max(off / w.dt, -w.target_turn_max), w.target_turn_max)
    dx, dy, dphi = unicycle(v, turn, w.dt, heading)
    px, py, mirror_x, mirror_y = _reached(lane, w, x[at] + dx, x[at + 1] + dy, x, k)
    heading = wrap(heading + dphi)
    if mirror_x < 0.0:
        heading = wrap(math.pi - heading)
    if mirror_y < 0.0:
        heading = wrap(-heading)
    x[at + 2], x[at + 3] = (px - x[at]) / w.dt, (py - x[at + 1]) / w.dt
    x[at], x[at + 1] = px, py
    x[k[TARGET_HEADING] + lane] = heading


@inline
def _wanted_heading(lane, w, u0, u1, u2, x, k):
    """Towards the waypoint, which changes at random or when reached; away from a near robot if it flees."""
    at, goal, robot = k[TARGET_STATE] + 4 * lane, k[GOAL] + 2 * lane, k[POSE] + 3 * lane
    gx, gy = x[goal] - x[at], x[goal + 1] - x[at + 1]
    if (
        k[k[STEP] + lane] == 0
        or gx * gx + gy * gy < ARRIVED * ARRIVED
        or u2 < -math.expm1(-w.target_waypoint_rate * w.dt)
    ):
        gx, gy = (u0 - 0.5) * w.arena_width, (u1 - 0.5) * w.arena_height
        gx, gy = _out_of_pillars(lane, w, gx, gy, BERTH, x, k)
        x[goal], x[goal + 1] = gx, gy
        gx, gy = gx - x[at], gy - x[at + 1]
    dx, dy = x[at] - x[robot], x[at + 1] - x[robot + 1]
    if w.target_kind != EVASIVE or dx * dx + dy * dy > w.target_flee_distance * w.target_flee_distance:
        return math.atan2(gy, gx)
    away = math.atan2(dy, dx)
    return _along_walls(lane, w, away, x, k) if w.arena_walls == 1 else away


@inline
def _along_walls(lane, w, wanted, x, k):
    """The heading nearest to `wanted` that leads, `ahead` metres on, into no wall or dead end."""
    at, ahead = k[TARGET_STATE] + 4 * lane, max(1.0, w.target_speed)
    for i in range(SIDE_STEPS):
        way = wanted + SIDE_STEP * ((i + 1) // 2) * (1.0 if i % 2 == 0 else -1.0)
        to_x, to_y = x[at] + ahead * math.cos(way), x[at + 1] + ahead * math.sin(way)
        to_x, to_y = _out_of_pillars(lane, w, to_x, to_y, 0.0, x, k)
        if abs(to_x) <= 0.5 * w.arena_width and abs(to_y) <= 0.5 * w.arena_height:
            return way
    return wanted


@inline
def _reached(lane, w, px, py, x, k):
    """Where a target that would go to (px, py) gets to, and per axis -1 where its motion is reflected.

    Walls reflect it, and it slides around pillars, itself a point. Where a pillar that reaches into a wall would push
    it out of the arena is a dead end: it stays where it stands, turns round and looks for another waypoint.
    """
    half_x, half_y = math.inf, math.inf
    if w.arena_walls == 1:
        half_x, half_y = 0.5 * w.arena_width, 0.5 * w.arena_height
    in_x, in_y = min(max(px, -half_x), half_x), min(max(py, -half_y), half_y)
    mirror_x, mirror_y = 1.0 if in_x == px else -1.0, 1.0 if in_y == py else -1.0
    to_x, to_y = _out_of_pillars(lane, w, in_x, in_y, 0.0, x, k)
    if abs(to_x) <= half_x and abs(to_y) <= half_y:
        return to_x, to_y, mirror_x, mirror_y
    at, goal = k[TARGET_STATE] + 4 * lane, k[GOAL] + 2 * lane
    if abs(x[at]) > half_x or abs(x[at + 1]) > half_y or _in_pillar(lane, x[at], x[at + 1], x, k):
        return in_x, in_y, mirror_x, mirror_y  # a scenario has placed it there: it walks out
    x[goal], x[goal + 1] = x[at], x[at + 1]
    return x[at], x[at + 1], -1.0, -1.0


@inline
def _out_of_pillars(lane, w, px, py, body, x, k):
    """The nearest place outside the pillars for a disc of radius `body`."""
    if w.landmarks_radius == 0.0:
        return px, py
    first = k[NUM_LANDMARKS] * lane
    return pushed_out(px, py, body, x, k[LANDMARKS] + 2 * first, k[RADIUS] + first, k[k[COUNT] + lane])


@inline
def _in_pillar(lane, px, py, x, k):
    """Whether a point is deeper in a pillar than rounding leaves one that slides along its rim."""
    first = k[NUM_LANDMARKS] * lane
    return touching(px, py, -DEPTH, x, k[LANDMARKS] + 2 * first, k[RADIUS] + first, k[k[COUNT] + lane])


@inline
def follow_path(lane, w, step, x, k):
    """Where the recorded rows (time_s, x_m, y_m) are at the end of that step; it rests at the last."""
    path, low, high = k[PATH], 0, k[NUM_ROWS] - 1
    t = step * w.dt + x[path]
    while high - low > 1:
        half = (low + high) // 2
        if x[path + 3 * half] <= t:
            low = half
        else:
            high = half
    at, before, after = k[TARGET_STATE] + 4 * lane, path + 3 * low, path + 3 * high
    if t >= x[after]:
        x[at], x[at + 1], x[at + 2], x[at + 3] = x[after + 1], x[after + 2], 0.0, 0.0
        return
    span = x[after] - x[before]
    vx, vy = (x[after + 1] - x[before + 1]) / span, (x[after + 2] - x[before + 2]) / span
    x[at], x[at + 1] = x[before + 1] + vx * (t - x[before]), x[before + 2] + vy * (t - x[before])
    x[at + 2], x[at + 3] = vx, vy
    if vx != 0.0 or vy != 0.0:
        x[k[TARGET_HEADING] + lane] = wrap(math.atan2(vy, vx))
