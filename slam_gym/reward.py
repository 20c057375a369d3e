"""What a policy is paid for, term by term.

| term      | weight | value of one step                                                                               |
|-----------|--------|-------------------------------------------------------------------------------------------------|
| track     | 0.3    | -(2 e + e_rel) / 3 with the true errors of the target's estimate in the world's and in the      |
|           |        | robot's frame [m], each at most 8, and 8 while the target is not known                          |
| pursue    | 1      | 1 if the latest sweep holds a return of the target, minus 0.03 x its true distance [m]          |
| explore   | 0      | landmarks that entered the map                                                                  |
| localise  | 0      | minus the true error of the robot's position [m], at most 8                                     |
| effort    | 0      | minus half the squared length of the action, each number cut to [-1, 1]                         |
| collision | 0      | minus the collisions with pillars begun                                                         |

The reward is the sum of weight x value; every value stands in info under `reward_<term>`. With the default weights it
is seen - 0.2 e - 0.1 e_rel - 0.03 distance. It pays for errors, not for what the filter says about itself: a policy
can win the log-determinant of a covariance by making the filter overconfident.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from estimators.kernels.jit import inline
from estimators.registry import unknown_name

Floats = NDArray[np.float64]

TERMS = ("track", "pursue", "explore", "localise", "effort", "collision")
OF_THE_TARGET = ("track", "pursue")  # zero where there is none
DEFAULT_WEIGHTS = {"track": 0.3, "pursue": 1.0, "explore": 0.0, "localise": 0.0, "effort": 0.0, "collision": 0.0}
ERROR_CAP = 8.0  # [m]
DISTANCE_PRICE = 0.03  # [1/m]


def weights(chosen: Mapping[str, float] | None) -> Floats:
    """The weights [6] in the order of `TERMS`: the default ones, with those named changed.

    Raises:
        ValueError: an unknown term, or a weight that is no finite number.
    """
    found = dict(DEFAULT_WEIGHTS)
    for name, weight in (chosen or {}).items():
        if name not in found:
            raise ValueError(unknown_name("reward term", str(name), list(TERMS)))
        if isinstance(weight, bool) or not isinstance(weight, (int, float)) or not np.isfinite(weight):
            raise ValueError(f"the weight of reward term {name!r} must be a finite number; got {weight!r}")
        found[name] = float(weight)
    return np.array([found[name] for name in TERMS])


def default_reward(target_error: float, target_error_rel: float, seen: bool, distance: float) -> float:
    """What tracking and pursuit are worth at an instant with the default weights; errors and distance in metres."""
    values = terms(0.0, target_error, target_error_rel, True, seen, distance, 0.0, 0.0, 0.0, 0.0)
    return float(np.dot(weights(None), values))


@inline
def _capped(error):
    """An error of at most the cap; what is no number counts as the cap."""
    return error if error < ERROR_CAP else ERROR_CAP


@inline
def terms(robot_error, target_error, target_error_rel, has_target, seen, distance, mapped, collided, forward, turn):
    """The values of `TERMS` for one lane."""
    track, pursue = 0.0, 0.0
    if has_target:
        track = -(2.0 * _capped(target_error) + _capped(target_error_rel)) / 3.0
        pursue = (1.0 if seen else 0.0) - DISTANCE_PRICE * distance
    forward, turn = min(abs(forward), 1.0), min(abs(turn), 1.0)
    effort = -0.5 * (forward * forward + turn * turn)
    return track, pursue, float(mapped), -_capped(robot_error), effort, -float(collided)
