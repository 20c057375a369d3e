"""The contract every estimator meets: `Scan` in, `Belief` out, one method per event.

Everything carries the lane axis first: L independent robots, each with its own belief. `M` is the capacity for
landmarks, `K` the width of a scan, `n_t` the size of the target's state (0 without a target).
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimators.models import MODEL, MotionModel, SensorModel, TargetModel, pack_models

if TYPE_CHECKING:
    from estimators.kernels.bound import Bound

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

UNKNOWN = -1  # a return whose source the sensor does not tell
TARGET = -2  # a return that the sensor knows to be the target's


@dataclass(slots=True)
class Scan:
    """One sweep per lane: every return in one list.

    Attributes:
        ranges: [L, K] metres; entries from `count` on are meaningless.
        bearings: [L, K] radians from the heading, left positive, in [-pi, pi).
        labels: [L, K] a landmark's id (>= 0), `TARGET` or `UNKNOWN`.
        count: [L] number of returns, at most K.
        complete: [L] whether the absence of a return is evidence (a recording that omits empty sweeps says no).
    """

    ranges: Floats
    bearings: Floats
    labels: Ints
    count: Ints
    complete: Bools

    @classmethod
    def empty(cls, num_lanes: int, width: int) -> Self:
        """A scan without returns, to be filled in place."""
        return cls(
            np.zeros((num_lanes, width)),
            np.zeros((num_lanes, width)),
            np.full((num_lanes, width), UNKNOWN, dtype=np.int64),
            np.zeros(num_lanes, dtype=np.int64),
            np.ones(num_lanes, dtype=np.bool_),
        )


class BoundCalls(NamedTuple):
    """An estimator's kernels for arrays that stay (see `estimators.kernels.bound`); each takes the lanes."""

    predict: "Bound"
    update: "Bound"
    fill: "Bound"  # the belief's buffers, all of them
    scratch: tuple[Any, ...] = ()  # arrays that these write and nobody reads: threads need their own


@dataclass(frozen=True, slots=True)
class Prior:
    """What `reset` was given, checked and laid out per lane: n lanes in the order named."""

    lanes: Ints  # [n]
    pose: Floats  # [n, 3], heading wrapped
    pose_cov: Floats  # [n, 3, 3]
    seeds: Ints  # [n]
    target: Floats | None  # [n, n_t]
    target_cov: Floats | None  # [n, n_t, n_t]


