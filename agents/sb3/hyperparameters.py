"""Hyperparameters in RL-Zoo's YAML format, read without running what is written there.

RL-Zoo evaluates `policy_kwargs: dict(net_arch=[64, 64], activation_fn=nn.Tanh)` as Python; here such a text is parsed,
and only dict(...), literals and names of activations are understood. `lin_3e-4` is a number that falls to zero.
"""

import ast
import inspect
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from estimators.registry import unknown_name

FOLDER = Path(__file__).parent / "hyperparams"
ENVIRONMENT = "SlamTarget-v0"
OURS = ("n_envs", "n_timesteps", "normalize", "policy")  # RL-Zoo's keys that are not the algorithm's
TEXTS = ("policy_kwargs", "normalize")  # where RL-Zoo writes Python
SCHEDULED = ("learning_rate", "clip_range", "clip_range_vf")
NOT_WRITTEN = ("policy", "env", "seed", "_init_setup_model")  # arguments of an algorithm that the training gives itself
COUNTS = ("n_steps", "batch_size", "n_epochs", "buffer_size")
RANGES = {
    "gamma": (0.0, 1.0), "gae_lambda": (0.0, 1.0), "tau": (0.0, 1.0), "learning_rate": (0.0, math.inf),
    "clip_range": (0.0, math.inf), "clip_range_vf": (0.0, math.inf), "target_kl": (0.0, math.inf),
    "max_grad_norm": (0.0, math.inf), "vf_coef": (0.0, math.inf), "ent_coef": (-math.inf, math.inf),
}  # fmt: skip
LINEAR = "lin_"
ACTIVATIONS = {"tanh": "Tanh", "relu": "ReLU"}


@dataclass(frozen=True)
class Hyperparameters:
    """What a training is told.

    Attributes:
        values: everything as written, of JSON types.
        n_envs, n_timesteps: lanes, and decisions altogether.
        normalise: arguments of VecNormalize; None: not used.
    """

    values: dict[str, Any]

    @property
    def n_envs(self) -> int:
        """Lanes."""
        return _count("n_envs", self.values.get("n_envs", 1))

    @property
    def n_timesteps(self) -> int:
        """Decisions of all lanes together."""
        return _count("n_timesteps", self.values["n_timesteps"])

    @property
    def normalise(self) -> dict[str, Any] | None:
        """Arguments of VecNormalize, with the algorithm's discount; None: not used."""
        chosen = self.values.get("normalize", False)
        if not chosen:
            return None
        gamma = {"gamma": self.values["gamma"]} if "gamma" in self.values else {}
        return gamma | (dict(chosen) if isinstance(chosen, Mapping) else {})

    def arguments(self, algorithm: type[Any]) -> dict[str, Any]:
        """What the algorithm's constructor is given beside policy and environment.

        Raises:
            ValueError: an argument that the algorithm does not have, or a number out of its range.
        """
        known = [name for name in inspect.signature(algorithm).parameters if name not in NOT_WRITTEN]
        arguments = {}
        for name, value in self.values.items():
            if name in OURS:
                continue
            if name not in known:
                raise ValueError(f"{algorithm.__name__}: {unknown_name('hyperparameter', name, [*known, *OURS])}")
            arguments[name] = _argument(name, value)
        if "policy_kwargs" in arguments:
            arguments["policy_kwargs"] = _with_activation(arguments["policy_kwargs"])
        return arguments


def read(file: Path, scenario: str, changes: Mapping[str, Any]) -> Hyperparameters:
    """From a YAML file: the environment's section, the scenario's over it, and the changes over both.

    Raises:
        ValueError: no such section, or a text that is not understood.
        OSError: no such file.
    """
    import yaml

    try:
        sections = yaml.safe_load(Path(file).read_text(encoding="utf-8"))
    except yaml.YAMLError as error:
        raise ValueError(f"{str(file)!r} is no YAML: {error}") from error
    if not isinstance(sections, Mapping) or not isinstance(sections.get(ENVIRONMENT), Mapping):
        raise ValueError(f"{str(file)!r} needs a section {ENVIRONMENT!r} with hyperparameters")
    values = {**sections[ENVIRONMENT], **(sections.get(scenario) or {}), **changes}
    for name in TEXTS:
        if isinstance(values.get(name), str):
            values[name] = parse(values[name])
    if values.get("policy", "MlpPolicy") != "MlpPolicy":
        raise ValueError(f"policy must be 'MlpPolicy'; got {values['policy']!r}")
    if "n_timesteps" not in values:
        raise ValueError(f"n_timesteps is missing in {str(file)!r}: give --steps")
    return Hyperparameters(values)


def parse(text: str) -> Any:
    """The value of a text such as "dict(net_arch=[64], activation_fn=nn.Tanh)"; activations become their names.

    Raises:
        ValueError: anything but dict(...), literals and activations.
    """
    try:
        return _value(ast.parse(text.strip(), mode="eval").body)
    except (SyntaxError, ValueError) as error:
        raise ValueError(
            f"only dict(...), numbers, texts, lists and nn.Tanh or nn.ReLU are read; got {text!r}"
        ) from error


def _value(node: ast.expr) -> Any:
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "dict" and not node.args:
        return {str(word.arg): _value(word.value) for word in node.keywords}
    if isinstance(node, ast.Dict) and all(key is not None for key in node.keys):
        return {ast.literal_eval(key): _value(value) for key, value in zip(node.keys, node.values, strict=True) if key}
    if isinstance(node, ast.List | ast.Tuple):
        return [_value(item) for item in node.elts]
    if isinstance(node, ast.Attribute) and node.attr.lower() in ACTIVATIONS:
        return node.attr.lower()
    return ast.literal_eval(node)


def _with_activation(kwargs: Mapping[str, Any]) -> dict[str, Any]:
    """policy_kwargs with torch's class in place of the activation's name."""
    import torch

    chosen = dict(kwargs)
    name = chosen.get("activation_fn")
    if name is not None:
        if name not in ACTIVATIONS:
            raise ValueError(unknown_name("activation_fn", str(name), list(ACTIVATIONS)))
        chosen["activation_fn"] = getattr(torch.nn, ACTIVATIONS[name])
    return chosen


def _argument(name: str, value: Any) -> Any:
    """A value as the algorithm wants it; numbers are checked, which the algorithms themselves do not do."""
    if value is None or (name == "ent_coef" and str(value).startswith("auto")):
        return value
    if name in COUNTS:
        return _count(name, value)
    if name in SCHEDULED and isinstance(value, str):
        return _schedule(name, value)
    return _number(name, value) if name in RANGES else value


def _number(name: str, value: Any) -> Any:
    least, most = RANGES[name]
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not least <= value <= most:
        raise ValueError(f"{name} must be a number{_limits(least, most)}; got {value!r}")
    return value


def _limits(least: float, most: float) -> str:
    if least == -math.inf:
        return ""
    return f" of at least {least:g}" if most == math.inf else f" from {least:g} to {most:g}"


def _schedule(name: str, text: str) -> Any:
    """A number, or a function of the share of the training that is left (1 to 0)."""
    try:
        start = float(text.removeprefix(LINEAR))
    except ValueError:
        raise ValueError(f"{name}: expected a number or {LINEAR}NUMBER, such as {LINEAR}3e-4; got {text!r}") from None
    _number(name, start)
    return (lambda left: left * start) if text.startswith(LINEAR) else start


def _count(name: str, value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not float(value).is_integer() or value < 1:
        raise ValueError(f"{name} must be a whole number of at least 1; got {value!r}")
    return int(value)
