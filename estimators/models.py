"""The models a filter believes in: how the robot moves, what its sensor reports, how the target moves.

Frozen dataclasses of numbers with units. `pack_models` lays them out as one record per lane (`MODEL`), which is what
kernels read. A scenario builds them from the world's own numbers unless it asks for a mismatch.
"""

import math
from dataclasses import dataclass, fields
from typing import Literal

import numpy as np
from numpy.typing import NDArray

UNICYCLE, BICYCLE = 0, 1
PER_STEP, PER_ROOT_SECOND = 0, 1
SUM, QUADRATURE = 0, 1
NO_TARGET, TWIST, CONSTANT_VELOCITY, IMM = -1, 0, 1, 2

_MOTION_KINDS = {"unicycle": UNICYCLE, "bicycle": BICYCLE}
_NOISE_LAWS = {"step": PER_STEP, "root-second": PER_ROOT_SECOND}
_RANGE_LAWS = {"sum": SUM, "quadrature": QUADRATURE}
_TARGET_KINDS = {"twist": TWIST, "constant-velocity": CONSTANT_VELOCITY, "imm": IMM}

TARGET_COORDINATES = {
    "twist": ("x", "y", "heading"),
    "constant-velocity": ("x", "y", "velocity_x", "velocity_y"),
    "imm": ("x", "y", "velocity_x", "velocity_y"),
}


def _choice(name: str, value: str, choices: dict[str, int]) -> int:
    if value not in choices:
        raise ValueError(f"{name} must be one of {', '.join(map(repr, choices))}; got {value!r}")
    return choices[value]


