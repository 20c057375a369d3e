"""The models refuse impossible numbers by name, and become one record per lane."""

import math
from dataclasses import FrozenInstanceError, fields

import pytest

from estimators.models import (
    BICYCLE,
    CONSTANT_VELOCITY,
    MODEL,
    NO_TARGET,
    PER_ROOT_SECOND,
    QUADRATURE,
    TWIST,
    UNICYCLE,
    MotionModel,
    SensorModel,
    TargetModel,
    pack_models,
)

WRONG = [
    (MotionModel, {"kind": "unicycles"}, "MotionModel.kind must be one of 'unicycle', 'bicycle'; got 'unicycles'"),
    (MotionModel, {"noise_law": "second"}, "MotionModel.noise_law must be one of 'step', 'root-second'"),
    (MotionModel, {"speed_std": -0.1}, "MotionModel.speed_std must be a number that is zero or more; got -0.1"),
    (MotionModel, {"turn_std": math.nan}, "MotionModel.turn_std must be a number that is zero or more; got nan"),
    (MotionModel, {"wheelbase": 0.0}, "MotionModel.wheelbase must be a number that is positive; got 0.0"),
    (MotionModel, {"speed_scale": -1.0}, "MotionModel.speed_scale must be a number that is positive"),
    (SensorModel, {"range_law": "root"}, "SensorModel.range_law must be one of 'sum', 'quadrature'"),
    (SensorModel, {"range_std": 0.0}, "SensorModel.range_std must be a number that is positive"),
    (SensorModel, {"max_range": -5.0}, "SensorModel.max_range must be a number that is positive"),
    (SensorModel, {"field_of_view": 7.0}, "SensorModel.field_of_view is at most 2 pi rad; got 7.0"),
    (SensorModel, {"detection_probability": 1.5}, "SensorModel.detection_probability is at most 1; got 1.5"),
    (SensorModel, {"clutter_rate": -1.0}, "SensorModel.clutter_rate must be a number that is zero or more"),
    (
        TargetModel,
        {"kind": "walker"},
        "TargetModel.kind must be one of 'twist', 'constant-velocity', 'imm'; got 'walker'",
    ),
    (TargetModel, {"acceleration_density": -1.0}, "TargetModel.acceleration_density must be"),
    (TargetModel, {"initial_speed_std": 0.0}, "TargetModel.initial_speed_std must be a number that is positive"),
    (TargetModel, {"reinitialise_spread": -1.0}, "TargetModel.reinitialise_spread must be a number that is positive"),
    (TargetModel, {"iterate_spread": 0.0}, "TargetModel.iterate_spread must be a number that is positive"),
    (TargetModel, {"velocity_time_constant": 0.0}, "TargetModel.velocity_time_constant must be"),
    (TargetModel, {"stop_share": 1.5}, "TargetModel.stop_share is at most 1; got 1.5"),
    (TargetModel, {"reinitialise_nis": 0.0}, "TargetModel.reinitialise_nis must be a number that is positive"),
]


@pytest.mark.parametrize(("model", "numbers", "message"), WRONG)
def test_an_impossible_value_is_named(model, numbers, message):
    with pytest.raises(ValueError) as caught:
        model(**numbers)
    assert message in str(caught.value)


@pytest.mark.parametrize("model", [MotionModel, SensorModel, TargetModel])
def test_models_are_frozen_and_by_keyword_only(model):
    with pytest.raises(FrozenInstanceError):
        setattr(model(), fields(model)[0].name, 1.0)
    with pytest.raises(TypeError):
        model("unicycle")


def test_the_record_holds_every_number():
    motion = MotionModel(kind="bicycle", speed_std=0.11, turn_std=0.12, noise_law="root-second", wheelbase=3.5)
    sensor = SensorModel(max_range=7.0, range_law="quadrature", bearing_std=0.013)
    target = TargetModel(kind="twist", speed=0.4, turn_rate=0.05, speed_std=0.21, turn_std=0.22)
    record = pack_models(motion, sensor, target)
    codes = ("motion_kind", "noise_law", "range_law", "target_kind")
    assert [int(record[name]) for name in codes] == [BICYCLE, PER_ROOT_SECOND, QUADRATURE, TWIST]
    assert (record["speed_std"], record["turn_std"], record["wheelbase"]) == (0.11, 0.12, 3.5)
    assert (record["target_speed"], record["target_turn_rate"]) == (0.4, 0.05)
    assert (record["target_speed_std"], record["target_turn_std"]) == (0.21, 0.22)
    assert (record["max_range"], record["bearing_std"]) == (7.0, 0.013)
    assert len(MODEL.names) == sum(len(fields(kind)) for kind in (MotionModel, SensorModel, TargetModel))


def test_no_target_has_a_code_of_its_own():
    assert pack_models(MotionModel(), SensorModel(), None)["target_kind"] == NO_TARGET
    record = pack_models(MotionModel(), SensorModel(), TargetModel())
    assert (int(record["target_kind"]), int(record["motion_kind"])) == (CONSTANT_VELOCITY, UNICYCLE)


def test_coordinates_are_named():
    assert TargetModel(kind="twist").coordinates == ("x", "y", "heading")
    assert TargetModel().coordinates == ("x", "y", "velocity_x", "velocity_y")
