"""A scenario's numbers as one record per lane, drawn anew where they are ranges; what the world's kernels read."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.kernels.jit import jit
from estimators.kernels.random import uniform4
from estimators.models import MotionModel, SensorModel
from estimators.registry import unknown_name
from slam_gym.scenario import Arena, Landmarks, Robot, Scenario, Sensor, Target
from slam_gym.scenario_fields import is_number, low_high
from slam_gym.world_draws import DRAW_RANGES, FIRST

SECTIONS = {"arena": Arena, "robot": Robot, "target": Target, "landmarks": Landmarks, "sensor": Sensor}


ROBOT_KINDS = ("unicycle", "bicycle")
UNICYCLE, BICYCLE = range(2)
NOISE_LAWS = ("step", "root-second")
PER_STEP, ROOT_SECOND = range(2)
NOISE_ON = ("motion", "odometry")
ON_MOTION, ON_ODOMETRY = range(2)
START_NOISES = ("gaussian", "one-sigma")
GAUSSIAN, ONE_SIGMA = range(2)
TARGET_KINDS = ("none", "twist", "constant-velocity", "waypoints", "evasive", "recorded")
NONE, TWIST, CONSTANT_VELOCITY, WAYPOINTS, EVASIVE, RECORDED = range(6)
PLACED = ("fixed", "in-view", "out-of-view", "anywhere")
FIXED, IN_VIEW, OUT_OF_VIEW, ANYWHERE = range(4)
LAYOUTS = ("uniform", "ring", "grid", "clustered", "file")
UNIFORM, RING, GRID, CLUSTERED, FILE = range(5)
COLLISIONS = ("none", "count", "block")
NO_COLLISION, COUNT, BLOCK = range(3)
RANGE_LAWS = ("sum", "quadrature")
SUM, QUADRATURE = range(2)

NUMBERS = tuple(
    (f"{section}_{f.name}", section, f.name) for section, kind in SECTIONS.items() for f in fields(kind) if is_number(f)
)
_WHOLE = {
    f"{section}_{f.name}": f.metadata["whole"]
    for section, kind in SECTIONS.items()
    for f in fields(kind)
    if is_number(f)
}
_DOTTED = [f"{section}.{field}" for _, section, field in NUMBERS]
WORDS = (
    ("robot_kind", "robot.kind", ROBOT_KINDS),
    ("robot_noise_law", "robot.noise_law", NOISE_LAWS),
    ("robot_noise_on", "robot.noise_on", NOISE_ON),
    ("robot_start_noise", "robot.start_noise", START_NOISES),
    ("target_kind", "target.kind", TARGET_KINDS),
    ("target_placed", "target.placed", PLACED),
    ("landmarks_layout", "landmarks.layout", LAYOUTS),
    ("landmarks_collision", "landmarks.collision", COLLISIONS),
    ("sensor_range_law", "sensor.range_law", RANGE_LAWS),
)
FLAGS = (
    ("arena_walls", "arena.walls"),
    ("arena_holds_robot", "arena.holds_robot"),
    ("landmarks_opaque", "landmarks.opaque"),
    ("landmarks_labelled", "landmarks.labelled"),
)

# Where a wish about the target's place is not met, these two are drawn again: kernels need their limits.
DRAWN_AGAIN = ("target_start_distance", "target_start_bearing")

WORLD = np.dtype(
    [(name, np.float64) for name, _, _ in NUMBERS]
    + [("dt", np.float64)]
    + [(f"{name}_{end}", np.float64) for name in DRAWN_AGAIN for end in ("low", "high")]
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


_TARGET_NUMBERS = {
    "twist": ("speed", "turn_rate", "speed_std", "turn_std"),
    "constant-velocity": ("acceleration_density",),
}


def model_numbers(scenario: Scenario) -> list[tuple[str, str, str]]:
    """Those of `NUMBERS` that the filters' models are made of."""
    used = {
        "robot": {f.name for f in fields(MotionModel)},
        "sensor": {f.name for f in fields(SensorModel)},
        "target": set(_TARGET_NUMBERS.get(scenario.target.kind, ())),
        "landmarks": {"radius"},
    }
    return [row for row in NUMBERS if row[2] in used.get(row[1], ())]


class Ranges:
    """Which numbers are drawn anew each episode, and between what.

    Args:
        scenario: whose numbers.
        options: other numbers or ranges, by dotted key.

    Attributes:
        scenario: the one with the options.
        record: zero-dimensional `WORLD`, all that is not drawn.
        index: [F] position in `NUMBERS`; the draw's item too, so that one range does not shift another's draw.
        low, high: [F]. whole: [F] whether the draw is a whole number.

    Raises:
        ValueError: an option that is no number of the world, or an impossible value.
    """

    def __init__(self, scenario: Scenario, options: Mapping[str, Any] | None = None) -> None:
        for key in options or {}:
            if key not in _DOTTED:
                raise ValueError(unknown_name("reset option", str(key), _DOTTED))
        chosen = scenario.load(scenario, **options) if options else scenario
        self.scenario, self.record = chosen, fixed_record(chosen)
        rows = []
        for i, (name, section, field) in enumerate(NUMBERS):
            low, high = low_high(getattr(getattr(chosen, section), field))
            if name in DRAWN_AGAIN:
                self.record[f"{name}_low"], self.record[f"{name}_high"] = low, high
            elif low < high:
                rows.append((i, low, high, _WHOLE[name]))
        self.index = np.array([row[0] for row in rows], dtype=np.int64)
        self.low = np.array([row[1] for row in rows], dtype=np.float64)
        self.high = np.array([row[2] for row in rows], dtype=np.float64)
        self.whole = np.array([row[3] for row in rows], dtype=np.bool_)

    def draw(self, numbers: NDArray[np.void], lanes: NDArray[np.int64], key: Any, episode: Any) -> None:
        """Fill the lanes' records. numbers: [L] of `WORLD`; key, episode: [L]."""
        numbers[lanes] = self.record
        if len(self.index):
            values = numbers.view(np.float64).reshape(len(numbers), -1)
            _draw(values, lanes, key.view(np.int64), episode, self.index, self.low, self.high, self.whole)


@jit
def _draw(values, lanes, key, episode, index, low, high, whole):
    """values[lane, index[i]] uniform in [low, high]; whole numbers include both ends."""
    for n in range(lanes.shape[0]):
        lane = lanes[n]
        for i in range(index.shape[0]):
            u = uniform4(key[lane], episode[lane], FIRST, DRAW_RANGES, index[i])[0]
            if whole[i]:
                values[lane, index[i]] = low[i] + np.floor(u * (high[i] - low[i] + 1.0))
            else:
                values[lane, index[i]] = low[i] + u * (high[i] - low[i])
