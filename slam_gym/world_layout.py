"""How an episode begins: where landmarks, robot and target stand. One kernel call per reset."""

import math

from estimators.kernels.angles import wrap
from estimators.kernels.jit import inline, jit
from estimators.kernels.random import normal4, uniform4
from slam_gym.world_geometry import hidden, in_view, pushed_out, touching
from slam_gym.world_numbers import (
    ANYWHERE,
    CLUSTERED,
    DRAW_LAYOUT,
    DRAW_START,
    FILE,
    FIXED,
    GRID,
    IN_VIEW,
    RECORDED,
    RING,
)

TRIES = 60  # places tried before a wish (a free gap, a visible target) is given up
CLUSTER_ITEM = 1 << 20  # items of the cluster centres' draws, beyond any landmark's
START_TARGET_ITEM = 1  # first item of the target's draws; item 0 is the robot's


@jit
def place_landmarks(lanes, numbers, key, episode, file_points, landmarks, radius, count):
    """Fill landmarks [L, N, 2], radius [L, N], count [L]; each landmark's draw has an item of its own."""
    for n in range(lanes.shape[0]):
        lane = lanes[n]
        w = numbers[lane]
        count[lane] = file_points.shape[0] if w.landmarks_layout == FILE else int(w.landmarks_count)
        for j in range(landmarks.shape[1]):
            radius[lane, j] = w.landmarks_radius if j < count[lane] else 0.0
            landmarks[lane, j, 0] = 0.0
            landmarks[lane, j, 1] = 0.0
        for j in range(count[lane]):
            for attempt in range(TRIES):
                x, y = _place(lane, j, attempt, w, key, episode, file_points, count)
                landmarks[lane, j, 0] = x
                landmarks[lane, j, 1] = y
                fixed = w.landmarks_layout == FILE or w.landmarks_layout == GRID
                if fixed or _free(lane, j, x, y, w, landmarks):
                    break


