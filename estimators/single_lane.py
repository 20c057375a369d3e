"""Write a filter for ONE robot in plain NumPy; this base class runs it for any number of lanes.

The author describes one robot's filter with four functions of an own state object (any picklable object: a
dictionary of arrays, a dataclass):

* `reset_one` makes the state of a lane from its prior;
* `predict_one` and `update_one` return the state after a control or a sweep (the same object changed, or a new one);
* `describe_one` tells what the state says, as a `LaneBelief`.

>>> class Still(SingleLaneEstimator):
...     "A robot that never moves."
...     def reset_one(self, models, pose, pose_cov, seed, target, target_cov):
...         return pose, pose_cov
...     def predict_one(self, state, models, control, dt):
...         return state
...     def update_one(self, state, models, returns):
...         return state
...     def describe_one(self, state, models):
...         return LaneBelief(pose=state[0], pose_cov=state[1])
"""

import copy
import math
from abc import abstractmethod
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from estimators.interface import Estimator, Floats, Ints, Scan
from estimators.models import MotionModel, SensorModel, TargetModel

UNIFORM_HEADING_VAR = math.pi**2 / 3.0  # [rad^2] of a heading of which nothing is known


class LaneModels(NamedTuple):
    """The models of one lane."""

    motion: MotionModel
    sensor: SensorModel
    target: TargetModel | None


class Returns(NamedTuple):
    """One lane's sweep: n returns."""

    ranges: Floats  # [n] metres
    bearings: Floats  # [n] radians from the heading
    labels: Ints  # [n] landmark id, TARGET or UNKNOWN
    complete: bool  # whether the absence of a return is evidence


@dataclass(slots=True)
class LaneBelief:
    """What one lane's filter believes: world frame, m mapped landmarks.

    Attributes:
        pose: [3] x, y, heading. pose_cov: [3, 3].
        target: [n_t] in the target model's coordinates; None while unknown. target_cov: [n_t, n_t].
        target_pose_cov: [n_t, 3] covariance of the target with the pose; None: independent.
        landmark_ids: [m]. landmarks: [m, 2]. landmark_covs: [m, 2, 2].
        landmark_pose_covs: [m, 2, 3] covariance of each landmark with the pose; None: independent.
    """

    pose: Floats
    pose_cov: Floats
    target: Floats | None = None
    target_cov: Floats | None = None
    target_pose_cov: Floats | None = None
    landmark_ids: ArrayLike = ()
    landmarks: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    landmark_covs: Floats = field(default_factory=lambda: np.zeros((0, 2, 2)))
    landmark_pose_covs: Floats | None = None


