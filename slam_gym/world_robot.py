"""One step of the robot: what is commanded, what moves it, what odometry reports, and what it runs into."""

import math

from estimators.kernels.angles import wrap
from estimators.kernels.jit import inline
from estimators.kernels.motion import bicycle, unicycle
from estimators.kernels.random import normal_pair, uniform4
from slam_gym.world_draws import DRAW_ROBOT, FIRST
from slam_gym.world_geometry import pushed_out, touching
from slam_gym.world_numbers import BICYCLE, BLOCK, NO_COLLISION, ON_ODOMETRY, ROOT_SECOND
from slam_gym.world_state import (
    COLLISIONS,
    COUNT,
    DELAYED,
    EPISODE,
    KEY,
    LANDMARKS,
    NUM_COMMANDS,
    NUM_LANDMARKS,
    ODOMETRY,
    POSE,
    RADIUS,
    STEERING,
    STEP,
    TOUCHING,
)


@inline
def move_robot(lane, w, command, x, k, b):
    """Advance the robot by dt under its command [L, 2]: (speed, turn rate) or (speed, steering angle)."""
    issued_v, issued_s, v, s = _executed(lane, w, command[lane, 0], command[lane, 1], x, k)
    dv, ds = _disturbance(lane, w, v, s, k)
    bias = w.robot_turn_bias if v != 0.0 or s != 0.0 else 0.0
    at = k[ODOMETRY] + 2 * lane
    if w.robot_noise_on == ON_ODOMETRY:  # what moved the robot is measured, and measured badly
        x[at] = v / w.robot_speed_scale + dv
        x[at + 1] = (s - bias) / w.robot_turn_scale + ds
    else:  # what is commanded is reported, and carried out badly
        x[at], x[at + 1] = issued_v, issued_s
        v = w.robot_speed_scale * v + dv
        s = w.robot_turn_scale * s + bias + ds
    at = k[POSE] + 3 * lane
    heading = x[at + 2]
    if w.robot_kind == BICYCLE:
        dx, dy, dphi = bicycle(v, s, w.dt, heading, w.robot_wheelbase)
    else:
        dx, dy, dphi = unicycle(v, s, w.dt, heading)
    x[at] += dx
    x[at + 1] += dy
    x[at + 2] = wrap(heading + dphi)
    if w.arena_holds_robot == 1:
        half_x, half_y = 0.5 * w.arena_width, 0.5 * w.arena_height
        x[at] = min(max(x[at], -half_x), half_x)
        x[at + 1] = min(max(x[at + 1], -half_y), half_y)
    if w.landmarks_collision != NO_COLLISION:
        _collide(lane, w, x, k, b)


@inline
def _executed(lane, w, speed, turn, x, k):
    """The limited command as issued and as it acts: delayed, the steering no faster than it can turn."""
    limit = w.robot_steering_max if w.robot_kind == BICYCLE else w.robot_turn_max
    issued_v = min(max(speed, w.robot_speed_min), w.robot_speed_max)
    issued_s = min(max(turn, -limit), limit)
    v, s = issued_v, issued_s
    ring = k[NUM_COMMANDS]
    if ring > 1:
        step = k[k[STEP] + lane]
        first = k[DELAYED] + 2 * ring * lane
        x[first + 2 * (step % ring)], x[first + 2 * (step % ring) + 1] = issued_v, issued_s
        back = min(int(w.robot_command_delay / w.dt + 0.5), ring - 1)
        if step < back:
            v, s = 0.0, 0.0
        else:
            then = first + 2 * ((step - back) % ring)
            v, s = x[then], x[then + 1]
    if w.robot_kind == BICYCLE:
        at = k[STEERING] + lane
        most = w.robot_steering_rate * w.dt
        s = x[at] + min(max(s - x[at], -most), most)
        x[at] = s
        issued_s = s
    return issued_v, issued_s, v, s


@inline
def _disturbance(lane, w, v, s, k):
    """This step's errors of the two rates; see `MotionModel` for the noise laws."""
    u0, u1, _, _ = uniform4(k[k[KEY] + lane], k[k[EPISODE] + lane], k[k[STEP] + lane], DRAW_ROBOT, FIRST)
    n0, n1 = normal_pair(u0, u1)
    speed_std = w.robot_speed_std + w.robot_speed_std_per_speed * abs(v)
    turn_std = w.robot_turn_std + w.robot_turn_std_per_turn * abs(s) + w.robot_turn_std_per_speed * abs(v)
    scale = 1.0 / math.sqrt(w.dt) if w.robot_noise_law == ROOT_SECOND else 1.0
    return scale * speed_std * n0, scale * turn_std * n1


@inline
def _collide(lane, w, x, k, b):
    """Count a touch that was not there a step ago; "block" takes the robot back out of the pillar."""
    at, count = k[POSE] + 3 * lane, k[k[COUNT] + lane]
    centres, radii = k[LANDMARKS] + 2 * k[NUM_LANDMARKS] * lane, k[RADIUS] + k[NUM_LANDMARKS] * lane
    hit = touching(x[at], x[at + 1], w.robot_radius, x, centres, radii, count)
    if hit and not b[k[TOUCHING] + lane]:
        k[k[COLLISIONS] + lane] += 1
    b[k[TOUCHING] + lane] = hit
    if hit and w.landmarks_collision == BLOCK:
        x[at], x[at + 1] = pushed_out(x[at], x[at + 1], w.robot_radius, x, centres, radii, count)
