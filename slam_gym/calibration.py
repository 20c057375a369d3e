"""The numbers of a recorded robot: what its sensor and odometry do, fitted against a recorded truth.

`slam-gym calibrate` fits them, `slam-gym replay --calibration` uses them: the systematic part corrects the recording
(for every estimator), the rest becomes models, and `RobotErrors` for the filters that know them.
"""

import math
import tomllib
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Self

import numpy as np

from estimators.gaussian.robot_errors import RobotErrors
from estimators.interface import TARGET
from estimators.models import MotionModel, SensorModel, TargetModel
from slam_gym.recording import Recording, wrap
from slam_gym.replay_models import ReplayModels

LATERAL_NOISE = 3e-4  # [m^2 per m]
STILL_NOISE = 0.02  # of the motion's noise variances, while commanded to stand
LANDMARK_GATE, TARGET_GATE, WEIGHT_DOF = 30.0, 13.8, 4.0
RESTART_AFTER = 3  # rejected returns in a row
TARGET_FRESH = 2.0  # [s]
PLAUSIBLE = (0.7, 2.0)  # logged range over true one
ODOMETRY_PRIOR = {"speed_scale_std": 0.03, "turn_scale_std": 0.03, "turn_bias_std": 0.002}


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """Of a robot whose sensor reports range r and bearing b of labelled things, and that knows what it was commanded.

    A logged range is the true one times 1 + range_offset + range_bearing2 b^2 + range_bearing4 b^4 +
    range_inverse / r, and for the target + target_offset.
    """

    range_offset: float = 0.0  # [-]
    range_bearing2: float = 0.0  # [1/rad^2]
    range_bearing4: float = 0.0  # [1/rad^4]
    range_inverse: float = 0.0  # [m]
    target_offset: float = 0.0  # [-]
    bearing_offset: float = 0.0  # [rad]
    measurement_delay: float = 0.0  # [s] from an image to its stamp
    command_delay: float = 0.0  # [s] from a command to its motion
    speed_scale: float = 1.0  # true speed = scale x commanded
    turn_scale: float = 1.0
    range_std: float = 0.011  # [m per m], of one label, without what all share
    range_time: float = 0.0  # [s] over which that error persists
    bearing_std: float = 0.014  # [rad], sb, of one return
    bearing_correlated_std: float = 0.0  # [rad], sab: the share sab^2 / (sab^2 + sb^2) of its variance persists
    bearing_time: float = 0.0  # [s]
    range_scale_std: float = 0.0  # [-], from robot to robot
    bearing_bias_std: float = 0.0  # [rad], from robot to robot
    speed_noise: float = 0.025  # [m per root second]
    turn_noise: float = 0.015  # [rad per root second]
    turn_noise_per_angle: float = 0.0  # [rad^2 per rad turned]
    target_speed_std: float = 0.04  # [m/s] per axis
    target_time: float = 30.0  # [s] over which its velocity persists
    target_pull: float = 0.0  # [1/s^2]
    target_centre_x: float = 0.0  # [m]
    target_centre_y: float = 0.0  # [m]

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
                raise ValueError(f"calibration: {field.name} must be a finite number; got {value!r}")
        for name in ("range_std", "bearing_std", "speed_scale", "turn_scale", "target_time"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"calibration: {name} must be positive; got {getattr(self, name)!r}")

    def corrected(self, recording: Recording) -> Recording:
        """The recording without the systematic errors of its ranges, bearings and stamps.

        Raises:
            ValueError: a range would change beyond `PLAUSIBLE`; the calibration is of another sensor.
        """
        r, b = recording.ranges, recording.bearings
        factor = 1.0 + self.range_offset + self.range_bearing2 * b**2 + self.range_bearing4 * b**4
        factor = factor + self.range_inverse / r + np.where(recording.labels == TARGET, self.target_offset, 0.0)
        odd = np.flatnonzero((factor < PLAUSIBLE[0]) | (factor > PLAUSIBLE[1]))
        if len(odd):
            raise ValueError(
                f"{recording.name}: this calibration says that a range of {r[odd[0]]:.2f} m at the bearing "
                f"{b[odd[0]]:.2f} rad is {factor[odd[0]]:.2f} times the true one; it was fitted on a sensor with a "
                "narrower view"
            )
        return replace(
            recording,
            ranges=r / factor,
            bearings=wrap(b - self.bearing_offset),
            sweep_times=recording.sweep_times - self.measurement_delay,
        )

    def models(self, *, target: bool = True) -> ReplayModels:
        """What the estimators are told of the corrected recording."""
        drift = math.sqrt(2.0 / self.target_time) * self.target_speed_std
        return ReplayModels(
            motion=MotionModel(
                speed_std=self.speed_noise,
                turn_std=self.turn_noise,
                noise_law="root-second",
                speed_scale=self.speed_scale,
                turn_scale=self.turn_scale,
            ),
            sensor=SensorModel(
                max_range=9.0, range_std=1e-6, range_std_per_range=self.range_std, range_law="quadrature",
                bearing_std=self.bearing_std,
            ),
            target=TargetModel(acceleration_density=drift, initial_speed_std=self.target_speed_std) if target else None,
            command_delay=self.command_delay,
            errors=self.errors(),
        )  # fmt: skip

    def errors(self) -> RobotErrors:
        """What `recorded-ri-ekf` allows for."""
        shared = {field.name for field in fields(self)} & {field.name for field in fields(RobotErrors)}
        return RobotErrors(
            **{name: getattr(self, name) for name in shared - {"turn_noise"}},
            **ODOMETRY_PRIOR,
            turn_noise=self.turn_noise_per_angle,
            lateral_noise=LATERAL_NOISE,
            still_noise=STILL_NOISE,
            target_fresh=TARGET_FRESH,
            landmark_gate=LANDMARK_GATE,
            target_gate=TARGET_GATE,
            weight_dof=WEIGHT_DOF,
            restart_after=RESTART_AFTER,
        )

    def save(self, path: str | Path) -> Path:
        """Write a TOML file; `load` reads it."""
        file = Path(path)
        file.parent.mkdir(parents=True, exist_ok=True)
        lines = [f"{field.name} = {getattr(self, field.name)!r}" for field in fields(self)]
        head = "# A recorded robot, as slam_gym.calibration.Calibration explains: slam-gym replay --calibration FILE\n"
        file.write_text(head + "\n".join(lines) + "\n", encoding="utf-8")
        return file

    @classmethod
    def load(cls, name: str | Path) -> Self:
        """A preset by name, or a TOML file.

        Raises:
            ValueError: neither; unknown or wrong numbers in the file.
        """
        if str(name) in PRESETS:
            return cls(**PRESETS[str(name)])
        file = Path(name)
        if not file.is_file():
            raise ValueError(
                f"no calibration {str(name)!r}: expected a file written by `slam-gym calibrate`, or one of "
                f"{', '.join(PRESETS)}"
            )
        try:
            numbers = tomllib.loads(file.read_text(encoding="utf-8"))
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise ValueError(f"{file}: expected TOML as `slam-gym calibrate` writes it; {error}") from error
        unknown = sorted(set(numbers) - {field.name for field in fields(cls)})
        if unknown:
            raise ValueError(f"{file}: unknown numbers {', '.join(unknown)}; a calibration has "
                             f"{', '.join(field.name for field in fields(cls))}")  # fmt: skip
        return cls(**numbers)


