"""One step of the truth: the robot under its command, then the target."""

import math

from estimators.kernels.angles import wrap
from estimators.kernels.jit import inline, jit
from estimators.kernels.motion import bicycle, unicycle
from estimators.kernels.random import normal4, uniform4
from slam_gym.world_geometry import pushed_out, touching
from slam_gym.world_numbers import (
    BLOCK,
    CONSTANT_VELOCITY,
    DRAW_ROBOT,
    DRAW_TARGET,
    EVASIVE,
    NO_COLLISION,
    NONE,
    RECORDED,
    TWIST,
)

BICYCLE = 1  # position in ROBOT_KINDS
ROOT_SECOND = 1  # in NOISE_LAWS
ON_ODOMETRY = 1  # in NOISE_ON
ARRIVED = 0.5  # [m] from a waypoint: the target takes a new one
FLEE_HYSTERESIS = 0.6  # [rad] either side in which a fleeing target looks for a way that stays inside the walls
FIRST_WAYPOINT = 1 << 20  # item of a waypoint's draw at the start of an episode

# Columns of `memory` [L, MEMORY], what a step needs of the last one.
STEERING, GOAL_X, GOAL_Y, VELOCITY_X, VELOCITY_Y, HAS_GOAL = range(6)
MEMORY = 6


@jit
def move(
    lanes, numbers, key, episode, step, command, delayed, odometry, pose, body, target, memory, path, landmarks, radius,
    count, collisions, touching_now, target_heading,
):  # fmt: skip
    """Advance robot and target by dt; `step` [L] is counted up by one.

    Args:
        lanes: [n]. numbers: [L] `WORLD`. key, episode, step: [L] of the random draws.
        command: [L, 2] wanted (speed, turn rate) or (speed, steering angle).
        delayed: [L, D, 2] ring of past commands, D - 1 the longest delay in steps.
        odometry: [L, 2] filled: what is reported of this step.
        pose: [L, 3]. body: [L, 3] the target's x, y, heading. target: [L, 4] filled: x, y and velocity.
        memory: [L, MEMORY]. path: [T, 3] time, x, y of a recorded target.
        landmarks, radius, count: the pillars. collisions: [L] entries counted. touching_now: [L].
        target_heading: [L] filled.
    """
    for n in range(lanes.shape[0]):
        lane = lanes[n]
        w = numbers[lane]
        v, s, issued_v, issued_s = _executed(lane, w, step, command, delayed, memory)
        _move_robot(lane, w, key, episode, step, v, s, issued_v, issued_s, odometry, pose)
        if w.landmarks_collision != NO_COLLISION:
            hit = touching(lane, pose[lane, 0], pose[lane, 1], w.robot_radius, landmarks, radius, count)
            if hit and not touching_now[lane]:
                collisions[lane] += 1
            touching_now[lane] = hit
            if hit and w.landmarks_collision == BLOCK:
                x, y = pushed_out(lane, pose[lane, 0], pose[lane, 1], w.robot_radius, landmarks, radius, count)
                pose[lane, 0], pose[lane, 1] = x, y
        if w.target_kind != NONE:
            x, y = body[lane, 0], body[lane, 1]
            _move_target(lane, w, key, episode, step, pose, body, memory, path, landmarks, radius, count)
            target[lane, 0], target[lane, 1] = body[lane, 0], body[lane, 1]
            target_heading[lane] = body[lane, 2]
            target[lane, 2], target[lane, 3] = (body[lane, 0] - x) / w.dt, (body[lane, 1] - y) / w.dt
        step[lane] += 1


