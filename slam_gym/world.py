"""The simulated truth of L lanes: robot, target, landmarks, sensor. One lane is the same code as many.

Every random draw is a function of (lane's key, episode, step, purpose, item): the same seed gives the same draws
whatever is commanded and estimated, for any number of lanes and threads.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimators.interface import TARGET, Scan
from estimators.kernels.bound import LATER, Bound, bind
from estimators.kernels.random import lane_key
from estimators.models import MotionModel, SensorModel, TargetModel
from slam_gym.scenario import Scenario
from slam_gym.scenario_fields import low_high
from slam_gym.scenario_io import read_columns
from slam_gym.scenario_models import build_models
from slam_gym.threads import Crew
from slam_gym.world_layout import begin
from slam_gym.world_numbers import ONE_SIGMA, Ranges, model_numbers
from slam_gym.world_state import VECTOR, Blocks
from slam_gym.world_step import step

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

CLUTTER_ROOM = 6.0  # standard deviations of the number of false returns that a sweep has room for


class World:
    """L independent worlds of one scenario.

    Args:
        scenario: what is simulated.
        num_lanes: L.
        threads: lanes are shared out among that many threads (kernels hold no lock); any number gives the same bits.

    Attributes:
        pose: [L, 3] the robot's x, y [m], heading [rad].
        target: [L, 4] x, y [m] and velocity [m/s]; target_heading [L] [rad].
        landmarks: [L, N, 2] [m] by id; landmark_radius [L, N] [m]; landmark_count [L].
        odometry: [L, 2] what is reported of the last step: the estimators' control.
        scan: the last sweep; `due` [L] says whether it was taken at the last step.
        origin: [L, K] where each return really came from: an id, `TARGET`, or `FALSE_ALARM`.
        target_visible: [L] within range, view and line of sight; target_detected [L] whether the last step has a
            return of it; time_since_seen [L] [s] since the last return (since the start before the first).
        collisions: [L] how often the robot ran into a pillar; in_collision [L] whether it touches one.
        overflow: [L] returns that found no room in a sweep.
        step_count: [L] simulation steps of this episode. start_pose [L, 3], start_cov [L, 3, 3]: the filter's prior.
        crew: the threads.
        numbers: [L] of `WORLD`, this episode's. key, episode: [L] that name its random draws.
        floats, integers, flags: the blocks that all these lie in; see `world_state`.
        models_vary: whether `lane_models` differ between lanes or episodes.
    """

    key: NDArray[np.uint64]
    episode: Ints
    step_count: Ints
    pose: Floats
    start_pose: Floats
    target: Floats
    target_heading: Floats
    target_visible: Bools
    target_detected: Bools
    time_since_seen: Floats
    landmarks: Floats
    landmark_radius: Floats
    landmark_count: Ints
    odometry: Floats
    origin: Ints
    due: Bools
    collisions: Ints
    in_collision: Bools
    overflow: Ints

    def __init__(self, scenario: Scenario, num_lanes: int = 1, threads: int = 1) -> None:
        if num_lanes < 1 or threads < 1:
            raise ValueError(f"num_lanes and threads must be at least 1; got {num_lanes} and {threads}")
        self.scenario, self.num_lanes, self.threads = scenario, int(num_lanes), int(threads)
        self.dt, self.has_target = float(scenario.dt), scenario.has_target
        self.labelled = scenario.landmarks.labelled
        self._points = _map(scenario)
        self._ranges = Ranges(scenario)
        self._models = scenario.models()
        self._model_numbers = [
            (name, f"{section}.{field}", isinstance(getattr(getattr(scenario, section), field), tuple))
            for name, section, field in model_numbers(scenario)
        ]
        self.models_vary = any(ranged for _, _, ranged in self._model_numbers)
        self._allocate()

    def _allocate(self) -> None:
        L = self.num_lanes
        self._sizes = _sizes(self.scenario, len(self._points))
        self.lanes: Ints = np.arange(L)
        self.numbers: NDArray[np.void] = np.repeat(self._ranges.record[None], L)
        self._blocks = Blocks(L, *self._sizes, _path(self.scenario))
        self.floats, self.integers, self.flags = self._blocks.floats, self._blocks.integers, self._blocks.flags
        views = dict(self._blocks.views)
        self.scan = Scan(
            ranges=views.pop("ranges"),
            bearings=views.pop("bearings"),
            labels=views.pop("labels"),
            count=views.pop("count"),
            complete=np.ones(L, dtype=np.bool_),
        )
        for name, view in views.items():
            setattr(self, name, view)
        self.start_cov: Floats = np.zeros((L, 3, 3))
        self._arguments = (self.numbers, self._blocks.floats, self._blocks.integers, self._blocks.flags)
        self._command: Floats = np.zeros((L, 2))
        self._step = self.bound_step(self._command)
        self._place = bind(begin, LATER, *self._arguments, self._points)
        self.crew = Crew(self.threads)

    def reset(self, seeds: ArrayLike, lanes: Ints | None = None, options: Mapping[str, Any] | None = None) -> None:
        """Begin an episode in the named lanes.

        Args:
            seeds: [n] or one integer; a lane whose seed stays goes on to its next episode's draws only through
                `next_episode`.
            lanes: [n]; None: all.
            options: numbers of the scenario for this episode alone, by dotted key: {"target.speed": 0.5,
                "target.start_distance": [3, 4]}.

        Raises:
            ValueError: an unknown key or impossible value among the options.
        """
        lanes = self.lanes if lanes is None else np.asarray(lanes, dtype=np.int64)
        ranges, chosen = self._ranges_with(options), np.broadcast_to(np.asarray(seeds), lanes.shape)
        for lane, seed in zip(lanes, chosen, strict=True):
            self.key[lane] = lane_key(int(seed))
        self.episode[lanes] = 0
        self._begin(lanes, ranges)

    def next_episode(self, lanes: Ints | None = None, options: Mapping[str, Any] | None = None) -> None:
        """Begin the next episode of the same seeds: fresh draws, the same for any policy. See `reset`."""
        lanes = self.lanes if lanes is None else np.asarray(lanes, dtype=np.int64)
        ranges = self._ranges_with(options)
        self.episode[lanes] += 1
        self._begin(lanes, ranges)

    def _ranges_with(self, options: Mapping[str, Any] | None) -> Ranges:
        """What an episode's numbers are drawn from; options are refused here, before anything has changed."""
        if not options:
            return self._ranges
        ranges = Ranges(self.scenario, options)
        if np.any(np.greater(_sizes(ranges.scenario, len(self._points)), self._sizes)):
            raise ValueError(
                "reset options cannot raise landmarks.count, sensor.clutter_rate or robot.command_delay above the "
                "scenario's largest: arrays are sized for those; set them in the scenario"
            )
        return ranges

    def _begin(self, lanes: Ints, ranges: Ranges) -> None:
        kept = self._blocks.views.keys() - {"key", "episode"}
        for name in kept:
            self._blocks.views[name][lanes] = 0
        ranges.draw(self.numbers, lanes, self.key, self.episode)
        self._place(np.ascontiguousarray(lanes, dtype=np.int64))
        self._start_cov(lanes)

    def _start_cov(self, lanes: Ints) -> None:
        """The covariance of the start that the filter is told; rank one where the start is one sigma off."""
        numbers = self.numbers[lanes]
        position, heading = numbers["robot_start_position_std"], numbers["robot_start_heading_std"]
        way = self.start_pose[lanes, 2] + heading
        one_sigma = np.stack([position * np.cos(way), position * np.sin(way), heading], axis=-1)
        independent = np.stack([position**2, position**2, heading**2], axis=-1)[:, :, None] * np.eye(3)
        rank_one = (numbers["robot_start_noise"] == ONE_SIGMA)[:, None, None]
        self.start_cov[lanes] = np.where(rank_one, one_sigma[:, :, None] * one_sigma[:, None, :], independent)

    def step(self, command: Floats, lanes: Ints | None = None) -> None:
        """One simulation step. command: [L, 2] (speed [m/s], turn rate [rad/s] or steering angle [rad])."""
        lanes = self.lanes if lanes is None else np.ascontiguousarray(lanes, dtype=np.int64)
        self._command[:] = command
        if self.threads > 1 and len(lanes) > 1:
            self._share(lanes)
        else:
            self._step(lanes)

    def scan_holds_target(self, lane: int) -> bool:
        """Whether a return of the latest sweep is really the target's."""
        return bool((self.origin[lane, : self.scan.count[lane]] == TARGET).any())

    def bound_step(self, command: Floats) -> Bound:
        """The kernel of `step` for ever the same array of commands, on the thread that calls it; it takes the lanes."""
        return bind(step, LATER, command, *self._arguments)

    def _share(self, lanes: Ints) -> None:
        """Every thread takes a run of lanes; they touch nothing in common."""
        parts = np.array_split(lanes, min(self.threads, len(lanes)))
        self.crew.run([(self._step, part) for part in parts])

    def target_start(self, lanes: Ints | None = None) -> tuple[Floats, Floats] | None:
        """The filter's prior of the target: mean [n, n_t] and covariance [n, n_t, n_t]; None where it is not told."""
        model = self._models[2]
        if model is None or not self.scenario.target.known_start:
            return None
        lanes = self.lanes if lanes is None else lanes
        known = {"x": self.target[lanes, 0], "y": self.target[lanes, 1], "heading": self.target_heading[lanes],
                 "velocity_x": self.target[lanes, 2], "velocity_y": self.target[lanes, 3]}  # fmt: skip
        mean = np.stack([known[name] for name in model.coordinates], axis=-1)
        return mean, np.zeros((len(lanes), mean.shape[1], mean.shape[1]))

    def lane_models(self, lane: int) -> tuple[MotionModel, SensorModel, TargetModel | None]:
        """What a filter is told of this lane's episode: the scenario's models with the numbers drawn for it."""
        row, base = self.numbers[lane], self._ranges.record
        drawn: dict[str, float] = {}
        for name, dotted, ranged in self._model_numbers:
            if ranged or row[name] != base[name]:
                drawn[dotted] = float(row[name])
        if not drawn:
            return self._models
        return build_models(self.scenario.load(self.scenario, **drawn), lambda value: value)

    def get_state(self) -> dict[str, Any]:
        """Everything that changes between calls, as copies."""
        blocks = self._blocks
        return {
            "floats": blocks.floats.copy(),
            "integers": blocks.integers.copy(),
            "flags": blocks.flags.copy(),
            "numbers": self.numbers.copy(),
            "start_cov": self.start_cov.copy(),
        }

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore what `get_state` returned, in place.

        Raises:
            ValueError: the state of a world of another size.
        """
        blocks = self._blocks
        mine = {"floats": blocks.floats, "integers": blocks.integers, "flags": blocks.flags, "numbers": self.numbers,
                "start_cov": self.start_cov}  # fmt: skip
        if any(array.shape != state[name].shape for name, array in mine.items()):
            raise ValueError("this state belongs to a world with other numbers of lanes, landmarks or returns")
        for name, array in mine.items():
            array[...] = state[name]

    def __getstate__(self) -> dict[str, Any]:
        """For pickle: the scenario, sizes and state; buffers are made anew."""
        return {
            "scenario": self.scenario,
            "num_lanes": self.num_lanes,
            "threads": self.threads,
            "state": self.get_state(),
        }

    def __setstate__(self, saved: dict[str, Any]) -> None:
        self.__init__(saved["scenario"], saved["num_lanes"], saved["threads"])  # type: ignore[misc]
        self.set_state(saved["state"])


def _sizes(scenario: Scenario, rows: int) -> tuple[int, int, int]:
    """Most landmarks, returns in a sweep, and remembered commands; rows: of the landmark file."""
    marks = rows if scenario.landmarks.layout == "file" else int(low_high(scenario.landmarks.count)[1])
    marks = max(1, marks)
    clutter = low_high(scenario.sensor.clutter_rate)[1]
    false = math.ceil(clutter + CLUTTER_ROOM * math.sqrt(clutter)) + 3 if clutter > 0.0 else 0
    commands = 1 + math.floor(low_high(scenario.robot.command_delay)[1] / scenario.dt + 0.5)
    returns = math.ceil((marks + 1 + false) / VECTOR) * VECTOR
    return marks, returns, commands


def _map(scenario: Scenario) -> Floats:
    if scenario.landmarks.layout != "file":
        return np.zeros((0, 2))
    return read_columns(scenario.landmarks.file, ("x_m", "y_m"))


def _path(scenario: Scenario) -> Floats:
    if scenario.target.kind != "recorded":
        return np.zeros((0, 3))
    path = read_columns(scenario.target.file, ("time_s", "x_m", "y_m"))
    if not np.all(np.diff(path[:, 0]) > 0):
        raise ValueError(f"{scenario.target.file!r}: time_s must increase from row to row")
    return path