def _check(model: object, nonnegative: tuple[str, ...], positive: tuple[str, ...] = ()) -> None:
    for name in (*nonnegative, *positive):
        value = getattr(model, name)
        bad = math.isnan(value) or value < 0 or (name in positive and value == 0)
        if bad:
            kind = type(model).__name__
            need = "positive" if name in positive else "zero or more"
            raise ValueError(f"{kind}.{name} must be a number that is {need}; got {value!r}")


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionModel:
    """How the robot moves and how far its reported control is off.

    unicycle: control (v [m/s], w [rad/s]); Eq. (16), Wu and Sun 2013: the heading at the END of the step.
    bicycle: control (V [m/s], G [rad] steering); Eq. (15), Tian et al. 2010.

    The standard deviations are of the rates. With `noise_law="step"` each step's rate is off by one draw of that
    deviation (displacement noise = deviation x dt); with "root-second" the displacement variance grows as
    deviation^2 x dt, whatever the step.
    """

    kind: Literal["unicycle", "bicycle"] = "unicycle"
    speed_std: float = 0.02  # [m/s]
    turn_std: float = 0.02  # [rad/s]; of the steering angle [rad] for the bicycle
    speed_std_per_speed: float = 0.0  # [m/s per m/s], added to speed_std
    turn_std_per_turn: float = 0.0  # [rad/s per rad/s], added to turn_std
    turn_std_per_speed: float = 0.0  # [rad/s per m/s], added to turn_std
    noise_law: Literal["step", "root-second"] = "step"
    wheelbase: float = 4.0  # [m], bicycle only
    speed_scale: float = 1.0  # odometry calibration: true speed = scale x reported
    turn_scale: float = 1.0  # true turn rate = scale x reported + turn_bias
    turn_bias: float = 0.0  # [rad/s], while the reported control is not zero

    def __post_init__(self) -> None:
        _choice("MotionModel.kind", self.kind, _MOTION_KINDS)
        _choice("MotionModel.noise_law", self.noise_law, _NOISE_LAWS)
        _check(
            self,
            ("speed_std", "turn_std", "speed_std_per_speed", "turn_std_per_turn", "turn_std_per_speed"),
            ("wheelbase", "speed_scale", "turn_scale"),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorModel:
    """A noisy range-bearing sensor looking along the robot's heading.

    Range deviation at range r: range_std + range_std_per_range r ("sum") or the root of the sum of squares
    ("quadrature").
    """

    max_range: float = 6.0  # [m]
    field_of_view: float = 2.0 * math.pi  # [rad], the whole opening: +-field_of_view/2 about the heading
    range_std: float = 0.05  # [m]
    range_std_per_range: float = 0.0  # [m per m]
    range_law: Literal["sum", "quadrature"] = "sum"
    bearing_std: float = 0.03  # [rad]
    detection_probability: float = 1.0  # [-], inside range, view and line of sight
    clutter_rate: float = 0.0  # [false returns per sweep]
    error_time_constant: float = 0.0  # [s] of first-order correlated errors; 0: white
    landmark_radius: float = 0.0  # [m] of opaque pillars; 0: points that hide nothing

    def __post_init__(self) -> None:
        _choice("SensorModel.range_law", self.range_law, _RANGE_LAWS)
        _check(
            self,
            ("range_std_per_range", "clutter_rate", "error_time_constant", "landmark_radius"),
            ("max_range", "field_of_view", "range_std", "bearing_std", "detection_probability"),
        )
        if self.field_of_view > 2.0 * math.pi + 1e-12:
            raise ValueError(f"SensorModel.field_of_view is at most 2 pi rad; got {self.field_of_view!r}")
        if self.detection_probability > 1.0:
            raise ValueError(f"SensorModel.detection_probability is at most 1; got {self.detection_probability!r}")


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetModel:
    """How the filter thinks that the target moves, and what it assumes at the first sighting.

    twist: a unicycle with known (speed, turn_rate) and noise on both; state (x, y, heading); Eqs. (16)-(17), Wu and
    Sun 2013; noise under the robot's noise_law "step".
    constant-velocity: state (x, y, velocity_x, velocity_y), white acceleration: velocity variance grows by
    acceleration_density^2 per second. The velocity turns at `turn_rate` and is forgotten as exp(-t /
    velocity_time_constant), where these are given.
    imm: the same state under interacting models (Blom and Bar-Shalom 1988): straight on as above, turning left or
    right at `manoeuvre_rate`, stopped; a Markov chain switches between them (`estimators.gaussian.manoeuvres`).
    """

    kind: Literal["twist", "constant-velocity", "imm"] = "constant-velocity"
    speed: float = 0.0  # [m/s], twist
    turn_rate: float = 0.0  # [rad/s], twist and constant-velocity
    speed_std: float = 0.8  # [m/s], twist
    turn_std: float = 0.6  # [rad/s], twist
    acceleration_density: float = 0.3  # [m/s per sqrt(s)], constant-velocity; imm: in its straight mode
    velocity_time_constant: float = math.inf  # [s], constant-velocity: memory of the velocity; infinite: for ever
    manoeuvre_rate: float = 1.5  # [rad/s] of the turning modes, imm
    manoeuvre_density: float = 0.5  # [m/s per sqrt(s)] in the turning and stopped modes, imm
    manoeuvre_duration: float = 0.7  # [s], mean, of a turn or a stop, imm
    straight_duration: float = 2.5  # [s], mean, between them, imm
    stop_share: float = 0.1  # [-] of manoeuvres that are stops, imm
    initial_speed_std: float = 1.0  # [m/s] per axis at the first sighting, constant-velocity and imm
    iterate_spread: float = 0.2  # position spread per measured range, above which a return's update is iterated
    reinitialise_nis: float = math.inf  # NIS (2 dof) of a return above which the target starts anew from it
    reinitialise_spread: float = math.inf  # position spread per measured range, above which a labelled return does so

    def __post_init__(self) -> None:
        _choice("TargetModel.kind", self.kind, _TARGET_KINDS)
        _check(
            self,
            ("speed_std", "turn_std", "acceleration_density", "manoeuvre_density", "stop_share"),
            (
                "velocity_time_constant", "manoeuvre_rate", "manoeuvre_duration", "straight_duration",
                "initial_speed_std", "iterate_spread", "reinitialise_nis", "reinitialise_spread",
            ),
        )  # fmt: skip
        if self.stop_share > 1.0:
            raise ValueError(f"TargetModel.stop_share is at most 1; got {self.stop_share!r}")

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the state's coordinates, in order."""
        return TARGET_COORDINATES[self.kind]


_RENAMED = {
    # model field -> record field, where the same word stands in two models
    ("target", "kind"): "target_kind",
    ("target", "speed_std"): "target_speed_std",
    ("target", "turn_std"): "target_turn_std",
    ("target", "speed"): "target_speed",
    ("target", "turn_rate"): "target_turn_rate",
    ("motion", "kind"): "motion_kind",
}
_CODES = {
    "motion_kind": _MOTION_KINDS,
    "noise_law": _NOISE_LAWS,
    "range_law": _RANGE_LAWS,
    "target_kind": _TARGET_KINDS,
}


def _record_fields() -> list[tuple[str, type]]:
    found: list[tuple[str, type]] = []
    for owner, model in (("motion", MotionModel), ("sensor", SensorModel), ("target", TargetModel)):
        for field in fields(model):
            name = _RENAMED.get((owner, field.name), field.name)
            found.append((name, np.int64 if name in _CODES else np.float64))
    return found


MODEL = np.dtype(_record_fields())
"""One lane's numbers as a record; read in kernels as `models[lane].bearing_std`."""


def pack_models(motion: MotionModel, sensor: SensorModel, target: TargetModel | None) -> NDArray[np.void]:
    """The three models as a zero-dimensional `MODEL` record (target_kind = NO_TARGET where there is none)."""
    record = np.zeros((), dtype=MODEL)
    for owner, model in (("motion", motion), ("sensor", sensor), ("target", target or TargetModel())):
        for field in fields(model):
            name = _RENAMED.get((owner, field.name), field.name)
            value = getattr(model, field.name)
            record[name] = _CODES[name][value] if name in _CODES else value
    if target is None:
        record["target_kind"] = NO_TARGET
    return record