@inline
def _executed(lane, w, step, command, delayed, memory):
    """The command that acts now (delayed, limited, the steering no faster than it can turn), and the issued one."""
    ring = delayed.shape[1]
    back = int(min(math.floor(w.robot_command_delay / w.dt + 0.5), ring - 1.0))
    now = step[lane] % ring
    delayed[lane, now, 0] = min(max(command[lane, 0], w.robot_speed_min), w.robot_speed_max)
    limit = w.robot_steering_max if w.robot_kind == BICYCLE else w.robot_turn_max
    delayed[lane, now, 1] = min(max(command[lane, 1], -limit), limit)
    then = (step[lane] - back + ring) % ring
    v, s = delayed[lane, then, 0], delayed[lane, then, 1]
    if step[lane] < back:
        v, s = 0.0, 0.0
    if w.robot_kind == BICYCLE:
        most = w.robot_steering_rate * w.dt
        s = memory[lane, STEERING] + min(max(s - memory[lane, STEERING], -most), most)
        memory[lane, STEERING] = s
        return v, s, delayed[lane, now, 0], s
    return v, s, delayed[lane, now, 0], delayed[lane, now, 1]


@inline
def _move_robot(lane, w, key, episode, step, v, s, issued_v, issued_s, odometry, pose):
    """True motion and report; the disturbance is on one of the two. Odometry reports the command as it is issued."""
    n0, n1, _, _ = normal4(key[lane], episode[lane], step[lane], DRAW_ROBOT, 0)
    scale = 1.0 / math.sqrt(w.dt) if w.robot_noise_law == ROOT_SECOND else 1.0
    dv = scale * n0 * (w.robot_speed_std + w.robot_speed_std_per_speed * abs(v))
    ds = scale * n1 * (w.robot_turn_std + w.robot_turn_std_per_turn * abs(s) + w.robot_turn_std_per_speed * abs(v))
    moving = v != 0.0 or s != 0.0
    if w.robot_noise_on == ON_ODOMETRY:
        bias = w.robot_turn_bias if moving else 0.0
        odometry[lane, 0] = issued_v / w.robot_speed_scale + dv
        odometry[lane, 1] = (issued_s - bias) / w.robot_turn_scale + ds
        true_v, true_s = v, s
    else:
        odometry[lane, 0], odometry[lane, 1] = issued_v, issued_s
        true_v = w.robot_speed_scale * v + dv
        true_s = w.robot_turn_scale * s + (w.robot_turn_bias if moving else 0.0) + ds
    if w.robot_kind == BICYCLE:
        dx, dy, dphi = bicycle(true_v, true_s, w.dt, pose[lane, 2], w.robot_wheelbase)
    else:
        dx, dy, dphi = unicycle(true_v, true_s, w.dt, pose[lane, 2])
    pose[lane, 0] += dx
    pose[lane, 1] += dy
    pose[lane, 2] = wrap(pose[lane, 2] + dphi)


@inline
def _move_target(lane, w, key, episode, step, pose, body, memory, path, landmarks, radius, count):
    """By its kind; then back inside the walls and out of the pillars."""
    kind = w.target_kind
    if kind == RECORDED:
        _follow_path(lane, w, step, body, path)
        return
    if kind == TWIST:
        n0, n1, _, _ = normal4(key[lane], episode[lane], step[lane], DRAW_TARGET, 0)
        dx, dy, dphi = unicycle(
            w.target_speed + w.target_speed_std * n0, w.target_turn_rate + w.target_turn_std * n1, w.dt, body[lane, 2]
        )
    elif kind == CONSTANT_VELOCITY:
        n0, n1, _, _ = normal4(key[lane], episode[lane], step[lane], DRAW_TARGET, 0)
        kick = w.target_acceleration_density * math.sqrt(w.dt)
        dx, dy = memory[lane, VELOCITY_X] * w.dt, memory[lane, VELOCITY_Y] * w.dt
        memory[lane, VELOCITY_X] += kick * n0
        memory[lane, VELOCITY_Y] += kick * n1
        dphi = wrap(math.atan2(memory[lane, VELOCITY_Y], memory[lane, VELOCITY_X]) - body[lane, 2])
    else:
        wanted = _wanted_heading(lane, w, key, episode, step, pose, body, memory)
        most = w.target_turn_max * w.dt
        dphi = min(max(wrap(wanted - body[lane, 2]), -most), most)
        dx = w.target_speed * w.dt * math.cos(body[lane, 2] + dphi)
        dy = w.target_speed * w.dt * math.sin(body[lane, 2] + dphi)
    body[lane, 0] += dx
    body[lane, 1] += dy
    body[lane, 2] = wrap(body[lane, 2] + dphi)
    _keep_inside(lane, w, body, memory)
    if w.landmarks_radius > 0.0:
        x, y = pushed_out(lane, body[lane, 0], body[lane, 1], 0.0, landmarks, radius, count)
        body[lane, 0], body[lane, 1] = x, y