@inline
def _place(lane, j, attempt, w, key, episode, file_points, count):
    """A candidate for landmark j."""
    if w.landmarks_layout == FILE:
        return file_points[j, 0], file_points[j, 1]
    u0, u1, u2, _ = uniform4(key[lane], episode[lane], attempt, DRAW_LAYOUT, j)
    half_x = 0.5 * w.arena_width - w.landmarks_margin
    half_y = 0.5 * w.arena_height - w.landmarks_margin
    if w.landmarks_layout == GRID:
        columns = math.ceil(math.sqrt(float(count[lane])))
        rows = (count[lane] + columns - 1) // columns
        x = (2.0 * (j % columns) + 1.0) / columns - 1.0
        y = (2.0 * (j // columns) + 1.0) / rows - 1.0
        return w.landmarks_center_x + x * half_x, w.landmarks_center_y + y * half_y
    if w.landmarks_layout == RING:
        inner = max(0.0, w.landmarks_ring_radius - w.landmarks_ring_width)
        outer = w.landmarks_ring_radius + w.landmarks_ring_width
        r = math.sqrt(inner * inner + u0 * (outer * outer - inner * inner))  # uniform over the area
        angle = 2.0 * math.pi * u1
        return w.landmarks_center_x + r * math.cos(angle), w.landmarks_center_y + r * math.sin(angle)
    if w.landmarks_layout == CLUSTERED:
        cluster = min(int(u2 * w.landmarks_clusters), int(w.landmarks_clusters) - 1)
        c0, c1, _, _ = uniform4(key[lane], episode[lane], 0, DRAW_LAYOUT, CLUSTER_ITEM + cluster)
        n0, n1, _, _ = normal4(key[lane], episode[lane], attempt, DRAW_LAYOUT, 2 * CLUSTER_ITEM + j)
        x = (2.0 * c0 - 1.0) * half_x + w.landmarks_cluster_std * n0
        y = (2.0 * c1 - 1.0) * half_y + w.landmarks_cluster_std * n1
        return w.landmarks_center_x + x, w.landmarks_center_y + y
    return w.landmarks_center_x + (2.0 * u0 - 1.0) * half_x, w.landmarks_center_y + (2.0 * u1 - 1.0) * half_y


@inline
def _free(lane, j, x, y, w, landmarks):
    """Whether landmark j keeps its distance from the robot's start and from those placed before."""
    dx, dy = x - w.robot_start_x, y - w.robot_start_y
    if math.hypot(dx, dy) < w.landmarks_clearance + w.landmarks_radius:
        return False
    apart = 2.0 * w.landmarks_radius + w.landmarks_gap
    for k in range(j):
        if apart > 0.0 and math.hypot(x - landmarks[lane, k, 0], y - landmarks[lane, k, 1]) < apart:
            return False
    return True


@jit
def place_bodies(lanes, numbers, key, episode, landmarks, radius, count, path, pose, start_pose, body):
    """Robot and target at their starts. pose, start_pose: [L, 3], true and told; body: [L, 3] the target."""
    for n in range(lanes.shape[0]):
        lane = lanes[n]
        w = numbers[lane]
        start_pose[lane, 0] = w.robot_start_x
        start_pose[lane, 1] = w.robot_start_y
        start_pose[lane, 2] = wrap(w.robot_start_heading)
        n0, n1, n2, _ = normal4(key[lane], episode[lane], 0, DRAW_START, 0)
        pose[lane, 0] = start_pose[lane, 0] + w.robot_start_position_std * n0
        pose[lane, 1] = start_pose[lane, 1] + w.robot_start_position_std * n1
        pose[lane, 2] = wrap(start_pose[lane, 2] + w.robot_start_heading_std * n2)
        body[lane, 2] = wrap(w.target_start_heading)
        if w.target_kind == RECORDED:
            body[lane, 0], body[lane, 1] = path[0, 1], path[0, 2]
        elif w.target_placed == FIXED:
            body[lane, 0], body[lane, 1] = w.target_start_x, w.target_start_y
        else:
            _place_target(lane, w, key, episode, landmarks, radius, count, pose, body)


@inline
def _place_target(lane, w, key, episode, landmarks, radius, count, pose, body):
    """Around the robot, at the wished distance and bearing; both fresh at each try where the wish is not met."""
    cos_half = math.cos(min(0.5 * w.sensor_field_of_view, math.pi))
    c, s = math.cos(pose[lane, 2]), math.sin(pose[lane, 2])
    for attempt in range(TRIES):
        u0, u1, _, _ = uniform4(key[lane], episode[lane], attempt, DRAW_START, START_TARGET_ITEM)
        distance, bearing = w.target_start_distance, w.target_start_bearing
        if attempt > 0:  # the first try is the drawn number itself; later ones look around it
            distance *= 1.0 + 0.5 * (2.0 * u0 - 1.0) * attempt / TRIES
            spread = math.pi if w.target_placed != IN_VIEW else 0.5 * w.sensor_field_of_view
            bearing += spread * (2.0 * u1 - 1.0) * attempt / TRIES
        angle = pose[lane, 2] + bearing
        x, y = pose[lane, 0] + distance * math.cos(angle), pose[lane, 1] + distance * math.sin(angle)
        body[lane, 0], body[lane, 1] = x, y
        inside = abs(x) <= 0.5 * w.arena_width and abs(y) <= 0.5 * w.arena_height
        if w.arena_walls == 1 and not inside:
            continue
        if touching(lane, x, y, 0.0, landmarks, radius, count):
            continue
        dx, dy = x - pose[lane, 0], y - pose[lane, 1]
        seen = in_view(dx, dy, c, s, w.sensor_min_range, w.sensor_max_range, cos_half)
        if seen and w.landmarks_opaque == 1:
            seen = not hidden(lane, pose[lane, 0], pose[lane, 1], x, y, -1, landmarks, radius, count)
        if w.target_placed == ANYWHERE or seen == (w.target_placed == IN_VIEW):
            return
    x, y = body[lane, 0], body[lane, 1]
    if w.arena_walls == 1:
        x = min(max(x, -0.5 * w.arena_width), 0.5 * w.arena_width)
        y = min(max(y, -0.5 * w.arena_height), 0.5 * w.arena_height)
    body[lane, 0], body[lane, 1] = pushed_out(lane, x, y, 0.0, landmarks, radius, count)
