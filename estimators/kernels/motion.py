"""How the robot and the target move in one step, as scalar helpers with their Jacobians.

Every helper works on displacements: the caller adds them to its mean, or draws a particle from them. The heading
column of a motion's Jacobian is J (dx, dy) = (-dy, dx), J = [[0, -1], [1, 0]].
"""

import math

from estimators.kernels.jit import inline
from estimators.models import BICYCLE, PER_ROOT_SECOND


@inline
def calibrated(model, v, w):
    """The control after the odometry calibration; turn_bias acts while the reported control is not zero."""
    if v == 0.0 and w == 0.0:
        return 0.0, 0.0
    return model.speed_scale * v, model.turn_scale * w + model.turn_bias


@inline
def control_std(model, v, w, dt):
    """Deviations of the two control rates over a step of dt > 0 seconds; displacement noise = deviation x dt.

    Under the "root-second" law the rate's deviation is s / sqrt(dt): the displacement variance is then s^2 dt.
    """
    sv = model.speed_std + model.speed_std_per_speed * abs(v)
    sw = model.turn_std + model.turn_std_per_turn * abs(w) + model.turn_std_per_speed * abs(v)
    if model.noise_law == PER_ROOT_SECOND:
        scale = 1.0 / math.sqrt(dt)
        return sv * scale, sw * scale
    return sv, sw


@inline
def unicycle(v, w, dt, heading):
    """Displacement (dx, dy, dheading): the heading at the END of the step. Eq. (16), Wu and Sun 2013."""
    turn = w * dt
    way = v * dt
    return way * math.cos(heading + turn), way * math.sin(heading + turn), turn


@inline
def bicycle(v, steering, dt, heading, wheelbase):
    """Displacement (dx, dy, dheading). Eq. (15), Tian et al. 2010."""
    way = v * dt
    turn = way * math.sin(steering) / wheelbase
    return way * math.cos(heading + steering), way * math.sin(heading + steering), turn


@inline
def displacement(model, v, w, dt, heading):
    """Displacement (dx, dy, dheading) of the model's robot under a calibrated control."""
    if model.motion_kind == BICYCLE:
        return bicycle(v, w, dt, heading, model.wheelbase)
    return unicycle(v, w, dt, heading)


@inline
def unicycle_noise(v, w, dt, heading, sv, sw):
    """G diag(sv^2, sw^2) G' as (q00, q01, q02, q11, q12, q22); G: Jacobian of `unicycle` by (v, w)."""
    turn = w * dt
    c, s = math.cos(heading + turn), math.sin(heading + turn)
    return outer_noise(dt * c, dt * s, 0.0, -v * dt * dt * s, v * dt * dt * c, dt, sv * sv, sw * sw)


@inline
def control_noise(model, v, w, dt, heading, sv, sw):
    """G diag(sv^2, sw^2) G' of the model's robot, G the control Jacobian at (heading, v, w)."""
    if model.motion_kind == BICYCLE:
        way = v * dt
        c, s = math.cos(heading + w), math.sin(heading + w)
        turn_v = dt * math.sin(w) / model.wheelbase
        turn_w = way * math.cos(w) / model.wheelbase
        return outer_noise(dt * c, dt * s, turn_v, -way * s, way * c, turn_w, sv * sv, sw * sw)
    return unicycle_noise(v, w, dt, heading, sv, sw)


@inline
def outer_noise(a0, a1, a2, b0, b1, b2, va, vb):
    """The upper triangle of va a a' + vb b b', row by row, of two 3-vectors."""
    return (
        va * a0 * a0 + vb * b0 * b0,
        va * a0 * a1 + vb * b0 * b1,
        va * a0 * a2 + vb * b0 * b2,
        va * a1 * a1 + vb * b1 * b1,
        va * a1 * a2 + vb * b1 * b2,
        va * a2 * a2 + vb * b2 * b2,
    )


@inline
def acceleration_noise(density, dt):
    """White acceleration over dt, per axis: (position variance, covariance, velocity variance)."""
    q = density * density
    return q * dt * dt * dt / 3.0, q * dt * dt / 2.0, q * dt
