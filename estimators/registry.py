"""Estimators by name: ours, and those that installed packages declare.

A package adds one through the entry-point group "slam_gym.estimators"; a script through `register`.
"""

import difflib
import inspect
import numbers
from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any

import numpy as np

from estimators.interface import Estimator
from estimators.models import MotionModel, SensorModel, TargetModel

ENTRY_POINT_GROUP = "slam_gym.estimators"
OWN_ESTIMATOR = (
    f". One of your own is known where its module was imported, and everywhere once a package declares it (entry "
    f'points "{ENTRY_POINT_GROUP}")'
)
_GIVEN = ("motion", "sensor", "target", "context", "num_lanes", "max_landmarks")  # what is not a person's choice
_KINDS = {bool: "true or false", int: "a whole number", float: "a number"}

_BUILT_IN = {
    "dead-reckoning": "estimators.dead_reckoning:DeadReckoning",
    "ekf": "estimators.gaussian.ekf:EKF",
    "compressed-ekf": "estimators.gaussian.compressed:CompressedEKF",
    "ideal-ekf": "estimators.gaussian.ideal:IdealEKF",
    "fej-ekf": "estimators.gaussian.fej:FEJEKF",
    "oc-ekf": "estimators.gaussian.observability:OCEKF",
    "robocentric-ekf": "estimators.gaussian.robocentric:RobocentricEKF",
    "ri-ekf": "estimators.gaussian.invariant:RIEKF",
    "recorded-ri-ekf": "estimators.gaussian.recorded:RecordedRIEKF",
    "cdkf": "estimators.gaussian.sigma_point:CDKF",
    "ukf": "estimators.gaussian.unscented:UKF",
    "ri-cdkf": "estimators.gaussian.invariant_points:RICDKF",
    "taylor-ekf": "estimators.gaussian.taylor:TaylorEKF",
    "ri-taylor-ekf": "estimators.gaussian.invariant_points:RITaylorEKF",
    "slamto": "estimators.particle.slamto:SLAMTO",
    "fastslam1": "estimators.particle.fastslam:FastSLAM1",
    "fastslam2": "estimators.particle.fastslam:FastSLAM2",
    "rbpf": "estimators.particle.improved_proposal:RBPF",
    "unscented-fastslam": "estimators.particle.unscented_fastslam:UnscentedFastSLAM",
    "seif": "estimators.information.seif:SEIF",
    "isam2": "estimators.smoothing.isam2:ISAM2",
    "independent": "estimators.independent:Independent",
}
_registered: dict[str, type[Estimator]] = {}


def names() -> list[str]:
    """Every known estimator's name, ours first."""
    found = dict.fromkeys([*_BUILT_IN, *_registered])
    found.update(dict.fromkeys(sorted(point.name for point in entry_points(group=ENTRY_POINT_GROUP))))
    return list(found)


def register(name: str, estimator: type[Estimator] | None = None) -> Any:
    """Make a class known under a name, directly or as a decorator: `@register("mine")`.

    Raises:
        ValueError: the name is taken by another class.
    """

    def add(cls: type[Estimator]) -> type[Estimator]:
        taken = _registered.get(name)
        if name in _BUILT_IN or (taken is not None and taken.__qualname__ != cls.__qualname__):
            raise ValueError(f"an estimator named {name!r} exists already; choose another name")
        _registered[name] = cls
        return cls

    return add if estimator is None else add(estimator)


def registered(names: Iterable[str]) -> dict[str, type[Estimator]]:
    """Those of the names that `register` has made known in this process: other processes have to be told."""
    return {name: _registered[name] for name in names if name in _registered}


def get(name: str) -> type[Estimator]:
    """The class of that name.

    Raises:
        ValueError: no such estimator; the message lists the choices and the nearest name.
    """
    if name in _registered:
        return _registered[name]
    if name in _BUILT_IN:
        module, _, attribute = _BUILT_IN[name].partition(":")
        return getattr(import_module(module), attribute)
    for point in entry_points(group=ENTRY_POINT_GROUP):
        if point.name == name:
            return load_plugin("estimator", point)
    raise ValueError(unknown_name("estimator", name, names(), OWN_ESTIMATOR))


def load_plugin(kind: str, point: EntryPoint) -> Any:
    """The class that an entry point names.

    Raises:
        ImportError: its module cannot be imported, or holds no such class; the message names the plug-in.
    """
    try:
        return point.load()
    except (ImportError, AttributeError) as error:
        raise ImportError(f"{kind} {point.name!r} cannot be loaded from {point.value!r}: {error}") from error


