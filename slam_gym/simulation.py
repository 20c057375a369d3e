"""A world and the estimators that watch it: the loop that the environments and the comparison share."""

from collections.abc import Mapping, Sequence
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimators import registry
from estimators.interface import BoundCalls, Estimator, TruthAware
from estimators.target_cloud import TargetCloud
from slam_gym.metrics import Meter
from slam_gym.scenario import Scenario
from slam_gym.world import World

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def make_estimator(scenario: Scenario, name: str, options: Mapping[str, Any], num_lanes: int = 1) -> Estimator:
    """An estimator with the scenario's models, room for its landmarks, and its labels or the lack of them."""
    motion, sensor, target = scenario.models()
    chosen = {"max_landmarks": scenario.max_landmarks, **options}
    if not scenario.landmarks.labelled:
        chosen.setdefault("association", "nearest")
    return registry.make(name, motion, sensor, target, num_lanes=num_lanes, **chosen)


class Simulation:
    """L lanes of a scenario, and any number of estimators that process identical data.

    Args:
        scenario: what is simulated.
        estimators: (name, options) of each.
        num_lanes: L.
        threads: for the world's kernels.
        allow_truth: accept reference filters that are handed the truth.
        timed: measure the estimators' time.

    Attributes:
        world, estimators, meters: one meter per estimator; names [E], of the estimators.
        is_plain: nobody is timed, nobody is told the truth.
        clouds: by an estimator's index, the points that accompany it (see `attach_cloud`).
        predict_seconds, update_seconds: [E] with `timed`; predict_calls, update_calls: [E] lane-calls they cover.

    Raises:
        ValueError: an unknown estimator or option, or a reference filter without `allow_truth`.
    """

    def __init__(
        self,
        scenario: Scenario,
        estimators: Sequence[tuple[str, Mapping[str, Any]]],
        num_lanes: int = 1,
        threads: int = 1,
        *,
        allow_truth: bool = False,
        timed: bool = False,
    ) -> None:
        self.scenario, self.num_lanes, self.dt, self.timed = scenario, int(num_lanes), float(scenario.dt), timed
        self.world = World(scenario, num_lanes, threads)
        self.names = [name for name, _ in estimators]
        self.estimators = [self._build(name, options, allow_truth) for name, options in estimators]
        self.meters = [Meter(num_lanes, e.max_landmarks) for e in self.estimators]
        self._told = [e for e in self.estimators if isinstance(e, TruthAware)]
        self.is_plain = not timed and not self._told
        self.clouds: dict[int, TargetCloud] = {}
        self._period = int(scenario.sensor_period)
        self._altered = np.zeros(self.num_lanes, dtype=np.bool_)  # lanes whose models reset options have changed
        count = len(self.estimators)
        self.predict_seconds, self.update_seconds = np.zeros(count), np.zeros(count)
        self.predict_calls, self.update_calls = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)

    def _build(self, name: str, options: Mapping[str, Any], allow_truth: bool) -> Estimator:
        if issubclass(registry.get(name), TruthAware) and not allow_truth:
            raise ValueError(
                f"estimator {name!r} is a reference that is handed the truth; it is for comparisons only "
                "(allow_truth=True accepts it all the same)"
            )
        return make_estimator(self.scenario, name, options, self.num_lanes)

    def attach_cloud(self, num_points: int, index: int = 0, **options: Any) -> None:
        """Let points accompany one estimator from the next `reset` on, as `belief.target_cloud`; see `TargetCloud`.

        They know the arena where it holds the target.

        Raises:
            ValueError: a scenario without a target, an option that there is not, or an impossible number.
        """
        arena = self.scenario.arena
        known = {"arena": arena.size if arena.walls else None, **options}
        self.clouds[index] = registry.build(
            "class", "TargetCloud", TargetCloud, known, self.estimators[index], num_points
        )

    def reset(
        self, seeds: ArrayLike | None, lanes: Ints | None = None, options: Mapping[str, Any] | None = None
    ) -> None:
        """Begin an episode in the named lanes (None: all); seeds None: the next episode of the same seeds.

        `options`: numbers of the scenario for this episode, by dotted key; see `World.reset`.
        """
        world = self.world
        chosen = np.arange(self.num_lanes) if lanes is None else np.asarray(lanes, dtype=np.int64)
        if seeds is None:
            world.next_episode(chosen, options)
        else:
            world.reset(seeds, chosen, options)
        start = world.target_start(chosen)
        mean, cov = start if start is not None else (None, None)
        streams = (world.key[chosen] >> np.uint64(1)).astype(np.int64) + world.episode[chosen]
        told = chosen if world.models_vary or options else chosen[self._altered[chosen]]
        self._altered[chosen] = bool(options)
        for lane in map(int, told):
            models = world.lane_models(lane)
            for estimator in self.estimators:
                estimator.set_models(lane, *models)
        for estimator in self.estimators:
            estimator.reset(
                world.start_pose[chosen], world.start_cov[chosen], seeds=streams, target=mean, target_cov=cov,
                lanes=None if lanes is None else chosen,
            )  # fmt: skip
        for cloud in self.clouds.values():
            cloud.reset(chosen, streams)

    def advance(self, command: Floats, lanes: Ints | None = None) -> None:
        """One simulation step: the world moves, every estimator predicts, and updates where a sweep is due.

        Args:
            command: [L, 2] physical, (speed [m/s], turn rate [rad/s] or steering angle [rad]).
            lanes: [n] which lanes; None: all.
        """
        world = self.world
        if not self.is_plain:
            self._advance_watched(command, lanes)
            return
        world.step(command, lanes)
        due = self.due(lanes)
        for e in range(len(self.estimators)):
            self.estimators[e].predict(world.odometry, self.dt, lanes=lanes)
            if due is not None:
                self._update(e, due)
        if self.clouds:
            self._advance_clouds(lanes, due)

    def _advance_clouds(self, lanes: Ints | None, due: Ints | None) -> None:
        for cloud in self.clouds.values():
            cloud.predict(self.dt, lanes)
            if due is not None:
                cloud.update(self.world.scan, due)

    def _update(self, e: int, due: Ints) -> None:
        self.estimators[e].update(self.world.scan, lanes=due if len(due) < self.num_lanes else None)

    def bound_calls(self) -> BoundCalls | None:
        """The first estimator's kernels for this world's arrays, for a loop that runs them itself; None: it has none.

        A comparison's many lanes do not need them, and to compile them takes as long as the kernels themselves.
        """
        steps = np.full(self.num_lanes, self.dt)
        return self.estimators[0].bound_calls(self.world.odometry, steps, self.world.scan)

    def due(self, lanes: Ints | None) -> Ints | None:
        """The lanes with a fresh sweep; None: there are none."""
        world = self.world
        if self._period == 1:
            return world.lanes if lanes is None else lanes
        due = np.flatnonzero(world.due) if lanes is None else lanes[world.due[lanes]]
        return due if len(due) else None

    def _advance_watched(self, command: Floats, lanes: Ints | None) -> None:
        """`advance` with clocks, and with the truth for those that are told it."""
        world = self.world
        self._tell()
        world.step(command, lanes)
        self._tell()
        due = self.due(lanes)
        for e, estimator in enumerate(self.estimators):
            began = perf_counter()
            estimator.predict(world.odometry, self.dt, lanes=lanes)
            moved = perf_counter()
            self.predict_seconds[e] += moved - began
            self.predict_calls[e] += self.num_lanes if lanes is None else len(lanes)
            if due is not None:
                self._update(e, due)
                self.update_seconds[e] += perf_counter() - moved
                self.update_calls[e] += len(due)
        self._advance_clouds(lanes, due)

    def _tell(self) -> None:
        for estimator in self._told:
            estimator.set_truth(self.world.pose, self.world.target, self.world.landmarks)

    def measure(self, index: int = 0, lanes: Ints | None = None, *, score_map: bool = True) -> NDArray[np.void]:
        """[L] records of `METRIC`: the belief of one estimator against the truth, now; landmarks only if asked."""
        world = self.world
        return self.meters[index].measure(
            self.estimators[index].belief,
            world.pose,
            world.target if world.has_target else None,
            world.landmarks if score_map else None,
            world.landmark_count,
            world.labelled,
            target_heading=world.target_heading,
            lanes=lanes,
        )

    def get_state(self) -> dict[str, Any]:
        """Everything that changes between calls, as copies."""
        states = [estimator.get_state() for estimator in self.estimators]
        clouds = {index: cloud.get_state() for index, cloud in self.clouds.items()}
        return {
            "world": self.world.get_state(), "estimators": states, "altered": self._altered.copy(), "clouds": clouds,
        }  # fmt: skip

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore what `get_state` returned."""
        self.world.set_state(state["world"])
        self._altered[:] = state["altered"]
        for estimator, saved in zip(self.estimators, state["estimators"], strict=True):
            estimator.set_state(saved)
        for index, cloud in self.clouds.items():
            cloud.set_state(state["clouds"][index])
