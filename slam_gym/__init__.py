"""What is true, and what is measured: the simulated world, the environment and the comparison of estimators.

>>> import gymnasium as gym
>>> import slam_gym
>>> env = gym.make("SlamTarget-v0")
"""

from pathlib import Path

import gymnasium as gym

import estimators

__version__ = "0.1.0"

if Path(estimators.__file__ or "").resolve().parent.parent != Path(__file__).resolve().parent.parent:
    raise ImportError(
        f"slam_gym needs its own package 'estimators', but Python found another one at {estimators.__file__}. "
        "Remove or rename that one, or put slam-gym's folder first on sys.path."
    )

gym.register(
    id="SlamTarget-v0",
    entry_point="slam_gym.envs.slam_target:SlamTargetEnv",
    vector_entry_point="slam_gym.envs.slam_target_vector:SlamTargetVectorEnv",
    order_enforce=False,  # the environment itself says that it needs a reset,
    disable_env_checker=True,  # and a test puts whole episodes through Gymnasium's checks
)
