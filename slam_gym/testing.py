"""A checker for vector environments; Gymnasium has one for single environments only.

    from gymnasium.vector import AutoresetMode
    from slam_gym.testing import check_vector_env

    def make(num_envs, mode):
        return gym.make_vec("SlamTarget-v0", num_envs=num_envs, autoreset_mode=mode, scenario_options={"max_steps": 20})

    check_vector_env(make, lambda: gym.make("SlamTarget-v0", scenario_options={"max_steps": 20}))

It works for any vector environment whose single form exists and whose episodes can be made short.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space, concatenate, create_empty_array, iterate
from numpy.typing import NDArray

Make = Callable[[int, AutoresetMode], VectorEnv[Any, Any, Any]]
MakeSingle = Callable[[], gym.Env[Any, Any]]
Bools = NDArray[np.bool_]

OPENING = 2  # steps after a reset that are compared, too
ALL_MODES = (AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED)


def check_vector_env(
    make: Make,
    make_single: MakeSingle,
    *,
    num_envs: int = 3,
    steps: int = 50,
    seed: int = 123,
    modes: Sequence[AutoresetMode] = ALL_MODES,
) -> None:
    """Check a vector environment against its single form, bit for bit, through several episodes.

    Args:
        make: (number of lanes, autoreset mode) -> the vector environment.
        make_single: the environment that each lane must equal.
        num_envs: L, at least 2.
        steps: how long to run; at least one episode must end on the way.
        seed: of reset; lane i must equal the single environment reset with seed + i.
        modes: autoreset modes to check.

    Raises:
        AssertionError: what is wrong, in words.
        ValueError: fewer than two lanes.
    """
    if num_envs < 2:
        raise ValueError(f"check_vector_env needs at least 2 lanes to tell them apart; got num_envs={num_envs}")
    for mode in modes:
        _check_spaces(make, make_single, num_envs, mode)
        _check_lanes(make, make_single, num_envs, mode, steps, seed)
        _check_seeding(make, num_envs, mode, seed)
        _check_reset_mask(make, num_envs, mode, seed)
        if mode is AutoresetMode.DISABLED:
            _check_ended_lanes_refuse(make, num_envs, steps, seed)


# ------------------------------------------------------------------------------------------------------- the checks


def _check_spaces(make: Make, make_single: MakeSingle, num_envs: int, mode: AutoresetMode) -> None:
    envs, single = make(num_envs, mode), make_single()
    assert envs.num_envs == num_envs, f"num_envs is {envs.num_envs!r}, not the {num_envs} asked for"
    said = envs.metadata.get("autoreset_mode")
    assert said is mode, f"metadata['autoreset_mode'] must be {mode}; got {said!r}"
    for kind in ("observation", "action"):
        one, batch = getattr(envs, f"single_{kind}_space"), getattr(envs, f"{kind}_space")
        theirs = getattr(single, f"{kind}_space")
        assert one == theirs, f"single_{kind}_space differs from the single environment's: {one} and {theirs}"
        assert batch == batch_space(one, num_envs), f"{kind}_space is not {num_envs} times single_{kind}_space"
    envs.close()
    single.close()


def _check_lanes(
    make: Make, make_single: MakeSingle, num_envs: int, mode: AutoresetMode, steps: int, seed: int
) -> None:
    """Every lane equals its single environment, through ends of episodes as the mode has them."""
    envs, lanes = make(num_envs, mode), _SingleLanes([make_single() for _ in range(num_envs)], mode)
    envs.action_space.seed(seed)
    observations, infos = envs.reset(seed=seed)
    kept = [(observations, _copy(observations))]
    _check_returned(envs, observations, infos)
    lanes.reset(seed)
    _compare(envs, observations, None, infos, lanes, f"reset(seed={seed})")
    ends = 0
    for step in range(steps):
        actions = envs.action_space.sample()
        result = envs.step(actions)
        observations, rewards, terminations, truncations, infos = result
        _check_returned(envs, observations, infos, rewards, terminations, truncations)
        lanes.step(list(iterate(envs.action_space, actions)))
        _compare(envs, observations, result[1:4], infos, lanes, f"step {step} in mode {mode.name}")
        kept.append((observations, _copy(observations)))
        over = terminations | truncations
        ends += int(over.sum())
        if mode is AutoresetMode.DISABLED and over.any():
            observations, infos = envs.reset(options={"reset_mask": over})
            lanes.reset_ended()
            _compare(envs, observations, None, infos, lanes, f"reset_mask after step {step}", told=over)
    assert ends, f"no episode ended within {steps} steps: pass environments with shorter episodes, or more steps"
    for returned, copied in kept:
        assert _equal(returned, copied), "an observation changed after it was returned: return fresh arrays"
    envs.close()
    lanes.close()


def _check_seeding(make: Make, num_envs: int, mode: AutoresetMode, seed: int) -> None:
    envs = make(num_envs, mode)
    first, second = _opening(envs, seed), _opening(envs, None)
    assert _equal(first, _opening(envs, seed)), f"reset(seed={seed}) gives other observations the second time"
    assert _equal(second, _opening(envs, None)), "the reset after a seeded one gives other observations the second time"
    listed = _opening(envs, [seed + i for i in range(num_envs)])
    assert _equal(first, listed), f"a list of seeds [{seed}, {seed + 1}, ...] must give what reset(seed={seed}) gives"
    order = list(range(num_envs))[::-1]
    turned = _opening(envs, [seed + i for i in order])
    for ours, theirs in zip(turned, first, strict=True):
        for lane, other in enumerate(order):
            assert _equal(_lane(envs, ours, lane), _lane(envs, theirs, other)), (
                f"lane {lane} with the seed of lane {other} does not give that lane's observation"
            )
    envs.close()


def _opening(envs: Any, seed: Any) -> tuple[Any, ...]:
    """Observations of a reset and of the steps after it, the same action in each: the first alone may show nothing."""
    observations = [_copy(envs.reset(seed=seed)[0])]
    for _ in range(OPENING):
        actions = _batch_of(envs, _fixed_action(envs.single_action_space))
        observations.append(_copy(envs.step(actions)[0]))
    return tuple(observations)


def _fixed_action(space: gym.Space[Any]) -> Any:
    """An action that is the same at every call."""
    space.seed(0)
    return space.sample()


def _batch_of(envs: Any, action: Any) -> Any:
    """The same action in every lane."""
    space, count = envs.single_action_space, envs.num_envs
    return concatenate(space, [action] * count, create_empty_array(space, count))  # type: ignore[arg-type]


def _check_reset_mask(make: Make, num_envs: int, mode: AutoresetMode, seed: int) -> None:
    """Only the lanes of a mask are reset, and as if they had been reset alone."""
    envs = make(num_envs, mode)
    start = _copy(envs.reset(seed=seed)[0])
    envs.action_space.seed(seed)
    before = _copy(envs.step(envs.action_space.sample())[0])
    mask = np.arange(num_envs) % 2 == 0
    after, infos = envs.reset(seed=seed, options={"reset_mask": mask.copy()})
    _check_returned(envs, after, infos)
    for lane in range(num_envs):
        wanted, what = (start, "was not reset") if mask[lane] else (before, "was reset, or changed, all the same")
        assert _equal(_lane(envs, after, lane), _lane(envs, wanted, lane)), (
            f"options['reset_mask'] = {mask.tolist()}: lane {lane} {what}"
        )
    for key, value in _masks(infos):
        assert not (value & ~mask).any(), f"after reset_mask, infos[{key!r}] speaks of lanes that were not reset"
    envs.close()


def _check_ended_lanes_refuse(make: Make, num_envs: int, steps: int, seed: int) -> None:
    envs = make(num_envs, AutoresetMode.DISABLED)
    envs.reset(seed=seed)
    envs.action_space.seed(seed)
    for _ in range(steps):
        _, _, terminations, truncations, _ = envs.step(envs.action_space.sample())
        if (terminations | truncations).any():
            break
    try:
        envs.step(envs.action_space.sample())
    except Exception:
        return
    finally:
        envs.close()
    raise AssertionError("with autoreset disabled, a step of lanes that have ended must raise an error")


# ------------------------------------------------------------------------------------- what the lanes should be doing


class _SingleLanes:
    """Single environments in a row, with the autoreset that a vector environment should do."""

    def __init__(self, envs: list[gym.Env[Any, Any]], mode: AutoresetMode) -> None:
        self.envs, self.mode = envs, mode
        self.results: list[tuple[Any, float, bool, bool, dict[str, Any]]] = []
        self.finals: list[tuple[Any, dict[str, Any]] | None] = []

    def reset(self, seed: int) -> None:
        self.results = [_begun(env.reset(seed=seed + i)) for i, env in enumerate(self.envs)]
        self.finals = [None] * len(self.envs)

    def reset_ended(self) -> None:
        self.results = [_begun(env.reset()) if r[2] or r[3] else r for env, r in zip(self.envs, self.results,
                                                                                    strict=True)]  # fmt: skip

    def step(self, actions: list[Any]) -> None:
        self.finals = [None] * len(self.envs)
        for i, (env, action) in enumerate(zip(self.envs, actions, strict=True)):
            over = self.results[i][2] or self.results[i][3]
            if over and self.mode is AutoresetMode.NEXT_STEP:
                self.results[i] = _begun(env.reset())
                continue
            obs, reward, terminated, truncated, info = env.step(action)
            if (terminated or truncated) and self.mode is AutoresetMode.SAME_STEP:
                self.finals[i] = (obs, info)
                obs, info = env.reset()
                # The ends belong to the old episode; the lane itself has begun the next.
            self.results[i] = (obs, float(reward), terminated, truncated, info)

    def close(self) -> None:
        for env in self.envs:
            env.close()


def _begun(result: tuple[Any, dict[str, Any]]) -> tuple[Any, float, bool, bool, dict[str, Any]]:
    return result[0], 0.0, False, False, result[1]


def _compare(
    envs: Any, observations: Any, outcome: Any, infos: Mapping[str, Any], lanes: _SingleLanes, when: str,
    told: Bools | None = None,
) -> None:  # fmt: skip
    """One result against the single environments'; outcome: (rewards, terminations, truncations), None at a reset."""
    for i, (obs, *single_outcome, info) in enumerate(lanes.results):
        assert _equal(_lane(envs, observations, i), obs), f"{when}: lane {i} observes other than its single environment"
        if outcome is not None:
            for name, ours, theirs in zip(("reward", "terminated", "truncated"), outcome, single_outcome, strict=True):
                assert ours[i] == theirs, f"{when}: lane {i} has {name} {ours[i]}, its single environment {theirs}"
        if told is None or told[i]:
            _compare_info(infos, i, info, when)
        final = lanes.finals[i]
        has_final = "_final_obs" in infos and bool(infos["_final_obs"][i])
        assert has_final == (final is not None), (
            f"{when}: lane {i}: final_obs is there and should not be, or the reverse"
        )
        if final is not None:
            assert _equal(infos["final_obs"][i], final[0]), (
                f"{when}: final_obs of lane {i} is not the old episode's last"
            )
            assert "final_info" in infos, f"{when}: there is no final_info beside final_obs"
            _compare_info(infos["final_info"], i, final[1], f"{when}, final_info")


