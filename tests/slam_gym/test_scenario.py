import json
import math
from dataclasses import FrozenInstanceError

import numpy as np
import pytest

from slam_gym.scenario import Robot, Scenario, Sensor, Target, scenario_names


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


TOML = """
summary = "mine"
dt = 0.05
[target]
kind = "constant-velocity"
speed = [0.2, 0.6]
[sensor]
max_range = 4.5
[filter.sensor]
bearing_std = 0.1
[policy]
name = "constant"
options = { speed = 0.3 }
"""


def test_default_comes_first():
    names = scenario_names()
    assert names[0] == "default"
    assert names[1:] == sorted(names[1:])


def test_a_toml_file_gives_the_scenario_and_its_name(tmp_path):
    scenario = Scenario.load(write(tmp_path / "mine.toml", TOML))
    assert (scenario.name, scenario.summary, scenario.dt) == ("mine", "mine", 0.05)
    assert scenario.target.speed == (0.2, 0.6)
    assert scenario.sensor.max_range == 4.5
    assert scenario.policy.options == {"speed": 0.3}
    assert Scenario.load(str(tmp_path / "mine.toml")) == scenario


@pytest.mark.parametrize("name", scenario_names())
def test_dictionaries_of_json_types_restore_it(name):
    scenario = Scenario.load(name)
    text = json.dumps(scenario.to_dict())
    assert Scenario.load(json.loads(text)) == scenario
    assert Scenario.load(scenario) == scenario


def test_loading_leaves_the_source_alone():
    source = {"sensor": {"max_range": 3.0}, "policy": {"options": {"stand_off": 1.0}}}
    changed = Scenario.load(source, **{"sensor.max_range": 5.0, "policy.options.stand_off": 2.0})
    assert source == {"sensor": {"max_range": 3.0}, "policy": {"options": {"stand_off": 1.0}}}
    assert changed.sensor.max_range == 5.0
    assert changed.policy.options == {"stand_off": 2.0}


def test_replace_changes_one_key():
    before = Scenario.load("default")
    after = before.replace("sensor.max_range", 5)
    assert after.sensor.max_range == 5.0
    assert isinstance(after.sensor.max_range, float)
    assert after.replace("sensor.max_range", 6.0) == before


def test_it_is_frozen():
    with pytest.raises(FrozenInstanceError):
        Scenario.load("default").dt = 1.0
    with pytest.raises(FrozenInstanceError):
        Scenario.load("default").sensor.max_range = 1.0


WRONG = {  # overrides of `default`, and the parts of the message
    "key": ({"sensor.maxrange": 3}, ["unknown scenario key 'sensor.maxrange'", "Did you mean 'sensor.max_range'?"]),
    "top key": ({"max_step": 3}, ["unknown scenario key 'max_step'", "Did you mean 'max_steps'?"]),
    "section": ({"senser.max_range": 3}, ["unknown scenario section 'senser'", "Did you mean 'sensor'?", "landmarks"]),
    "section as a number": ({"sensor": 3}, ["sensor must be a table of keys and values; got 3"]),
    "word": ({"target.kind": "waypoint"}, ["target.kind 'waypoint'", "Did you mean 'waypoints'?", "evasive"]),
    "negative": ({"sensor.range_std": -1.0}, ["sensor.range_std must be more than 0; got -1.0"]),
    "zero": ({"dt": 0}, ["dt must be more than 0; got 0"]),
    "too much": ({"sensor.detection_probability": 1.5}, ["sensor.detection_probability must be at most 1; got 1.5"]),
    "not a number": (
        {"robot.speed_std": "fast"},
        ["robot.speed_std must be a number or a range [low, high]", "'fast'"],
    ),
    "infinite": ({"sensor.max_range": math.inf}, ["sensor.max_range must be finite; got inf"]),
    "mostly wrong": ({"sensor.mislabel_probability": -0.1}, ["sensor.mislabel_probability must be 0 to 1; got -0.1"]),
    "nan": ({"robot.speed_std": math.nan}, ["robot.speed_std must be a number", "nan"]),
    "truth value": ({"robot.speed_std": True}, ["robot.speed_std must be a number", "True"]),
    "fraction": ({"landmarks.count": 2.5}, ["landmarks.count must be a whole number; got 2.5"]),
    "range of three": ({"target.speed": [1, 2, 3]}, ["target.speed must be a number or a range [low, high]"]),
    "range upside down": ({"target.speed": [2, 1]}, ["target.speed: the range's low end must come first", "[2, 1]"]),
    "range out of limits": ({"landmarks.radius": [-1, 1]}, ["landmarks.radius must be at least 0; got -1"]),
    "range of the time grid": ({"dt": [0.1, 0.2]}, ["dt must be one number, not a range; got [0.1, 0.2]"]),
    "no steps": ({"max_steps": 0}, ["max_steps must be at least 1; got 0"]),
    "flag": ({"landmarks.opaque": 1}, ["landmarks.opaque must be true or false; got 1"]),
    "text": ({"landmarks.file": 3}, ["landmarks.file must be text; got 3"]),
    "speeds": ({"robot.speed_min": 2.0}, ["robot.speed_min must not exceed robot.speed_max"]),
    "ranges": ({"sensor.min_range": 7.0}, ["sensor.min_range must be below sensor.max_range"]),
    "opaque points": ({"landmarks.radius": 0.0}, ["landmarks.opaque needs landmarks.radius above 0"]),
    "no map": ({"landmarks.layout": "file"}, ["landmarks.file must name a CSV file"]),
    "no path": ({"target.kind": "recorded"}, ["target.file must name a CSV file"]),
    "filter's key": ({"filter.motion": {"speed": 1}}, ["unknown scenario key 'filter.motion.speed'"]),
    "filter's value": ({"filter.motion": {"speed_std": -1}}, ["MotionModel.speed_std must be", "-1"]),
}


