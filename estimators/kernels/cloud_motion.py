"""Where the points of a target cloud are born, and how they move (see `estimators.target_cloud`).

One lane's points are rows [5, N]: x, y, direction (cosine, sine), speed.
"""

import math

import numpy as np

from estimators.kernels.elementary import sincos_turn
from estimators.kernels.jit import inline
from estimators.kernels.random import normal_pair, uniform4
from estimators.models import TWIST

X, Y, COSINE, SINE, SPEED = range(5)
ROWS = 5

# Purposes of draws: streams that never mix.
DRAW_FOLLOW, DRAW_MOVE, DRAW_TURN, DRAW_PRIOR, DRAW_RESAMPLE, DRAW_ROUGHEN = map(np.int64, range(6))
_EPISODE = np.int64(0)  # a lane's key is new in each episode

HALF_WIDTH, HALF_HEIGHT, PRIOR_RADIUS, TURN_RATE, SCATTER, ROUGHENING, MISS_FLOOR, THRESHOLD = range(8)  # `settings`


@inline
def draws(key, step, purpose, item):
    """Four uniforms of one point."""
    return uniform4(key, _EPISODE, step, purpose, item)


@inline
def factor2(cov, lane):
    """Lower Cholesky factor (l00, l10, l11) of a semidefinite 2 x 2 covariance."""
    l00 = math.sqrt(max(cov[lane, 0, 0], 0.0))
    l10 = cov[lane, 1, 0] / l00 if l00 > 0.0 else 0.0
    return l00, l10, math.sqrt(max(cov[lane, 1, 1] - l10 * l10, 0.0))


@inline
def draw_from_belief(lane, rows, key, step, model, position, position_cov, velocity, velocity_cov, heading, variance):
    """N points of the Gaussian belief: position, and velocity (constant velocity) or heading at known speed (twist).

    The correlation between position and velocity is left out: it is small while the target has just been seen.
    """
    p00, p10, p11 = factor2(position_cov, lane)
    v00, v10, v11 = factor2(velocity_cov, lane)
    spread = math.sqrt(max(variance[lane], 0.0))
    for p in range(rows.shape[1]):
        u0, u1, u2, u3 = draws(key, step, DRAW_FOLLOW, p)
        n0, n1 = normal_pair(u0, u1)
        n2, n3 = normal_pair(u2, u3)
        rows[X, p] = position[lane, 0] + p00 * n0
        rows[Y, p] = position[lane, 1] + p10 * n0 + p11 * n1
        if model.target_kind == TWIST:
            angle = heading[lane] + spread * n2
            rows[COSINE, p], rows[SINE, p], rows[SPEED, p] = math.cos(angle), math.sin(angle), model.target_speed
        else:
            set_velocity(rows, p, velocity[lane, 0] + v00 * n2, velocity[lane, 1] + v10 * n2 + v11 * n3)


@inline
def set_velocity(rows, p, vx, vy):
    """Direction and speed of a velocity; a resting point keeps its direction."""
    speed = math.sqrt(vx * vx + vy * vy)
    moving = speed > 1e-12
    scale = 1.0 / speed if moving else 0.0
    rows[COSINE, p] = vx * scale if moving else rows[COSINE, p]
    rows[SINE, p] = vy * scale if moving else rows[SINE, p]
    rows[SPEED, p] = speed


@inline
def draw_anywhere(p, rows, key, step, model, x, y, settings):
    """One point of which nothing is known: uniform over the arena, or over a disc around (x, y) where there is none.

    Its direction is uniform; its speed the model's (twist), or uniform up to `initial_speed_std`.
    """
    u0, u1, u2, u3 = draws(key, step, DRAW_PRIOR, p)
    if settings[HALF_WIDTH] < math.inf:
        rows[X, p], rows[Y, p] = settings[HALF_WIDTH] * (2.0 * u0 - 1.0), settings[HALF_HEIGHT] * (2.0 * u1 - 1.0)
    else:
        s, c = sincos_turn(u1)
        r = settings[PRIOR_RADIUS] * math.sqrt(u0)
        rows[X, p], rows[Y, p] = x + r * c, y + r * s
    rows[SINE, p], rows[COSINE, p] = sincos_turn(u2)
    rows[SPEED, p] = model.target_speed if model.target_kind == TWIST else u3 * model.initial_speed_std


@inline
def move_points(rows, noise, key, step, model, dt, settings):
    """All points move for dt seconds with the target model's own noise, and turn as a lost target may.

    At rate `turn_rate`, and at the arena's walls, a point sets out anew at its speed: towards a place drawn uniformly
    from the arena, or in any direction where there is no arena. noise: [3, N] scratch.
    """
    turned = -math.expm1(-settings[TURN_RATE] * dt)
    for p in range(rows.shape[1]):
        u0, u1, u2, _ = draws(key, step, DRAW_MOVE, p)
        noise[0, p], noise[1, p] = normal_pair(u0, u1)
        noise[2, p] = u2
    if model.target_kind == TWIST:
        _move_twist(rows, noise, model, dt)
    else:
        _move_straight(rows, noise, model.acceleration_density * math.sqrt(dt), dt)
    half_x, half_y = settings[HALF_WIDTH], settings[HALF_HEIGHT]
    for p in range(rows.shape[1]):
        x, y = rows[X, p], rows[Y, p]
        if noise[2, p] < turned or abs(x) > half_x or abs(y) > half_y:
            rows[X, p], rows[Y, p] = min(max(x, -half_x), half_x), min(max(y, -half_y), half_y)
            _set_out(p, rows, key, step, half_x, half_y)


@inline
def _move_straight(rows, noise, kick, dt):
    """White acceleration: x += v dt; v += kick n."""
    for p in range(rows.shape[1]):
        vx, vy = rows[SPEED, p] * rows[COSINE, p], rows[SPEED, p] * rows[SINE, p]
        rows[X, p] += dt * vx
        rows[Y, p] += dt * vy
        set_velocity(rows, p, vx + kick * noise[0, p], vy + kick * noise[1, p])


@inline
def _move_twist(rows, noise, model, dt):
    """Known speed and turn rate with noise on both; Eqs. (16)-(17), Wu and Sun 2013: the heading at the step's end."""
    for p in range(rows.shape[1]):
        angle = dt * (model.target_turn_rate + model.target_turn_std * noise[1, p])
        c, s = math.cos(angle), math.sin(angle)
        rows[COSINE, p], rows[SINE, p] = (
            c * rows[COSINE, p] - s * rows[SINE, p],
            s * rows[COSINE, p] + c * rows[SINE, p],
        )
        way = dt * (rows[SPEED, p] + model.target_speed_std * noise[0, p])
        rows[X, p] += way * rows[COSINE, p]
        rows[Y, p] += way * rows[SINE, p]


@inline
def _set_out(p, rows, key, step, half_x, half_y):
    u0, u1, _, _ = draws(key, step, DRAW_TURN, p)
    rows[SINE, p], rows[COSINE, p] = sincos_turn(u0)
    if half_x < math.inf:
        dx, dy = half_x * (2.0 * u0 - 1.0) - rows[X, p], half_y * (2.0 * u1 - 1.0) - rows[Y, p]
        length = math.sqrt(dx * dx + dy * dy)
        if length > 1e-9:
            rows[COSINE, p], rows[SINE, p] = dx / length, dy / length
