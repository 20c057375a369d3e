"""What is said of each lane after a step: reward terms, numbers and flags of info, ends of episodes."""

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from estimators.kernels.bound import LATER, Bound, bind, chain
from estimators.kernels.jit import subroutine
from slam_gym import reward
from slam_gym.metrics import LOST_AFTER, METRIC
from slam_gym.observation import seen_now
from slam_gym.scenario import Scenario
from slam_gym.simulation import Simulation
from slam_gym.world_state import COLLISIONS, POSE, SINCE_SEEN, STEP, TARGET_STATE, TOUCHING, VISIBLE

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
T = TypeVar("T")

# GOSPA needs a map without ids, which is too slow to match at every step.
MEASURED = tuple(name for name in METRIC.names or () if name != "landmark_gospa")
NUM_METRICS = len(MEASURED)
_COLUMNS = tuple((METRIC.names or ()).index(name) for name in MEASURED)
NUMBERS = (
    *MEASURED,
    *(f"reward_{name}" for name in reward.TERMS),
    "target_distance", "time_since_seen", "collisions",
)  # fmt: skip
"""Info's numbers, in the order of `Scorer.values`; undefined ones (NaN) are left out of info."""
FLAGS = ("target_seen", "target_visible", "target_lost", "in_collision", "outside", "captured", "is_success")
_SAID = (*NUMBERS, *FLAGS)
_PAID = struct.Struct(f"d{8 * len(NUMBERS) + len(FLAGS)}x3?")
"""Of a lane's record: the reward; whether it has terminated, was truncated, and has all its numbers."""
_TOLD = struct.Struct(f"8x{len(NUMBERS)}d{len(FLAGS)}?3x")
"""The rest of it: numbers and flags."""

_ROBOT_ERROR, _TARGET_ERROR, _TARGET_ERROR_REL, _LANDMARK_COUNT = (
    (METRIC.names or ()).index(name) for name in ("robot_error", "target_error", "target_error_rel", "landmark_count")
)
_TERMS = NUM_METRICS
_DISTANCE = _TERMS + len(reward.TERMS)
_HAS_TARGET, _SWEEP, _DT, _MAX_STEPS, _CAPTURE, _OUTSIDE, _SUCCESS = range(7)  # of `settings`


@dataclass(frozen=True, slots=True)
class Ending:
    """When an episode ends before its time, and what counts as a success.

    Raises:
        ValueError: a distance that is not positive.
    """

    terminate_on_capture: float | None = None  # [m] true distance of robot and target; None: never
    terminate_outside: bool = False  # when the robot leaves the arena
    success_error: float = 1.0  # [m] of the target's estimate (the robot's where there is no target)

    def __post_init__(self) -> None:
        for name in ("terminate_on_capture", "success_error"):
            value = getattr(self, name)
            if value is None and name == "terminate_on_capture":
                continue
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 < value < math.inf:
                raise ValueError(f"{name} must be a positive number of metres; got {value!r}")
        if not isinstance(self.terminate_outside, bool):
            raise ValueError(f"terminate_outside must be True or False; got {self.terminate_outside!r}")


@subroutine
def _score(
    lanes, metrics, x, k, b, action, before, border, settings, weights, values, defined, whole, flags, paid, ended
):
    """Fill the rows of the lanes [n].

    metrics [L, 13]; x, k, b: the world's blocks; action [L, 2]; before [L, 3]: landmarks mapped and collisions at the
    last call, and whether the lane has just begun an episode, which has no reward yet and cannot have ended;
    values [NUMBERS, L], whether they are `defined` [NUMBERS, L] and all of them `whole` [L], flags [FLAGS, L], paid
    [L], ended [2, L] (terminated, truncated): output.
    """
    has_target = settings[_HAS_TARGET] > 0.0
    for n in range(lanes.shape[0]):
        lane = lanes[n]
        at, body = k[POSE] + 3 * lane, k[TARGET_STATE] + 4 * lane
        since, steps = x[k[SINCE_SEEN] + lane], k[k[STEP] + lane]
        distance = math.hypot(x[body] - x[at], x[body + 1] - x[at + 1]) if has_target else math.nan
        seen = has_target and seen_now(since, steps, settings[_SWEEP], settings[_DT])
        lost = has_target and since > LOST_AFTER
        mapped, collisions = metrics[lane, _LANDMARK_COUNT], float(k[k[COLLISIONS] + lane])
        collided = collisions - before[lane, 1]
        found = max(mapped - before[lane, 0], 0.0)
        started = before[lane, 2] > 0.0
        before[lane, 0], before[lane, 1], before[lane, 2] = max(mapped, 0.0), collisions, 0.0
        for i in range(NUM_METRICS):
            values[i, lane] = metrics[lane, _COLUMNS[i]]
        term = reward.terms(
            metrics[lane, _ROBOT_ERROR], metrics[lane, _TARGET_ERROR], metrics[lane, _TARGET_ERROR_REL], has_target,
            seen, distance, found, collided, action[lane, 0], action[lane, 1],
        )  # fmt: skip
        total = 0.0
        for i in range(weights.shape[0]):
            total += weights[i] * term[i]
            values[_TERMS + i, lane] = math.nan if started else term[i]
        paid[lane] = 0.0 if started else total
        values[_DISTANCE, lane] = distance
        values[_DISTANCE + 1, lane] = since if has_target else math.nan
        values[_DISTANCE + 2, lane] = collisions
        outside = not (abs(x[at]) <= border[lane, 0] and abs(x[at + 1]) <= border[lane, 1])
        captured = has_target and distance < settings[_CAPTURE]
        error = metrics[lane, _TARGET_ERROR] if has_target else metrics[lane, _ROBOT_ERROR]
        flags[0, lane], flags[1, lane], flags[2, lane] = seen, b[k[VISIBLE] + lane], lost
        flags[3, lane], flags[4, lane], flags[5, lane] = b[k[TOUCHING] + lane], outside, captured
        flags[6, lane] = captured or (error < settings[_SUCCESS] and not lost)
        ended[0, lane] = not started and (captured or (outside and settings[_OUTSIDE] > 0.0))
        ended[1, lane] = steps >= settings[_MAX_STEPS]
        whole[lane] = True
        for i in range(values.shape[0]):
            defined[i, lane] = values[i, lane] == values[i, lane]
            whole[lane] &= defined[i, lane]