def _fit(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Floats:
    """A finite array of that shape, repeated over the first axis where it is missing."""
    array = np.asarray(value, dtype=np.float64)
    if array.shape not in (shape, shape[1:]):
        raise ValueError(f"{name} must have shape {list(shape)} or {list(shape[1:])}; got {list(array.shape)}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite; got NaN or infinity")
    return np.array(np.broadcast_to(array, shape))


class Cloud(Protocol):
    """What `Belief.target_cloud` reads: see `estimators.target_cloud.TargetCloud`."""

    def points(self) -> tuple[Floats, Floats]:
        """Positions [L, N, 2] and weights [L, N]."""

    def foresee(self, lane: int, dt: float, ahead: Floats) -> None:
        """Where one lane's points will be after dt, 2 dt, ... seconds, into `ahead` [T, N, 2]."""


class Belief:
    """What an estimator believes, the same shape for every family. Buffers, valid until the estimator's next call.

    Read them as attributes; those who record history copy. Angles in radians, lengths in metres.

    Robot and target (refreshed together):
        pose [L, 3], pose_cov [L, 3, 3]: world frame (x, y, heading).
        target_known [L]: whether the target has been initialised. Where it is not, the target's numbers are zero
            and its covariances zero.
        target_mean [L, n_t], target_cov [L, n_t, n_t]: in the model's own coordinates, named by `target_names`.
        target_position [L, 2], target_position_cov [L, 2, 2], target_velocity [L, 2],
            target_velocity_cov [L, 2, 2], target_heading [L], target_heading_var [L]: world frame, derived.
        target_rel [L, 2], target_rel_cov [L, 2, 2]: position in the ROBOT's frame (x forward, y left) with the
            covariance that includes the cross terms with the pose.
        target_rel_velocity [L, 2]: the target's world velocity turned into the robot's axes.
    Landmarks (refreshed on first use):
        landmark_count [L]; landmark_id [L, M] (-1: empty slot); landmark_mapped [L, M];
        landmark_mean [L, M, 2], landmark_cov [L, M, 2, 2]: world frame;
        landmark_rel [L, M, 2], landmark_rel_cov [L, M, 2, 2]: robot frame, cross terms included.
    """

    _CORE: ClassVar[tuple[str, ...]] = (
        "pose", "pose_cov", "target_known", "target_mean", "target_cov", "target_position", "target_position_cov",
        "target_velocity", "target_velocity_cov", "target_heading", "target_heading_var", "target_rel",
        "target_rel_cov", "target_rel_velocity",
    )  # fmt: skip
    _MAP: ClassVar[tuple[str, ...]] = (
        "landmark_count", "landmark_id", "landmark_mapped", "landmark_mean", "landmark_cov", "landmark_rel",
        "landmark_rel_cov",
    )  # fmt: skip

    pose: Floats
    pose_cov: Floats
    target_known: Bools
    target_mean: Floats
    target_cov: Floats
    target_position: Floats
    target_position_cov: Floats
    target_velocity: Floats
    target_velocity_cov: Floats
    target_heading: Floats
    target_heading_var: Floats
    target_rel: Floats
    target_rel_cov: Floats
    target_rel_velocity: Floats
    landmark_count: Ints
    landmark_id: Ints
    landmark_mapped: Bools
    landmark_mean: Floats
    landmark_cov: Floats
    landmark_rel: Floats
    landmark_rel_cov: Floats

    def __init__(self, estimator: "Estimator", num_lanes: int, max_landmarks: int, target_names: tuple[str, ...]):
        L, M, n_t = num_lanes, max_landmarks, len(target_names)
        self._estimator = estimator
        self._cloud: Cloud | None = None
        self.target_names = target_names
        self._core_stale = self._map_stale = True
        shapes: dict[str, tuple[int, ...]] = {
            "pose": (L, 3), "pose_cov": (L, 3, 3), "target_known": (L,), "target_mean": (L, n_t),
            "target_cov": (L, n_t, n_t), "target_position": (L, 2), "target_position_cov": (L, 2, 2),
            "target_velocity": (L, 2), "target_velocity_cov": (L, 2, 2), "target_heading": (L,),
            "target_heading_var": (L,), "target_rel": (L, 2), "target_rel_cov": (L, 2, 2),
            "target_rel_velocity": (L, 2), "landmark_count": (L,), "landmark_id": (L, M), "landmark_mapped": (L, M),
            "landmark_mean": (L, M, 2), "landmark_cov": (L, M, 2, 2), "landmark_rel": (L, M, 2),
            "landmark_rel_cov": (L, M, 2, 2),
        }  # fmt: skip
        kinds = {
            "target_known": np.bool_,
            "landmark_mapped": np.bool_,
            "landmark_count": np.int64,
            "landmark_id": np.int64,
        }
        self.buffers: dict[str, Any] = {k: np.zeros(s, dtype=kinds.get(k, np.float64)) for k, s in shapes.items()}
        self.buffers["landmark_id"].fill(-1)

    def mark_stale(self) -> None:
        """Called by the estimator whenever its state has changed."""
        self._core_stale = self._map_stale = True

    def mark_fresh(self) -> None:
        """Called by those who fill `buffers` in all lanes through `BoundCalls.fill`."""
        self._core_stale = self._map_stale = False

    @property
    def is_stale(self) -> bool:
        """Whether the estimator has changed since `buffers` were filled, as far as it has said so."""
        return self._core_stale or self._map_stale

    def refresh(self) -> None:
        """Bring `buffers` up to date, for those who read them there."""
        if self._core_stale:
            self._core_stale = False
            self._estimator._fill_core(self.buffers)
        if self._map_stale:
            self._map_stale = False
            self._estimator._fill_map(self.buffers)

    def joint(self, lane: int) -> tuple[Floats, Floats]:
        """Mean [n] and covariance [n, n] of the joint Gaussian (robot, target, landmarks) of one lane, as copies.

        Raises:
            NotImplementedError: the family has no joint Gaussian.
        """
        return self._estimator.joint(lane)

    def attach_cloud(self, cloud: "Cloud") -> None:
        """Called by a `TargetCloud` when it is built: `target_cloud` then gives its points."""
        self._cloud = cloud

    @property
    def has_target_cloud(self) -> bool:
        """Whether `target_cloud` can be read."""
        return self._cloud is not None

    @property
    def target_cloud(self) -> tuple[Floats, Floats]:
        """Where a lost target may be: points [L, N, 2] in the world's frame and weights [L, N] that sum to one.

        While the target is seen, points of its Gaussian.

        Raises:
            RuntimeError: no cloud accompanies the estimator.
        """
        return self._attached_cloud().points()

    def foresee_target(self, lane: int, dt: float, ahead: Floats) -> None:
        """Where the points of one lane's `target_cloud` will be after dt, 2 dt, ... seconds, into `ahead` [T, N, 2].

        One way that each may go, drawn from the target's model; the weights stay.

        Raises:
            RuntimeError: no cloud accompanies the estimator.
        """
        self._attached_cloud().foresee(lane, dt, ahead)

    def _attached_cloud(self) -> Cloud:
        if self._cloud is None:
            raise RuntimeError(
                "no target cloud accompanies this estimator: build estimators.TargetCloud(estimator, num_points=256) "
                "and call its predict and update after the estimator's; in an environment pass target_cloud=256; a "
                "policy class sets needs_target_cloud = 256"
            )
        return self._cloud

    def particles(self, lane: int) -> tuple[Floats, Floats]:
        """Poses [N, 3] and weights [N] of one lane's particles, as copies.

        Raises:
            NotImplementedError: the family has no particles.
        """
        return self._estimator.particles(lane)


def _buffer_property(name: str, stale: str, refresh: str) -> property:
    def get(self: Belief) -> Any:
        if getattr(self, stale):
            setattr(self, stale, False)
            getattr(self._estimator, refresh)(self.buffers)
        return self.buffers[name]

    return property(get)


for _name in Belief._CORE:
    setattr(Belief, _name, _buffer_property(_name, "_core_stale", "_fill_core"))
for _name in Belief._MAP:
    setattr(Belief, _name, _buffer_property(_name, "_map_stale", "_fill_map"))


class Estimator(ABC):
    """A filter for robot pose, landmarks and a moving target, over L lanes.

    Args:
        motion: how the robot moves.
        sensor: what the sensor reports.
        target: how the target moves; None in a world without one.
        num_lanes: L, independent robots filtered side by side.
        max_landmarks: M, capacity of the map; a landmark beyond it is ignored and counted in `counts`.
        **options: the filter's own, named and documented by each class.
    """

    name: ClassVar[str] = ""  # as in the registry
    summary: ClassVar[str] = ""  # one line for `slam-gym list`

    def __init__(
        self,
        motion: MotionModel,
        sensor: SensorModel,
        target: TargetModel | None,
        *,
        num_lanes: int = 1,
        max_landmarks: int,
    ) -> None:
        if num_lanes < 1:
            raise ValueError(f"num_lanes must be at least 1; got {num_lanes}")
        if max_landmarks < 1:
            raise ValueError(f"max_landmarks must be at least 1; got {max_landmarks}")
        self.motion, self.sensor, self.target = motion, sensor, target
        self.num_lanes, self.max_landmarks = int(num_lanes), int(max_landmarks)
        self.target_names = target.coordinates if target is not None else ()
        self.models: NDArray[np.void] = np.empty(self.num_lanes, dtype=MODEL)  # [L], what kernels read
        self.models[:] = pack_models(motion, sensor, target)
        self.all_lanes: Ints = np.arange(self.num_lanes)
        self.belief = Belief(self, self.num_lanes, self.max_landmarks, self.target_names)

    def set_models(self, lane: int, motion: MotionModel, sensor: SensorModel, target: TargetModel | None) -> None:
        """Give one lane models of its own (numbers drawn anew each episode); call before `reset`.

        Raises:
            ValueError: the target's kind differs from the one at construction (its state has another size).
        """
        if (target.coordinates if target is not None else ()) != self.target_names:
            raise ValueError("the target model's kind is fixed at construction; only its numbers may change")
        self.models[lane] = pack_models(motion, sensor, target)

    @abstractmethod
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
        """Forget everything in the named lanes and start from a prior.

        Args:
            pose: [n, 3] or [3], world frame. pose_cov: [n, 3, 3] or [3, 3]; zero is legal (a known start).
            seeds: [n] one integer per lane: the estimator's own random stream.
            target: [n, n_t] or [n_t] prior mean in `target_names`; None: unknown until first seen.
            target_cov: [n, n_t, n_t] or [n_t, n_t]; needed with `target`.
            lanes: [n] distinct lane indices; None: all, n = L.
        """

    @abstractmethod
    def predict(self, control: Floats, dt: float | Floats, *, lanes: Ints | None = None) -> None:
        """Move robot and target on by dt seconds. control: [L, 2], what odometry reports; dt: scalar or [L]."""

    @abstractmethod
    def update(self, scan: Scan, *, lanes: Ints | None = None) -> None:
        """Take in one sweep, in the lanes where it is due (arrays in `scan` span all L lanes)."""

    def bound_calls(self, control: Floats, dt: Floats, scan: Scan) -> BoundCalls | None:
        """The kernels that do what `predict` and `update` do with these very arrays; None: call the methods.

        control: [L, 2]; dt: [L]. The first two leave the belief stale without saying so: call the third, or
        `Belief.mark_stale`.
        """
        return None

    @abstractmethod
    def _fill_core(self, buffers: dict[str, Any]) -> None:
        """Write robot and target into the belief's buffers (see `Belief`)."""

    @abstractmethod
    def _fill_map(self, buffers: dict[str, Any]) -> None:
        """Write the landmarks into the belief's buffers (see `Belief`)."""

    def _prior(
        self,
        pose: ArrayLike,
        pose_cov: ArrayLike,
        seeds: ArrayLike,
        target: ArrayLike | None,
        target_cov: ArrayLike | None,
        lanes: Ints | None,
    ) -> Prior:
        """Check and lay out the arguments of `reset`.

        Raises:
            ValueError: a wrong shape, a number that is not finite, an unknown or repeated lane, a target prior
                without covariance or in a world without a target.
        """
        chosen = self.all_lanes if lanes is None else np.atleast_1d(np.asarray(lanes, dtype=np.int64))
        if len(np.unique(chosen)) != len(chosen) or ((chosen < 0) | (chosen >= self.num_lanes)).any():
            raise ValueError(f"lanes must be distinct indices below {self.num_lanes}; got {chosen.tolist()}")
        n, n_t = len(chosen), len(self.target_names)
        mean = _fit("pose", pose, (n, 3))
        mean[:, 2] = (mean[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
        cov = _fit("pose_cov", pose_cov, (n, 3, 3))
        seed = np.asarray(seeds, dtype=np.int64)
        if seed.shape not in ((n,), ()):
            raise ValueError(f"seeds must be one integer per lane, shape [{n}]; got {list(seed.shape)}")
        if (target is None) != (target_cov is None):
            raise ValueError("target and target_cov go together: give both, or neither for a target not yet seen")
        if target is None or target_cov is None:
            return Prior(chosen, mean, cov, np.array(np.broadcast_to(seed, (n,))), None, None)
        if n_t == 0:
            raise ValueError("a target prior was given to an estimator built without a target model")
        names = ", ".join(self.target_names)
        target_mean = _fit(f"target ({names})", target, (n, n_t))
        target_mean_cov = _fit("target_cov", target_cov, (n, n_t, n_t))
        return Prior(chosen, mean, cov, np.array(np.broadcast_to(seed, (n,))), target_mean, target_mean_cov)

    @property
    def counts(self) -> dict[str, Ints]:
        """What went wrong since `reset`, by name: [L] integers (gate rejections, overflow, collapsed weights, ...)."""
        return {}

    def joint(self, lane: int) -> tuple[Floats, Floats]:
        """See `Belief.joint`."""
        raise NotImplementedError(f"{type(self).__name__} keeps no joint Gaussian")

    def particles(self, lane: int) -> tuple[Floats, Floats]:
        """See `Belief.particles`."""
        raise NotImplementedError(f"{type(self).__name__} keeps no particles")

    def get_state(self) -> dict[str, Any]:
        """Everything that changes between calls, as copies; `set_state` restores it bit for bit."""
        raise NotImplementedError

    def set_state(self, state: dict[str, Any]) -> None:
        """Restore what `get_state` returned."""
        raise NotImplementedError


class TruthAware(ABC):
    """Mixin of reference filters that are handed the truth before every predict and update; benchmarks only."""

    @abstractmethod
    def set_truth(self, pose: Floats, target: Floats, landmarks: Floats) -> None:
        """Pass pose [L, 3]; target [L, 4] (x, y, velocity_x, velocity_y); landmarks [L, N, 2], the id as index."""
