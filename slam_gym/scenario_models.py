"""What the filters of a scenario believe: its own numbers, but for what its `filter` section changes."""

import math
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

from estimators.models import MotionModel, SensorModel, TargetModel
from slam_gym.scenario_fields import low_high, middle

if TYPE_CHECKING:
    from slam_gym.scenario import Scenario


def build_models(scenario: "Scenario", at: Any) -> tuple[MotionModel, SensorModel, TargetModel | None]:
    """The filters' models from the world's numbers, each taken through `at`, and the scenario's overrides."""
    robot, sensor, believed = scenario.robot, scenario.sensor, scenario.filter
    inflate = math.sqrt(middle(believed.noise_inflation))
    motion_numbers = {f.name: at(getattr(robot, f.name)) for f in fields(MotionModel) if _is_number_of(robot, f.name)}
    motion_numbers |= {"kind": robot.kind, "noise_law": robot.noise_law}
    sensor_numbers = {f.name: at(getattr(sensor, f.name)) for f in fields(SensorModel) if _is_number_of(sensor, f.name)}
    sensor_numbers |= {
        "range_law": sensor.range_law,
        "landmark_radius": at(scenario.landmarks.radius) if scenario.landmarks.opaque else 0.0,
    }
    sensor_numbers |= dict(believed.sensor)
    sensor_model = SensorModel(**sensor_numbers)
    if inflate != 1.0:
        names = ("range_std", "range_std_per_range", "bearing_std")
        sensor_model = replace(sensor_model, **{name: inflate * getattr(sensor_model, name) for name in names})
    return MotionModel(**{**motion_numbers, **believed.motion}), sensor_model, _target_model(scenario, at)


def _is_number_of(section: Any, name: str) -> bool:
    return isinstance(getattr(section, name, None), (int, float, tuple))


def _target_model(scenario: "Scenario", at: Any) -> TargetModel | None:
    target = scenario.target
    if target.kind == "none":
        return None
    numbers: dict[str, Any] = {"kind": "constant-velocity"}
    if target.kind == "twist":
        numbers = {"kind": "twist"}
        numbers |= {name: at(getattr(target, name)) for name in ("speed", "turn_rate", "speed_std", "turn_std")}
    elif target.kind == "constant-velocity":
        numbers["acceleration_density"] = at(target.acceleration_density)
    numbers["initial_speed_std"] = max(low_high(target.speed)[1], 1e-3)
    return TargetModel(**{**numbers, **scenario.filter.target})
