"""Map the arena: drive to the border of what has been seen, and to landmarks that are poorly known."""

import math

import numpy as np

from agents.scripted.driving import clip, drive_to_place, largest_variance, set_command
from estimators.interface import Belief
from estimators.kernels.angles import wrap
from estimators.kernels.jit import inline, jit
from slam_gym.policies import Floats, Ints, Policy, PolicyContext

AROUND = 2  # cells about a place that count as seen from there
_X, _Y, _AGE = 0, 1, 2  # columns of a goal; an age below zero: none


@inline
def _mark_seen(pose, seen, cell, corner, sensor, pillars, mapped):
    """Cells whose middle is in range, in view and behind no mapped pillar."""
    max_range, view, radius = sensor
    low_x, high_x = int((pose[0] - max_range - corner[0]) / cell), int((pose[0] + max_range - corner[0]) / cell)
    low_y, high_y = int((pose[1] - max_range - corner[1]) / cell), int((pose[1] + max_range - corner[1]) / cell)
    for i in range(max(low_x, 0), min(high_x + 1, seen.shape[0])):
        for k in range(max(low_y, 0), min(high_y + 1, seen.shape[1])):
            dx, dy = corner[0] + (i + 0.5) * cell - pose[0], corner[1] + (k + 0.5) * cell - pose[1]
            r = math.hypot(dx, dy)
            if seen[i, k] or r > max_range or abs(wrap(math.atan2(dy, dx) - pose[2])) > 0.5 * view:
                continue
            hidden = False
            for j in range(mapped.size if radius > 0.0 else 0):
                if mapped[j]:
                    ex, ey = pillars[j, 0] - pose[0], pillars[j, 1] - pose[1]
                    along = (ex * dx + ey * dy) / max(r, 1e-9)
                    across = abs(ex * dy - ey * dx) / max(r, 1e-9)
                    hidden = hidden or (0.0 < along < r - radius and across < radius)
            seen[i, k] = not hidden


@inline
def _unseen_around(seen, i, k):
    """How many cells about (i, k) have not been seen; 0 where none has been (nothing to drive along)."""
    unseen, known = 0, False
    for a in range(max(i - AROUND, 0), min(i + AROUND + 1, seen.shape[0])):
        for b in range(max(k - AROUND, 0), min(k + AROUND + 1, seen.shape[1])):
            known = known or seen[a, b]
            unseen += 0 if seen[a, b] else 1
    return unseen if known else 0


@inline
def _worth(gain, pose, x, y, discount, speed, turn):
    """Gain x exp(-discount x seconds until there)."""
    dx, dy = x - pose[0], y - pose[1]
    seconds = math.hypot(dx, dy) / speed + abs(wrap(math.atan2(dy, dx) - pose[2])) / turn
    return gain * math.exp(-discount * seconds)


@jit
def _explore(
    pose, pose_cov, mapped, landmarks, landmark_cov, seen, cell, corner, sensor, settings, gains, limits, goal, command
):
    """One command per lane.

    pose [L, 3], pose_cov [L, 3, 3], mapped [L, M], landmarks [L, M, 2], landmark_cov [L, M, 2, 2]: the belief;
    seen [L, X, Y]: cells of `cell` metres from `corner` on, updated;
    sensor: (range [m], view [rad], pillars' radius [m]);
    settings: (discount [1/s], known_std [m], landmark_weight [m], decisions between two choices); goal [L, 3];
    command [L, 2]: output.
    """
    discount, known_std, landmark_weight, keep = settings
    for lane in range(command.shape[0]):
        here = pose[lane]
        _mark_seen(here, seen[lane], cell, corner, sensor, landmarks[lane], mapped[lane])
        if not 0.0 <= goal[lane, _AGE] < keep:
            best = 0.0
            cov = pose_cov[lane]  # a look cannot make a landmark better known than the robot itself
            enough = known_std + math.sqrt(max(largest_variance(cov[0, 0], cov[0, 1], cov[1, 1]), 0.0))
            for i in range(seen.shape[1]):
                for k in range(seen.shape[2]):
                    gain = _unseen_around(seen[lane], i, k) if not seen[lane, i, k] else 0
                    x, y = corner[0] + (i + 0.5) * cell, corner[1] + (k + 0.5) * cell
                    worth = _worth(gain * cell * cell, here, x, y, discount, limits[1], limits[2]) if gain else 0.0
                    if worth > best:
                        best, goal[lane, _X], goal[lane, _Y] = worth, x, y
            for j in range(mapped.shape[1]):
                cov = landmark_cov[lane, j]
                std = math.sqrt(max(largest_variance(cov[0, 0], cov[0, 1], cov[1, 1]), 0.0)) if mapped[lane, j] else 0.0
                if std > enough:
                    x, y = landmarks[lane, j, 0], landmarks[lane, j, 1]
                    worth = _worth(landmark_weight * (std - enough), here, x, y, discount, limits[1], limits[2])
                    if worth > best:
                        best, goal[lane, _X], goal[lane, _Y] = worth, x, y
            goal[lane, _AGE] = 0.0 if best > 0.0 else -1.0
            if best == 0.0:
                seen[lane] = False  # all is seen and well known: once more
        if goal[lane, _AGE] < 0.0 or drive_to_place(lane, pose, goal[lane, _X], goal[lane, _Y], gains, limits, command):
            goal[lane, _AGE] = -1.0
            set_command(command, lane, 0.0, clip(1.0, 0.0, limits[2]), limits)
        else:
            goal[lane, _AGE] += 1.0