def _compare_info(infos: Mapping[str, Any], lane: int, info: Mapping[str, Any], when: str) -> None:
    for key, value in info.items():
        assert key in infos, f"{when}: infos lacks {key!r}, which the single environment gives"
        assert f"_{key}" in infos, f"{when}: infos has {key!r} without its mask '_{key}'"
        assert infos[f"_{key}"][lane], f"{when}: infos['_{key}'] says that lane {lane} has none, but it should"
        ours = infos[key]
        ours = {k: v[lane] for k, v in ours.items()} if isinstance(ours, dict) else ours[lane]
        assert _equal(ours, value), (
            f"{when}: infos[{key!r}] of lane {lane} is {ours}, in its single environment {value}"
        )
    for key, mask in _masks(infos):
        name = key[1:]
        if name not in info and name not in ("final_obs", "final_info"):
            assert not mask[lane], (
                f"{when}: infos has {name!r} for lane {lane}, which its single environment does not give"
            )


# ---------------------------------------------------------------------------------------------------- shapes and types


def _check_returned(envs: Any, observations: Any, infos: Any, *outcome: Any) -> None:
    """Types, shapes and spaces of what reset or step returned."""
    L = envs.num_envs
    assert observations in envs.observation_space, "the observations are not in observation_space"
    for lane in range(L):
        one = _lane(envs, observations, lane)
        assert one in envs.single_observation_space, (
            f"the observation of lane {lane} is not in single_observation_space"
        )
    for name, array, kind in zip(("rewards", "terminations", "truncations"), outcome, (np.float64, np.bool_, np.bool_),
                                 strict=False):  # fmt: skip
        right = isinstance(array, np.ndarray) and array.shape == (L,) and array.dtype == kind
        got = f"{array.dtype} {array.shape}" if isinstance(array, np.ndarray) else repr(array)
        assert right, f"{name} must be an array of {np.dtype(kind)} with shape ({L},); got {got}"
    assert isinstance(infos, dict), f"infos must be a dictionary; got {type(infos).__name__}"
    for key, mask in _masks(infos):
        assert mask.shape == (L,), f"the mask infos[{key!r}] must have shape ({L},); got {mask.shape}"
        assert key[1:] in infos, f"infos has the mask {key!r} without its key"


