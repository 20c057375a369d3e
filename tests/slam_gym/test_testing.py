"""The checker must notice what is wrong: each broken environment here fails it, in the right words."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import slam_gym  # noqa: F401  (registers the environment)
from slam_gym.envs.slam_target_vector import SlamTargetVectorEnv
from slam_gym.testing import check_vector_env

SHORT = {"max_steps": 8}


def single():
    return gym.make("SlamTarget-v0", scenario_options=SHORT)


def check(kind, mode=AutoresetMode.SAME_STEP, **kwargs):
    check_vector_env(
        lambda n, m: kind(num_envs=n, autoreset_mode=m, scenario_options=SHORT),
        single,
        steps=12,
        modes=[mode],
        **kwargs,
    )


class Mixed(SlamTargetVectorEnv):
    """Lanes in another order."""

    def step(self, actions):
        observations, *rest = super().step(actions)
        return (np.roll(observations, 1, axis=0), *rest)


class Reusing(SlamTargetVectorEnv):
    """One buffer for all observations."""

    def _pack(self, flat):
        if not hasattr(self, "buffer"):
            self.buffer = flat.copy()
        self.buffer[:] = flat
        return self.buffer


class Forgetful(SlamTargetVectorEnv):
    """No last observation of an episode that ended."""

    def step(self, actions):
        *rest, infos = super().step(actions)
        infos.pop("final_obs", None)
        infos.pop("_final_obs", None)
        return (*rest, infos)


class Stubborn(SlamTargetVectorEnv):
    """The same worlds whatever the seed."""

    def reset(self, *, seed=None, options=None):
        return super().reset(seed=123 if isinstance(seed, int) else [123] * self.num_envs, options=options)


class Coarse(SlamTargetVectorEnv):
    """Rewards of single precision."""

    def step(self, actions):
        observations, rewards, *rest = super().step(actions)
        return (observations, rewards.astype(np.float32), *rest)


class Unmasked(SlamTargetVectorEnv):
    """Info without its masks."""

    def _info(self, where=None):
        return {key: value for key, value in super()._info(where).items() if not key.startswith("_")}


class Eager(SlamTargetVectorEnv):
    """Resets every lane, whatever the mask says."""

    def reset(self, *, seed=None, options=None):
        return super().reset(seed=seed)


class Mute(SlamTargetVectorEnv):
    """Does not say how it resets."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.metadata = {"render_modes": []}


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (Mixed, "observes other than its single environment"),
        (Reusing, "changed after it was returned|final_obs"),
        (Forgetful, "final_obs"),
        (Stubborn, "list of seeds"),
        (Coarse, "rewards must be an array of float64"),
        (Unmasked, "without its mask"),
        (Eager, "was reset, or changed"),
        (Mute, "autoreset_mode"),
    ],
)
def test_what_is_broken_is_noticed(kind, message):
    with pytest.raises(AssertionError, match=message):
        check(kind)


def test_a_sound_environment_passes():
    check(SlamTargetVectorEnv)


def test_episodes_that_never_end_prove_nothing():
    with pytest.raises(AssertionError, match="no episode ended within 12 steps"):
        check_vector_env(
            lambda n, m: SlamTargetVectorEnv(num_envs=n, autoreset_mode=m),
            lambda: gym.make("SlamTarget-v0"),
            steps=12,
            modes=[AutoresetMode.SAME_STEP],
        )


def test_one_lane_cannot_be_checked():
    with pytest.raises(ValueError, match="at least 2 lanes"):
        check(SlamTargetVectorEnv, num_envs=1)
