"""Follow the believed target at a distance."""

import math

import numpy as np

from estimators.interface import Belief
from estimators.kernels.angles import wrap
from estimators.kernels.jit import inline, jit
from slam_gym.policies import Floats, Ints, Policy, PolicyContext

ARRIVED = 0.5  # [m] from the place where the target was lost: close enough to look around
_UNSEEN, _FOLLOWING, _RETURNING, _LOOKING = range(4)  # what a lane is doing


@inline
def _largest_variance(p00, p01, p11):
    """Largest eigenvalue of a symmetric 2 x 2 matrix."""
    return 0.5 * (p00 + p11) + math.sqrt(0.25 * (p00 - p11) ** 2 + p01 * p01)


@inline
def _drive_to(x, y, distance, stand_off, gains, lead, lead_turn):
    """Speed and turn rate towards a point (x, y) in the robot's frame, stopping `stand_off` before it.

    The speed is projected on the line of sight: a point abeam asks for a turn, not for speed.
    """
    bearing = math.atan2(y, x)
    speed = gains[0] * (distance - stand_off) * math.cos(bearing) + lead
    if abs(bearing) > 0.5 * math.pi:
        speed = 0.0  # first turn to face it
    return speed, gains[1] * bearing + lead_turn


@inline
def _clip(value, low, high):
    return max(low, min(high, value))


@jit
def _pursue(pose, known, position, rel, rel_cov, rel_velocity, settings, gains, limits, state, last, command):
    """One command per lane.

    pose [L, 3], known [L], position [L, 2], rel [L, 2], rel_cov [L, 2, 2], rel_velocity [L, 2]: the belief;
    settings: (stand-off [m], lost_std [m], lead, look rate [rad/s]); gains: (speed, turn) [1/s];
    limits: (lowest, highest speed, turn rate);
    state [L], last [L, 2]: what the lane is doing and the last trusted position; command [L, 2]: output.
    """
    stand_off, lost_std, lead, look_rate = settings
    for lane in range(command.shape[0]):
        variance = _largest_variance(rel_cov[lane, 0, 0], rel_cov[lane, 0, 1], rel_cov[lane, 1, 1])
        if known[lane] and variance <= lost_std * lost_std:
            state[lane] = _FOLLOWING
            last[lane, 0] = position[lane, 0]
            last[lane, 1] = position[lane, 1]
            x, y = rel[lane, 0], rel[lane, 1]
            distance = max(math.hypot(x, y), 1e-9)
            along = lead * (x * rel_velocity[lane, 0] + y * rel_velocity[lane, 1]) / distance
            across = lead * (x * rel_velocity[lane, 1] - y * rel_velocity[lane, 0]) / distance
            # The line of sight turns with the target's motion across it; near the target that rate is not usable.
            turning = across / max(distance, 0.5 * stand_off, 0.1)
            speed, turn = _drive_to(x, y, distance, stand_off, gains, along, turning)
            command[lane, 0] = _clip(speed, limits[0], limits[1])
            command[lane, 1] = _clip(turn, -limits[2], limits[2])
            continue
        if state[lane] == _FOLLOWING:
            state[lane] = _RETURNING
        if state[lane] == _RETURNING:
            east, north = last[lane, 0] - pose[lane, 0], last[lane, 1] - pose[lane, 1]
            distance = math.hypot(east, north)
            if distance > ARRIVED:
                bearing = wrap(math.atan2(north, east) - pose[lane, 2])
                x, y = distance * math.cos(bearing), distance * math.sin(bearing)
                speed, turn = _drive_to(x, y, distance, 0.0, gains, 0.0, 0.0)
                command[lane, 0] = _clip(speed, limits[0], limits[1])
                command[lane, 1] = _clip(turn, -limits[2], limits[2])
                continue
            state[lane] = _LOOKING
        command[lane, 0] = 0.0
        command[lane, 1] = _clip(look_rate, -limits[2], limits[2])


class Pursuit(Policy):
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
        super().__init__(context, num_lanes)
        given = {
            "stand_off": stand_off, "speed_gain": speed_gain, "turn_gain": turn_gain, "lead": lead,
            "lost_std": lost_std,
        }  # fmt: skip
        for name, value in given.items():
            if not 0.0 <= value < math.inf:
                raise ValueError(f"pursuit: {name} must be a finite number that is zero or more; got {value!r}")
        if look_rate is not None and not math.isfinite(look_rate):
            raise ValueError(f"pursuit: look_rate must be a finite number; got {look_rate!r}")
        if look_rate is None:
            look_rate = 1.0 if context.is_bicycle else min(0.6 * context.turn_max, 1.0)
        self._settings = (float(stand_off), float(lost_std), float(lead), float(look_rate))
        self._gains = (float(speed_gain), float(turn_gain))
        turn_max = math.inf if context.is_bicycle else context.turn_max  # a bicycle's wheels have a stop instead
        self._limits = (float(context.speed_min), float(context.speed_max), float(turn_max))
        self._state = np.full(num_lanes, _UNSEEN, dtype=np.int64)
        self._last = np.zeros((num_lanes, 2))

    def reset(self, lanes: Ints, seeds: Ints) -> None:
        """Forget where the target was."""
        self._state[lanes] = _UNSEEN
        self._last[lanes] = 0.0

    def act(self, observation: Floats | None, belief: Belief) -> Floats:
        """Drive to the believed target, or to where it was lost; see `Policy.act`."""
        _pursue(
            belief.pose, belief.target_known, belief.target_position, belief.target_rel, belief.target_rel_cov,
            belief.target_rel_velocity, self._settings, self._gains, self._limits, self._state, self._last,
            self.command,
        )  # fmt: skip
        if self.context.is_bicycle:
            self._steer()
        return self.to_action(self.command)

    def _steer(self) -> None:
        """Turn rates into steering angles; Eq. (15), Tian et al. 2010: turn rate = speed sin(steering) / wheelbase."""
        looking = (self._state == _UNSEEN) | (self._state == _LOOKING)
        self.command[looking, 0] = 0.2 * self.context.speed_max
        speed = self.command[:, 0]
        slow = np.abs(speed) < 1e-3 * self.context.speed_max
        sine = self.command[:, 1] * self.context.motion.wheelbase / np.where(slow, 1.0, speed)
        stop = self.context.steering_max
        self.command[:, 1] = np.clip(np.where(slow, 0.0, np.arcsin(np.clip(sine, -1.0, 1.0))), -stop, stop)
