"""Policy files: what was learned, as weights and JSON that cannot run code.

A policy is a folder with `weights.safetensors`, every tensor of the Stable-Baselines3 policy and the statistics of
VecNormalize, and `policy.json`: what the network looks like, what it was shown and how it was trained.
"""

import hashlib
import json
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from agents.sb3.network import Network, Normalisation
from agents.sb3.tensors import Tensors, read_tensors, refuse_pickle, to_bytes
from slam_gym.results import write_atomic

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm
    from stable_baselines3.common.vec_env import VecEnv, VecNormalize

SETTINGS, WEIGHTS = "policy.json", "weights.safetensors"
BEST, LATEST = "best", "latest"  # the policies in a training's folder
FORMAT = "slam-gym policy 1"
BODY = {"PPO": "mlp_extractor.policy_net.", "SAC": "actor.latent_pi."}  # where the actor's layers stand
HEAD = {"PPO": "action_net.", "SAC": "actor.mu."}
OUTPUT = {"PPO": "clip", "SAC": "tanh"}
STATISTICS = ("mean", "var", "count")


# ------------------------------------------------------------------------------------------------------------ writing


def export_policy(
    model: "BaseAlgorithm",
    folder: Path,
    *,
    action: str,
    decision_dt: float,
    nearest_landmarks: int = 8,
    sectors: int = 8,
    target_cloud: int = 0,
    target_cloud_options: Mapping[str, Any] | None = None,
    training: Mapping[str, Any] | None = None,
) -> str:
    """Write a trained model's policy.

    Args:
        model: PPO or SAC with an MlpPolicy on the flat observation; its VecNormalize, if any, goes along.
        folder: where to.
        action: kind of action, "twist", "wheels" or "steering".
        decision_dt: [s] that an action lasts.
        nearest_landmarks: K, landmarks in the observation.
        sectors: S, directions in the observation.
        target_cloud: points of the cloud in the observation; 0: none.
        target_cloud_options: of that cloud, of JSON types.
        training: whatever should be known of how it came about, of JSON types.

    Returns:
        The SHA-256 of the weights: equal for equal tensors.

    Raises:
        ValueError: a model of another kind.
    """
    algorithm = type(model).__name__
    if algorithm not in BODY:
        raise ValueError(f"a policy file holds {' or '.join(BODY)}; got {algorithm}")
    kwargs = _policy_kwargs(model)
    tensors = {f"policy.{k}": v.detach().cpu().numpy() for k, v in model.policy.state_dict().items()}
    normalise = model.get_vec_normalize_env()
    tensors.update(_statistics(normalise))
    content = to_bytes(tensors)
    digest = hashlib.sha256(content).hexdigest()
    settings = {
        "format": FORMAT,
        "algorithm": algorithm,
        "policy_kwargs": kwargs,
        "observation": {
            "size": int(np.prod(model.observation_space.shape or ())),
            "nearest_landmarks": nearest_landmarks,
            "sectors": sectors,
            "target_cloud": target_cloud,
            "target_cloud_options": dict(target_cloud_options or {}),
        },
        "action": action,
        "decision_dt": decision_dt,
        "normalisation": _normalise_settings(normalise),
        "sha256": digest,
        "training": dict(training or {}),
    }
    _network(settings, tensors)  # what cannot be read is not written
    write_atomic(folder / WEIGHTS, partial(_write, content=content))
    write_atomic(folder / SETTINGS, partial(_write, content=(json.dumps(settings, indent=2) + "\n").encode()))
    return digest


def _write(path: Path, content: bytes) -> None:
    path.write_bytes(content)


def _policy_kwargs(model: "BaseAlgorithm") -> dict[str, Any]:
    """The policy's arguments in JSON types: of classes only the activation, by its name."""
    kwargs = dict(model.policy_kwargs or {})
    activation: Any = model.policy.activation_fn
    kwargs["activation_fn"] = activation.__name__
    try:
        json.dumps(kwargs)
    except TypeError as error:
        raise ValueError(f"only plain MlpPolicies can be written; policy_kwargs are {kwargs}") from error
    return kwargs


def _statistics(normalise: "VecNormalize | None") -> Tensors:
    if normalise is None:
        return {}
    tensors: Tensors = {}
    for name, of in (("obs", getattr(normalise, "obs_rms", None)), ("ret", normalise.ret_rms)):
        if of is not None:
            tensors.update({f"normalise.{name}_{s}": np.asarray(getattr(of, s), dtype=np.float64) for s in STATISTICS})
    return tensors


def _normalise_settings(normalise: "VecNormalize | None") -> dict[str, Any] | None:
    names = ("norm_obs", "norm_reward", "clip_obs", "clip_reward", "gamma", "epsilon")
    return None if normalise is None else {name: getattr(normalise, name) for name in names}


# ------------------------------------------------------------------------------------------------------------ reading