@inline
def _wanted_heading(lane, w, key, episode, step, pose, body, memory):
    """Towards the waypoint, which changes at random or when reached; away from a near robot if it flees."""
    u0, u1, u2, _ = uniform4(key[lane], episode[lane], step[lane], DRAW_TARGET, 0)
    away = math.hypot(memory[lane, GOAL_X] - body[lane, 0], memory[lane, GOAL_Y] - body[lane, 1])
    if memory[lane, HAS_GOAL] == 0.0 or away < ARRIVED or u2 < w.target_waypoint_rate * w.dt:
        memory[lane, HAS_GOAL] = 1.0
        memory[lane, GOAL_X] = (u0 - 0.5) * w.arena_width
        memory[lane, GOAL_Y] = (u1 - 0.5) * w.arena_height
    dx, dy = body[lane, 0] - pose[lane, 0], body[lane, 1] - pose[lane, 1]
    if w.target_kind != EVASIVE or math.hypot(dx, dy) > w.target_flee_distance:
        return math.atan2(memory[lane, GOAL_Y] - body[lane, 1], memory[lane, GOAL_X] - body[lane, 0])
    wanted = math.atan2(dy, dx)
    if w.arena_walls == 1:
        wanted = _along_walls(lane, w, body, wanted)
    return wanted


@inline
def _along_walls(lane, w, body, wanted):
    """The heading nearest to `wanted` whose next metres stay inside the walls."""
    ahead = max(1.0, w.target_speed)
    for k in range(12):
        turn = FLEE_HYSTERESIS * ((k + 1) // 2) * (1.0 if k % 2 == 0 else -1.0)
        x = body[lane, 0] + ahead * math.cos(wanted + turn)
        y = body[lane, 1] + ahead * math.sin(wanted + turn)
        if abs(x) <= 0.5 * w.arena_width and abs(y) <= 0.5 * w.arena_height:
            return wanted + turn
    return wanted


@inline
def _keep_inside(lane, w, body, memory):
    """Walls reflect the heading and the velocity."""
    if w.arena_walls == 0:
        return
    half_x, half_y = 0.5 * w.arena_width, 0.5 * w.arena_height
    if abs(body[lane, 0]) > half_x:
        body[lane, 0] = min(max(body[lane, 0], -half_x), half_x)
        body[lane, 2] = wrap(math.pi - body[lane, 2])
        memory[lane, VELOCITY_X] = -memory[lane, VELOCITY_X]
    if abs(body[lane, 1]) > half_y:
        body[lane, 1] = min(max(body[lane, 1], -half_y), half_y)
        body[lane, 2] = wrap(-body[lane, 2])
        memory[lane, VELOCITY_Y] = -memory[lane, VELOCITY_Y]


@inline
def _follow_path(lane, w, step, body, path):
    """Linear interpolation of the recorded rows at the end of this step; rests at the last."""
    t = (step[lane] + 1) * w.dt + path[0, 0]
    rows = path.shape[0]
    low, high = 0, rows - 1
    while high - low > 1:
        half = (low + high) // 2
        if path[half, 0] <= t:
            low = half
        else:
            high = half
    span = path[high, 0] - path[low, 0]
    share = min(max((t - path[low, 0]) / span, 0.0), 1.0) if span > 0.0 else 1.0
    x = path[low, 1] + share * (path[high, 1] - path[low, 1])
    y = path[low, 2] + share * (path[high, 2] - path[low, 2])
    dx, dy = x - body[lane, 0], y - body[lane, 1]
    if dx != 0.0 or dy != 0.0:
        body[lane, 2] = math.atan2(dy, dx)
    body[lane, 0], body[lane, 1] = x, y
