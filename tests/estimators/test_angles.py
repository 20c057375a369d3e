"""Angles stay in [-pi, pi), up to the last bit."""

import math

import numpy as np
import pytest

from estimators.kernels.angles import wrap


@pytest.mark.parametrize("angle", [0.0, 3.0, -math.pi, -3.14159, math.nextafter(math.pi, 0.0)])
def test_an_angle_inside_is_left_alone(angle):
    assert wrap(angle) == angle


@pytest.mark.parametrize("angle", [math.pi, 3 * math.pi, -3 * math.pi, 4.0, -4.0, 1e3, math.nextafter(-math.pi, -4.0)])
def test_an_angle_outside_is_turned_back(angle):
    wrapped = wrap(angle)
    assert -math.pi <= wrapped < math.pi
    assert math.cos(wrapped - angle) == pytest.approx(1.0, abs=1e-12)


def test_many_angles():
    angles = np.random.default_rng(0).uniform(-100.0, 100.0, 2000)
    wrapped = np.array([wrap(angle) for angle in angles])
    assert ((wrapped >= -np.pi) & (wrapped < np.pi)).all()
    assert np.abs(np.exp(1j * angles) - np.exp(1j * wrapped)).max() < 1e-13


def test_nan_stays_nan():
    assert math.isnan(wrap(math.nan))


def test_an_angle_beyond_all_precision_is_still_wrapped():
    for angle in (1e16, -3e17, 1e300):
        assert -np.pi <= wrap(angle) < np.pi
    assert np.isnan(wrap(np.nan))
