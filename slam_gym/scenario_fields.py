"""How a scenario's numbers and words are declared, checked and looked up by name."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import Field, field, fields
from typing import Any

from estimators.registry import unknown_name

Number = float | tuple[float, float]
"""A number, or a range (low, high) from which one is drawn anew each episode."""


def number(
    default: Number, low: float = -math.inf, high: float = math.inf, *, above: float | None = None, whole: bool = False
) -> Any:
    """A number of the world: within [low, high], more than `above`, perhaps whole; may be a range.

    It must be finite, unless its default is infinite.
    """
    rule = {"kind": "number", "low": low, "high": high, "above": above, "whole": whole, "ranged": True}
    rule["infinite"] = default == math.inf
    return field(default=default, metadata=rule)


def constant(default: float, low: float = -math.inf, *, above: float | None = None, whole: bool = False) -> Any:
    """A number that the structure of an episode depends on, so never a range."""
    rule = {"kind": "number", "low": low, "high": math.inf, "above": above, "whole": whole, "ranged": False}
    rule["infinite"] = False
    return field(default=default, metadata=rule)


def choice(default: str, options: tuple[str, ...]) -> Any:
    """One of a few words."""
    return field(default=default, metadata={"kind": "choice", "options": options})


def low_high(value: Number) -> tuple[float, float]:
    """Both ends of a number or range."""
    return (value[0], value[1]) if isinstance(value, tuple) else (value, value)


def middle(value: Number) -> float:
    """A number, or the middle of its range."""
    low, high = low_high(value)
    return 0.5 * (low + high)


def known_keys(section: type) -> list[str]:
    """The keys a section has."""
    return [f.name for f in fields(section)]


def check_keys(section: type, given: Iterable[str], where: str) -> None:
    """Every given key belongs to the section.

    Raises:
        ValueError: one does not; the message has its dotted name, the nearest key and the choices.
    """
    known = known_keys(section)
    for key in given:
        if key not in known:
            raise ValueError(unknown_name("scenario key", f"{where}{key}", [f"{where}{name}" for name in known]))


def check_section(section: Any, where: str) -> None:
    """Check and normalise every declared field of a frozen dataclass in place.

    Raises:
        ValueError: a value of the wrong type or outside its limits.
    """
    for declared in fields(section):
        kind = declared.metadata.get("kind")
        value = getattr(section, declared.name)
        name = f"{where}{declared.name}"
        if kind == "number":
            object.__setattr__(section, declared.name, _checked_number(name, value, declared.metadata))
        elif kind == "choice" and value not in declared.metadata["options"]:
            raise ValueError(unknown_name(f"value of {name}", str(value), list(declared.metadata["options"])))
        elif declared.type in (bool, "bool") and not isinstance(value, bool):
            raise ValueError(f"{name} must be true or false; got {value!r}")
        elif declared.type in (str, "str") and not isinstance(value, str):
            raise ValueError(f"{name} must be text; got {value!r}")


def _checked_number(name: str, value: Any, rule: Mapping[str, Any]) -> Number:
    if isinstance(value, (list, tuple)):
        if not rule["ranged"]:
            raise ValueError(f"{name} must be one number, not a range; got {value!r}")
        if len(value) != 2:
            raise ValueError(f"{name} must be a number or a range [low, high]; got {value!r}")
        low, high = (_one(name, item, rule) for item in value)
        if low > high:
            raise ValueError(f"{name}: the range's low end must come first; got {value!r}")
        return low, high
    return _one(name, value, rule)


def _one(name: str, value: Any, rule: Mapping[str, Any]) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or math.isnan(value):
        raise ValueError(f"{name} must be a number{' or a range [low, high]' if rule['ranged'] else ''}; got {value!r}")
    if math.isinf(value) and not rule["infinite"]:
        raise ValueError(f"{name} must be finite; got {value!r}")
    if rule["above"] is not None and not value > rule["above"]:
        raise ValueError(f"{name} must be more than {rule['above']:g}; got {value!r}")
    if not rule["low"] <= value <= rule["high"]:
        limits = f"{rule['low']:g} to {rule['high']:g}"
        if math.isinf(rule["high"]):
            limits = f"at least {rule['low']:g}"
        elif math.isinf(rule["low"]):
            limits = f"at most {rule['high']:g}"
        raise ValueError(f"{name} must be {limits}; got {value!r}")
    if rule["whole"]:
        if value != math.floor(value):
            raise ValueError(f"{name} must be a whole number; got {value!r}")
        return int(value)
    return float(value)


def is_number(declared: Field[Any]) -> bool:
    """Whether a declared field is a number of the world that may be drawn anew each episode."""
    return bool(declared.metadata.get("ranged", False))
