"""Follow the believed target at a distance."""

import math

import numpy as np

from agents.scripted.driving import drive_to_place, set_command
from agents.scripted.follower import Follower
from estimators.interface import Belief
from estimators.kernels.jit import jit
from slam_gym.policies import Ints, PolicyContext

_UNSEEN, _FOLLOWING, _RETURNING, _LOOKING = range(4)  # what a lane is doing


@jit
def _look_around(pose, lost, last, look_rate, gains, limits, state, command):
    """Where the target is lost: drive to where it was last trusted to be, then turn on the spot.

    pose [L, 3], lost [L], last [L, 2]; look_rate [rad/s]; state [L]: what the lane is doing; command [L, 2]: output.
    """
    for lane in range(command.shape[0]):
        if not lost[lane]:
            state[lane] = _FOLLOWING
            continue
        if state[lane] == _FOLLOWING:
            state[lane] = _RETURNING
        if state[lane] == _RETURNING:
            if not drive_to_place(lane, pose, last[lane, 0], last[lane, 1], gains, limits, command):
                continue
            state[lane] = _LOOKING
        set_command(command, lane, 0.0, look_rate, limits)


class Pursuit(Follower):
    """Drives to a stand-off distance from the believed target and faces it.

    In the robot's frame let the believed target be at distance r and bearing b with velocity u:

        speed     = speed_gain (r - stand_off) cos b + lead u_along      (zero while the target is behind)
        turn rate = turn_gain b + lead u_across / r

    both within the robot's limits. The stand-off is kept in both directions: too near, the robot backs off if it can.

    When the target's position is uncertain by more than `lost_std` (the largest standard deviation relative to the
    robot), it counts as lost: the robot drives to where it last trusted the target to be, then turns on the spot until
    it is found. A target that was never seen is looked for on the spot from the start. A bicycle, which cannot turn on
    the spot, circles slowly with its wheels at the stop.

    Args:
        context: models and limits.
        num_lanes: L.
        stand_off: [m] distance to keep.
        speed_gain: [1/s], speed per metre of distance error.
        turn_gain: [1/s], turn rate per radian of bearing.
        lead: share of the target's believed velocity that is anticipated; 0: react to positions only.
        lost_std: [m] uncertainty at which the target counts as lost.
        look_rate: [rad/s] of looking around; default: 0.6 times the robot's highest, at most 1.

    Raises:
        ValueError: a negative or non-finite number.
    """

    name = "pursuit"
    summary = "follows the believed target at a stand-off distance; looks around where it was lost"

    def __init__(
        self,
        context: PolicyContext,
        num_lanes: int = 1,
        *,
        stand_off: float = 1.5,
        speed_gain: float = 1.5,
        turn_gain: float = 3.0,
        lead: float = 1.0,
        lost_std: float = 1.0,
        look_rate: float | None = None,
    ) -> None:
        super().__init__(
            context, num_lanes, stand_off=stand_off, speed_gain=speed_gain, turn_gain=turn_gain, lead=lead,
            lost_std=lost_std,
        )  # fmt: skip
        if look_rate is not None and not math.isfinite(look_rate):
            raise ValueError(f"pursuit: look_rate must be a finite number; got {look_rate!r}")
        if look_rate is None:
            look_rate = 1.0 if context.is_bicycle else min(0.6 * context.turn_max, 1.0)
        self._look_rate = float(look_rate)
        self._state = np.full(num_lanes, _UNSEEN, dtype=np.int64)

    def reset(self, lanes: Ints, seeds: Ints) -> None:
        """Forget where the target was."""
        super().reset(lanes, seeds)
        self._state[lanes] = _UNSEEN

    def _seek(self, belief: Belief) -> None:
        _look_around(
            belief.pose, self._lost, self._last, self._look_rate, self._gains, self._limits, self._state, self.command
        )
