"""A robot that stands still."""

from estimators.interface import Belief
from slam_gym.policies import Floats, Ints, Policy


class Stationary(Policy):
    """Stands still: speed and turn rate zero.

    The baseline of baselines: the target comes and goes, the map is what can be seen from the start.
    """

    summary = "stands still"

    def reset(self, lanes: Ints, seeds: Ints) -> None:
        """Nothing to forget."""

    def act(self, observation: Floats | None, belief: Belief) -> Floats:
        """The command zero in every lane; see `Policy.act`."""
        return self.to_action(self.command)
