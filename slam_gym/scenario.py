"""What is simulated, in numbers: robot, target, landmarks, sensor, arena, and what the filters believe of them.

>>> from slam_gym.scenario import Scenario
>>> Scenario.load("default").sensor.max_range
6.0
>>> Scenario.load("open", **{"sensor.max_range": 4.0, "target.speed": [0.2, 0.6]}).target.speed
(0.2, 0.6)

Any number except those of the time grid may be a range [low, high], drawn anew each episode.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Self

from estimators.models import MotionModel, SensorModel, TargetModel
from slam_gym import scenario_io
from slam_gym.scenario_fields import Number, check_section, choice, constant, low_high, middle, number
from slam_gym.scenario_models import build_models


@dataclass(frozen=True, kw_only=True)
class Arena:
    """The place, centred on the origin."""

    width: Number = number(20.0, above=0.0)  # [m], along x
    height: Number = number(20.0, above=0.0)  # [m], along y
    walls: bool = True  # whether the target stays inside
    holds_robot: bool = False  # whether the robot does

    @property
    def size(self) -> tuple[float, float]:
        """[m] width and height (the middle where one is a range)."""
        return middle(self.width), middle(self.height)


@dataclass(frozen=True, kw_only=True)
class Robot:
    """The robot and its odometry.

    unicycle: Eq. (16), Wu and Sun 2013, command (speed, turn rate). bicycle: Eq. (15), Tian et al. 2010, command
    (speed, steering angle). With noise_on = "motion" the truth is disturbed and odometry reports the command; with
    "odometry" the truth executes the command and the report is disturbed.
    """

    kind: str = choice("unicycle", ("unicycle", "bicycle"))
    speed_min: Number = number(-0.4)  # [m/s]
    speed_max: Number = number(1.0, above=0.0)  # [m/s]
    turn_max: Number = number(1.5, above=0.0)  # [rad/s], unicycle
    steering_max: Number = number(math.pi / 6, above=0.0, high=math.pi / 2)  # [rad], bicycle
    steering_rate: Number = number(math.inf, above=0.0)  # [rad/s], bicycle
    wheelbase: Number = number(4.0, above=0.0)  # [m], bicycle
    wheel_track: Number = number(0.5, above=0.0)  # [m] between the wheels, for actions as wheel speeds
    radius: Number = number(0.2, 0.0)  # [m], for collisions
    speed_std: Number = number(0.02, 0.0)  # [m/s]
    turn_std: Number = number(0.02, 0.0)  # [rad/s]; of the steering angle [rad] for the bicycle
    speed_std_per_speed: Number = number(0.0, 0.0)  # [m/s per m/s], added
    turn_std_per_turn: Number = number(0.0, 0.0)  # [rad/s per rad/s], added
    turn_std_per_speed: Number = number(0.0, 0.0)  # [rad/s per m/s], added
    noise_law: str = choice("step", ("step", "root-second"))  # see MotionModel
    noise_on: str = choice("motion", ("motion", "odometry"))
    command_delay: Number = number(0.0, 0.0)  # [s] until a command moves the robot
    speed_scale: Number = number(1.0, above=0.0)  # true speed = scale x reported
    turn_scale: Number = number(1.0, above=0.0)  # true turn rate = scale x reported + turn_bias
    turn_bias: Number = number(0.0)  # [rad/s], while the reported control is not zero
    start_x: Number = number(0.0)  # [m]
    start_y: Number = number(0.0)  # [m]
    start_heading: Number = number(0.0)  # [rad]
    start_position_std: Number = number(0.0, 0.0)  # [m] per axis, of the true start about the one the filter is told
    start_heading_std: Number = number(0.0, 0.0)  # [rad]
    start_noise: str = choice("gaussian", ("gaussian", "one-sigma"))  # one-sigma: Eqs. (38)-(39), Tian et al. 2010

    @property
    def start(self) -> tuple[Number, Number, Number]:
        """(x [m], y [m], heading [rad]) that the filter is told."""
        return self.start_x, self.start_y, self.start_heading


@dataclass(frozen=True, kw_only=True)
class Target:
    """The moving target.

    twist: unicycle with a constant twist and noise on both rates, Eq. (17), Wu and Sun 2013. constant-velocity:
    straight, with white acceleration. waypoints: drives to random points. evasive: the same, but flees a robot that
    comes near. recorded: a path from a CSV file (time_s, x_m, y_m). none: no target.

    It starts at (start_x, start_y, start_heading) if placed = "fixed", else at start_distance and start_bearing from
    the robot, "in-view", "out-of-view" or "anywhere".
    """

    kind: str = choice("waypoints", ("waypoints", "evasive", "twist", "constant-velocity", "recorded", "none"))
    speed: Number = number(0.9, 0.0)  # [m/s]
    turn_rate: Number = number(0.0)  # [rad/s], twist
    turn_max: Number = number(2.0, above=0.0)  # [rad/s], waypoints and evasive
    speed_std: Number = number(0.0, 0.0)  # [m/s] of each step's rate, twist
    turn_std: Number = number(0.0, 0.0)  # [rad/s] of each step's rate, twist
    acceleration_density: Number = number(0.0, 0.0)  # [m/s per sqrt(s)], constant-velocity
    waypoint_rate: Number = number(0.4, 0.0)  # [1/s] of changes of mind
    flee_distance: Number = number(5.0, 0.0)  # [m], evasive
    placed: str = choice("in-view", ("in-view", "out-of-view", "anywhere", "fixed"))
    start_distance: Number = number((2.0, 4.5), 0.0)  # [m] from the robot
    start_bearing: Number = number((-0.7, 0.7))  # [rad] from the robot's heading
    start_x: Number = number(0.0)  # [m], fixed
    start_y: Number = number(0.0)  # [m], fixed
    start_heading: Number = number((-math.pi, math.pi))  # [rad]
    known_start: bool = False  # whether the filter is told where it starts
    file: str = ""  # recorded


@dataclass(frozen=True, kw_only=True)
class Landmarks:
    """The unknown landmarks: points, or round pillars that may hide what is behind them.

    Unlabelled ones are not told from each other, nor from false alarms; the target always is told from them.
    """

    layout: str = choice("uniform", ("uniform", "ring", "grid", "clustered", "file"))
    count: Number = number((15, 20), 0, whole=True)
    radius: Number = number(0.0, 0.0)  # [m]; 0: points
    opaque: bool = False  # pillars hide the target and each other
    collision: str = choice("none", ("none", "count", "block"))  # of robot and pillars
    labelled: bool = True  # whether the sensor tells which landmark a return is from
    margin: Number = number(0.0, 0.0)  # [m] kept free along the arena's border, uniform and grid
    gap: Number = number(0.0, 0.0)  # [m] kept free between pillars' rims, where possible
    clearance: Number = number(0.0, 0.0)  # [m] kept free around the robot's start
    center_x: Number = number(0.0)  # [m], of the region, ring or grid
    center_y: Number = number(0.0)  # [m]
    ring_radius: Number = number(8.0, 0.0)  # [m]
    ring_width: Number = number(0.0, 0.0)  # [m] at most either side of the ring's radius, by turns
    ring_gap: Number = number(0.0, 0.0)  # [m] at least, at most ring_width
    clusters: Number = number(4, 1, whole=True)
    cluster_std: Number = number(1.0, 0.0)  # [m] per axis about a cluster's centre
    file: str = ""  # CSV with the columns x_m and y_m; a bare name is one of this package's own


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """The range-bearing sensor; see SensorModel for the range's two noise laws."""

    max_range: Number = number(6.0, above=0.0)  # [m]
    min_range: Number = number(0.0, 0.0)  # [m]
    field_of_view: Number = number(2.0 * math.pi, above=0.0, high=2.0 * math.pi + 1e-9)  # [rad], whole opening
    range_std: Number = number(0.05, above=0.0)  # [m]
    range_std_per_range: Number = number(0.0, 0.0)  # [m per m]
    range_law: str = choice("sum", ("sum", "quadrature"))
    bearing_std: Number = number(0.03, above=0.0)  # [rad]
    detection_probability: Number = number(1.0, above=0.0, high=1.0)
    clutter_rate: Number = number(0.0, 0.0, 50.0)  # [false returns per sweep]
    error_time_constant: Number = number(0.0, 0.0)  # [s] of first-order errors; 0: white
    mislabel_probability: Number = number(0.0, 0.0, 1.0)  # that a landmark's return carries another's id


