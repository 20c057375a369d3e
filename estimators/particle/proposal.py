"""Drawing robot poses: the prior at reset and the motion model at each step (FastSLAM 1 and SLAMTO)."""

import math

import numpy as np

from estimators.kernels.elementary import log, sincos, sincos_turn, wrap_smooth
from estimators.kernels.jit import disjoint, jit, subroutine
from estimators.kernels.motion import calibrated, control_std
from estimators.kernels.random import philox
from estimators.models import BICYCLE
from estimators.particle.layout import DRAW_START

_TO_UNIT = 1.0 / 4294967296.0


@jit
def draw_normals(key, step, purpose, normals):
    """Standard normals [4, H] from H blocks of Philox: `normal4` of items 0 .. H - 1, vectorised."""
    a, b, c, d = normals[0], normals[1], normals[2], normals[3]
    _uniforms(key, step, purpose, a, b, c, d)
    _box_muller(a, b)
    _box_muller(c, d)


@disjoint
def _uniforms(key, step, purpose, a, b, c, d):
    for i in range(a.size):
        x0, x1, x2, x3 = philox(key, 0, step, purpose, i)
        a[i] = (float(np.int64(x0)) + 0.5) * _TO_UNIT
        b[i] = (float(np.int64(x1)) + 0.5) * _TO_UNIT
        c[i] = (float(np.int64(x2)) + 0.5) * _TO_UNIT
        d[i] = (float(np.int64(x3)) + 0.5) * _TO_UNIT


@disjoint
def _box_muller(u, turn):
    for i in range(u.size):
        r = math.sqrt(-2.0 * log(u[i]))
        s, c = sincos_turn(turn[i])
        u[i] = r * c
        turn[i] = r * s


def draw_start(mean, cov, key, num_particles):
    """Particles [3, N] from N(mean, cov); a zero or singular covariance is legal."""
    half = (num_particles + 1) // 2
    normals = np.empty((2, 4, half))
    for part in range(2):
        draw_normals(key, part, DRAW_START, normals[part])
    z = normals.transpose(1, 0, 2).reshape(4, 2 * half)[:3, :num_particles]
    factor = _semidefinite_factor(cov)
    pose = mean[:, None] + sum(factor[:, i, None] * z[i] for i in range(3))
    pose[2] = (pose[2] + np.pi) % (2.0 * np.pi) - np.pi
    return pose


def _semidefinite_factor(cov):
    """Lower triangular L with L L' = cov; columns without variance are zero."""
    L = np.zeros_like(cov)
    for j in range(len(cov)):
        rest = cov[j:, j] - L[j:, :j] @ L[j, :j]
        if rest[0] > 1e-15 * cov[j, j]:
            L[j:, j] = rest / np.sqrt(rest[0])
    return L


@subroutine
def move(pose, model, control_v, control_w, dt, normals):
    """Draw each particle's pose from the motion model: its control is the reported one plus noise on both rates.

    Args:
        pose: [3, N], moved in place.
        control_v, control_w: the reported control; dt: seconds, > 0.
        normals: [4, H] standard normals, 2 H >= N: particle p < H takes rows 0 and 1, particle H + i rows 2 and 3.
    """
    v, w = calibrated(model, control_v, control_w)
    sv, sw = control_std(model, v, w, dt)
    half = normals.shape[1]
    n = pose.shape[1]
    way, way_std, shift, shift_std, wheelbase = v * dt, sv * dt, w * dt, sw * dt, math.inf
    if model.motion_kind == BICYCLE:
        shift, shift_std, wheelbase = w, sw, model.wheelbase
    for part in range(2):
        first, last = part * half, min((part + 1) * half, n)
        _move_half(
            pose[0, first:last], pose[1, first:last], pose[2, first:last], normals[2 * part], normals[2 * part + 1],
            way, way_std, shift, shift_std, wheelbase,
        )  # fmt: skip


@disjoint
def _move_half(x, y, heading, noise_way, noise_shift, way, way_std, shift, shift_std, wheelbase):
    """A unicycle (wheelbase infinite) turns by `shift`, then drives: Eq. (16), Wu and Sun 2013.

    A bicycle drives along heading + `shift`, its steering angle: Eq. (15), Tian et al. 2010.
    """
    turns = wheelbase == math.inf
    for p in range(x.size):
        angle = shift + shift_std * noise_shift[p]
        d = way + way_std * noise_way[p]
        s, c = sincos(heading[p] + angle)
        x[p] += d * c
        y[p] += d * s
        turn = angle if turns else d * sincos(angle)[0] / wheelbase
        heading[p] = wrap_smooth(heading[p] + turn)


@disjoint
def trigonometry(heading, cosine, sine):
    """Cosine and sine of each particle's heading, once per update."""
    for p in range(heading.size):
        s, c = sincos(heading[p])
        cosine[p] = c
        sine[p] = s
