"""What the pursuing policies share: follow a target that is known well enough; what else to do is each policy's own."""

import math
from abc import abstractmethod

import numpy as np

from agents.scripted.driving import drive_to, largest_variance, set_command
from estimators.interface import Belief
from estimators.kernels.jit import jit
from slam_gym.policies import Bools, Floats, Ints, Policy, PolicyContext


@jit
def _follow(known, position, rel, rel_cov, rel_velocity, settings, gains, limits, lost, last, command):
    """One command per lane in which the target is known well enough.

    known [L], position [L, 2], rel [L, 2], rel_cov [L, 2, 2], rel_velocity [L, 2]: the belief;
    settings: (stand-off [m], lost_std [m], lead); gains: (speed, turn) [1/s];
    limits: (lowest, highest speed, turn rate);
    lost [L], last [L, 2]: whether the target is lost, and the last trusted position; command [L, 2]: output.
    """
    stand_off, lost_std, lead = settings
    for lane in range(command.shape[0]):
        variance = largest_variance(rel_cov[lane, 0, 0], rel_cov[lane, 0, 1], rel_cov[lane, 1, 1])
        lost[lane] = not (known[lane] and variance <= lost_std * lost_std)
        if lost[lane]:
            continue
        last[lane, 0] = position[lane, 0]
        last[lane, 1] = position[lane, 1]
        x, y = rel[lane, 0], rel[lane, 1]
        distance = max(math.hypot(x, y), 1e-9)
        along = lead * (x * rel_velocity[lane, 0] + y * rel_velocity[lane, 1]) / distance
        across = lead * (x * rel_velocity[lane, 1] - y * rel_velocity[lane, 0]) / distance
        # The line of sight turns with the target's motion across it; near the target that rate is not usable.
        turning = across / max(distance, 0.5 * stand_off, 0.1)
        speed, turn = drive_to(x, y, distance, stand_off, gains, along, turning)
        set_command(command, lane, speed, turn, limits)


class Follower(Policy):
    """Follows the target while it is known well enough; a subclass says what to do where it is lost.

    Args:
        context, num_lanes: see `Policy`.
        stand_off, speed_gain, turn_gain, lead, lost_std: see `agents.scripted.pursuit.Pursuit`.

    Raises:
        ValueError: a negative or non-finite number.
    """

    name = ""  # as in the registry, for messages

    def __init__(
        self,
        context: PolicyContext,
        num_lanes: int = 1,
        *,
        stand_off: float,
        speed_gain: float,
        turn_gain: float,
        lead: float,
        lost_std: float,
    ) -> None:
        super().__init__(context, num_lanes)
        self._check(stand_off=stand_off, speed_gain=speed_gain, turn_gain=turn_gain, lead=lead, lost_std=lost_std)
        self._settings = (float(stand_off), float(lost_std), float(lead))
        self._gains = (float(speed_gain), float(turn_gain))
        turn_max = math.inf if context.is_bicycle else context.turn_max  # a bicycle's wheels have a stop instead
        self._limits = (float(context.speed_min), float(context.speed_max), float(turn_max))
        self._lost: Bools = np.ones(num_lanes, dtype=np.bool_)
        self._last: Floats = np.zeros((num_lanes, 2))

    def _check(self, **given: float) -> None:
        for name, value in given.items():
            if not 0.0 <= value < math.inf:
                raise ValueError(f"{self.name}: {name} must be a finite number that is zero or more; got {value!r}")

    def reset(self, lanes: Ints, seeds: Ints) -> None:
        """Forget where the target was."""
        self._lost[lanes] = True
        self._last[lanes] = 0.0

    def act(self, observation: Floats | None, belief: Belief) -> Floats:
        """Drive to the believed target, or look for it; see `Policy.act`."""
        _follow(
            belief.target_known, belief.target_position, belief.target_rel, belief.target_rel_cov,
            belief.target_rel_velocity, self._settings, self._gains, self._limits, self._lost, self._last,
            self.command,
        )  # fmt: skip
        self._seek(belief)
        if self.context.is_bicycle:
            self._steer()
        return self.to_action(self.command)

    @abstractmethod
    def _seek(self, belief: Belief) -> None:
        """Write `command` in the lanes where the target is `_lost`."""

    def _steer(self) -> None:
        """Turn rates into steering angles; Eq. (15), Tian et al. 2010: turn rate = speed sin(steering) / wheelbase.

        A bicycle cannot turn on the spot: where that is asked for it circles slowly, its wheels at the stop.
        """
        self.command[self._lost & (self.command[:, 0] == 0.0), 0] = 0.2 * self.context.speed_max
        speed = self.command[:, 0]
        slow = np.abs(speed) < 1e-3 * self.context.speed_max
        sine = self.command[:, 1] * self.context.motion.wheelbase / np.where(slow, 1.0, speed)
        stop = self.context.steering_max
        self.command[:, 1] = np.clip(np.where(slow, 0.0, np.arcsin(np.clip(sine, -1.0, 1.0))), -stop, stop)
