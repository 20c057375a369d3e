"""The prediction of `recorded-ri-ekf`: a robot with uncertain odometry, and a target that wanders about a room.

Five states stand between the target and the map: the errors of the speed's and the turn's scale, the turn bias, the
range scale and the bearing bias. They do not move; the robot's rows lean on the first three.
"""

import math

from estimators.gaussian.ekf import predict_target
from estimators.kernels.angles import wrap
from estimators.kernels.borrow import borrow
from estimators.kernels.gaussian import ROBOT, add_symmetric, rows_in_use, shear
from estimators.kernels.jit import inline, jit
from estimators.kernels.motion import acceleration_noise, calibrated, control_noise, control_std, displacement
from estimators.models import TWIST

SPEED_SCALE, TURN_SCALE, TURN_BIAS, RANGE_SCALE, BEARING_BIAS = range(5)
EXTRA = 5  # states between the target and the map


@inline
def move_leaning_robot(P, lane, n, extra, hx, hy, cx, cy, turn_scale, turn_bias):
    """P <- F P F' for dheading = turn_scale dw + turn_bias db, then dposition = (hx, hy) dheading+ + (cx, cy) dv."""
    v, w, b = extra + SPEED_SCALE, extra + TURN_SCALE, extra + TURN_BIAS
    for i in range(n):
        heading = P[lane, 2, i] + turn_scale * P[lane, w, i] + turn_bias * P[lane, b, i]
        P[lane, 2, i] = heading
        P[lane, 0, i] += hx * heading + cx * P[lane, v, i]
        P[lane, 1, i] += hy * heading + cy * P[lane, v, i]
    for k in range(ROBOT):  # the block's columns; its rows hold F P
        heading = P[lane, k, 2] + turn_scale * P[lane, k, w] + turn_bias * P[lane, k, b]
        P[lane, k, 2] = heading
        P[lane, k, 0] += hx * heading + cx * P[lane, k, v]
        P[lane, k, 1] += hy * heading + cy * P[lane, k, v]
    P[lane, 1, 0], P[lane, 2, 0], P[lane, 2, 1] = P[lane, 0, 1], P[lane, 0, 2], P[lane, 1, 2]
    for i in range(ROBOT, n):
        for k in range(ROBOT):
            P[lane, i, k] = P[lane, k, i]


@inline
def add_pose_noise(P, lane, q00, q01, q02, q11, q12, q22):
    """P += Q on the robot's block."""
    P[lane, 0, 0] += q00
    P[lane, 1, 1] += q11
    P[lane, 2, 2] += q22
    add_symmetric(P, lane, 0, 1, q01)
    add_symmetric(P, lane, 0, 2, q02)
    add_symmetric(P, lane, 1, 2, q12)


@inline
def predict_robot(mu, P, lane, n, extra, model, errors, v, w, dt):
    """Move the robot by ds = v dt (1 + dv) and dheading = w dt (1 + dw) + b dt, b only while commanded to move."""
    moving = v != 0.0 or w != 0.0
    v, w = calibrated(model, v, w)
    sv, sw = control_std(model, v, w, dt)
    still = 1.0 if moving else math.sqrt(errors.still_noise)
    sv, sw = still * sv, math.sqrt(still * still * sw * sw + errors.turn_noise * abs(w) / dt)
    turn_scale, turn_bias = w * dt, dt if moving else 0.0
    heading = mu[lane, 2]
    v_now = v * (1.0 + mu[lane, extra + SPEED_SCALE])
    w_now = w * (1.0 + mu[lane, extra + TURN_SCALE]) + (mu[lane, extra + TURN_BIAS] if moving else 0.0)
    dx, dy, turn = displacement(model, v_now, w_now, dt, heading)
    q00, q01, q02, q11, q12, q22 = control_noise(model, v_now, w_now, dt, heading, sv, sw)
    c, s = math.cos(heading + turn), math.sin(heading + turn)
    sideways = errors.lateral_noise * abs(v_now) * dt
    move_leaning_robot(P, lane, n, extra, -dy, dx, v * dt * c, v * dt * s, turn_scale, turn_bias)
    add_pose_noise(
        P, lane, q00 + sideways * s * s, q01 - sideways * s * c, q02, q11 + sideways * c * c, q12, q22
    )  # fmt: skip
    mu[lane, 0] += dx
    mu[lane, 1] += dy
    mu[lane, 2] = wrap(heading + turn)


@inline
def wander(mu, P, lane, n, density, errors, dt):
    """Ornstein-Uhlenbeck velocity with a weak spring: dv = (-v / tau - kappa (p - c)) dt + white acceleration."""
    decay = dt / errors.target_time if errors.target_time > 0.0 else 0.0
    pull = errors.target_pull * dt
    centre_x, centre_y = errors.target_centre_x, errors.target_centre_y
    mu[lane, 3] += dt * mu[lane, 5]
    mu[lane, 4] += dt * mu[lane, 6]
    mu[lane, 5] -= decay * mu[lane, 5] + pull * (mu[lane, 3] - centre_x)
    mu[lane, 6] -= decay * mu[lane, 6] + pull * (mu[lane, 4] - centre_y)
    for axis in range(2):
        shear(P, lane, n, 3 + axis, 5 + axis, dt)
        _damp(P, lane, n, 5 + axis, 3 + axis, 1.0 - decay, -pull)
        position, cross, velocity = acceleration_noise(density, dt)
        P[lane, 3 + axis, 3 + axis] += position
        P[lane, 5 + axis, 5 + axis] += velocity
        add_symmetric(P, lane, 3 + axis, 5 + axis, cross)


@inline
def _damp(P, lane, n, row, by, keep, factor):
    """P <- E P E', E the identity but for row `row`: keep times itself plus factor times row `by`."""
    diagonal = (
        keep * keep * P[lane, row, row] + 2.0 * keep * factor * P[lane, row, by] + factor * factor * P[lane, by, by]
    )
    for i in range(n):
        P[lane, row, i] = keep * P[lane, row, i] + factor * P[lane, by, i]
    P[lane, row, row] = diagonal
    for i in range(n):
        P[lane, i, row] = P[lane, row, i]


@jit
def predict(mu, P, models, errors, n_t, count, target_known, pending, clock, control, dt, last_dt, lanes):
    """One step of the named lanes; O(n)."""
    mu, P, pending = borrow(mu), borrow(P), borrow(pending)
    for i in range(lanes.size):
        lane = lanes[i]
        step = dt[lane]
        if not step > 0.0:
            continue
        n, extra, model = rows_in_use(n_t + EXTRA, count[lane]), ROBOT + n_t, models[lane]
        predict_robot(mu, P, lane, n, extra, model, errors[0], control[lane, 0], control[lane, 1], step)
        if n_t > 0 and target_known[lane] and model.target_kind != TWIST:
            wander(mu, P, lane, n, model.acceleration_density, errors[0], step)
        elif n_t > 0:
            predict_target(mu, P, lane, n, model, target_known, pending, step)
        last_dt[lane] = step
        clock[lane] += step
