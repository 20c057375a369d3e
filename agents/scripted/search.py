"""Look for a lost target along a widening spiral."""

import math

import numpy as np

from agents.scripted.driving import clip, drive_to_place, set_command
from agents.scripted.follower import Follower
from estimators.interface import Belief
from estimators.kernels.jit import jit
from slam_gym.policies import Ints, PolicyContext

SPOKES = 6  # places to drive to in one turn of the spiral
_IDLE = -1  # instead of a place's number: the target is not being looked for


@jit
def _spiral(pose, lost, last, pitch, border, gains, limits, look_rate, dt, centre, at, turned, command):
    """Where the target is lost: look around where it was last trusted to be, then drive along a spiral about it.

    pose [L, 3], lost [L], last [L, 2]; pitch [m] between two turns; border: half the arena's width and height [m];
    look_rate [rad/s]; dt [s] between decisions; centre [L, 2], at [L], turned [L]: of the spiral, the number of the
    place that is driven to, and how far the robot has looked around at the first; command [L, 2]: output.
    """
    longest = 2.0 * math.hypot(border[0], border[1])
    for lane in range(command.shape[0]):
        if not lost[lane]:
            at[lane] = _IDLE
            continue
        if at[lane] == _IDLE:
            at[lane], turned[lane] = 0, 0.0
            centre[lane, 0], centre[lane, 1] = last[lane, 0], last[lane, 1]
        if pitch * at[lane] / SPOKES > longest:  # everywhere once: again, from the middle
            at[lane], centre[lane, 0], centre[lane, 1] = 0, 0.0, 0.0
        radius, angle = pitch * at[lane] / SPOKES, 2.0 * math.pi * at[lane] / SPOKES
        x = clip(centre[lane, 0] + radius * math.cos(angle), -border[0], border[0])
        y = clip(centre[lane, 1] + radius * math.sin(angle), -border[1], border[1])
        if not drive_to_place(lane, pose, x, y, gains, limits, command):
            continue
        set_command(command, lane, 0.0, look_rate, limits)
        turned[lane] += abs(command[lane, 1]) * dt
        if at[lane] > 0 or turned[lane] >= 2.0 * math.pi:
            at[lane] += 1


class Search(Follower):
    """Pursuit that looks for a lost target along a widening spiral.

    While the target is known well enough it does what `pursuit` does. Where it is lost, the robot drives to where it
    last trusted the target to be, looks around once, and goes on along a spiral about that place: a hexagon per turn,
    `pitch` from the one before; places outside the arena are moved to its border. After the arena's last corner it
    begins again in the middle. A target that was never seen is looked for about the start.

    The pattern asks nothing of the belief but the last trusted position: not where the sensor has looked, nor what the
    pillars hide. `pursuit-search` does.

    Args:
        context: models and limits.
        num_lanes: L.
        pitch: [m] between two turns of the spiral; default: half the sensor's range, at most a quarter of the arena's
            shorter side.
        stand_off: [m] distance to keep.
        speed_gain: [1/s], speed per metre of distance error.
        turn_gain: [1/s], turn rate per radian of bearing.
        lead: share of the target's believed velocity that is anticipated.
        lost_std: [m] uncertainty at which the target counts as lost.

    Raises:
        ValueError: a negative or non-finite number, a pitch of zero.
    """

    name = "search"
    summary = "pursuit; looks for a lost target along a widening spiral"

    def __init__(
        self,
        context: PolicyContext,
        num_lanes: int = 1,
        *,
        pitch: float | None = None,
        stand_off: float = 1.5,
        speed_gain: float = 1.5,
        turn_gain: float = 3.0,
        lead: float = 1.0,
        lost_std: float = 1.0,
    ) -> None:
        super().__init__(
            context, num_lanes, stand_off=stand_off, speed_gain=speed_gain, turn_gain=turn_gain, lead=lead,
            lost_std=lost_std,
        )  # fmt: skip
        if pitch is None:
            pitch = min(0.5 * context.sensor.max_range, 0.25 * min(context.arena))
        if not 0.0 < pitch < math.inf:
            raise ValueError(f"search: pitch must be a finite number above zero; got {pitch!r}")
        self._pitch = float(pitch)
        self._border = (0.5 * context.arena[0], 0.5 * context.arena[1])
        self._start = np.array(context.start[:2])
        self._centre = np.zeros((num_lanes, 2))
        self._look_rate = 1.0 if context.is_bicycle else float(context.turn_max)
        self._turned = np.zeros(num_lanes)
        self._at = np.full(num_lanes, _IDLE, dtype=np.int64)

    def reset(self, lanes: Ints, seeds: Ints) -> None:
        """Forget where the target was."""
        super().reset(lanes, seeds)
        self._last[lanes] = self._start
        self._at[lanes] = _IDLE

    def _seek(self, belief: Belief) -> None:
        _spiral(
            belief.pose, self._lost, self._last, self._pitch, self._border, self._gains, self._limits,
            self._look_rate, self.context.dt, self._centre, self._at, self._turned, self.command,
        )  # fmt: skip
