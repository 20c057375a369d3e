"""How an episode begins: where landmarks, robot and target stand. One kernel call per reset."""

import math

from estimators.kernels.angles import wrap
from estimators.kernels.borrow import borrow
from estimators.kernels.jit import inline, jit
from estimators.kernels.random import normal4, uniform4
from slam_gym.world_draws import CLUSTER_ITEM, DRAW_LAYOUT, DRAW_START, FIRST, NOBODY, TARGET_ITEM
from slam_gym.world_geometry import cos_half_view, pushed_out, touching
from slam_gym.world_numbers import (
    ANYWHERE,
    CLUSTERED,
    FILE,
    FIXED,
    GRID,
    IN_VIEW,
    NONE,
    ONE_SIGMA,
    RECORDED,
    RING,
)
from slam_gym.world_sensor import is_visible
from slam_gym.world_state import (
    COUNT,
    EPISODE,
    KEY,
    LANDMARKS,
    NUM_LANDMARKS,
    POSE,
    RADIUS,
    START_POSE,
    TARGET_HEADING,
    TARGET_STATE,
    VISIBLE,
)
from slam_gym.world_target import follow_path

TRIES = 100  # places tried before a wish (a free gap, a visible target) is given up


@jit
def begin(lanes, numbers, x, k, b, points):
    """Place everything in the lanes [n]; points: [rows, 2] of a landmark file; the rest as in `world_step.step`."""
    numbers, x, k, b, points = borrow(numbers), borrow(x), borrow(k), borrow(b), borrow(points)
    for n in range(lanes.shape[0]):
        lane = lanes[n]
        w = numbers[lane]
        _place_landmarks(lane, w, x, k, points)
        _place_robot(lane, w, x, k)
        if w.target_kind != NONE:
            _place_target(lane, w, x, k)
            robot, body = k[POSE] + 3 * lane, k[TARGET_STATE] + 4 * lane
            b[k[VISIBLE] + lane] = _sees(lane, w, x[robot], x[robot + 1], x[robot + 2], x[body], x[body + 1], x, k)


@inline
def _place_landmarks(lane, w, x, k, points):
    """Every landmark's draws have an item of their own; pillars keep apart where there is room."""
    count = points.shape[0] if w.landmarks_layout == FILE else int(w.landmarks_count)
    k[k[COUNT] + lane] = count
    first = k[NUM_LANDMARKS] * lane
    at, radii = k[LANDMARKS] + 2 * first, k[RADIUS] + first
    for j in range(k[NUM_LANDMARKS]):
        x[radii + j] = w.landmarks_radius if j < count else 0.0
        x[at + 2 * j], x[at + 2 * j + 1] = 0.0, 0.0
    for j in range(count):
        if w.landmarks_layout == FILE:
            x[at + 2 * j], x[at + 2 * j + 1] = points[j, 0], points[j, 1]
            continue
        for attempt in range(TRIES):
            px, py = _candidate(j, attempt, count, w, k[k[KEY] + lane], k[k[EPISODE] + lane])
            x[at + 2 * j], x[at + 2 * j + 1] = px, py
            if w.landmarks_layout == GRID or _free(j, px, py, w, x, at):
                break


