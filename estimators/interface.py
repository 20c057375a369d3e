"""The contract every estimator meets: `Scan` in, `Belief` out, one method per event.

Everything carries the lane axis first: L independent robots, each with its own belief. `M` is the capacity for
landmarks, `K` the width of a scan, `n_t` the size of the target's state (0 without a target).
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimators.belief import Belief, Cloud
from estimators.models import MODEL, MotionModel, SensorModel, TargetModel, pack_models
from estimators.scan import TARGET, UNKNOWN, Bools, Floats, Ints, Scan

if TYPE_CHECKING:
    from estimators.kernels.bound import Bound

__all__ = [
    "TARGET", "UNKNOWN", "Belief", "Bools", "BoundCalls", "Cloud", "Estimator", "Floats", "Ints", "Prior", "Scan",
    "TruthAware",
]  # fmt: skip


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