@dataclass(frozen=True, kw_only=True)
class Filter:
    """What the filters believe where it differs from the world: fields of MotionModel, SensorModel, TargetModel."""

    motion: Mapping[str, Any] = field(default_factory=dict)
    sensor: Mapping[str, Any] = field(default_factory=dict)
    target: Mapping[str, Any] = field(default_factory=dict)
    noise_inflation: Number = constant(1.0, above=0.0)  # factor on the variance of every return


@dataclass(frozen=True, kw_only=True)
class DefaultPolicy:
    """Who drives when nobody else is named."""

    name: str = "pursuit"
    options: Mapping[str, Any] = field(default_factory=dict)


_SECTIONS = {
    "arena": Arena, "robot": Robot, "target": Target, "landmarks": Landmarks, "sensor": Sensor, "filter": Filter,
    "policy": DefaultPolicy,
}  # fmt: skip
_MODELS = {"motion": MotionModel, "sensor": SensorModel, "target": TargetModel}


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """Everything an episode is made of; see the sections' classes for their numbers.

    Raises:
        ValueError: an unknown key, or an impossible value; the message names it.
    """

    name: str = "custom"
    summary: str = ""
    dt: float = constant(0.1, above=0.0)  # [s], one simulation step
    max_steps: int = constant(400, 1, whole=True)  # simulation steps of an episode
    sensor_period: int = constant(1, 1, whole=True)  # steps between sweeps
    hold: int = constant(1, 1, whole=True)  # steps that one action lasts
    burn_in: int = constant(0, 0, whole=True)  # first steps that comparisons do not score
    estimators: tuple[str, ...] = ()  # what `compare` runs when none is named; empty: its usual ones
    arena: Arena = field(default_factory=Arena)
    robot: Robot = field(default_factory=Robot)
    target: Target = field(default_factory=Target)
    landmarks: Landmarks = field(default_factory=Landmarks)
    sensor: Sensor = field(default_factory=Sensor)
    filter: Filter = field(default_factory=Filter)
    policy: DefaultPolicy = field(default_factory=DefaultPolicy)

    def __post_init__(self) -> None:
        check_section(self, "")
        object.__setattr__(self, "estimators", tuple(self.estimators))
        for name in _SECTIONS:
            check_section(getattr(self, name), f"{name}.")
        for name, model in _MODELS.items():
            scenario_io.check_keys(model, getattr(self.filter, name), f"filter.{name}.")
        self._check_together()
        self.models()

    def _check_together(self) -> None:
        if low_high(self.robot.speed_min)[1] > low_high(self.robot.speed_max)[0]:
            raise ValueError(
                f"robot.speed_min must not exceed robot.speed_max; got {self.robot.speed_min}, {self.robot.speed_max}"
            )
        if low_high(self.sensor.min_range)[1] >= low_high(self.sensor.max_range)[0]:
            raise ValueError(
                f"sensor.min_range must be below sensor.max_range; got {self.sensor.min_range}, {self.sensor.max_range}"
            )
        for section in ("landmarks", "target"):
            part = getattr(self, section)
            wants = part.layout == "file" if section == "landmarks" else part.kind == "recorded"
            if wants and not part.file:
                raise ValueError(f"{section}.file must name a CSV file for this {section} layout or kind")
        if self.landmarks.opaque and low_high(self.landmarks.radius)[0] <= 0.0:
            raise ValueError("landmarks.opaque needs landmarks.radius above 0: points hide nothing")

    @classmethod
    def load(cls, source: "str | Path | Mapping[str, Any] | Scenario", **overrides: Any) -> Self:
        """From a preset's name, a TOML file's path, a dictionary, or another scenario; dotted keys override.

        Raises:
            ValueError: no such preset, an unknown key, an impossible value.
            FileNotFoundError: no such file.
        """
        data = source.to_dict() if isinstance(source, Scenario) else scenario_io.read(source)
        for key, value in overrides.items():
            scenario_io.put(data, key, value, cls, _SECTIONS)
        return cls.from_dict(data)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """From nested dictionaries of JSON types."""
        scenario_io.check_keys(cls, data, "")
        built: dict[str, Any] = {}
        for key, value in data.items():
            section = _SECTIONS.get(key)
            if section is None:
                built[key] = value
                continue
            if not isinstance(value, Mapping):
                raise ValueError(f"{key} must be a table of keys and values; got {value!r}")
            scenario_io.check_keys(section, value, f"{key}.")
            built[key] = section(**value)
        return cls(**built)

    def replace(self, key: str, value: Any) -> Self:
        """A copy with one dotted key changed: `scenario.replace("sensor.max_range", 5.0)`."""
        return type(self).load(self, **{key: value})

    def to_dict(self) -> dict[str, Any]:
        """Nested dictionaries of JSON types; `from_dict` restores the scenario."""
        return scenario_io.plain(asdict(self))

    @property
    def has_target(self) -> bool:
        """Whether there is a target at all."""
        return self.target.kind != "none"

    @property
    def max_landmarks(self) -> int:
        """Landmarks there can be: the estimators' default capacity; more where ids are not told."""
        count = scenario_io.landmark_rows(self.landmarks.file) if self.landmarks.layout == "file" else int(
            low_high(self.landmarks.count)[1]
        )  # fmt: skip
        return max(1, count if self.landmarks.labelled else 2 * count + 5)

    def models(self) -> tuple[MotionModel, SensorModel, TargetModel | None]:
        """What the filters believe; the middle of a number that is drawn anew each episode."""
        return build_models(self, middle)


def scenario_names() -> list[str]:
    """Names of the presets, `default` first."""
    return scenario_io.preset_names()