@pytest.mark.parametrize(("overrides", "parts"), WRONG.values(), ids=WRONG.keys())
def test_wrong_values_are_named(overrides, parts):
    with pytest.raises(ValueError) as caught:
        Scenario.load("default", **overrides)
    for part in parts:
        assert part in str(caught.value)


def test_unknown_names_and_files(tmp_path):
    with pytest.raises(ValueError, match=r"unknown scenario 'opne'\. Did you mean 'open'\?.*tian-dense.*\.toml"):
        Scenario.load("opne")
    with pytest.raises(FileNotFoundError, match=r"no scenario file .*missing\.toml"):
        Scenario.load(tmp_path / "missing.toml")
    with pytest.raises(ValueError, match="is not a TOML file"):
        Scenario.load(write(tmp_path / "broken.toml", "dt = = 3"))


def test_landmark_files(tmp_path):
    def load(text):
        path = write(tmp_path / "map.csv", text)
        return Scenario.load("open", **{"landmarks.layout": "file", "landmarks.file": str(path)})

    assert load("x_m,y_m\n1,2\n3,4\n5,6\n").max_landmarks == 3
    with pytest.raises(ValueError, match="must have the columns x_m, y_m; it has x, y"):
        _ = load("x,y\n1,2\n").max_landmarks
    with pytest.raises(ValueError, match="could not convert string to float"):
        _ = load("x_m,y_m\n1,two\n3,4\n").max_landmarks
    with pytest.raises(ValueError, match="at least one row of finite numbers"):
        _ = load("x_m,y_m\n").max_landmarks
    with pytest.raises(FileNotFoundError, match=r"no file 'nowhere\.csv'"):
        _ = Scenario.load("open", **{"landmarks.layout": "file", "landmarks.file": "nowhere.csv"}).max_landmarks


def test_capacity_covers_the_largest_map_and_inventions_where_ids_are_not_told():
    assert Scenario.load("default").max_landmarks == 20
    assert Scenario.load("default", **{"landmarks.labelled": False}).max_landmarks > 20
    assert Scenario.load("default", **{"landmarks.count": 0}).max_landmarks == 1


def test_filters_believe_the_worlds_numbers():
    scenario = Scenario(
        robot=Robot(speed_std=0.1, turn_std=0.2, speed_scale=0.9, noise_law="root-second"),
        sensor=Sensor(range_std=0.3, range_std_per_range=0.04, range_law="quadrature", clutter_rate=1.5),
        target=Target(kind="twist", speed=2.0, turn_rate=0.5, speed_std=0.7, turn_std=0.6),
    )
    motion, sensor, target = scenario.models()
    assert (motion.speed_std, motion.turn_std, motion.speed_scale, motion.noise_law) == (0.1, 0.2, 0.9, "root-second")
    assert (sensor.range_std, sensor.range_std_per_range, sensor.range_law) == (0.3, 0.04, "quadrature")
    assert sensor.clutter_rate == 1.5
    assert (target.kind, target.speed, target.turn_rate, target.speed_std, target.turn_std) == (
        "twist", 2.0, 0.5, 0.7, 0.6,
    )  # fmt: skip


def test_filters_may_believe_something_else():
    scenario = Scenario.load(
        "open",
        **{
            "filter.motion": {"speed_std": 0.5},
            "filter.sensor.bearing_std": 0.1,
            "filter.target.kind": "twist",
            "filter.target.turn_rate": 0.2,
            "filter.noise_inflation": 4.0,
        },
    )
    motion, sensor, target = scenario.models()
    assert motion.speed_std == 0.5
    assert motion.turn_std == scenario.robot.turn_std
    assert sensor.bearing_std == pytest.approx(0.2)  # a variance four times as large
    assert sensor.range_std == pytest.approx(2.0 * scenario.sensor.range_std)
    assert (target.kind, target.turn_rate) == ("twist", 0.2)


def test_filters_of_a_drawn_number_believe_its_middle():
    scenario = Scenario.load("open", **{"sensor.max_range": [4.0, 6.0], "robot.speed_std": [0.1, 0.2]})
    motion, sensor, _ = scenario.models()
    assert sensor.max_range == 5.0
    assert motion.speed_std == pytest.approx(0.15)


def test_only_opaque_pillars_hide_in_the_filters_sensor():
    pillars = Scenario.load("default")
    assert pillars.models()[1].landmark_radius == 0.5
    assert pillars.replace("landmarks.opaque", False).models()[1].landmark_radius == 0.0


def test_no_target_no_model():
    assert Scenario.load("open", **{"target.kind": "none"}).models()[2] is None
    assert np.isfinite(Scenario.load("open").models()[2].initial_speed_std)
