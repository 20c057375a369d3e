"""What a filter is told about a recorded robot: models, odometry calibration, delays.

`slam_gym.calibration` holds fitted numbers, and makes of them a `ReplayModels` with the robot's own errors.
"""

import math
from dataclasses import dataclass, replace
from typing import Self

from estimators.gaussian.robot_errors import RobotErrors
from estimators.interface import TARGET
from estimators.models import MotionModel, SensorModel, TargetModel
from slam_gym.recording import Recording
from slam_gym.scenario import Scenario
from slam_gym.scenario_fields import middle

MRCLAM_CALIBRATION = (0.935, 0.948, -0.0023)
"""Speed scale, turn scale, turn bias [rad/s] of the MRCLAM robots, measured on another recording of the same robots."""
MRCLAM_COMMAND_DELAY = 0.2  # [s], motion lags the logged command by 0.20-0.25 s
UNCALIBRATED = (1.0, 1.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayModels:
    """What the estimators believe.

    Attributes:
        motion, sensor, target: as everywhere; target None: the recording has none.
        command_delay: [s] from a command's time to its motion.
        start_std: (position [m] per axis, heading [rad]) of the start, which is read from the recorded truth.
        errors: beyond white noise, for the filters that know them (`recorded-ri-ekf`); None: theirs.
    """

    motion: MotionModel
    sensor: SensorModel
    target: TargetModel | None
    command_delay: float = 0.0
    start_std: tuple[float, float] = (0.01, 0.01)
    errors: RobotErrors | None = None

    def inflated(self, factor: float) -> Self:
        """The sensor's noise variances times a factor: the plain remedy against errors correlated in time.

        Raises:
            ValueError: the factor is not a positive number.
        """
        if not 0.0 < factor < math.inf:
            raise ValueError(f"a noise inflation multiplies the sensor's variances; it must be positive, got {factor}")
        root, sensor = math.sqrt(factor), self.sensor
        return replace(
            self,
            sensor=replace(
                sensor,
                range_std=root * sensor.range_std,
                range_std_per_range=root * sensor.range_std_per_range,
                bearing_std=root * sensor.bearing_std,
            ),
        )


def parse_calibration(text: str) -> tuple[float, float, float]:
    """An odometry calibration from "mrclam", "none" or "SPEED,TURN,BIAS".

    Raises:
        ValueError: something else.
    """
    named = {"mrclam": MRCLAM_CALIBRATION, "none": UNCALIBRATED}
    if text in named:
        return named[text]
    try:
        speed, turn, bias = (float(part) for part in text.split(","))
    except ValueError as error:
        raise ValueError(
            f"an odometry calibration is 'mrclam', 'none' or SPEED,TURN,BIAS such as 0.935,0.948,-0.0023; got {text!r}"
        ) from error
    return speed, turn, bias


def mrclam_models(calibration: tuple[float, float, float] = MRCLAM_CALIBRATION, *, target: bool = True) -> ReplayModels:
    """The robots of the MRCLAM data sets with white noise.

    Sensor: spread of the logged ranges and bearings about the surveyed ones. Those errors are correlated for seconds,
    so that white noise of this size makes every filter overconfident; see `ReplayModels.inflated`.
    Motion: spread of recorded displacements over 1 to 20 s about the calibrated commands. The noise vanishes with the
    command (these robots stand still when told to), and that of the heading grows with the angle turned: 0.1 rad per
    root radian, which is 0.063 rad per root second at their usual 0.4 rad/s.
    Target: another robot at up to 0.1 m/s that turns every few seconds; the acceleration is a compromise between the
    first seconds out of sight, which want more, and a minute later, when a constant velocity runs out of the room.

    Args:
        calibration: speed scale, turn scale, turn bias [rad/s] (true = scale x logged + bias).
        target: whether there is one.
    """
    scale, turn_scale, bias = calibration
    tracked = TargetModel(
        acceleration_density=0.02, initial_speed_std=0.06, reinitialise_nis=20.0, reinitialise_spread=0.5
    )
    return ReplayModels(
        motion=MotionModel(
            speed_std=0.0005,  # [m/s per root second]
            speed_std_per_speed=0.3,  # 0.025 at the usual 0.083 m/s
            turn_std=0.0003,
            turn_std_per_speed=0.18,  # 0.015 rad/s per root second at the usual speed
            turn_std_per_turn=0.15,
            noise_law="root-second",
            speed_scale=scale,
            turn_scale=turn_scale,
            turn_bias=bias,
        ),
        sensor=SensorModel(
            max_range=9.0,
            field_of_view=2 * 0.59,
            range_std=0.020,
            range_std_per_range=0.043,
            range_law="quadrature",
            bearing_std=0.014,
        ),
        target=tracked if target else None,
        command_delay=MRCLAM_COMMAND_DELAY,
    )


def scenario_models(scenario: Scenario, recording: Recording) -> ReplayModels:
    """A scenario's numbers as filters believe them, for recordings of other robots."""
    motion, sensor, target = scenario.models()
    if recording.target is None and TARGET not in recording.labels:
        target = None
    elif target is None:
        target = TargetModel()
    delay = middle(scenario.robot.command_delay)
    return ReplayModels(motion=motion, sensor=sensor, target=target, command_delay=delay)
