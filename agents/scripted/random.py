"""Random actions, each held for a while."""

import math

import numpy as np

from estimators.interface import Belief
from estimators.kernels.jit import jit
from estimators.kernels.random import lane_key, uniform4
from slam_gym.policies import Floats, Ints, Policy, PolicyContext

STREAM = 0x504F4C  # separates a policy's draws from everything else that is seeded with the same number


@jit
def _draw(keys, decisions, hold, actions):
    """A uniform action in [-1, 1]^2 for each lane, redrawn every `hold` decisions. actions: [L, 2]."""
    for lane in range(actions.shape[0]):
        forward, turn, _, _ = uniform4(keys[lane], 0, decisions[lane] // hold, 0, 0)
        actions[lane, 0] = 2.0 * forward - 1.0
        actions[lane, 1] = 2.0 * turn - 1.0
        decisions[lane] += 1


class Random(Policy):
    """Draws an action uniformly and keeps it for a second: the floor that any policy has to beat.

    Without the holding time the draws average out within a few steps and the robot only trembles on the spot. The
    draws of a lane depend on its seed alone, not on the number of lanes.

    Args:
        context: models and limits.
        num_lanes: L.
        hold_time: [s] that an action lasts; 0: a new one at each decision, as `action_space.sample()` does.

    Raises:
        ValueError: a negative holding time.
    """

    summary = "uniform random actions, each held for a second"

    def __init__(self, context: PolicyContext, num_lanes: int = 1, *, hold_time: float = 1.0) -> None:
        super().__init__(context, num_lanes)
        if not 0.0 <= hold_time < math.inf:
            raise ValueError(f"random: hold_time must be zero or more seconds; got {hold_time!r}")
        self._hold = max(1, round(hold_time / context.dt))
        self._keys = np.zeros(num_lanes, dtype=np.uint64)
        self._decisions = np.zeros(num_lanes, dtype=np.int64)

    def reset(self, lanes: Ints, seeds: Ints) -> None:
        """Start the lanes' own random streams anew."""
        for lane, seed in zip(lanes, seeds, strict=True):
            self._keys[lane] = lane_key(int(seed), STREAM)
        self._decisions[lanes] = 0

    def act(self, observation: Floats | None, belief: Belief) -> Floats:
        """The held or a newly drawn action; see `Policy.act`."""
        actions = np.empty((self.num_lanes, 2))
        _draw(self._keys, self._decisions, self._hold, actions)
        return actions
