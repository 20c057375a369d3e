"""One command for ever."""

import math

from estimators.interface import Belief
from slam_gym.policies import Floats, Ints, Policy, PolicyContext


class Constant(Policy):
    """Drives with constant speed and turn rate: a circle, or a straight line with `turn_rate=0`.

    The usual driver of filter comparisons: the command depends on nothing, so every estimator sees the same motion.

    Args:
        context: models and limits.
        num_lanes: L.
        speed: [m/s]; default: half the robot's highest.
        turn_rate: [rad/s], left positive; of a bicycle the rate that its steering angle is chosen for. Default: a
            circle whose diameter is half the arena's shorter side.

    Raises:
        ValueError: a value that is not a finite number.
    """

    summary = "constant speed and turn rate: a circle or a straight line"

    def __init__(
        self,
        context: PolicyContext,
        num_lanes: int = 1,
        *,
        speed: float | None = None,
        turn_rate: float | None = None,
    ) -> None:
        super().__init__(context, num_lanes)
        for name, value in (("speed", speed), ("turn_rate", turn_rate)):
            if value is not None and not math.isfinite(value):
                raise ValueError(f"constant: {name} must be a finite number; got {value!r}")
        v = 0.5 * context.speed_max if speed is None else speed
        w = v / (0.25 * min(context.arena)) if turn_rate is None else turn_rate
        self.command[:] = v, self._steering(v, w) if context.is_bicycle else w

    def _steering(self, speed: float, turn_rate: float) -> float:
        """Steering angle of that turn rate, the largest possible where it is out of reach; Eq. (15), Tian 2010."""
        limit = self.context.steering_max
        sine = turn_rate * self.context.motion.wheelbase / speed if speed else 0.0
        return max(-limit, min(limit, math.asin(max(-1.0, min(1.0, sine)))))

    def reset(self, lanes: Ints, seeds: Ints) -> None:
        """Nothing to forget."""

    def act(self, observation: Floats | None, belief: Belief) -> Floats:
        """The same command in every lane; see `Policy.act`."""
        return self.to_action(self.command)