def _masks(infos: Mapping[str, Any]) -> list[tuple[str, Bools]]:
    found = [(key, value) for key, value in infos.items() if key.startswith("_")]
    for key, value in found:
        is_mask = isinstance(value, np.ndarray) and value.dtype == np.bool_
        assert is_mask, f"infos[{key!r}] must be a boolean mask; got {value!r}"
    return found


def _lane(envs: Any, observations: Any, lane: int) -> Any:
    for i, one in enumerate(iterate(envs.observation_space, observations)):
        if i == lane:
            return one
    raise AssertionError(f"the observations have no lane {lane}")


def _copy(data: Any) -> Any:
    if isinstance(data, Mapping):
        return {key: _copy(value) for key, value in data.items()}
    return tuple(map(_copy, data)) if isinstance(data, tuple) else np.array(data)


def _equal(a: Any, b: Any) -> bool:
    """Bit for bit, NaN equal to NaN."""
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        return a.keys() == b.keys() and all(_equal(a[key], b[key]) for key in a)
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(_equal, a, b))
    x, y = np.asarray(a), np.asarray(b)
    if x.shape != y.shape or (x.dtype.kind == "f") != (y.dtype.kind == "f"):
        return False
    return bool(np.array_equal(x, y, equal_nan=x.dtype.kind == "f"))
