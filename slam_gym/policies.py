"""The contract every policy meets, what a policy is told, and policies by name.

A policy decides from the observation or the belief, never from the truth. It acts for L lanes at once. A package adds
one through the entry-point group "slam_gym.policies"; a script through `register`.
"""

import math
import os
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from estimators.interface import Belief
from estimators.models import MotionModel, SensorModel, TargetModel
from estimators.registry import build, load_plugin, parameters_of, unknown_name
from slam_gym.actions import ActionMap
from slam_gym.scenario import Scenario
from slam_gym.scenario_fields import middle
from slam_gym.specs import Spec

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

ENTRY_POINT_GROUP = "slam_gym.policies"
TRAINED = "learned"  # the policy that drives as a folder says


@dataclass(frozen=True, kw_only=True)
class PolicyContext:
    """What a policy knows before it starts: models and limits, all of which a real robot's engineer knows too.

    Where the scenario draws a number anew each episode, the middle of its range stands here.
    """

    action_map: ActionMap  # between actions in [-1, 1] and physical commands
    motion: MotionModel
    sensor: SensorModel
    target: TargetModel | None
    step_dt: float  # [s], one simulation step
    hold: int = 1  # simulation steps that one action lasts
    sensor_period: int = 1  # simulation steps between sweeps
    speed_min: float = -math.inf  # [m/s], negative where the robot can reverse
    speed_max: float = math.inf  # [m/s]
    turn_max: float = math.inf  # [rad/s], unicycle
    steering_max: float = math.pi / 6  # [rad], bicycle
    steering_rate: float = math.inf  # [rad/s], bicycle
    arena: tuple[float, float] = (20.0, 20.0)  # [m], width and height about the origin
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [m, m, rad], expected start pose
    scenario: str = ""  # its name, by which a trained policy knows what it was trained for

    @property
    def dt(self) -> float:
        """[s] between two decisions."""
        return self.step_dt * self.hold

    @property
    def is_bicycle(self) -> bool:
        """Whether commands are (speed, steering angle) rather than (speed, turn rate)."""
        return self.motion.kind == "bicycle"

    @classmethod
    def from_scenario(cls, scenario: Scenario, action: str | None = None) -> Self:
        """The context of a scenario under one kind of action ("twist", "wheels" or "steering"; None: its usual one)."""
        robot = scenario.robot
        motion, sensor, target = scenario.models()
        kind = action or ("steering" if motion.kind == "bicycle" else "twist")
        return cls(
            action_map=ActionMap(scenario, kind),
            motion=motion,
            sensor=sensor,
            target=target,
            step_dt=scenario.dt,
            hold=scenario.hold,
            sensor_period=scenario.sensor_period,
            speed_min=middle(robot.speed_min),
            speed_max=middle(robot.speed_max),
            turn_max=middle(robot.turn_max),
            steering_max=middle(robot.steering_max),
            steering_rate=middle(robot.steering_rate),
            arena=scenario.arena.size,
            start=(middle(robot.start[0]), middle(robot.start[1]), middle(robot.start[2])),
            scenario=scenario.name,
        )


class Policy(ABC):
    """Decides for L lanes at once.

    Args:
        context: models and limits.
        num_lanes: L.
        **options: the policy's own, keyword-only, each with a default, documented by each class.

    Attributes:
        finished: [L] set by `act` where nothing is left to do (a route is at its end): that action need not be
            carried out any more, and the episode may end.
        observation_options: of the observation, where one is needed: arguments of `slam_gym.observation.Observer`
            beside scenario and lanes ("nearest", "sectors").
        weights: a digest of what was learned; a comparison is not resumed with others. Empty where nothing was.
        target_cloud_options: of the target cloud, where one is needed: arguments of `estimators.TargetCloud`.
    """

    summary: ClassVar[str] = ""  # one line for `slam-gym list`
    needs_observation: ClassVar[bool] = False  # whether `act` must be given the observation; else it may get None
    needs_target_cloud: int = 0  # points of `belief.target_cloud` that `act` reads; 0: it reads none

    def __init__(self, context: PolicyContext, num_lanes: int = 1) -> None:
        if num_lanes < 1:
            raise ValueError(f"num_lanes must be at least 1; got {num_lanes}")
        self.context, self.num_lanes = context, int(num_lanes)
        self.command: Floats = np.zeros((self.num_lanes, 2))  # [L, 2], physical, scratch of `act`
        self.finished: Bools = np.zeros(self.num_lanes, dtype=np.bool_)
        self.observation_options: dict[str, int] = {}
        self.weights = ""
        self.target_cloud_options: dict[str, Any] = {}

    @abstractmethod
    def reset(self, lanes: Ints, seeds: Ints) -> None:
        """A new episode in the named lanes. lanes, seeds: [n]; the seeds are the policy's own randomness."""

    @abstractmethod
    def act(self, observation: Floats | None, belief: Belief) -> Floats:
        """One decision per lane.

        Args:
            observation: [L, n] what a learned policy sees; None where `needs_observation` is False.
            belief: of all lanes, valid until the estimator's next call.

        Returns:
            [L, 2] in [-1, 1], float64.
        """

    def to_action(self, command: Floats) -> Floats:
        """Physical commands [L, 2] (speed and turn rate, or speed and steering angle) as actions in [-1, 1]."""
        return np.maximum(np.minimum(self.context.action_map.to_action(command), 1.0), -1.0)  # np.clip is slower


