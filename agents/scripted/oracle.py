"""Pursuit that is told where the target is: what following could reach if finding were no problem."""

from typing import cast

import numpy as np

from agents.scripted.pursuit import Pursuit
from estimators.interface import Belief
from slam_gym.policies import Floats, TruthAwarePolicy


class _Truth:
    """Robot and target as a belief without doubt, in the names of `estimators.interface.Belief`."""

    def __init__(self, num_lanes: int) -> None:
        self.pose = np.zeros((num_lanes, 3))
        self.target_known = np.zeros(num_lanes, dtype=np.bool_)
        self.target_position, self.target_rel = np.zeros((num_lanes, 2)), np.zeros((num_lanes, 2))
        self.target_rel_cov = np.zeros((num_lanes, 2, 2))
        self.target_rel_velocity = np.zeros((num_lanes, 2))

    def set(self, pose: Floats, target: Floats) -> None:
        """Pose [L, 3], target [L, 4]."""
        cosine, sine = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        self.pose[:], self.target_position[:] = pose, target[:, :2]
        for out, vector in ((self.target_rel, target[:, :2] - pose[:, :2]), (self.target_rel_velocity, target[:, 2:])):
            out[:, 0] = cosine * vector[:, 0] + sine * vector[:, 1]
            out[:, 1] = cosine * vector[:, 1] - sine * vector[:, 0]
        self.target_known[:] = True


class Oracle(Pursuit, TruthAwarePolicy):
    """`pursuit` of the TRUE target from the TRUE pose: a reference, marked as such wherever it is listed.

    It never loses the target and never searches, so that what separates it from `pursuit` is the price of not knowing:
    the gap of which `slam-gym compare` prints the closed part (see `slam_gym.gaps`). Not a bound: a policy that
    chooses what to look at (pillars to localise by, a line of sight that stays free) can beat it. The estimators are
    told nothing; they meet what this driver's path lets the sensor see.

    Only comparisons and single runs hand over the truth; elsewhere `act` raises a RuntimeError.

    Args:
        context: models and limits.
        num_lanes: L.
        stand_off: [m] distance to keep.
        speed_gain: [1/s], speed per metre of distance error.
        turn_gain: [1/s], turn rate per radian of bearing.
        lead: share of the target's velocity that is anticipated.
        lost_std: [m] without effect: nothing is uncertain.
        look_rate: [rad/s] likewise.
    """

    summary = "pursuit of the TRUE target: the reference of comparisons, nothing one could use"

    _truth: _Truth | None = None

    def set_truth(self, pose: Floats, target: Floats) -> None:
        """See `TruthAwarePolicy.set_truth`."""
        self._truth = self._truth or _Truth(self.num_lanes)
        self._truth.set(pose, target)

    def act(self, observation: Floats | None, belief: Belief) -> Floats:
        """Drive to the true target; see `Policy.act`."""
        if self._truth is None:
            raise RuntimeError(
                "the oracle was told no truth: it drives in `slam-gym compare` and `slam-gym run` only; a policy for "
                "environments and training reads the belief, such as 'pursuit'"
            )
        return super().act(observation, cast(Belief, self._truth))