def find_policy(path: Path) -> Path:
    """The folder with the policy: the one given, or the best (else the latest) of a training's.

    Raises:
        ValueError: a file of another kind; a pickle or a zip is refused.
        FileNotFoundError: nothing there.
    """
    if path.is_file():
        if path.name in (SETTINGS, WEIGHTS):
            return path.parent
        with path.open("rb") as file:
            refuse_pickle(path, file.read(2))
        raise ValueError(f"{str(path)!r} is no policy: give the folder with {SETTINGS} and {WEIGHTS}")
    for folder in (path, path / BEST, path / LATEST):
        if (folder / SETTINGS).is_file():
            return folder
    within = ", ".join(str(file.parent.parent) for file in sorted(path.glob(f"*/{BEST}/{SETTINGS}")))
    hint = f". Trainings within: {within}" if within else ""
    raise FileNotFoundError(f"no policy in {str(path)!r}: a policy is a folder with {SETTINGS} and {WEIGHTS}{hint}")


def read_settings(folder: Path) -> dict[str, Any]:
    """policy.json.

    Raises:
        ValueError: something else.
    """
    file = folder / SETTINGS
    try:
        settings = json.loads(file.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{str(file)!r} is no JSON: {error}") from error
    found = settings.get("format") if isinstance(settings, dict) else None
    if found != FORMAT:
        raise ValueError(f"{str(file)!r} is of format {found!r}; this version reads {FORMAT!r}")
    return settings


def load_policy(folder: Path) -> tuple[dict[str, Any], Network]:
    """Settings and the acting network; without torch.

    Raises:
        ValueError: files of another kind or damaged.
    """
    settings = read_settings(folder)
    tensors = read_tensors(folder / WEIGHTS)
    try:
        network = _network(settings, tensors)
    except (KeyError, IndexError, TypeError) as error:
        raise ValueError(f"the policy in {str(folder)!r} is damaged: {type(error).__name__} {error}") from error
    if hashlib.sha256((folder / WEIGHTS).read_bytes()).hexdigest() != settings["sha256"]:
        raise ValueError(f"{WEIGHTS} in {str(folder)!r} is not the file that {SETTINGS} describes: another SHA-256")
    return settings, network


def _network(settings: Mapping[str, Any], tensors: Tensors) -> Network:
    algorithm = settings["algorithm"]
    body = f"policy.{BODY[algorithm]}"
    indices = sorted(
        int(k.removeprefix(body).split(".")[0]) for k in tensors if k.startswith(body) and k.endswith("weight")
    )
    names = [f"{body}{i}." for i in indices] + [f"policy.{HEAD[algorithm]}"]
    layers = [(tensors[f"{name}weight"], tensors[f"{name}bias"]) for name in names]
    said, normalisation = settings["normalisation"], None
    if said is not None and said["norm_obs"]:
        mean, variance = tensors["normalise.obs_mean"], tensors["normalise.obs_var"]
        normalisation = Normalisation(mean, variance, said["clip_obs"], said["epsilon"])
    activation = settings["policy_kwargs"]["activation_fn"].lower()
    network = Network(layers, activation, OUTPUT[algorithm], normalisation)
    if network.size != settings["observation"]["size"]:
        raise ValueError(f"weights for {network.size} numbers, settings for {settings['observation']['size']}")
    return network


def load_sb3(path: Path, venv: "VecEnv", **changes: Any) -> "BaseAlgorithm":
    """The policy as a Stable-Baselines3 model, to go on training or to look inside.

    Args:
        path: as in `find_policy`.
        venv: environments to train on; wrapped in VecNormalize with the policy's statistics where it has any.
        **changes: arguments of the algorithm.
    """
    import stable_baselines3
    import torch
    from stable_baselines3.common.vec_env import VecNormalize

    folder = find_policy(path)
    settings, tensors = read_settings(folder), read_tensors(folder / WEIGHTS)
    kwargs = dict(settings["policy_kwargs"])
    kwargs["activation_fn"] = getattr(torch.nn, {"tanh": "Tanh", "relu": "ReLU"}[kwargs["activation_fn"].lower()])
    if settings["normalisation"] is not None:
        venv = VecNormalize(venv, **settings["normalisation"])
        restore_statistics(venv, tensors)
    algorithm = {"PPO": stable_baselines3.PPO, "SAC": stable_baselines3.SAC}[settings["algorithm"]]
    model = algorithm("MlpPolicy", venv, policy_kwargs=kwargs, **{"device": "cpu", **changes})
    state = {k.removeprefix("policy."): torch.from_numpy(v) for k, v in tensors.items() if k.startswith("policy.")}
    model.policy.load_state_dict(state)
    return model


def restore_statistics(normalise: "VecNormalize", tensors: Mapping[str, Any]) -> None:
    """Put the statistics of `export_policy` back."""
    for name, of in (("obs", getattr(normalise, "obs_rms", None)), ("ret", normalise.ret_rms)):
        if of is not None:
            of.mean = np.array(tensors[f"normalise.{name}_mean"])
            of.var = np.array(tensors[f"normalise.{name}_var"])
            of.count = float(tensors[f"normalise.{name}_count"])