class Explore(Policy):
    """Drives where the most of the arena is still to be seen and where landmarks are poorly known.

    A grid remembers which cells the sensor has covered (in range, in view, behind no mapped pillar). Every `replan`
    seconds the robot chooses the goal with the largest

        gain exp(-discount t),   t: seconds to turn and drive there;

    gain: the unseen area about a cell of the frontier (an unseen cell with a seen one near) in m^2, or for a
    landmark whose largest standard deviation exceeds `known_std` plus the robot's own, landmark_weight x the excess.
    When nothing is left the grid is cleared and the tour begins again. The target is not looked at.

    When to use it: to map, to compare maps of estimators, or as a teacher of exploration. Weakness: straight lines to
    the goal, with no path around pillars.

    Args:
        context: models and limits; a bicycle, which cannot turn on the spot, is refused.
        num_lanes: L.
        cell: [m] of the grid.
        discount: [1/s] by which a later gain is worth less.
        known_std: [m] deviation beyond the robot's own below which a landmark is known well enough.
        landmark_weight: [m] unseen area that a metre of deviation above that is worth.
        replan: [s] between two choices of a goal.
        speed_gain: [1/s], speed per metre of distance.
        turn_gain: [1/s], turn rate per radian of bearing.

    Raises:
        ValueError: a negative or non-finite number, a cell of zero, or a bicycle.
    """

    summary = "drives to the frontier of what has been seen and to poorly known landmarks"

    def __init__(
        self,
        context: PolicyContext,
        num_lanes: int = 1,
        *,
        cell: float = 1.0,
        discount: float = 0.05,
        known_std: float = 0.15,
        landmark_weight: float = 10.0,
        replan: float = 1.0,
        speed_gain: float = 1.5,
        turn_gain: float = 3.0,
    ) -> None:
        super().__init__(context, num_lanes)
        if context.is_bicycle:
            raise ValueError("explore turns on the spot, which a bicycle cannot; use 'waypoints' for it")
        given = {
            "cell": cell, "discount": discount, "known_std": known_std, "landmark_weight": landmark_weight,
            "replan": replan, "speed_gain": speed_gain, "turn_gain": turn_gain,
        }  # fmt: skip
        for name, value in given.items():
            if not 0.0 <= value < math.inf or (name == "cell" and value == 0.0):
                raise ValueError(f"explore: {name} must be a finite number that is zero or more; got {value!r}")
        width, height = context.arena
        sensor = context.sensor
        self._cell, self._corner = float(cell), (-0.5 * width, -0.5 * height)
        self._sensor = (float(sensor.max_range), float(sensor.field_of_view), float(sensor.landmark_radius))
        self._settings = (float(discount), float(known_std), float(landmark_weight), float(round(replan / context.dt)))
        self._gains = (float(speed_gain), float(turn_gain))
        self._limits = (float(context.speed_min), min(context.speed_max, 1e6), min(context.turn_max, 1e6))
        self.seen = np.zeros((num_lanes, math.ceil(width / cell), math.ceil(height / cell)), dtype=np.bool_)
        self._goal = np.full((num_lanes, 3), -1.0)

    def reset(self, lanes: Ints, seeds: Ints) -> None:
        """Nothing has been seen."""
        self.seen[lanes] = False
        self._goal[lanes] = -1.0

    def act(self, observation: Floats | None, belief: Belief) -> Floats:
        """Drive to where the most is to be learnt; see `Policy.act`."""
        _explore(
            belief.pose, belief.pose_cov, belief.landmark_mapped, belief.landmark_mean, belief.landmark_cov, self.seen,
            self._cell, self._corner, self._sensor, self._settings, self._gains, self._limits, self._goal, self.command,
        )  # fmt: skip
        return self.to_action(self.command)
