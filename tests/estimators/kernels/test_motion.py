import dataclasses

import numpy as np
import pytest

from estimators.kernels import motion
from estimators.kernels.jit import jit
from estimators.models import MotionModel, SensorModel, pack_models


def record(**changes):
    return pack_models(MotionModel(**changes), SensorModel(), None)[()]


@jit
def _displacement(model, v, w, dt, heading):
    return motion.displacement(model, v, w, dt, heading)


@jit
def _noise(model, v, w, dt, heading, sv, sw):
    return motion.control_noise(model, v, w, dt, heading, sv, sw)


@jit
def _calibrated(model, v, w):
    return motion.calibrated(model, v, w)


@jit
def _std(model, v, w, dt):
    return motion.control_std(model, v, w, dt)


def test_unicycle_turns_before_it_moves():
    dx, dy, turn = _displacement(record(), 0.5, 0.3, 0.2, 1.0)
    np.testing.assert_allclose([dx, dy, turn], [0.1 * np.cos(1.06), 0.1 * np.sin(1.06), 0.06], rtol=1e-12)


def test_bicycle():
    dx, dy, turn = _displacement(record(kind="bicycle", wheelbase=4.0), 3.0, 0.2, 0.025, 1.0)
    expected = [0.075 * np.cos(1.2), 0.075 * np.sin(1.2), 0.075 * np.sin(0.2) / 4.0]
    np.testing.assert_allclose([dx, dy, turn], expected, rtol=1e-12)


@pytest.mark.parametrize("kind", ["unicycle", "bicycle"])
def test_noise_is_the_finite_difference_jacobian_of_the_control(kind):
    model, v, w, dt, heading = record(kind=kind), 1.3, 0.4, 0.2, 0.7
    step = 1e-6

    def end(v, w):
        return np.array(_displacement(model, v, w, dt, heading))

    G = np.column_stack([
        (end(v + step, w) - end(v - step, w)) / (2 * step),
        (end(v, w + step) - end(v, w - step)) / (2 * step),
    ])  # fmt: skip
    Q = G @ np.diag([0.3**2, 0.2**2]) @ G.T
    np.testing.assert_allclose(_noise(model, v, w, dt, heading, 0.3, 0.2), Q[np.triu_indices(3)], atol=1e-9)


def test_heading_column_is_the_turned_displacement():
    model, step = record(), 1e-6
    ahead, behind = (np.array(_displacement(model, 1.3, 0.4, 0.2, 0.7 + s)) for s in (step, -step))
    dx, dy, _ = _displacement(model, 1.3, 0.4, 0.2, 0.7)
    np.testing.assert_allclose((ahead - behind) / (2 * step), [-dy, dx, 0.0], atol=1e-9)


def test_calibration_rests_while_the_robot_is_told_to():
    model = record(speed_scale=0.9, turn_scale=1.1, turn_bias=0.01)
    np.testing.assert_allclose(_calibrated(model, 2.0, 0.5), (1.8, 0.56))
    assert _calibrated(model, 0.0, 0.0) == (0.0, 0.0)


def test_noise_laws():
    grown = {"speed_std": 0.1, "turn_std": 0.2, "speed_std_per_speed": 0.5, "turn_std_per_turn": 0.25,
             "turn_std_per_speed": 0.125}  # fmt: skip
    np.testing.assert_allclose(_std(record(**grown), -2.0, 0.4, 0.25), (1.1, 0.55))
    np.testing.assert_allclose(_std(record(**grown, noise_law="root-second"), -2.0, 0.4, 0.25), (2.2, 1.1))


def test_root_second_noise_does_not_depend_on_the_step():
    model = record(speed_std=0.1, turn_std=0.0, noise_law="root-second")
    one = _noise(model, 1.0, 0.0, 0.4, 0.0, *_std(model, 1.0, 0.0, 0.4))[0]
    four = 4 * _noise(model, 1.0, 0.0, 0.1, 0.0, *_std(model, 1.0, 0.0, 0.1))[0]
    assert one == pytest.approx(four, rel=1e-12)


def test_acceleration_noise_adds_up_over_steps():
    """Two halves of a step give what one whole step gives."""

    def cov(dt):
        position, cross, velocity = motion.acceleration_noise(0.3, dt)
        return np.array([[position, cross], [cross, velocity]])

    F = np.array([[1.0, 0.5], [0.0, 1.0]])
    np.testing.assert_allclose(F @ cov(0.5) @ F.T + cov(0.5), cov(1.0), rtol=1e-12)


def test_record_holds_every_number():
    names = {f.name for f in dataclasses.fields(MotionModel)} - {"kind"}
    assert names <= set(record().dtype.names)
