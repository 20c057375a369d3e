"""A target with a velocity: straight on, round a bend of known rate, or coming to rest, all linear in its coordinates.

Over dt the velocity turns by w dt and shrinks by exp(-dt / tau) (an Ornstein-Uhlenbeck velocity where tau is finite);
white acceleration adds to it. Half of turn and shrinking before the straight step and half after it: right to second
order in dt, as the chord of a bend. Turning commutes with J, so the unobservable directions pass through.
"""

import math

from estimators.kernels.gaussian import drift_velocity
from estimators.kernels.jit import inline


@inline
def half_bend(model, dt):
    """Half a step's (cosine, sine) of the turn, times its shrinking; (1, 0) for a target that goes straight on."""
    if model.target_turn_rate == 0.0 and model.velocity_time_constant == math.inf:
        return 1.0, 0.0
    angle = 0.5 * model.target_turn_rate * dt
    shrink = math.exp(-0.5 * dt / model.velocity_time_constant)
    return shrink * math.cos(angle), shrink * math.sin(angle)


@inline
def bend(mu, P, lane, n, c, s):
    """Velocity rows 5, 6 times [[c, -s], [s, c]]: mean, rows and columns."""
    if c == 1.0 and s == 0.0:
        return
    vx, vy = mu[lane, 5], mu[lane, 6]
    mu[lane, 5], mu[lane, 6] = c * vx - s * vy, s * vx + c * vy
    xx, xy, yy = P[lane, 5, 5], P[lane, 5, 6], P[lane, 6, 6]
    for i in range(n):
        a, b = P[lane, 5, i], P[lane, 6, i]
        P[lane, 5, i], P[lane, 6, i] = c * a - s * b, s * a + c * b
    cross = c * s * (xx - yy) + (c * c - s * s) * xy
    P[lane, 5, 5], P[lane, 5, 6] = c * c * xx - 2.0 * c * s * xy + s * s * yy, cross
    P[lane, 6, 5], P[lane, 6, 6] = cross, s * s * xx + 2.0 * c * s * xy + c * c * yy
    for i in range(n):
        P[lane, i, 5], P[lane, i, 6] = P[lane, 5, i], P[lane, 6, i]


@inline
def move_velocity_target(mu, P, lane, n, model, dt):
    """One step of a known target whose model is not a twist: its own F and Q, mean and covariance."""
    c, s = half_bend(model, dt)
    bend(mu, P, lane, n, c, s)
    drift_velocity(mu, P, lane, n, model.acceleration_density, dt)
    bend(mu, P, lane, n, c, s)
