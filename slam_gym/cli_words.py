"""What people type, respelled as a command names it: one rule instead of a list of exceptions to remember.

`run` takes a scenario as its first word, `compare` several after --scenarios, `train` one after --scenario. All three
understand --scenario and --scenarios, and so it is with every option.
"""

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from itertools import takewhile
from typing import Any, get_args, get_origin

import tyro


def respelled(command: type, words: Sequence[str]) -> list[str]:
    """The words with singular for plural or the reverse where only that is an option, and places named as options.

    Raises:
        ValueError: words without an option, where the command has no place for any; the message says what to write.
    """
    own = _fields(command)
    kinds = [kind for field in own.values() for kind in map(_plain, get_args(_plain(field)))]
    kinds = [kind for kind in kinds if dataclasses.is_dataclass(kind)]  # `replay mrclam`: each with its own options
    fields = {name: field for kind in kinds for name, field in _fields(kind).items() if not _is_place(field)} | own
    places = [name for name, field in own.items() if _is_place(field)]
    found = _respell_options(words, fields, places)
    bare = list(takewhile(lambda word: not word.startswith("-"), found))
    if bare and not places and not kinds:
        raise ValueError(_by_option(bare, fields))
    return found


def _respell_options(words: Sequence[str], fields: dict[str, Any], places: Sequence[str]) -> list[str]:
    first: list[str] = []  # what belongs in a place goes before all options, none of which can then swallow it
    found: list[str] = []
    rest = list(words)
    while rest:
        word = rest.pop(0)
        option, equals, value = word.partition("=")
        name = _known(option, fields)
        if name is None:
            found.append(word)
        elif name not in places:
            found.append(f"--{name.replace('_', '-')}{equals}{value}")
        elif equals:
            first.append(value)
        else:
            many = get_origin(_plain(fields[name])) is tuple
            values = list(takewhile(lambda v: not v.startswith("-"), rest if many else rest[:1]))
            first += values
            del rest[: len(values)]
    return first + found


def _known(option: str, fields: Iterable[str]) -> str | None:
    """The field that an option names, literally or in the other number; None: none does."""
    if not option.startswith("--"):
        return None
    name = option[2:].replace("-", "_")
    other = name[:-3] + "y" if name.endswith("ies") else name.removesuffix("s")
    several = name[:-1] + "ies" if name.endswith("y") else name + "s"
    return next((spelling for spelling in (name, other, several) if spelling in fields), None)


def _is_place(kind: Any) -> bool:
    return tyro.conf.Positional in getattr(kind, "__metadata__", ())


def _plain(kind: Any) -> Any:
    """A type without its annotations."""
    return kind.__origin__ if hasattr(kind, "__metadata__") else kind


def _fields(command: Any) -> dict[str, Any]:
    return {field.name: field.type for field in dataclasses.fields(command)}


def _by_option(bare: Sequence[str], fields: dict[str, Any]) -> str:
    """What to write instead of bare words."""
    options: dict[str, list[str]] = {}
    for word in bare:
        if (option := _option_for(word, fields)) is not None:
            options.setdefault(option, []).append(word)
    said = f"names go behind an option; got {' '.join(bare)!r}"
    if not options:
        return f"{said}. --help lists the options"
    instead = " ".join(" ".join([option, *names]) for option, names in options.items())
    return f"{said}. Did you mean {instead!r}?"


def _option_for(word: str, fields: dict[str, Any]) -> str | None:
    """The option that takes such a name, where it is the name of something."""
    from estimators import registry
    from slam_gym import policies
    from slam_gym.scenario import scenario_names

    kinds: dict[str, Callable[[], Iterable[str]]] = {
        "scenario": scenario_names, "estimator": registry.names, "policy": policies.names
    }  # fmt: skip
    for kind, names in kinds.items():
        if word.partition(":")[0] in names() and (name := _known(f"--{kind}", fields)) is not None:
            return f"--{name}"
    return None
