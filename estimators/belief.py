"""What estimators say: the belief about robot, target and landmarks, the same shape for every family."""

from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np

from estimators.scan import Bools, Floats, Ints

if TYPE_CHECKING:
    from estimators.interface import Estimator


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
