"""Scenarios as files and dictionaries: TOML presets and paths, dotted keys, CSV maps."""

import csv
import math
import tomllib
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators import registry
from estimators.registry import unknown_name
from slam_gym.scenario_fields import check_keys

__all__ = ["check_keys", "landmark_rows", "plain", "preset_names", "put", "read", "read_columns"]

_PRESETS = files("slam_gym.scenarios")


def preset_names() -> list[str]:
    """Names of the presets in this package, `default` first, the rest by name."""
    found = sorted(item.name.removesuffix(".toml") for item in _PRESETS.iterdir() if item.name.endswith(".toml"))
    return sorted(found, key=lambda name: (name != "default", name))


def read(source: str | Path | Mapping[str, Any]) -> dict[str, Any]:
    """A scenario's dictionary from a preset's name, a TOML file or a dictionary.

    Raises:
        ValueError: no preset of that name, or not a TOML file.
        FileNotFoundError: a path (ends in .toml, or has a separator) that does not exist.
    """
    if isinstance(source, Mapping):
        return _copied(source)
    text = str(source)
    if text in preset_names():
        return tomllib.loads(_PRESETS.joinpath(f"{text}.toml").read_text(encoding="utf-8"))
    if not (isinstance(source, Path) or text.endswith(".toml") or "/" in text or "\\" in text):
        hint = ", or the path of a .toml file"
        if text.partition(":")[0] in registry.names():
            hint += f". {text!r} is an estimator: --estimators {text} at the command line"
        raise ValueError(unknown_name("scenario", text, preset_names()) + hint)
    path = Path(source)
    if not path.is_file():
        raise FileNotFoundError(f"no scenario file {text!r}")
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{text!r} is not a TOML file: {error}") from error
    data.setdefault("name", path.stem)
    return data


def _copied(data: Mapping[str, Any]) -> dict[str, Any]:
    return {key: _copied(value) if isinstance(value, Mapping) else value for key, value in data.items()}


def put(data: dict[str, Any], key: str, value: Any, top: type, sections: Mapping[str, type]) -> None:
    """Set a dotted key such as "sensor.max_range" or "policy.options.stand_off" in nested dictionaries.

    Raises:
        ValueError: no such key.
    """
    head, _, rest = key.partition(".")
    if not rest:
        check_keys(top, [head], "")
        data[head] = value
        return
    if head not in sections:
        raise ValueError(unknown_name("scenario section", head, list(sections)))
    name, _, inner = rest.partition(".")
    check_keys(sections[head], [name], f"{head}.")
    table = data.setdefault(head, {})
    if inner:
        table[name] = {**table.get(name, {}), inner: value}
    else:
        table[name] = value


def plain(value: Any) -> Any:
    """The same with JSON types only: tuples become lists."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return value


def find_file(name: str) -> Path:
    """A user's file, or one of this package's own.

    Raises:
        FileNotFoundError: neither exists.
    """
    path = Path(name).expanduser()
    if path.is_file():
        return path
    own = Path(str(_PRESETS.joinpath(name)))
    if own.is_file():
        return own
    raise FileNotFoundError(f"no file {name!r}, neither there nor among the scenarios' own")


def read_columns(name: str, columns: tuple[str, ...]) -> NDArray[np.float64]:
    """Named columns [n, len(columns)] of a CSV file with a header.

    Raises:
        FileNotFoundError: no such file.
        ValueError: a column is missing, or a value is not a finite number.
    """
    path = find_file(name)
    return _columns(path, columns, path.stat().st_mtime_ns).copy()


@cache
def _columns(path: Path, columns: tuple[str, ...], _stamp: int) -> NDArray[np.float64]:
    with path.open(newline="", encoding="utf-8-sig") as file:
        reader = csv.DictReader(line for line in file if not line.startswith("#"))
        missing = [column for column in columns if column not in (reader.fieldnames or [])]
        if missing:
            raise ValueError(
                f"{str(path)!r} must have the columns {', '.join(columns)}; it has {', '.join(reader.fieldnames or [])}"
            )
        try:
            rows = [[float(row[column]) for column in columns] for row in reader]
        except (TypeError, ValueError) as error:
            raise ValueError(f"{str(path)!r}: {error}") from error
    if not rows or not all(math.isfinite(value) for row in rows for value in row):
        raise ValueError(f"{str(path)!r} must hold at least one row of finite numbers")
    return np.array(rows)


def landmark_rows(name: str) -> int:
    """How many landmarks a CSV map holds."""
    return len(read_columns(name, ("x_m", "y_m")))
