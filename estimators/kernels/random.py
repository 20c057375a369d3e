"""Counter-based random numbers: Philox4x32-10 and Box-Muller, pure functions of where a draw is used.

A draw is named by (key, episode, step, purpose, item). Nothing is consumed in order, so a draw does not shift when
something else is drawn or not: the same seed gives the same noise whatever the policy and the estimator do, for any
number of lanes and threads.

Reference: Salmon, Moraes, Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC 2011.
"""

import math

import numpy as np

from estimators.kernels.elementary import log, sincos_turn
from estimators.kernels.jit import inline

_M0 = np.uint64(0xD2511F53)
_M1 = np.uint64(0xCD9E8D57)
_W0 = np.uint64(0x9E3779B9)
_W1 = np.uint64(0xBB67AE85)
_LOW = np.uint64(0xFFFFFFFF)
_32 = np.uint64(32)
_TO_UNIT = 1.0 / 4294967296.0


@inline
def philox(key, c0, c1, c2, c3):
    """Philox4x32-10: four 32-bit words (as uint64) from a 64-bit key and four 32-bit counter words."""
    k0 = np.uint64(key) & _LOW
    k1 = np.uint64(key) >> _32
    x0 = np.uint64(c0) & _LOW
    x1 = np.uint64(c1) & _LOW
    x2 = np.uint64(c2) & _LOW
    x3 = np.uint64(c3) & _LOW
    for _ in range(10):
        p0 = _M0 * x0
        p1 = _M1 * x2
        x0, x1, x2, x3 = (p1 >> _32) ^ x1 ^ k0, p1 & _LOW, (p0 >> _32) ^ x3 ^ k1, p0 & _LOW
        k0 = (k0 + _W0) & _LOW
        k1 = (k1 + _W1) & _LOW
    return x0, x1, x2, x3


@inline
def uniform4(key, episode, step, purpose, item):
    """Four uniforms in the open interval (0, 1)."""
    x0, x1, x2, x3 = philox(key, episode, step, purpose, item)
    return (
        (float(x0) + 0.5) * _TO_UNIT,
        (float(x1) + 0.5) * _TO_UNIT,
        (float(x2) + 0.5) * _TO_UNIT,
        (float(x3) + 0.5) * _TO_UNIT,
    )


@inline
def normal4(key, episode, step, purpose, item):
    """Four independent standard normals."""
    u0, u1, u2, u3 = uniform4(key, episode, step, purpose, item)
    r0 = math.sqrt(-2.0 * math.log(u0))
    r1 = math.sqrt(-2.0 * math.log(u2))
    a0 = 2.0 * math.pi * u1
    a1 = 2.0 * math.pi * u3
    return r0 * math.cos(a0), r0 * math.sin(a0), r1 * math.cos(a1), r1 * math.sin(a1)


@inline
def normal_pair(u0, u1):
    """Two independent standard normals from uniforms in (0, 1), by Box and Muller; runs on vectors.

    Half of what `normal4` gives, so that one Philox block serves all that a source of returns or a point needs.
    """
    s, c = sincos_turn(u1)
    r = math.sqrt(-2.0 * log(u0))
    return r * c, r * s


def lane_key(seed: int, purpose: int = 0) -> np.uint64:
    """The 64-bit Philox key of one lane: hashed, so neighbouring seeds share nothing."""
    return np.random.SeedSequence([int(seed), purpose]).generate_state(1, np.uint64)[0]
