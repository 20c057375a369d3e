"""The simulated truth of L lanes: robot, target, landmarks, sensor. One lane is the same code as many.

Every random draw is a function of (lane's key, episode, step, purpose, item): the same seed gives the same draws
whatever is commanded and estimated, for any number of lanes and threads.
"""

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimators.interface import Scan
from estimators.kernels.random import lane_key
from estimators.models import MotionModel, SensorModel, TargetModel
from slam_gym.scenario import Scenario, build_models
from slam_gym.scenario_fields import low_high
from slam_gym.scenario_io import read_columns
from slam_gym.world_layout import place_bodies, place_landmarks
from slam_gym.world_motion import MEMORY, VELOCITY_X, VELOCITY_Y, move
from slam_gym.world_numbers import NUMBERS, Ranges, fixed_record
from slam_gym.world_sensor import sense

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_STATE = (
    "numbers", "key", "episode", "step_count", "pose", "body", "target", "target_heading", "memory", "delayed",
    "errors", "landmarks", "landmark_radius", "landmark_count", "odometry", "start_pose", "due",
    "target_visible", "target_detected", "time_since_seen", "collisions", "in_collision", "origin",
)  # fmt: skip


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
        step_count: [L] simulation steps of this episode. start_pose [L, 3], start_cov [L, 3, 3]: the filter's prior.
        numbers: [L] of `WORLD`, this episode's.
    """

    def __init__(self, scenario: Scenario, num_lanes: int = 1, threads: int = 1) -> None:
        if num_lanes < 1 or threads < 1:
            raise ValueError(f"num_lanes and threads must be at least 1; got {num_lanes} and {threads}")
        self.scenario, self.num_lanes, self.threads = scenario, int(num_lanes), int(threads)
        self.dt, self.has_target = float(scenario.dt), scenario.has_target
        self.labelled = scenario.landmarks.labelled
        self._points = _map(scenario)
        self._path = _path(scenario)
        self._ranges = Ranges(scenario)
        self._models = scenario.models()
        self.models_vary = scenario.models(0.0) != scenario.models(1.0)
        self._allocate()

    def _allocate(self) -> None:
        scenario, L = self.scenario, self.num_lanes
        laid_out = len(self._points) if scenario.landmarks.layout == "file" else int(
            low_high(scenario.landmarks.count)[1]
        )  # fmt: skip
        N = max(1, laid_out)
        clutter = low_high(scenario.sensor.clutter_rate)[1]
        K = N + 1 + (math.ceil(clutter + 6.0 * math.sqrt(clutter) + 3.0) if clutter > 0 else 0)
        D = 1 + round(low_high(scenario.robot.command_delay)[1] / self.dt)
        self.numbers: NDArray[np.void] = np.repeat(fixed_record(scenario)[None], L)
        self._fixed = fixed_record(scenario)
        self._values: Floats = self.numbers.view(np.float64).reshape(L, -1)
        self.key = np.zeros(L, dtype=np.uint64)
        self.episode, self.step_count = np.zeros(L, dtype=np.int64), np.zeros(L, dtype=np.int64)
        self.pose, self.start_pose, self.body = np.zeros((L, 3)), np.zeros((L, 3)), np.zeros((L, 3))
        self.start_cov = np.zeros((L, 3, 3))
        self.target_heading = np.zeros(L)
        self.target, self.memory = np.zeros((L, 4)), np.zeros((L, MEMORY))
        self.delayed, self.errors = np.zeros((L, D, 2)), np.zeros((L, N + 1, 2))
        self.landmarks, self.landmark_radius = np.zeros((L, N, 2)), np.zeros((L, N))
        self.landmark_count, self.odometry = np.zeros(L, dtype=np.int64), np.zeros((L, 2))
        self.scan = Scan.empty(L, K)
        self.origin = np.full((L, K), -1, dtype=np.int64)
        self.due, self.target_visible, self.target_detected = (np.zeros(L, dtype=np.bool_) for _ in range(3))
        self.time_since_seen = np.zeros(L)
        self.collisions, self.in_collision = np.zeros(L, dtype=np.int64), np.zeros(L, dtype=np.bool_)
        self.lanes = np.arange(L)
        self._bind()

    def _bind(self) -> None:
        """Argument lists of the kernels, gathered once: a step costs two calls and no look-ups."""
        self._move_args = (
            self.delayed, self.odometry, self.pose, self.body, self.target, self.memory, self._path, self.landmarks,
            self.landmark_radius, self.landmark_count, self.collisions, self.in_collision, self.target_heading,
        )  # fmt: skip
        scan = self.scan
        self._sense_args = (
            self.numbers, self.key, self.episode, self.step_count, self.pose, self.body, self.landmarks,
            self.landmark_radius, self.landmark_count, self.errors, scan.ranges, scan.bearings, scan.labels, scan.count,
            self.origin, self.due, self.target_visible, self.target_detected, self.time_since_seen,
        )  # fmt: skip
        self._pool: ThreadPoolExecutor | None = None

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
        chosen = np.broadcast_to(np.asarray(seeds), lanes.shape)
        for lane, seed in zip(lanes, chosen, strict=True):
            self.key[lane] = lane_key(int(seed))
        self.episode[lanes] = 0
        self._begin(lanes, options)

    def next_episode(self, lanes: Ints | None = None, options: Mapping[str, Any] | None = None) -> None:
        """Begin the next episode of the same seeds: fresh draws, the same for any policy. See `reset`."""
        lanes = self.lanes if lanes is None else np.asarray(lanes, dtype=np.int64)
        self.episode[lanes] += 1
        self._begin(lanes, options)

    def _begin(self, lanes: Ints, options: Mapping[str, Any] | None) -> None:
        ranges = Ranges(self.scenario, options) if options else self._ranges
        self.numbers[lanes] = self._fixed
        ranges.draw(self._values, lanes, self.key, self.episode)
        started: tuple[NDArray[Any], ...] = (
            self.step_count, self.memory, self.delayed, self.errors, self.odometry, self.collisions,
            self.time_since_seen, self.in_collision, self.target_detected, self.due, self.scan.count,
        )  # fmt: skip
        for state in started:
            state[lanes] = 0
        place_landmarks(
            lanes, self.numbers, self.key, self.episode, self._points, self.landmarks, self.landmark_radius,
            self.landmark_count,
        )  # fmt: skip
        place_bodies(
            lanes, self.numbers, self.key, self.episode, self.landmarks, self.landmark_radius, self.landmark_count,
            self._path, self.pose, self.start_pose, self.body,
        )  # fmt: skip
        self._start_beliefs(lanes)

    def _start_beliefs(self, lanes: Ints) -> None:
        numbers = self.numbers[lanes]
        for axis, name in (
            (0, "robot_start_position_std"),
            (1, "robot_start_position_std"),
            (2, "robot_start_heading_std"),
        ):
            self.start_cov[lanes, axis, axis] = numbers[name] ** 2
        speed = numbers["target_speed"] if self.scenario.target.kind != "recorded" else 0.0
        heading = self.target_heading[lanes] = self.body[lanes, 2]
        self.target[lanes, :2] = self.body[lanes, :2]
        self.target[lanes, 2], self.target[lanes, 3] = speed * np.cos(heading), speed * np.sin(heading)
        self.memory[lanes, VELOCITY_X], self.memory[lanes, VELOCITY_Y] = self.target[lanes, 2], self.target[lanes, 3]
        self.target_visible[lanes] = False

    def step(self, command: Floats, lanes: Ints | None = None) -> None:
        """One simulation step. command: [L, 2] (speed [m/s], turn rate [rad/s] or steering angle [rad])."""
        lanes = self.lanes if lanes is None else lanes
        if self.threads > 1 and len(lanes) > 1:
            self._share(command, lanes)
        else:
            self._step(command, lanes)

    def _step(self, command: Floats, lanes: Ints) -> None:
        move(lanes, self.numbers, self.key, self.episode, self.step_count, command, *self._move_args)
        sense(lanes, *self._sense_args)

    def _share(self, command: Floats, lanes: Ints) -> None:
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self.threads, thread_name_prefix="slam-gym-world")
        parts: Sequence[Ints] = np.array_split(lanes, self.threads)
        list(self._pool.map(lambda part: self._step(command, part), parts))

    def target_start(self, lanes: Ints | None = None) -> tuple[Floats, Floats] | None:
        """The filter's prior of the target: mean [n, n_t] and covariance [n, n_t, n_t]; None where it is not told."""
        model = self._models[2]
        if model is None or not self.scenario.target.known_start:
            return None
        lanes = self.lanes if lanes is None else lanes
        known = {"x": self.target[lanes, 0], "y": self.target[lanes, 1], "heading": self.body[lanes, 2],
                 "velocity_x": self.target[lanes, 2], "velocity_y": self.target[lanes, 3]}  # fmt: skip
        mean = np.stack([known[name] for name in model.coordinates], axis=-1)
        return mean, np.zeros((len(lanes), mean.shape[1], mean.shape[1]))

    def lane_models(self, lane: int) -> tuple[MotionModel, SensorModel, TargetModel | None]:
        """What a filter is told of this lane's episode; differs between lanes only where `models_vary`."""
        if not self.models_vary:
            return self._models
        scenario = self.scenario.load(self.scenario, **self._drawn(lane))
        return build_models(scenario, lambda value: value)

    def _drawn(self, lane: int) -> dict[str, float]:
        """This lane's numbers where the scenario has a range."""
        drawn = {}
        for name, section, field in NUMBERS:
            if isinstance(getattr(getattr(self.scenario, section), field), tuple):
                drawn[f"{section}.{field}"] = float(self.numbers[name][lane])
        return drawn

    def get_state(self) -> dict[str, Any]:
        """Everything that changes between calls, as copies."""
        state = {name: getattr(self, name).copy() for name in _STATE}
        scan = self.scan
        state["scan"] = [a.copy() for a in (scan.ranges, scan.bearings, scan.labels, scan.count, scan.complete)]
        state["start_cov"] = self.start_cov.copy()
        return state

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore what `get_state` returned, in place."""
        for name in (*_STATE, "start_cov"):
            getattr(self, name)[...] = state[name]
        scan = self.scan
        for mine, saved in zip(
            (scan.ranges, scan.bearings, scan.labels, scan.count, scan.complete), state["scan"], strict=True
        ):
            mine[...] = saved

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


def _map(scenario: Scenario) -> Floats:
    if scenario.landmarks.layout != "file":
        return np.zeros((0, 2))
    return read_columns(scenario.landmarks.file, ("x_m", "y_m"))


def _path(scenario: Scenario) -> Floats:
    if scenario.target.kind != "recorded":
        return np.zeros((1, 3))
    path = read_columns(scenario.target.file, ("time_s", "x_m", "y_m"))
    if not np.all(np.diff(path[:, 0]) > 0):
        raise ValueError(f"{scenario.target.file!r}: time_s must increase from row to row")
    return path
