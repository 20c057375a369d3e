"""Fit the numbers of a recorded robot (`slam_gym.calibration.Calibration`) from recordings with truth.

In this order: bearing offset and delay of the stamps, by a trimmed regression of the bearing error on (1, turn rate);
the range factor, by trimmed least squares; spreads of what is left after each robot's mean, and from its autocovariance
the times over which it persists; delay, scales and noise of the odometry from windows of 1, 10 and 20 s; the target's
wandering.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from slam_gym.calibrate_motion import fit_command_delay, fit_odometry, fit_target
from slam_gym.calibrate_sensor import Returns, fit_delay, fit_noise, fit_range, likely, returns_of
from slam_gym.calibration import Calibration
from slam_gym.recording import Floats, Recording, wrap


@dataclass(frozen=True, slots=True)
class Fit:
    """A calibration and how well it fits.

    Attributes:
        calibration: the numbers.
        returns: what was fitted, without outliers, [Z] each.
        range_before, range_after: [Z] relative range errors of the logged and of the corrected ranges.
        bearing_before, bearing_after: [Z] bearing errors [rad] at the stamp, and corrected.
        outliers: returns left out, mis-read labels most of them.
    """

    calibration: Calibration
    returns: Returns
    range_before: Floats
    range_after: Floats
    bearing_before: Floats
    bearing_after: Floats
    outliers: int


def calibrate(recordings: Sequence[Recording], progress: Callable[[str], Any] | None = None) -> Fit:
    """Fit one calibration to recordings of the same kind of robot, one recording per robot.

    Args:
        recordings: with truth and surveyed landmarks; more than one tells how robots differ.
        progress: called with each step's name before it starts.

    Raises:
        ValueError: no recording, no truth, or too little of it.
    """
    tell = progress or (lambda _: None)
    if not recordings:
        raise ValueError("a calibration needs at least one recording")
    tell("stamps and bearings")
    offset, delay = fit_delay(recordings)
    returns = returns_of(recordings, delay)
    tell("ranges")
    numbers, range_left = fit_range(returns)
    bearing_left = wrap(returns.bearing - returns.true_bearing) - offset
    kept = likely(range_left) & likely(bearing_left)
    good = returns.only(kept)
    tell("noise and its persistence")
    numbers |= fit_noise(good, range_left[kept], bearing_left[kept])
    tell("odometry")
    command_delay = fit_command_delay(recordings)
    numbers |= fit_odometry(recordings, command_delay)
    tell("target")
    numbers |= fit_target(recordings)
    calibration = Calibration(
        bearing_offset=offset, measurement_delay=delay, command_delay=command_delay, **numbers
    )  # fmt: skip
    return Fit(
        calibration=calibration,
        returns=good,
        range_before=good.range / good.true_range - 1.0,
        range_after=range_left[kept],
        bearing_before=wrap(good.bearing - good.true_bearing) + delay * good.turn_rate,
        bearing_after=bearing_left[kept],
        outliers=int((~kept).sum()),
    )