class Scorer:
    """Scores every lane after a step.

    Args:
        scenario, simulation: what is scored; the belief of its first estimator.
        weights: [6] of the reward's terms.
        ending: when episodes end.
        border: [L, 2] half the arena's width and height [m].
        action: [L, 2] where the actions taken stand.

    Attributes:
        record: the memory of the next ones, one after the other.
        reward: [L]. values: [NUMBERS, L], NaN where undefined. flags: [FLAGS, L]. ended: [2, L] terminated, truncated.
        whole: [L] all numbers are defined. defined: [NUMBERS, L].
        before: [L, 3] landmarks in the map and collisions at the last call; 1 where an episode has just begun.
        bound: measures and scores the lanes that it is given, from a fresh belief.
        scratch: arrays that it writes and nobody reads.
    """

    def __init__(
        self,
        scenario: Scenario,
        simulation: Simulation,
        weights: Floats,
        ending: Ending,
        border: Floats,
        action: Floats,
    ) -> None:
        L = simulation.num_lanes
        self.simulation, self.weights, self.border = simulation, weights, border
        self.record: NDArray[np.uint8] = np.zeros(_PAID.size * L, dtype=np.uint8)
        size = 8 * L * (1 + len(NUMBERS))
        numbers: Floats = self.record[:size].view(np.float64).reshape(-1, L)
        bits: Bools = self.record[size:].view(np.bool_).reshape(-1, L)
        self.reward, self.values = numbers[0], numbers[1:]
        self.flags, self.ended, self.whole = bits[: len(FLAGS)], bits[len(FLAGS) : -1], bits[-1]
        self.defined: Bools = np.zeros((len(NUMBERS), L), dtype=np.bool_)
        self.values.fill(np.nan)
        self.before: Floats = np.zeros((L, 3))
        capture = -1.0 if ending.terminate_on_capture is None else ending.terminate_on_capture
        self.settings: Floats = np.array([
            scenario.has_target, scenario.dt * scenario.sensor_period, scenario.dt, scenario.max_steps, capture,
            ending.terminate_outside, ending.success_error,
        ])  # fmt: skip
        world = simulation.world
        # A map without ids must be matched with the true one landmark by landmark: too slow for every step. It is
        # counted all the same, against a true one of no landmarks.
        count = world.landmark_count if world.labelled else np.zeros(L, dtype=np.int64)
        meter, target = simulation.meters[0], world.target if world.has_target else None
        belief = simulation.estimators[0].belief
        measure = meter.bound(belief, world.pose, target, world.landmarks, count, world.target_heading)
        score = bind(
            _score, LATER, meter.record.view(np.float64).reshape(L, -1), world.floats, world.integers, world.flags,
            action, self.before, border, self.settings, weights, self.values, self.defined, self.whole, self.flags,
            self.reward, self.ended,
        )  # fmt: skip
        self.bound: Bound = chain(measure, score)
        self.scratch = meter.scratch

    def begin(self, lanes: Ints) -> None:
        """The lanes [n] begin an episode: what is scored next has no reward."""
        self.before[lanes] = 0.0, 0.0, 1.0

    def get_state(self) -> dict[str, Any]:
        """Scores and what they are counted from, as copies."""
        return {name: getattr(self, name).copy() for name in ("values", "flags", "reward", "ended", "before")}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore what `get_state` returned."""
        for name, array in state.items():
            getattr(self, name)[...] = array
        self.defined[...] = ~np.isnan(self.values)
        self.whole[...] = self.defined.all(axis=0)


class LaneScore:
    """What is said of one lane alone after a step, as Python's own objects: made anew at each call.

    Info holds numbers and flags without those undefined, true pose and target.
    """

    def __init__(self, scorer: Scorer) -> None:
        world = scorer.simulation.world
        self._record = scorer.record.data
        self._pose, self._target = world.pose[0], world.target[0] if world.has_target else None
        self._info: dict[str, Any] = dict.fromkeys((*_SAID, "robot_pose"))

    def __call__(self, observation: T) -> tuple[T, float, bool, bool, dict[str, Any]]:
        """What `step` returns: the observation given, reward, terminated, truncated, info."""
        paid, terminated, truncated, whole = _PAID.unpack(self._record)
        info = self._info.copy()  # its table is large enough: half the time of one that grows
        info.update(zip(_SAID, _TOLD.unpack(self._record)))  # noqa: B905  (to be strict takes a tenth of the time)
        info["robot_pose"] = self._pose.copy()
        if self._target is not None:
            info["target_state"] = self._target.copy()
        if not whole:
            for name in NUMBERS:
                if info[name] != info[name]:
                    del info[name]
        return observation, paid, terminated, truncated, info
