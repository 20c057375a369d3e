"""Pursuit that turns back to well-known landmarks when it no longer knows where it is."""

import math

import numpy as np

from agents.scripted.driving import drive_to, largest_variance, set_command
from agents.scripted.pursuit import Pursuit
from estimators.interface import Belief
from estimators.kernels.angles import wrap
from estimators.kernels.jit import inline, jit
from slam_gym.policies import Bools, Ints, PolicyContext

NOWHERE = -1  # instead of a landmark's slot


@inline
def _best_landmark(pose, mapped, landmarks, landmark_cov, speed, settle):
    """Slot of the landmark that promises the most: variance it leaves the pose with + variance gained on the way."""
    best, least = NOWHERE, math.inf
    for j in range(mapped.size):
        if not mapped[j]:
            continue
        variance = largest_variance(landmark_cov[j, 0, 0], landmark_cov[j, 0, 1], landmark_cov[j, 1, 1])
        seconds = math.hypot(landmarks[j, 0] - pose[0], landmarks[j, 1] - pose[1]) / speed
        cost = variance + settle * seconds
        if cost < least:
            best, least = j, cost
    return best


@jit
def _return(pose, pose_cov, mapped, landmarks, landmark_cov, settings, gains, limits, returning, command):
    """Where the pose has become uncertain: drive to a well-known landmark until it is certain again.

    pose [L, 3], pose_cov [L, 3, 3], mapped [L, M], landmarks [L, M, 2], landmark_cov [L, M, 2, 2]: the belief;
    settings: (return_std, resume_std [m], distance kept [m], settle [m^2/s]); gains, limits: see `driving`;
    returning [L]; command [L, 2]: overwritten where the robot returns.
    """
    return_std, resume_std, distance_kept, settle = settings
    for lane in range(returning.size):
        cov = pose_cov[lane]
        std = math.sqrt(max(largest_variance(cov[0, 0], cov[0, 1], cov[1, 1]), 0.0))
        returning[lane] = std > (resume_std if returning[lane] else return_std)
        if not returning[lane]:
            continue
        j = _best_landmark(pose[lane], mapped[lane], landmarks[lane], landmark_cov[lane], limits[1], settle)
        if j == NOWHERE:
            returning[lane] = False
            continue
        cov = landmark_cov[lane, j]
        if math.sqrt(max(largest_variance(cov[0, 0], cov[0, 1], cov[1, 1]), 0.0)) > resume_std:
            returning[lane] = False  # no landmark of the map could make the pose as certain as is asked for
            continue
        east, north = landmarks[lane, j, 0] - pose[lane, 0], landmarks[lane, j, 1] - pose[lane, 1]
        distance = math.hypot(east, north)
        bearing = wrap(math.atan2(north, east) - pose[lane, 2])
        ahead, left = distance * math.cos(bearing), distance * math.sin(bearing)
        speed, turn = drive_to(ahead, left, distance, distance_kept, gains, 0.0, 0.0)
        set_command(command, lane, max(speed, 0.0), turn, limits)


class PursuitRevisit(Pursuit):
    """`pursuit` that goes back to a well-known landmark when its own position has become uncertain.

    When the largest standard deviation of the believed position exceeds `return_std`, the robot turns to the landmark j
    with the least

        (largest variance of landmark j) + settle (seconds to drive there),

    and drives until it is `distance_kept` away, looking at it, or until a look on the way has brought the deviation
    below `resume_std`; then it pursues again. Where no mapped landmark is known better than `resume_std`, returning
    would help nothing, and it pursues.

    When to use it: few landmarks and poor odometry (scenario revisit), as the simple rule beside `receding-horizon`.
    Weakness: it gives up the target while it returns, whether or not the target's estimate needs a better pose:
    in `default` and `revisit` it knows its own position better than `pursuit`, and loses the target more often.

    Args:
        context: models and limits.
        num_lanes: L.
        return_std: [m] deviation of the own position at which it turns back.
        resume_std: [m] at which it pursues again; default: half of `return_std`.
        distance_kept: [m] from the landmark.
        settle: [m^2/s] price of the way.
        stand_off: [m] distance to keep from the target.
        speed_gain: [1/s], speed per metre of distance error.
        turn_gain: [1/s], turn rate per radian of bearing.
        lead: share of the target's believed velocity that is anticipated.
        lost_std: [m] uncertainty at which the target counts as lost.
        look_rate: [rad/s] of looking around; default: 0.6 times the robot's highest, at most 1.

    Raises:
        ValueError: a negative or non-finite number, or a resume_std that is not below return_std.
    """

    name = "pursuit-revisit"
    summary = "pursuit; returns to well-known landmarks when its own position grows uncertain"

    def __init__(
        self,
        context: PolicyContext,
        num_lanes: int = 1,
        *,
        return_std: float = 0.3,
        resume_std: float | None = None,
        distance_kept: float = 2.0,
        settle: float = 0.01,
        stand_off: float = 1.5,
        speed_gain: float = 1.5,
        turn_gain: float = 3.0,
        lead: float = 1.0,
        lost_std: float = 1.0,
        look_rate: float | None = None,
    ) -> None:
        super().__init__(
            context, num_lanes, stand_off=stand_off, speed_gain=speed_gain, turn_gain=turn_gain, lead=lead,
            lost_std=lost_std, look_rate=look_rate,
        )  # fmt: skip
        resume = 0.5 * return_std if resume_std is None else resume_std
        self._check(return_std=return_std, resume_std=resume, distance_kept=distance_kept, settle=settle)
        if not resume < return_std:
            raise ValueError(
                f"pursuit-revisit: resume_std must be below return_std ({return_std}), or it would turn back and "
                f"forth; got {resume}"
            )
        self._return_settings = (float(return_std), float(resume), float(distance_kept), float(settle))
        self._returning: Bools = np.zeros(num_lanes, dtype=np.bool_)

    def reset(self, lanes: Ints, seeds: Ints) -> None:
        """Forget where the target was."""
        super().reset(lanes, seeds)
        self._returning[lanes] = False

    def _seek(self, belief: Belief) -> None:
        super()._seek(belief)
        _return(
            belief.pose, belief.pose_cov, belief.landmark_mapped, belief.landmark_mean, belief.landmark_cov,
            self._return_settings, self._gains, self._limits, self._returning, self.command,
        )  # fmt: skip
