import math

import numpy as np
import pytest

from estimators.kernels import range_bearing as rb
from estimators.kernels.jit import jit
from estimators.models import MotionModel, SensorModel, pack_models


@jit
def _std(model, distance):
    return rb.noise_std(model, distance)


def test_measure_and_offset_are_inverse():
    for heading in (-3.0, 0.4, 2.9):
        r, b = rb.measure(-1.2, 0.7, heading)
        assert r == pytest.approx(math.hypot(1.2, 0.7))
        assert -math.pi <= b < math.pi
        np.testing.assert_allclose(rb.offset(r, b, heading), (-1.2, 0.7), atol=1e-12)


def test_gradient_against_finite_differences():
    d, step = np.array([1.5, -0.8]), 1e-6
    columns = []
    for axis in np.eye(2):
        ahead, behind = (np.array(rb.measure(*(d + s * axis), 0.3)) for s in (step, -step))
        columns.append((ahead - behind) / (2 * step))
    np.testing.assert_allclose(np.reshape(rb.gradient(*d), (2, 2)), np.column_stack(columns), atol=1e-9)


def test_offset_noise_is_the_inverse_gradient():
    A = np.reshape(rb.gradient(1.5, -0.8), (2, 2))
    back = np.linalg.inv(A)
    N = back @ np.diag([0.1**2, 0.03**2]) @ back.T
    np.testing.assert_allclose(rb.offset_noise(1.5, -0.8, 0.1, 0.03), N[np.triu_indices(2)], rtol=1e-12)


@pytest.mark.parametrize(("law", "expected"), [("sum", 0.03 + 0.04 * 2.0), ("quadrature", math.hypot(0.03, 0.08))])
def test_range_laws(law, expected):
    sensor = SensorModel(range_std=0.03, range_std_per_range=0.04, range_law=law, bearing_std=0.014)
    np.testing.assert_allclose(_std(pack_models(MotionModel(), sensor, None)[()], 2.0), (expected, 0.014))


@pytest.mark.parametrize("bad", [(0.0, 0.0), (-1.0, 0.0), (math.nan, 0.0), (math.inf, 0.0), (1.0, math.nan)])
def test_unusable_returns(bad):
    assert not rb.usable(*bad)
    assert rb.usable(1.0, 0.0)
