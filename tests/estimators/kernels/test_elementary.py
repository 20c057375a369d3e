"""Branch-free functions against NumPy's."""

import math

import numpy as np
import pytest

from estimators.kernels import elementary
from estimators.kernels.jit import jit


@jit
def _apply(sin_of, cos_of, turn_sin, turn_cos, logs, exps, between, angles, positive, negative):
    for i in range(angles.size):
        sin_of[i], cos_of[i] = elementary.sincos(angles[i])
        turn_sin[i], turn_cos[i] = elementary.sincos_turn(abs(angles[i]) / 10.0)
        logs[i] = elementary.log(positive[i])
        exps[i] = elementary.exp_nonpositive(negative[i])
        between[i] = elementary.angle_between(3.0 * math.cos(angles[i]), 3.0 * math.sin(angles[i]), 3.0)


@pytest.fixture(scope="module")
def values():
    rng = np.random.default_rng(0)
    angles = rng.uniform(-10.0, 10.0, 20000)
    positive = np.exp(rng.uniform(-600.0, 600.0, 20000))
    negative = -(10.0 ** rng.uniform(-12.0, 2.8, 20000))
    positive[:5] = [1.0, 0.0, -1.0, np.inf, np.nan]
    negative[:3] = [0.0, -np.inf, -1e4]
    out = [np.empty(20000) for _ in range(7)]
    _apply(*out, angles, positive, negative)
    return angles, positive, negative, out


def test_sine_and_cosine(values):
    angles, _, _, out = values
    np.testing.assert_allclose(out[0], np.sin(angles), atol=1e-15)
    np.testing.assert_allclose(out[1], np.cos(angles), atol=1e-15)
    np.testing.assert_allclose(out[2], np.sin(0.2 * np.pi * abs(angles)), atol=2e-15)
    np.testing.assert_allclose(out[3], np.cos(0.2 * np.pi * abs(angles)), atol=2e-15)


def test_logarithm(values):
    _, positive, _, out = values
    np.testing.assert_allclose(out[4][5:], np.log(positive[5:]), rtol=1e-15)
    assert out[4][0] == 0.0
    assert np.isnan(out[4][1:5]).all()


def test_exponential(values):
    _, _, negative, out = values
    np.testing.assert_allclose(out[5], np.exp(negative), rtol=1e-13, atol=1e-300)
    assert out[5][0] == 1.0
    assert (out[5][1:3] == 0.0).all()


def test_angle_between(values):
    angles, _, _, out = values
    expected = (angles + np.pi) % (2 * np.pi) - np.pi
    away = abs(expected) < 3.0
    np.testing.assert_allclose(out[6][away], expected[away], atol=2e-15)
    np.testing.assert_allclose(out[6][~away], expected[~away], atol=1e-10)


def test_opposite_directions_give_half_a_turn():
    @jit
    def between(dot, cross):
        return elementary.angle_between(dot, cross, 1.0)

    assert between(-1.0, 0.0) == pytest.approx(math.pi)
    assert between(-1.0, 1e-20) == pytest.approx(math.pi)
    assert between(1.0, 0.0) == pytest.approx(0.0, abs=1e-200)
