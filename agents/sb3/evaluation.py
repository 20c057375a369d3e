"""How a policy in training does on worlds of its own, always the same ones."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slam_gym.envs.slam_target_vector import SlamTargetVectorEnv
from slam_gym.reward import ERROR_CAP

Act = Callable[[NDArray[np.float32]], NDArray[Any]]


def evaluate(act: Act, envs: SlamTargetVectorEnv, seeds: list[int]) -> dict[str, float]:
    """One episode in every lane.

    Args:
        act: observations [L, n] -> actions [L, 2].
        envs: with autoreset in the next step.
        seeds: of the worlds, one per lane.

    Returns:
        Means over the lanes: "return"; over lanes and steps: "robot_error" [m], and where there is a target
        "target_error" [m] (at most 8, and 8 while it is not known) and "lost" (share of steps); and "success", the
        share of lanes that ended well.
    """
    observations, _ = envs.reset(seed=seeds)
    going = np.ones(envs.num_envs, dtype=np.bool_)
    returns, success = np.zeros(envs.num_envs), np.zeros(envs.num_envs)
    steps, sums = 0, {"robot_error": 0.0, "target_error": 0.0, "lost": 0.0}
    while going.any():
        observations, rewards, terminated, truncated, infos = envs.step(act(observations))
        returns[going] += rewards[going]
        steps += int(going.sum())
        sums["robot_error"] += float(infos["robot_error"][going].sum())
        sums["target_error"] += float(np.fmin(infos["target_error"], ERROR_CAP)[going].sum())
        sums["lost"] += float(infos["target_lost"][going].sum())
        over = going & (terminated | truncated)
        success[over] = infos["is_success"][over]
        going &= ~over
    means = {name: total / steps for name, total in sums.items()}
    if not envs.scenario.has_target:
        del means["target_error"], means["lost"]
    return {"return": float(returns.mean()), **means, "success": float(success.mean())}
