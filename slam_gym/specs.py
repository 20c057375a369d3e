"""Names with options as people type them: `slamto:particles=500`, `sensor.max_range=5`."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from estimators import registry
from estimators.interface import TruthAware
from estimators.registry import unknown_name


@dataclass(frozen=True, slots=True)
class Spec:
    """An estimator or a policy with its options; `label` is what tables call it."""

    label: str
    name: str
    options: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def parse(cls, text: "str | Spec | tuple[str, Mapping[str, Any]]") -> "Spec":
        """From "name", "name:key=value,key=value", (name, options) or a `Spec`.

        Raises:
            ValueError: an option without a value.
        """
        if isinstance(text, Spec):
            return text
        if not isinstance(text, str):
            name, options = text
            return cls(label(name, options), name, dict(options))
        name, _, rest = text.partition(":")
        return cls(text, name, parse_settings(part for part in rest.split(",") if part))

    def to_dict(self) -> dict[str, Any]:
        """JSON types."""
        return {"label": self.label, "name": self.name, "options": self.options}


def label(name: str, options: Mapping[str, Any]) -> str:
    """How a name with options is written: "name:key=value,..."."""
    return f"{name}:{','.join(f'{key}={value}' for key, value in options.items())}" if options else name


def parse_settings(texts: Iterable[str]) -> dict[str, Any]:
    """`key=value` texts as a dict; values are JSON where they can be, else strings.

    Raises:
        ValueError: a text without "=".
    """
    settings: dict[str, Any] = {}
    for text in texts:
        key, sign, value = text.partition("=")
        if not sign or not key.strip():
            raise ValueError(f"a setting is written key=value, for example sensor.max_range=5; got {text!r}")
        settings[key.strip()] = parse_value(value.strip())
    return settings


def parse_sweep(texts: Iterable[str]) -> dict[str, list[Any]]:
    """`key=v1,v2,v3` texts as lists of values; a value may be a [low, high] range.

    Raises:
        ValueError: a text without "=" or without a value.
    """
    sweep: dict[str, list[Any]] = {}
    for text in texts:
        key, sign, values = text.partition("=")
        if not sign or not key.strip() or not values.strip():
            raise ValueError(f"a sweep is written key=v1,v2,v3, for example target.speed=0.6,0.9; got {text!r}")
        listed = parse_value(f"[{values}]")
        sweep[key.strip()] = listed if isinstance(listed, list) else [parse_value(v.strip()) for v in values.split(",")]
    return sweep


def parse_value(text: str) -> Any:
    """A number, true, false, null, a [list] or a {table} in JSON; anything else is a string."""
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        return text


def parse_options(text: str, chosen: Iterable[str] | None = None) -> dict[str, dict[str, Any]]:
    """A JSON object that gives options by name: {"slamto": {"particles": 500}}.

    Raises:
        ValueError: not such an object, or a name that is not among the chosen (None: the known ones).
    """
    try:
        options = json.loads(text)
    except json.JSONDecodeError as error:
        raise ValueError(
            f'options are a JSON object like {{"ekf": {{"gate": 16}}}}; {text!r} is not: {error}'
        ) from error
    if not isinstance(options, dict) or not all(isinstance(value, dict) for value in options.values()):
        raise ValueError(f'options are a JSON object of objects like {{"ekf": {{"gate": 16}}}}; got {text!r}')
    names = registry.names() if chosen is None else list(chosen)
    for name in options:
        if name not in names:
            raise ValueError(f"options for an estimator that is not there: {unknown_name('estimator', name, names)}")
    return options


def is_reference(text: str) -> bool:
    """Whether an estimator's label names a filter that is told the truth, a yardstick that nobody could use."""
    try:
        return issubclass(registry.get(text.partition(":")[0]), TruthAware)
    except (ValueError, ImportError, AttributeError):  # results of a plug-in that is not installed here
        return False
