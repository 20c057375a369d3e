"""How a real robot errs, beyond white noise: numbers with units, packed as one record for the kernels.

The motion and sensor models hold the white part. What is here is what recorded robots add to it; the defaults add
nothing.
"""

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

CENTRE = ("target_centre_x", "target_centre_y")


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotErrors:
    """What `recorded-ri-ekf` allows for; every number is zero or more, and zero (or infinity, for gates) adds nothing.

    Attributes:
        speed_scale_std, turn_scale_std: [-] prior deviation of the odometry's scale errors, states of the filter.
        turn_bias_std: [rad/s] prior deviation of a turn bias that acts while the robot is commanded to move; a state.
        range_scale_std, bearing_bias_std: [-], [rad] prior deviation of the sensor's scale and bias; states.
        turn_noise: [rad^2 per rad] heading variance per angle turned.
        lateral_noise: [m^2 per m] sideways variance per distance travelled.
        still_noise: [-] factor on the motion's noise variances while the robot is commanded to stand; 1: none.
        range_time: [s] time constant of the range error of one label; 0: white.
        bearing_time: [s] the same of the bearing error's persisting part.
        bearing_correlated_std: [rad] sab; the share sab^2 / (sab^2 + bearing_std^2) of its variance persists.
        target_time: [s] after which a constant-velocity target forgets its velocity; 0: never.
        target_pull: [1/s^2] spring that holds the target near (target_centre_x, target_centre_y) [m].
        target_fresh: [s] a target out of sight for longer is linearised where it is measured; 0: never.
        landmark_gate, target_gate: NIS (2 dof) above which a labelled return is rejected; infinity: the option `gate`.
        weight_dof: degrees of freedom of the Student t weights on landmark returns; 0: none.
        restart_after: rejected returns of one label in a row, each near the last, that start it anew; 0: never.
        restart_radius: [m] what near means.
    """

    speed_scale_std: float = 0.0
    turn_scale_std: float = 0.0
    turn_bias_std: float = 0.0
    range_scale_std: float = 0.0
    bearing_bias_std: float = 0.0
    turn_noise: float = 0.0
    lateral_noise: float = 0.0
    still_noise: float = 1.0
    range_time: float = 0.0
    bearing_time: float = 0.0
    bearing_correlated_std: float = 0.0
    target_time: float = 0.0
    target_pull: float = 0.0
    target_centre_x: float = 0.0
    target_centre_y: float = 0.0
    target_fresh: float = 0.0
    landmark_gate: float = math.inf
    target_gate: float = math.inf
    weight_dof: float = 0.0
    restart_after: float = 0.0
    restart_radius: float = 0.5

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if math.isnan(value) or (value < 0.0 and field.name not in CENTRE):
                raise ValueError(f"RobotErrors.{field.name} must be a number that is zero or more; got {value!r}")

    def pack(self) -> NDArray[np.void]:
        """The numbers as an array of one `ERRORS` record."""
        record = np.zeros(1, dtype=ERRORS)
        for field in fields(self):
            record[field.name] = getattr(self, field.name)
        return record


ERRORS = np.dtype([(field.name, np.float64) for field in fields(RobotErrors)])
"""The numbers as kernels read them: `errors.range_time`."""