@inline
def _candidate(j, attempt, count, w, key, episode):
    """A place for landmark j."""
    u0, u1, u2, _ = uniform4(key, episode, attempt, DRAW_LAYOUT, j)
    half_x = 0.5 * w.arena_width - w.landmarks_margin
    half_y = 0.5 * w.arena_height - w.landmarks_margin
    px, py = (2.0 * u0 - 1.0) * half_x, (2.0 * u1 - 1.0) * half_y
    if w.landmarks_layout == GRID:
        columns = math.ceil(math.sqrt(float(count)))
        rows = (count + columns - 1) // columns
        px = ((2.0 * (j % columns) + 1.0) / columns - 1.0) * half_x
        py = ((2.0 * (j // columns) + 1.0) / rows - 1.0) * half_y
    elif w.landmarks_layout == RING:
        side = 1.0 if j % 2 == 0 else -1.0  # by turns outside and inside, so that no stretch of the ring is bare
        aside = w.landmarks_ring_gap + u0 * (w.landmarks_ring_width - w.landmarks_ring_gap)
        r = max(0.0, w.landmarks_ring_radius + side * aside)
        px, py = r * math.cos(2.0 * math.pi * j / count), r * math.sin(2.0 * math.pi * j / count)
    elif w.landmarks_layout == CLUSTERED:
        cluster = min(int(u2 * w.landmarks_clusters), int(w.landmarks_clusters) - 1)
        c0, c1, _, _ = uniform4(key, episode, FIRST, DRAW_LAYOUT, CLUSTER_ITEM + cluster)
        n0, n1, _, _ = normal4(key, episode, attempt, DRAW_LAYOUT, 2 * CLUSTER_ITEM + j)
        px = (2.0 * c0 - 1.0) * half_x + w.landmarks_cluster_std * n0
        py = (2.0 * c1 - 1.0) * half_y + w.landmarks_cluster_std * n1
    return w.landmarks_center_x + px, w.landmarks_center_y + py


@inline
def _free(j, px, py, w, x, at):
    """Whether landmark j keeps its distance from the robot's start and from those placed before."""
    reach = w.landmarks_clearance + w.landmarks_radius
    dx, dy = px - w.robot_start_x, py - w.robot_start_y
    if dx * dx + dy * dy < reach * reach:
        return False
    apart = 2.0 * w.landmarks_radius + w.landmarks_gap
    for i in range(j):
        dx, dy = px - x[at + 2 * i], py - x[at + 2 * i + 1]
        if dx * dx + dy * dy < apart * apart:
            return False
    return True


@inline
def _place_robot(lane, w, x, k):
    """The start that the filter is told, and the true one about it."""
    told, at = k[START_POSE] + 3 * lane, k[POSE] + 3 * lane
    x[told], x[told + 1], x[told + 2] = w.robot_start_x, w.robot_start_y, wrap(w.robot_start_heading)
    n0, n1, n2, _ = normal4(k[k[KEY] + lane], k[k[EPISODE] + lane], FIRST, DRAW_START, FIRST)
    if w.robot_start_noise == ONE_SIGMA:
        way = x[told + 2] + w.robot_start_heading_std
        n0, n1, n2 = math.cos(way), math.sin(way), 1.0
    x[at] = x[told] + w.robot_start_position_std * n0
    x[at + 1] = x[told + 1] + w.robot_start_position_std * n1
    x[at + 2] = wrap(x[told + 2] + w.robot_start_heading_std * n2)


@inline
def _place_target(lane, w, x, k):
    """Where it stands, where it looks, and how fast it goes."""
    at = k[TARGET_STATE] + 4 * lane
    x[k[TARGET_HEADING] + lane] = wrap(w.target_start_heading)
    if w.target_kind == RECORDED:
        follow_path(lane, w, FIRST, x, k)
        return
    if w.target_placed == FIXED:
        x[at], x[at + 1] = w.target_start_x, w.target_start_y
    else:
        x[at], x[at + 1] = _target_place(lane, w, x, k)
    x[at + 2] = w.target_speed * math.cos(w.target_start_heading)
    x[at + 3] = w.target_speed * math.sin(w.target_start_heading)


@inline
def _target_place(lane, w, x, k):
    """Around the robot, at a distance and bearing of the scenario's; then at any bearing; then anything inside."""
    robot, first = k[POSE] + 3 * lane, k[NUM_LANDMARKS] * lane
    centres, radii, count = k[LANDMARKS] + 2 * first, k[RADIUS] + first, k[k[COUNT] + lane]
    half_x, half_y = 0.5 * w.arena_width, 0.5 * w.arena_height
    px, py = x[robot], x[robot + 1]
    for attempt in range(2 * TRIES):
        u0, u1, _, _ = uniform4(k[k[KEY] + lane], k[k[EPISODE] + lane], attempt, DRAW_START, TARGET_ITEM)
        low, high = w.target_start_distance_low, w.target_start_distance_high
        distance = low + u0 * (high - low)
        low, high = w.target_start_bearing_low, w.target_start_bearing_high
        bearing = low + u1 * (high - low) if attempt < TRIES else (2.0 * u1 - 1.0) * math.pi
        w.target_start_distance, w.target_start_bearing = distance, bearing
        px = x[robot] + distance * math.cos(x[robot + 2] + bearing)
        py = x[robot + 1] + distance * math.sin(x[robot + 2] + bearing)
        if w.arena_walls == 1 and (abs(px) > half_x or abs(py) > half_y):
            continue
        if touching(px, py, 0.0, x, centres, radii, count):
            continue
        seen = _sees(lane, w, x[robot], x[robot + 1], x[robot + 2], px, py, x, k)
        if w.target_placed == ANYWHERE or seen == (w.target_placed == IN_VIEW):
            return px, py
    if w.arena_walls == 1:
        px, py = min(max(px, -half_x), half_x), min(max(py, -half_y), half_y)
    return pushed_out(px, py, 0.0, x, centres, radii, count)


@inline
def _sees(lane, w, from_x, from_y, heading, to_x, to_y, x, k):
    """Whether the robot's sensor at that pose sees that point."""
    c, s, cos_half = math.cos(heading), math.sin(heading), cos_half_view(w.sensor_field_of_view)
    return is_visible(lane, w, from_x, from_y, c, s, cos_half, to_x, to_y, NOBODY, x, k)
