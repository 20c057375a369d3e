"""Look for a lost target where most of what is believed of it can be seen soonest."""

import math

import numpy as np

from agents.scripted.driving import drive_to_place, set_command
from agents.scripted.follower import Follower
from agents.scripted.viewpoints import AGE, BINS, HEADING, X, Y, choose_views
from estimators.interface import Belief
from estimators.kernels.angles import wrap
from estimators.kernels.jit import jit
from slam_gym.policies import Ints, PolicyContext


@jit
def _go_and_look(pose, lost, goal, gains, limits, command):
    """Where the target is lost: drive to the goal's place, then turn to its heading. goal: see `choose_views`."""
    for lane in range(command.shape[0]):
        if lost[lane] and drive_to_place(lane, pose, goal[lane, X], goal[lane, Y], gains, limits, command):
            set_command(command, lane, 0.0, gains[1] * wrap(goal[lane, HEADING] - pose[lane, 2]), limits)


class PursuitSearch(Follower):
    """Pursuit that looks for a lost target where a cloud of points says that it may be.

    While the target is known well enough it does what `pursuit` does. Where it is lost, every `replan` seconds the
    robot weighs places around it and in the cloud, with every heading there, by

        worth = (weight of the points that the sensor would report from there) exp(-discount t),

    t: seconds to turn, drive straight and turn, and goes for the best. A point is reported if it is in range, in the
    field of view and behind no pillar of the map. The cloud (`estimators.TargetCloud`, in `belief.target_cloud`) loses
    weight where the sensor has looked in vain: NEGATIVE INFORMATION, so that the robot looks elsewhere next.

    Args:
        context: models and limits.
        num_lanes: L.
        negative_information: False: sweeps without a return teach the cloud nothing, for comparison.
        discount: [1/s] by which a later view is worth less.
        replan: [s] between two choices of where to look.
        stand_off: [m] distance to keep.
        speed_gain: [1/s], speed per metre of distance error.
        turn_gain: [1/s], turn rate per radian of bearing.
        lead: share of the target's believed velocity that is anticipated.
        lost_std: [m] uncertainty at which the target counts as lost.

    Raises:
        ValueError: a negative or non-finite number.
    """

    name = "pursuit-search"
    summary = "pursuit; looks for a lost target where most of its cloud can be seen soonest"
    needs_target_cloud = 256

    def __init__(
        self,
        context: PolicyContext,
        num_lanes: int = 1,
        *,
        negative_information: bool = True,
        discount: float = 0.05,
        replan: float = 0.5,
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
        self._check(discount=discount, replan=replan)
        self.target_cloud_options = {"negative_information": bool(negative_information)}
        self._discount, self._keep = float(discount), float(round(replan / context.dt))
        sensor = context.sensor
        self._sensor = (float(sensor.max_range), 0.5 * float(sensor.field_of_view), float(sensor.landmark_radius))
        self._border = (0.5 * context.arena[0], 0.5 * context.arena[1])
        turn_max = context.speed_max / context.motion.wheelbase if context.is_bicycle else context.turn_max
        self._pace = (self._limits[0], min(self._limits[1], 1e6), min(float(turn_max), 1e6))
        self._goal = np.full((num_lanes, 4), -1.0)
        self._pillars, self._mass = np.zeros(0), np.zeros(BINS)

    def reset(self, lanes: Ints, seeds: Ints) -> None:
        """Forget where the target was."""
        super().reset(lanes, seeds)
        self._goal[lanes] = -1.0

    def _seek(self, belief: Belief) -> None:
        if self.context.target is None or not self._lost.any():
            self._goal[:, AGE] = -1.0
            self.command[self._lost] = 0.0
            return
        points, weights = belief.target_cloud
        mapped = belief.landmark_mapped
        if len(self._pillars) != 3 * mapped.shape[1]:
            self._pillars = np.zeros(3 * mapped.shape[1])
        choose_views(
            self._lost, belief.pose, points, weights, mapped, belief.landmark_mean, self._sensor, self._pace,
            self._border, self._discount, self._keep, math.exp(self._discount), self._pillars, self._mass, self._goal,
        )  # fmt: skip
        _go_and_look(belief.pose, self._lost, self._goal, self._gains, self._limits, self.command)