class SingleLaneEstimator(Estimator):
    """Base of filters written for one lane; loops over lanes, fills the belief, keeps and restores states.

    A filter that maps more than `max_landmarks` landmarks must drop the excess itself and say so in `counts_one`.
    """

    def __init__(
        self,
        motion: MotionModel,
        sensor: SensorModel,
        target: TargetModel | None,
        *,
        num_lanes: int = 1,
        max_landmarks: int,
    ) -> None:
        super().__init__(motion, sensor, target, num_lanes=num_lanes, max_landmarks=max_landmarks)
        self.lane_models = [LaneModels(motion, sensor, target)] * self.num_lanes
        self.states: list[Any] = [None] * self.num_lanes  # None: never reset, the belief is all zeros

    @abstractmethod
    def reset_one(
        self,
        models: LaneModels,
        pose: Floats,
        pose_cov: Floats,
        seed: int,
        target: Floats | None,
        target_cov: Floats | None,
    ) -> Any:
        """Make the state of a lane from its prior; the arrays are the author's to keep."""

    @abstractmethod
    def predict_one(self, state: Any, models: LaneModels, control: Floats, dt: float) -> Any:
        """Return the state after dt seconds under `control` [2]."""

    @abstractmethod
    def update_one(self, state: Any, models: LaneModels, returns: Returns) -> Any:
        """Return the state after one sweep."""

    @abstractmethod
    def describe_one(self, state: Any, models: LaneModels) -> LaneBelief:
        """Tell what the state says."""

    def counts_one(self, state: Any) -> dict[str, int]:
        """Tell what went wrong since the reset, by name; the same names for every state."""
        return {}

    def set_models(self, lane: int, motion: MotionModel, sensor: SensorModel, target: TargetModel | None) -> None:
        """See `Estimator.set_models`."""
        super().set_models(lane, motion, sensor, target)
        self.lane_models[lane] = LaneModels(motion, sensor, target)

    def reset(
        self,
        pose: ArrayLike,
        pose_cov: ArrayLike,
        *,
        seeds: ArrayLike,
        target: ArrayLike | None = None,
        target_cov: ArrayLike | None = None,
        lanes: Ints | None = None,
    ) -> None:
        """See `Estimator.reset`."""
        prior = self._prior(pose, pose_cov, seeds, target, target_cov, lanes)
        for i, lane in enumerate(prior.lanes):
            mean = None if prior.target is None else prior.target[i].copy()
            cov = None if prior.target_cov is None else prior.target_cov[i].copy()
            self.states[lane] = self.reset_one(
                self.lane_models[lane], prior.pose[i].copy(), prior.pose_cov[i].copy(), int(prior.seeds[i]), mean, cov
            )
        self.belief.mark_stale()

    def predict(self, control: Floats, dt: float | Floats, *, lanes: Ints | None = None) -> None:
        """See `Estimator.predict`."""
        steps = np.broadcast_to(np.asarray(dt, dtype=np.float64), (self.num_lanes,))
        for lane in self.all_lanes if lanes is None else lanes:
            state = self.predict_one(
                self._state(lane), self.lane_models[lane], np.array(control[lane]), float(steps[lane])
            )
            self.states[lane] = self._returned("predict_one", state)
        self.belief.mark_stale()

    def update(self, scan: Scan, *, lanes: Ints | None = None) -> None:
        """See `Estimator.update`."""
        for lane in self.all_lanes if lanes is None else lanes:
            n = int(scan.count[lane])
            returns = Returns(
                scan.ranges[lane, :n].copy(),
                scan.bearings[lane, :n].copy(),
                scan.labels[lane, :n].copy(),
                bool(scan.complete[lane]),
            )
            state = self.update_one(self._state(lane), self.lane_models[lane], returns)
            self.states[lane] = self._returned("update_one", state)
        self.belief.mark_stale()

    @property
    def counts(self) -> dict[str, Ints]:
        """See `Estimator.counts`."""
        found = [{} if state is None else self.counts_one(state) for state in self.states]
        names = dict.fromkeys(name for one in found for name in one)
        return {name: np.array([one.get(name, 0) for one in found], dtype=np.int64) for name in names}

    def get_state(self) -> dict[str, Any]:
        """See `Estimator.get_state`."""
        return {
            "states": copy.deepcopy(self.states),
            "lane_models": list(self.lane_models),
            "models": self.models.copy(),
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """See `Estimator.set_state`."""
        self.states = copy.deepcopy(state["states"])
        self.lane_models = list(state["lane_models"])
        self.models[:] = state["models"]
        self.belief.mark_stale()

    def _state(self, lane: int) -> Any:
        if self.states[lane] is None:
            raise RuntimeError(f"lane {lane} has no prior yet: call reset before predict and update")
        return self.states[lane]

    def _returned(self, method: str, state: Any) -> Any:
        """The state, if there is one."""
        if state is None:
            raise TypeError(f"{type(self).__name__}.{method} must return the lane's new state; it returned None")
        return state

    def _describe(self, lane: int) -> LaneBelief:
        if self.states[lane] is None:
            return LaneBelief(np.zeros(3), np.zeros((3, 3)))
        one = self.describe_one(self.states[lane], self.lane_models[lane])
        if not isinstance(one, LaneBelief):
            raise TypeError(f"{type(self).__name__}.describe_one must return a LaneBelief; got {type(one).__name__}")
        self._check_shapes(one)
        return one

    def _check_shapes(self, one: LaneBelief) -> None:
        """See that every array is as `LaneBelief` says."""
        n_t, m = len(self.target_names), len(np.asarray(one.landmark_ids))
        if m > self.max_landmarks:
            raise ValueError(
                f"{type(self).__name__}.describe_one: {m} landmarks, but max_landmarks is {self.max_landmarks}: drop "
                "what does not fit, and count it in counts_one"
            )
        shapes = {
            "pose": (3,), "pose_cov": (3, 3), "target": (n_t,), "target_cov": (n_t, n_t), "target_pose_cov": (n_t, 3),
            "landmarks": (m, 2), "landmark_covs": (m, 2, 2), "landmark_pose_covs": (m, 2, 3),
        }  # fmt: skip
        for name, shape in shapes.items():
            value = getattr(one, name)
            found = shape if value is None else np.shape(value)
            if found != shape and not (m == 0 and found[:1] == (0,) and name.startswith("landmark")):
                coordinates = ", ".join(self.target_names) or "no target model: leave it None"
                why = f" ({coordinates})" if name.startswith("target") else ""
                raise ValueError(
                    f"{type(self).__name__}.describe_one: {name} must have the shape {list(shape)}{why}; "
                    f"got {list(found)}"
                )

    def _fill_core(self, buffers: dict[str, Any]) -> None:
        for lane in range(self.num_lanes):
            one = self._describe(lane)
            buffers["pose"][lane] = one.pose
            buffers["pose_cov"][lane] = one.pose_cov
            buffers["target_known"][lane] = one.target is not None
            if one.target is None or one.target_cov is None:
                for name in buffers:
                    if name.startswith("target_"):
                        buffers[name][lane] = 0
            else:
                fill_target(buffers, lane, self.lane_models[lane].target, one)

    def _fill_map(self, buffers: dict[str, Any]) -> None:
        buffers["landmark_id"].fill(-1)
        for name in ("landmark_count", "landmark_mapped", "landmark_mean", "landmark_cov", "landmark_rel"):
            buffers[name].fill(0)
        buffers["landmark_rel_cov"].fill(0)
        for lane in range(self.num_lanes):
            one = self._describe(lane)
            ids = np.asarray(one.landmark_ids, dtype=np.int64)
            buffers["landmark_count"][lane] = len(ids)
            buffers["landmark_id"][lane, : len(ids)] = ids
            buffers["landmark_mapped"][lane, : len(ids)] = True
            for j in range(len(ids)):
                cross = np.zeros((2, 3)) if one.landmark_pose_covs is None else one.landmark_pose_covs[j]
                rel, rel_cov = relative(one.pose, one.pose_cov, one.landmarks[j], one.landmark_covs[j], cross)
                buffers["landmark_mean"][lane, j] = one.landmarks[j]
                buffers["landmark_cov"][lane, j] = one.landmark_covs[j]
                buffers["landmark_rel"][lane, j] = rel
                buffers["landmark_rel_cov"][lane, j] = rel_cov


def relative(pose: Floats, pose_cov: Floats, point: Floats, cov: Floats, cross: Floats) -> tuple[Floats, Floats]:
    """A point in the robot's frame with its covariance.

    Args:
        pose: [3]. pose_cov: [3, 3]. point: [2], world. cov: [2, 2]. cross: [2, 3] covariance of point and pose.

    Returns:
        The point [2] (x forward, y left) and its covariance [2, 2], first order.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    to_robot = np.array([[c, s], [-s, c]])
    rel = to_robot @ (point - pose[:2])
    by_pose = np.column_stack([-to_robot, [rel[1], -rel[0]]])
    mixed = to_robot @ cross @ by_pose.T
    return rel, to_robot @ cov @ to_robot.T + by_pose @ pose_cov @ by_pose.T + mixed + mixed.T


def fill_target(buffers: dict[str, Any], lane: int, model: TargetModel | None, one: LaneBelief) -> None:
    """Write a known target into the belief's buffers: its own coordinates, and what follows from them."""
    assert model is not None and one.target is not None and one.target_cov is not None  # for the type checker
    mean, cov = one.target, one.target_cov
    cross = np.zeros((len(mean), 3)) if one.target_pose_cov is None else one.target_pose_cov
    if model.kind == "twist":
        heading = float(mean[2])
        along = np.array([math.cos(heading), math.sin(heading)])
        across = model.speed * np.array([-along[1], along[0]])
        velocity, velocity_cov = model.speed * along, cov[2, 2] * np.outer(across, across)
        heading_var = float(cov[2, 2])
    else:
        velocity, velocity_cov = mean[2:], cov[2:, 2:]
        heading, heading_var = course(velocity, velocity_cov)
    rel, rel_cov = relative(one.pose, one.pose_cov, mean[:2], cov[:2, :2], cross[:2])
    c, s = math.cos(one.pose[2]), math.sin(one.pose[2])
    buffers["target_mean"][lane], buffers["target_cov"][lane] = mean, cov
    buffers["target_position"][lane], buffers["target_position_cov"][lane] = mean[:2], cov[:2, :2]
    buffers["target_velocity"][lane], buffers["target_velocity_cov"][lane] = velocity, velocity_cov
    buffers["target_heading"][lane], buffers["target_heading_var"][lane] = heading, heading_var
    buffers["target_rel"][lane], buffers["target_rel_cov"][lane] = rel, rel_cov
    buffers["target_rel_velocity"][lane] = np.array([[c, s], [-s, c]]) @ velocity


def course(velocity: Floats, cov: Floats) -> tuple[float, float]:
    """Direction of a velocity [2] and its variance, at most that of a uniform heading."""
    square = float(velocity @ velocity)
    if square == 0.0:
        return 0.0, UNIFORM_HEADING_VAR
    slope = np.array([-velocity[1], velocity[0]]) / square
    return math.atan2(velocity[1], velocity[0]), min(float(slope @ cov @ slope), UNIFORM_HEADING_VAR)