class TruthAwarePolicy(ABC):
    """Mixin of reference policies that are handed the truth before every decision: a yardstick, nothing one could use.

    Comparisons and single runs call `set_truth` and mark the name; environments and training never do.
    """

    @abstractmethod
    def set_truth(self, pose: Floats, target: Floats) -> None:
        """Pass pose [L, 3] and target [L, 4] (x, y, velocity_x, velocity_y) of the world."""


_registered: dict[str, type[Policy]] = {}


def names() -> list[str]:
    """Every known policy's name: those of installed packages, then those registered here."""
    installed = (point.name for point in entry_points(group=ENTRY_POINT_GROUP))
    return list(dict.fromkeys([*sorted(installed), *_registered]))


def register(name: str, policy: type[Policy] | None = None) -> Any:
    """Make a class known under a name, directly or as a decorator: `@register("mine")`.

    Raises:
        ValueError: the name is taken by another class.
    """

    def add(cls: type[Policy]) -> type[Policy]:
        taken = _registered.get(name)
        installed = name in names() and taken is None
        if installed or (taken is not None and taken.__qualname__ != cls.__qualname__):
            raise ValueError(f"a policy named {name!r} exists already; choose another name")
        _registered[name] = cls
        return cls

    return add if policy is None else add(policy)


def registered(names: Iterable[str]) -> dict[str, type[Policy]]:
    """Those of the names that `register` has made known in this process: other processes have to be told."""
    return {name: _registered[name] for name in names if name in _registered}


def get(name: str) -> type[Policy]:
    """The class of that name.

    Raises:
        ValueError: no such policy; the message lists the choices and the nearest name.
    """
    if name in _registered:
        return _registered[name]
    for point in entry_points(group=ENTRY_POINT_GROUP):
        if point.name == name:
            return load_plugin("policy", point)
    folder = f". Nor is there a folder {name!r} here, in which a training could have left its policy"
    raise ValueError(unknown_name("policy", name, names(), folder))


def parse(text: Any) -> Spec:
    """A policy as people write it: a name with options as `Spec.parse` reads it, or the folder of a trained policy.

    A name goes before a folder that is called the same; ./NAME is the folder.
    """
    spec = Spec.parse(text)
    if not isinstance(text, str) or spec.name in names() or not (os.sep in text or Path(text).exists()):
        return spec
    return Spec(text.rstrip(os.sep), TRAINED, {"path": text})


def is_reference(label: str) -> bool:
    """Whether a policy's label names one that is told the truth."""
    try:
        return issubclass(get(label.partition(":")[0]), TruthAwarePolicy)
    except (ValueError, ImportError, AttributeError):  # results of a plug-in that is not installed here
        return False


def options(name: str) -> dict[str, Any]:
    """The options of a policy and their defaults."""
    return {key: parameter.default for key, parameter in parameters_of(get(name))[0].items()}


def make(name: str, context: PolicyContext, num_lanes: int = 1, **chosen: Any) -> Policy:
    """Build a policy by name.

    Raises:
        ValueError: unknown name, an option that this policy does not have, an impossible value, or a policy that is
            told where the target is in a scenario without one.
    """
    policy = get(name)
    if context.target is None and issubclass(policy, TruthAwarePolicy):
        raise ValueError(
            f"policy {name!r} is told where the target is, and this scenario has none; choose another policy"
        )
    return build("policy", name, policy, chosen, context, num_lanes)