def make(
    name: str,
    motion: MotionModel,
    sensor: SensorModel,
    target: TargetModel | None,
    *,
    num_lanes: int = 1,
    max_landmarks: int,
    **options: Any,
) -> Estimator:
    """Build an estimator by name.

    Raises:
        ValueError: unknown name, an option that this estimator does not have, or an impossible value.
    """
    return build("estimator", name, get(name), options, motion, sensor, target, num_lanes=num_lanes,
                 max_landmarks=max_landmarks)  # fmt: skip


def build(
    kind: str, name: str, factory: Callable[..., Any], options: Mapping[str, Any], *given: Any, **also: Any
) -> Any:
    """Call `factory` with the options that a person has typed, and say what is wrong with them.

    Raises:
        ValueError: an option that is not there (the message lists the choices), or a word where a number belongs.
    """
    known, open_ended = parameters_of(factory)
    for key, value in options.items():
        if key in known:
            _check_value(f"{kind} {name!r}: {key}", value, known[key])
        elif not open_ended:
            raise ValueError(_unknown_option(kind, name, key, list(known)))
    try:
        return factory(*given, **also, **options)
    except TypeError as error:
        unknown = [key for key in options if key not in known and f"unexpected keyword argument {key!r}" in str(error)]
        if unknown:
            raise ValueError(_unknown_option(kind, name, unknown[0], list(known))) from error
        texts = [f"{key}={value!r}" for key, value in options.items() if isinstance(value, str)]
        if texts:  # typed at a command line: text that no number could be read from
            wrong = f"{kind} {name!r} cannot be made with {', '.join(texts)} ({error})"
            raise ValueError(f"{wrong}; see `slam-gym list {name}` for its options") from error
        raise


def parameters_of(factory: Callable[..., Any]) -> tuple[dict[str, inspect.Parameter], bool]:
    """The options that a class takes, with those of its bases where it hands on what it does not know.

    And whether it takes any others (`**options`): only calling it tells which.
    """
    found: dict[str, inspect.Parameter] = {}
    open_ended = False
    for base in inspect.getmro(factory) if inspect.isclass(factory) else (factory,):
        parameters = inspect.signature(base).parameters
        for name, parameter in parameters.items():
            if parameter.kind in (parameter.KEYWORD_ONLY, parameter.POSITIONAL_OR_KEYWORD) and name not in _GIVEN:
                found.setdefault(name, parameter)
        if not any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters.values()):
            break
        open_ended = True
    return found, open_ended


def _unknown_option(kind: str, name: str, key: str, known: list[str]) -> str:
    if not known:
        return f"{kind} {name!r} has no options; got {key!r}"
    return f"{kind} {name!r}: {unknown_name('option', key, known)}"


def _check_value(what: str, value: Any, parameter: inspect.Parameter) -> None:
    """Refuse a word where a number belongs; choices of words or of several types are checked by their owners."""
    default, declared = parameter.default, parameter.annotation
    wanted = type(default)
    if wanted not in _KINDS or declared not in (wanted, wanted.__name__, parameter.empty):
        return
    fits = isinstance(value, bool | np.bool) if wanted is bool else _is_number(value, whole=wanted is int)
    if not fits:
        raise ValueError(f"{what} must be {_KINDS[wanted]}, such as {default}; got {value!r}")


def _is_number(value: Any, whole: bool) -> bool:
    if isinstance(value, bool | np.bool) or not isinstance(value, numbers.Real):
        return False
    return not whole or float(value).is_integer()


def unknown_name(kind: str, name: str, choices: list[str], otherwise: str = "") -> str:
    """The message for a name that is not there: the nearest match, then the choices.

    Args:
        kind: what it should name.
        name: what was given.
        choices: what there is.
        otherwise: what else it may have been, said where nothing is near.
    """
    listed = [part.strip() for part in name.split(",")]
    if len(listed) > 1 and all(part in choices for part in listed):
        return f"unknown {kind} {name!r}. Several names are written with spaces between them: {' '.join(listed)}"
    head, colon, options = name.partition(":")
    if colon and head in choices:
        return f"unknown {kind} {name!r}: the name is {head!r}; its options ({options}) are an argument of their own"
    near = difflib.get_close_matches(name, choices, n=1, cutoff=0.5)
    hint = f" Did you mean {near[0]!r}?" if near else ""
    return f"unknown {kind} {name!r}.{hint} Choices: {', '.join(choices)}{'' if near else otherwise}"
