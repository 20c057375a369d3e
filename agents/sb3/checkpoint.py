"""The whole state of a training between two rollouts, so that it goes on as if it had never stopped.

Weights, optimisers, normalisation, every lane's world and filter, the replay buffer and all random generators: a
training that was interrupted and resumed ends with the same weights, bit for bit.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

COUNTERS = ("num_timesteps", "_n_updates", "_episode_num")
LAST = ("_last_obs", "_last_original_obs", "_last_episode_starts")
REPLAY = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")
WRAPPERS: dict[type[Any], tuple[str, ...]] = {
    VecNormalize: ("obs_rms", "ret_rms", "returns", "old_obs", "old_reward"),
    VecMonitor: ("episode_returns", "episode_lengths", "episode_count"),
}
MOMENTS = ("mean", "var", "count")


def capture(model: "BaseAlgorithm") -> dict[str, Any]:
    """State of a model and of everything it trains on."""
    _, variables = model._get_torch_save_params()
    return {
        "parameters": model.get_parameters(),
        "variables": {name: getattr(model, name).detach() for name in variables},
        "counters": {name: getattr(model, name) for name in COUNTERS if hasattr(model, name)},
        "last": {name: getattr(model, name) for name in LAST if getattr(model, name, None) is not None},
        "wrappers": {cls.__name__: _wrapper(model, cls) for cls in WRAPPERS},
        "environment": _environment(model).get_state(),
        "replay": _replay(model),
        "random": {
            "torch": torch.get_rng_state(),
            "numpy": np.random.get_state(),  # noqa: NPY002  (Stable-Baselines3 draws from it)
            "actions": model.action_space.np_random.bit_generator.state,
        },
    }


def restore(model: "BaseAlgorithm", state: Mapping[str, Any]) -> None:
    """Put back what `capture` returned, into a model made with the same arguments."""
    model.set_parameters(state["parameters"], exact_match=True, device="cpu")
    with torch.no_grad():
        for name, value in state["variables"].items():
            getattr(model, name).copy_(value)
    for name, value in {**state["counters"], **state["last"]}.items():
        setattr(model, name, value)
    for cls in WRAPPERS:
        _restore_wrapper(model, cls, state["wrappers"][cls.__name__])
    _environment(model).set_state(state["environment"])
    _restore_replay(model, state["replay"])
    torch.set_rng_state(state["random"]["torch"])
    np.random.set_state(state["random"]["numpy"])  # noqa: NPY002
    model.action_space.np_random.bit_generator.state = state["random"]["actions"]


def _environment(model: "BaseAlgorithm") -> Any:
    venv: Any = model.get_env()
    return venv.unwrapped.envs.unwrapped


def _find(model: "BaseAlgorithm", cls: type[Any]) -> Any:
    venv: Any = model.get_env()
    while venv is not None and not isinstance(venv, cls):
        venv = getattr(venv, "venv", None)
    return venv


def _wrapper(model: "BaseAlgorithm", cls: type[Any]) -> dict[str, Any] | None:
    wrapper = _find(model, cls)
    if wrapper is None:
        return None
    state = {name: getattr(wrapper, name) for name in WRAPPERS[cls] if hasattr(wrapper, name)}
    for name in ("obs_rms", "ret_rms"):
        if name in state:
            state[name] = {moment: getattr(state[name], moment) for moment in MOMENTS}
    return state


def _restore_wrapper(model: "BaseAlgorithm", cls: type[Any], state: Mapping[str, Any] | None) -> None:
    wrapper = _find(model, cls)
    for name, value in (state or {}).items():
        if name in ("obs_rms", "ret_rms"):
            for moment in MOMENTS:
                setattr(getattr(wrapper, name), moment, value[moment])
        else:
            setattr(wrapper, name, value)


def _replay(model: "BaseAlgorithm") -> dict[str, Any] | None:
    buffer: Any = getattr(model, "replay_buffer", None)
    if buffer is None:
        return None
    used = buffer.buffer_size if buffer.full else buffer.pos
    return {"pos": buffer.pos, "full": buffer.full} | {name: getattr(buffer, name)[:used] for name in REPLAY}


def _restore_replay(model: "BaseAlgorithm", state: Mapping[str, Any] | None) -> None:
    if state is None:
        return
    buffer: Any = model.replay_buffer  # type: ignore[attr-defined]
    buffer.pos, buffer.full = state["pos"], state["full"]
    for name in REPLAY:
        getattr(buffer, name)[: len(state[name])] = state[name]