_SHARED = {"command_delay": 0.22, "speed_scale": 0.935, "turn_scale": 0.948}
PRESETS: dict[str, dict[str, float]] = {
    "mrclam-7": _SHARED | {
        "range_offset": 0.0218, "range_bearing2": -0.5108, "range_bearing4": 0.1623, "range_inverse": 0.0480,
        "target_offset": 0.0107, "bearing_offset": -0.0022, "measurement_delay": 0.0390,
        "range_std": 0.0111, "range_time": 20.0,
        "bearing_std": 0.0138, "bearing_correlated_std": 0.0113, "bearing_time": 10.0,
        "range_scale_std": 0.0111, "bearing_bias_std": 0.0048,
        "speed_noise": 0.0253, "turn_noise": 0.0150, "turn_noise_per_angle": 0.0126,
        "target_speed_std": 0.040, "target_time": 30.0, "target_pull": 8e-4,
        "target_centre_x": 1.96, "target_centre_y": 0.50,
    },
    "mrclam-other": _SHARED | {
        "range_offset": 0.0224, "range_bearing2": -0.5088, "range_bearing4": 0.1548, "range_inverse": 0.0474,
        "target_offset": 0.0095, "bearing_offset": -0.0022, "measurement_delay": 0.0371,
        "range_std": 0.0112, "range_time": 20.0,
        "bearing_std": 0.0103, "bearing_correlated_std": 0.0068, "bearing_time": 20.0,
        "range_scale_std": 0.0109, "bearing_bias_std": 0.0059,
        "speed_noise": 0.0203, "turn_noise": 0.0114, "turn_noise_per_angle": 0.0100,
        "target_speed_std": 0.042, "target_time": 40.0, "target_pull": 8e-4,
        "target_centre_x": 2.29, "target_centre_y": 0.18,
    },
}  # fmt: skip
"""The five robots of the MRCLAM data sets: fitted on set 7, and on another set of the same robots.

Scored on set 7, "mrclam-other" is held out."""
