"""A scenario's numbers as one record per lane, drawn anew where they are ranges; what the world's kernels read."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.kernels.jit import jit
from estimators.kernels.random import uniform4
from slam_gym.scenario import Arena, Landmarks, Robot, Scenario, Sensor, Target
from slam_gym.scenario_fields import is_number, low_high

SECTIONS = {"arena": Arena, "robot": Robot, "target": Target, "landmarks": Landmarks, "sensor": Sensor}

# Purposes of the random draws: streams that never mix (last word of a draw's counter: the item).
DRAW_RANGES, DRAW_LAYOUT, DRAW_START, DRAW_ROBOT, DRAW_TARGET, DRAW_SENSOR, DRAW_DETECTION, DRAW_CLUTTER = range(8)

ROBOT_KINDS = ("unicycle", "bicycle")
NOISE_LAWS = ("step", "root-second")
NOISE_ON = ("motion", "odometry")
TARGET_KINDS = ("none", "twist", "constant-velocity", "waypoints", "evasive", "recorded")
NONE, TWIST, CONSTANT_VELOCITY, WAYPOINTS, EVASIVE, RECORDED = range(6)
PLACED = ("fixed", "in-view", "out-of-view", "anywhere")
FIXED, IN_VIEW, OUT_OF_VIEW, ANYWHERE = range(4)
LAYOUTS = ("uniform", "ring", "grid", "clustered", "file")
UNIFORM, RING, GRID, CLUSTERED, FILE = range(5)
COLLISIONS = ("none", "count", "block")
NO_COLLISION, COUNT, BLOCK = range(3)
RANGE_LAWS = ("sum", "quadrature")

NUMBERS = tuple(
    (f"{section}_{f.name}", section, f.name) for section, kind in SECTIONS.items() for f in fields(kind) if is_number(f)
)
WORDS = (
    ("robot_kind", "robot.kind", ROBOT_KINDS),
    ("robot_noise_law", "robot.noise_law", NOISE_LAWS),
    ("robot_noise_on", "robot.noise_on", NOISE_ON),
    ("target_kind", "target.kind", TARGET_KINDS),
    ("target_placed", "target.placed", PLACED),
    ("landmarks_layout", "landmarks.layout", LAYOUTS),
    ("landmarks_collision", "landmarks.collision", COLLISIONS),
    ("sensor_range_law", "sensor.range_law", RANGE_LAWS),
)
FLAGS = (
    ("arena_walls", "arena.walls"),
    ("landmarks_opaque", "landmarks.opaque"),
    ("landmarks_labelled", "landmarks.labelled"),
)

WORLD = np.dtype(
    [(name, np.float64) for name, _, _ in NUMBERS]
    + [("dt", np.float64)]
    + [(name, np.int64) for name, _, _ in WORDS]
    + [(name, np.int64) for name, _ in FLAGS]
    + [("sensor_period", np.int64)]
)
"""One lane's numbers, e.g. `numbers[lane].sensor_max_range`; words as codes, flags as 0 or 1."""


def _get(scenario: Scenario, dotted: str) -> Any:
    section, _, name = dotted.partition(".")
    return getattr(getattr(scenario, section), name)


def fixed_record(scenario: Scenario) -> NDArray[np.void]:
    """Everything that is not drawn, as a zero-dimensional `WORLD` record."""
    record = np.zeros((), dtype=WORLD)
    for name, section, field in NUMBERS:
        record[name] = low_high(_get(scenario, f"{section}.{field}"))[0]
    for name, dotted, choices in WORDS:
        record[name] = choices.index(_get(scenario, dotted))
    for name, dotted in FLAGS:
        record[name] = _get(scenario, dotted)
    record["dt"], record["sensor_period"] = scenario.dt, scenario.sensor_period
    return record


class Ranges:
    """Which numbers are drawn anew each episode, and between what.

    Attributes:
        index: [F] position in `NUMBERS`; the draw's item too, so that one range does not shift another's draw.
        low, high: [F]. whole: [F] whether the draw is a whole number.
    """

    def __init__(self, scenario: Scenario, options: Mapping[str, Any] | None = None) -> None:
        chosen = scenario
        for key, value in (options or {}).items():
            chosen = chosen.replace(key, value)
        rows = []
        for i, (_, section, field) in enumerate(NUMBERS):
            value = _get(chosen, f"{section}.{field}")
            changed = value != _get(scenario, f"{section}.{field}")
            if isinstance(value, tuple) or changed:
                low, high = low_high(value)
                declared = SECTIONS[section].__dataclass_fields__[field]  # type: ignore[attr-defined]
                rows.append((i, low, high, declared.metadata["whole"]))
        self.index = np.array([row[0] for row in rows], dtype=np.int64)
        self.low = np.array([row[1] for row in rows], dtype=np.float64)
        self.high = np.array([row[2] for row in rows], dtype=np.float64)
        self.whole = np.array([row[3] for row in rows], dtype=np.bool_)

    def draw(self, values: NDArray[np.float64], lanes: NDArray[np.int64], key: Any, episode: Any) -> None:
        """Fill the lanes' numbers. values: [L, W] the records seen as float64."""
        if len(self.index):
            _draw(values, lanes, key, episode, self.index, self.low, self.high, self.whole)


@jit
def _draw(values, lanes, key, episode, index, low, high, whole):
    """values[lane, index[i]] uniform in [low, high]; whole numbers include both ends."""
    for n in range(lanes.shape[0]):
        lane = lanes[n]
        for i in range(index.shape[0]):
            u = uniform4(key[lane], episode[lane], 0, DRAW_RANGES, index[i])[0]
            if whole[i]:
                values[lane, index[i]] = low[i] + np.floor(u * (high[i] - low[i] + 1.0))
            else:
                values[lane, index[i]] = low[i] + u * (high[i] - low[i])
