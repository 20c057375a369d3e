"""SLAM and target tracking apart: any SLAM filter, and a target filter that takes its pose for exact.

The baseline of Table 1, Wu and Sun 2013: what is lost when the two do not share their covariance. The target filter
believes the pose, so that it is overconfident wherever the pose is uncertain.
"""

from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from estimators.dead_reckoning import DeadReckoning
from estimators.gaussian.sweep import associate
from estimators.interface import TARGET, Belief, Estimator, Floats, Ints, Scan, TruthAware
from estimators.kernels.association import TARGET_SLOT
from estimators.kernels.gaussian import ROBOT
from estimators.kernels.jit import inline, jit
from estimators.models import MotionModel, SensorModel, TargetModel
from estimators.registry import make

_POSE = ("pose", "pose_cov")


@jit
def believe_pose(mu, P, pose, lanes, copies):
    """Put the robot where the SLAM filter says, known exactly, uncorrelated with the target.

    pose: one for every `copies` lanes.
    """
    for i in range(lanes.size):
        lane = lanes[i]
        for k in range(ROBOT):
            mu[lane, k] = pose[lane // copies, k]
            for other in range(P.shape[1]):
                P[lane, k, other] = 0.0
                P[lane, other, k] = 0.0


@inline
def hand_on(ranges, bearings, lane, k, label, to_ranges, to_bearings, to_labels, to_count):
    """Append return k to another sweep."""
    at = to_count[lane]
    to_ranges[lane, at], to_bearings[lane, at], to_labels[lane, at] = ranges[lane, k], bearings[lane, k], label
    to_count[lane] = at + 1


@jit
def split(
    mu, P, models, n_t, count, ids, target_known, ranges, bearings, labels, num_returns, code, gates, cost, slots,
    lanes, counters, rest_ranges, rest_bearings, rest_labels, rest_count, own_ranges, own_bearings, own_labels,
    own_count,
):  # fmt: skip
    """Part a sweep into the target's own returns and the rest; a TARGET return that is no use is in neither."""
    for i in range(lanes.size):
        lane = lanes[i]
        rest_count[lane] = own_count[lane] = 0
        associate(
            lane, mu, P, models[lane], n_t, count, ids, target_known, counters, ranges, bearings, labels,
            num_returns[lane], code, gates, cost, slots,
        )  # fmt: skip
        for k in range(num_returns[lane]):
            label = labels[lane, k]
            if slots[lane, k] == TARGET_SLOT:
                hand_on(ranges, bearings, lane, k, TARGET, own_ranges, own_bearings, own_labels, own_count)
            elif label != TARGET:
                hand_on(ranges, bearings, lane, k, label, rest_ranges, rest_bearings, rest_labels, rest_count)


class Independent(Estimator):
    """Any SLAM filter, and apart from it an EKF for the target that takes the estimated pose for exact.

    Args:
        motion, sensor, target, num_lanes, max_landmarks: see `Estimator`.
        slam: name of the SLAM filter; it runs without a target.
        slam_options: its options.
        association: "known", "nearest" or "jcbb", of both filters.
        gate: NIS (2 dof) above which the target's labelled return is rejected.
    """

    name = "independent"
    summary = "A SLAM filter and a separate target EKF that takes its pose for exact"

    def __init__(
        self,
        motion: MotionModel,
        sensor: SensorModel,
        target: TargetModel | None,
        *,
        num_lanes: int = 1,
        max_landmarks: int,
        slam: str = "ekf",
        slam_options: dict[str, Any] | None = None,
        association: Literal["known", "nearest", "jcbb"] = "known",
        gate: float = np.inf,
    ) -> None:
        super().__init__(motion, sensor, target, num_lanes=num_lanes, max_landmarks=max_landmarks)
        options = dict(slam_options or {})
        if association != "known":
            options.setdefault("association", association)
        self.slam = make(slam, motion, sensor, None, num_lanes=num_lanes, max_landmarks=max_landmarks, **options)
        if isinstance(self.slam, TruthAware):
            raise ValueError(f"slam={slam!r} is handed the truth and cannot run inside `independent`; choose another")
        self.tracker = DeadReckoning(
            motion, sensor, target, num_lanes=num_lanes, max_landmarks=1, association=association, gate=gate
        )
        self._rest, self._own = Scan.empty(num_lanes, 0), Scan.empty(num_lanes, 0)
        self._uncounted = np.zeros_like(self.tracker.counters)  # the filters count for themselves

    def set_models(self, lane: int, motion: MotionModel, sensor: SensorModel, target: TargetModel | None) -> None:
        """See `Estimator.set_models`."""
        super().set_models(lane, motion, sensor, target)
        self.slam.set_models(lane, motion, sensor, None)
        self.tracker.set_models(lane, motion, sensor, target)

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
        self.slam.reset(pose, pose_cov, seeds=seeds, lanes=lanes)
        self.tracker.reset(pose, pose_cov, seeds=seeds, target=target, target_cov=target_cov, lanes=lanes)
        self._follow(self.all_lanes if lanes is None else np.atleast_1d(np.asarray(lanes, dtype=np.int64)))

    def predict(self, control: Floats, dt: float | Floats, *, lanes: Ints | None = None) -> None:
        """See `Estimator.predict`."""
        self.slam.predict(control, dt, lanes=lanes)
        self.tracker.predict(control, dt, lanes=lanes)
        self._follow(self.all_lanes if lanes is None else lanes)

    def update(self, scan: Scan, *, lanes: Ints | None = None) -> None:
        """See `Estimator.update`."""
        chosen = self.all_lanes if lanes is None else lanes
        self._part(scan, chosen)
        self.slam.update(self._rest, lanes=lanes)
        self._follow(chosen)
        self.tracker.update(self._own, lanes=lanes)
        self.belief.mark_stale()

    def _follow(self, lanes: Ints) -> None:
        by, pose = self.tracker, self.slam.belief.pose
        believe_pose(by.mu, by.P, pose, lanes, 1)
        if by.bank is not None and by.bank.members is not None:
            believe_pose(by.bank.members.mu, by.bank.members.P, pose, by.bank.rows(lanes), by.bank.size)
        self.tracker.belief.mark_stale()
        self.belief.mark_stale()

    def _part(self, scan: Scan, lanes: Ints) -> None:
        """Fill `_rest` and `_own` from a sweep."""
        by, rest, own = self.tracker, self._rest, self._own
        width = scan.ranges.shape[1]
        if width != rest.ranges.shape[1]:
            rest, own = self._rest, self._own = Scan.empty(self.num_lanes, width), Scan.empty(self.num_lanes, width)
            by.make_room(width)
        rest.complete[:] = own.complete[:] = scan.complete
        split(
            by.mu, by.P, by.models, by.n_t, by.count, by.ids, by.target_known, scan.ranges, scan.bearings, scan.labels,
            scan.count, by.association_code, by.gates, by.cost, by.slots, lanes, self._uncounted, rest.ranges,
            rest.bearings, rest.labels, rest.count, own.ranges, own.bearings, own.labels, own.count,
        )  # fmt: skip

    def _fill_core(self, buffers: dict[str, Any]) -> None:
        for name in Belief._CORE:
            source = self.slam if name in _POSE else self.tracker
            buffers[name][...] = getattr(source.belief, name)

    def _fill_map(self, buffers: dict[str, Any]) -> None:
        for name in Belief._MAP:
            buffers[name][...] = getattr(self.slam.belief, name)

    @property
    def counts(self) -> dict[str, Ints]:
        """The SLAM filter's counts, and the target filter's under "target_..."."""
        return self.slam.counts | {f"target_{name}": values for name, values in self.tracker.counts.items()}

    def particles(self, lane: int) -> tuple[Floats, Floats]:
        """See `Belief.particles`: the SLAM filter's."""
        return self.slam.particles(lane)

    def get_state(self) -> dict[str, Any]:
        """See `Estimator.get_state`."""
        return {"slam": self.slam.get_state(), "tracker": self.tracker.get_state(), "models": self.models.copy()}

    def set_state(self, state: dict[str, Any]) -> None:
        """See `Estimator.set_state`."""
        self.slam.set_state(state["slam"])
        self.tracker.set_state(state["tracker"])
        self.models[:] = state["models"]
        self.belief.mark_stale()
