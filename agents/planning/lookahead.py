"""What a command would do to the belief: one segment of motion, one expected look."""

import math

from agents.planning.state import TARGET, VELOCITY
from estimators.kernels.angles import wrap
from estimators.kernels.jit import inline
from estimators.kernels.motion import acceleration_noise, control_std, unicycle_noise
from estimators.kernels.range_bearing import gradient, noise_std

_NEAREST = 0.05  # [m] from a point: its bearing says nothing usable


@inline
def _shear(P, n, row, by, factor):
    """Add factor x row `by` to `row`, then the same for the columns: P <- F P F'."""
    for k in range(n):
        P[row, k] += factor * P[by, k]
    for k in range(n):
        P[k, row] += factor * P[k, by]


@inline
def drive(x, v, w, seconds):
    """Move the mean: the robot on an arc of `seconds`, the target straight on.

    v [m/s], w [rad/s]. Returns the robot's displacement (dx, dy) and its heading half way.
    """
    half = 0.5 * w * seconds
    chord = v * seconds * (math.sin(half) / half if abs(half) > 1e-6 else 1.0)
    heading = x[2] + half
    dx, dy = chord * math.cos(heading), chord * math.sin(heading)
    x[0], x[1], x[2] = x[0] + dx, x[1] + dy, wrap(x[2] + w * seconds)
    x[TARGET] += seconds * x[VELOCITY]
    x[TARGET + 1] += seconds * x[VELOCITY + 1]
    return dx, dy, heading


@inline
def grow(P, n, dx, dy, heading, v, w, seconds, steps, model, density):
    """P <- F P F' + Q of what `drive` did in `steps` steps of odometry.

    density: of the target's white acceleration [m/s per sqrt(s)].
    """
    _shear(P, n, 0, 2, -dy)
    _shear(P, n, 1, 2, dx)
    dt = seconds / steps
    sv, sw = control_std(model, v, w, dt)
    q00, q01, q02, q11, q12, q22 = unicycle_noise(v, w, dt, heading - w * dt, sv, sw)
    P[0, 0] += steps * q00
    P[1, 1] += steps * q11
    P[2, 2] += steps * q22
    for i, k, q in ((0, 1, q01), (0, 2, q02), (1, 2, q12)):
        P[i, k] += steps * q
        P[k, i] += steps * q
    spread, both, speed = acceleration_noise(density, seconds)
    for axis in range(2):
        _shear(P, n, TARGET + axis, VELOCITY + axis, seconds)
        P[TARGET + axis, TARGET + axis] += spread
        P[VELOCITY + axis, VELOCITY + axis] += speed
        P[TARGET + axis, VELOCITY + axis] += both
        P[VELOCITY + axis, TARGET + axis] += both


@inline
def look(x, P, n, at, chance, sweeps, model, B):
    """P <- P - chance K H P for range and bearing of the point in rows at, at + 1, over `sweeps` sweeps from here.

    With probability `chance` all sweeps report the point (R / sweeps), otherwise none does: the expected covariance.
    B [n, 2]: scratch.
    """
    dx, dy = x[at] - x[0], x[at + 1] - x[1]
    r = math.sqrt(dx * dx + dy * dy)
    if r < _NEAREST:
        return
    a00, a01, a10, a11 = gradient(dx, dy)
    range_std, bearing_std = noise_std(model, r)
    for i in range(n):
        east, north = P[i, at] - P[i, 0], P[i, at + 1] - P[i, 1]
        B[i, 0] = a00 * east + a01 * north
        B[i, 1] = a10 * east + a11 * north - P[i, 2]
    east, north = B[at, 1] - B[0, 1], B[at + 1, 1] - B[1, 1]
    s00 = a00 * (B[at, 0] - B[0, 0]) + a01 * (B[at + 1, 0] - B[1, 0]) + range_std * range_std / sweeps
    s01 = a00 * east + a01 * north
    s11 = a10 * east + a11 * north - B[2, 1] + bearing_std * bearing_std / sweeps
    det = s00 * s11 - s01 * s01
    if not det > 0.0:
        return
    scale = chance / det
    for i in range(n):
        k0 = scale * (s11 * B[i, 0] - s01 * B[i, 1])
        k1 = scale * (s00 * B[i, 1] - s01 * B[i, 0])
        for k in range(i + 1):
            P[i, k] -= k0 * B[k, 0] + k1 * B[k, 1]
            P[k, i] = P[i, k]
