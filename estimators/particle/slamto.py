"""SLAMTO: Rao-Blackwellised SLAM with a moving target."""

from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from estimators.interface import Estimator, Floats, Ints, Scan
from estimators.kernels.existence import REMOVE_BELOW, check_remove_below, log_odds
from estimators.kernels.random import lane_key
from estimators.kernels.simd import aligned_zeros
from estimators.models import TWIST, MotionModel, SensorModel, TargetModel
from estimators.particle.belief import fill_map_lanes, fill_pose_lanes, fill_target_lanes
from estimators.particle.islands import MOST_ISLANDS
from estimators.particle.layout import EVENTS, HEADINGS, LANE, TWIST_ROWS, VELOCITY_ROWS
from estimators.particle.looks import LINEAR, LOOK
from estimators.particle.map_storage import (
    DENSE,
    STORES,
    TREE,
    allocate,
    bytes_in_use,
    clear,
    make_room,
    touches_left,
)
from estimators.particle.nearest import update_nearest_lanes
from estimators.particle.proposal import draw_start
from estimators.particle.steps import move_lanes, resample_lanes, update_lanes
from estimators.particle.target import predict_twist_lanes, predict_velocity_lanes, target_rows

How = tuple[int, Floats, Floats, Floats, Floats]
"""A proposal's kind, room for its looks, samples, work, box: see `particle.looks`."""

_KEY_PURPOSE = 17  # keeps the filter's stream apart from a world's that is given the same seed
_ASSOCIATIONS = ("known", "nearest")
_SCRATCH_ROWS = 23
_STATE = (
    "state", "pose", "pose_cov", "log_w", "w", "used", "exists", "ids", "maps", "points", "ancestors", "index",
    "target", "log_hypothesis",
)  # fmt: skip
_TARGET_BUFFERS = (
    "target_known", "target_mean", "target_cov", "target_velocity", "target_velocity_cov", "target_heading",
    "target_heading_var", "target_rel", "target_rel_cov", "target_rel_velocity",
)  # fmt: skip
_MAP_BUFFERS = (
    "landmark_count", "landmark_id", "landmark_mapped", "landmark_mean", "landmark_cov", "landmark_rel",
    "landmark_rel_cov",
)  # fmt: skip


class SLAMTO(Estimator):
    """Rao-Blackwellised SLAM with target tracking: weighted robot paths, small EKFs inside each.

    Wu and Sun, "Simultaneous localization, mapping and object tracking in an unknown environment using particle
    filtering", CAAI Transactions on Intelligent Systems 8(2), 2013. This is FastSLAM 1 (Montemerlo et al., AAAI 2002)
    with the target as one more small filter:

    1. predict: each particle draws its pose from the motion model with control noise; its target's EKF is predicted,
       Eqs. (16)-(17);
    2. update: each landmark seen and the target update their EKFs given the particle's pose, Eq. (18);
    3. weight: the product of all their likelihoods, each with its own innovation covariance S = A P A' + R,
       Eqs. (11)-(14), in the log domain and re-centred. Weights are kept while not resampling;
    4. systematic resampling once the effective number of particles 1 / sum w^2 falls below `resample_threshold` times
       their number. It waits for the next call, so that a belief is read from the weighted particles.

    The belief is the mixture's mean and covariance. Under per-particle association the map is the heaviest
    particle's, as slots of different particles need not be the same landmark.

    A target first seen: its position is known, its heading is not. A `twist` target starts as a Gaussian sum of eight
    headings in every particle, merged once they agree; it takes part in the weight from the second sighting on. A
    `constant-velocity` target starts at rest with `TargetModel.initial_speed_std`. After a long absence the update is
    iterated.

    What to expect, and what not: with 200 particles it reaches the errors that the paper reports (robot 0.040 m,
    target 0.068 m over 400 runs of its experiment 1). Its covariances are too small, and over long runs far too
    small: resampling copies histories, after some thousand steps all particles share one past, and the map's
    uncertainty along that past is lost. In the same world driven on for 3,200 steps the robot's error stays bounded
    (0.05 m), but the share of its NEES inside the 95 % bounds falls from 63 % (first 320 steps) to 15 % by step
    1,500; with 1,000 particles from 78 % to 17 %. The target itself is tracked honestly by every particle, also when
    seen again after 80 sweeps out of sight: its NEES (2 when honest) is 2.1 in the robot's frame, but 7.0 in the
    world's, by the pose's error.

    `islands` mend most of that at no cost: groups of particles that resample among themselves alone make their errors
    independently, and how far they lie apart is part of the covariance. The paper's filter is one group. 200 runs of
    the scenario `default` under `pursuit` (NEES is 3 for the pose and 2 for the target when honest), and of the above
    gap ("again": the target's NEES in the world's frame over the dozen sweeps after it):

    | 200 particles          | robot [m] | pose NEES | target NEES | diverged | again |
    |------------------------|-----------|-----------|-------------|----------|-------|
    | slamto                 | 0.29      | 131.8     | 15.2        | 70       | 7.0   |
    | slamto, 8 islands      | 0.25      | 5.0       | 3.2         | 0        | 2.4   |
    | slamto, 20 islands     | 0.26      | 3.7       | 2.8         | 0        | 2.0   |
    | fastslam2              | 0.25      | 60.7      | 10.1        | 50       | 5.5   |
    | fastslam2, 20 islands  | 0.23      | 3.7       | 2.8         | 0        | 2.0   |

    Without labels ("nearest") the robot's error in that experiment grows by 3 % (400 runs, on the same data; with
    `fastslam2` by 4 %). With a false alarm per sweep and one detection in twenty missed, the maps shown hold 98 to
    102 % of the landmarks that were seen.

    Args:
        particles: their number, at least 2.
        resample_threshold: share of the particles, in [0, 1]; 0 never resamples, 1 at every weighted update.
        islands: number of equal groups of particles that weigh and resample among themselves, each with the same
            share of the weight (see `particle.islands`); 1: the paper's filter.
        association: "known" uses the labels; "nearest" ignores them (but for `TARGET`) and lets each particle decide,
            by gated maximum likelihood with mutual exclusion (to which "jcbb" would reduce: given its pose, a
            particle's landmarks are independent).
        gate: "known": NIS (2 dof) above which, in particles of more than half the weight, a labelled return is
            refused; infinite by default.
        match_gate, new_gate: "nearest": a return within `match_gate` of a landmark is its; outside `new_gate` of
            all it is a new landmark; between the two it is left alone.
        remove_below: "nearest": probability of existence below which a particle removes a landmark that should have
            been seen and was not, and with which false alarms are kept out of the belief (`kernels.existence`); 0
            keeps and shows everything.
        map_storage: "lazy" puts a landmark's column into the particles' order when it is seen again, "tree" is the
            shared binary tree of Wang et al. 2019, "dense" moves the whole map at each resampling: the same numbers
            bit for bit, see `particle.map_storage`, and `map_bytes`. "nearest" reads every column in every sweep and
            is always dense.
    """

    name: ClassVar[str] = "slamto"
    summary: ClassVar[str] = "Rao-Blackwellised particles with EKFs for landmarks and target (Wu and Sun 2013)"
    _pose_cov_rows: ClassVar[int] = 0

    def __init__(
        self,
        motion: MotionModel,
        sensor: SensorModel,
        target: TargetModel | None,
        *,
        num_lanes: int = 1,
        max_landmarks: int,
        particles: int = 200,
        resample_threshold: float = 0.5,
        islands: int = 1,
        association: Literal["known", "nearest"] = "known",
        gate: float = np.inf,
        match_gate: float = 16.0,
        new_gate: float = 25.0,
        remove_below: float = REMOVE_BELOW,
        map_storage: Literal["lazy", "tree", "dense"] = "lazy",
    ) -> None:
        super().__init__(motion, sensor, target, num_lanes=num_lanes, max_landmarks=max_landmarks)
        if target is not None and target.kind == "imm":
            raise ValueError(
                'particle filters know "twist" and "constant-velocity" targets, not "imm"; take one of them'
            )
        if particles < 2:
            raise ValueError(f"particles must be at least 2; got {particles}")
        if not (1 <= islands <= MOST_ISLANDS and particles % islands == 0 and particles >= 2 * islands):
            raise ValueError(
                f"islands must be 1 to {MOST_ISLANDS} equal groups of at least two particles; got {islands} for "
                f"{particles} particles"
            )
        if not 0.0 <= resample_threshold <= 1.0:
            raise ValueError(f"resample_threshold is a share of the particles, in [0, 1]; got {resample_threshold}")
        if association not in _ASSOCIATIONS:
            raise ValueError(f"association must be one of {', '.join(map(repr, _ASSOCIATIONS))}; got {association!r}")
        if not (gate > 0.0 and 0.0 < match_gate <= new_gate):
            raise ValueError(
                f"gates are positive and match_gate at most new_gate; got gate={gate}, match_gate={match_gate}, "
                f"new_gate={new_gate}"
            )
        check_remove_below(remove_below)
        self.remove_below = 0.0 if association == "known" else float(remove_below)
        self.num_particles, self.resample_threshold = int(particles), float(resample_threshold)
        self.islands = int(islands)
        if map_storage not in STORES:
            raise ValueError(f"map_storage must be one of {', '.join(map(repr, STORES))}; got {map_storage!r}")
        self.association = association
        self._store = STORES[map_storage] if association == "known" else DENSE
        self.gate, self.match_gate, self.new_gate = float(gate), float(match_gate), float(new_gate)
        self._allocate()
        self.reset(np.zeros(3), np.zeros((3, 3)), seeds=np.arange(self.num_lanes))

    def _allocate(self) -> None:
        L, M, N = self.num_lanes, self.max_landmarks, self.num_particles
        twist = self.models["target_kind"][0] == TWIST
        rows = (TWIST_ROWS if twist else VELOCITY_ROWS) if self.target is not None else 0
        hypotheses = (HEADINGS if twist else 1) if self.target is not None else 0
        self._state = np.zeros(L, dtype=LANE)
        self._pose = aligned_zeros(L, 3, N)
        self._pose_cov = aligned_zeros(L, self._pose_cov_rows, N)
        self._log_w, self._w = np.zeros((L, N)), np.zeros((L, N))
        self._used = np.zeros((L, N), dtype=np.int64)
        self._exists = np.zeros((L, M if self.remove_below > 0.0 else 0, N))
        self._ids = np.full((L, M), -1, dtype=np.int64)
        self._maps, self._points, self._ancestors, self._index = allocate(L, M, N, self._store)
        self._target = aligned_zeros(L, hypotheses, rows, N)
        self._log_hypothesis = np.zeros((L, hypotheses, N))
        self._scratch = aligned_zeros(_SCRATCH_ROWS, N)
        self._normals = np.zeros((4, (N + 1) // 2))
        self._is_due = False  # whether some lane is to be resampled
        self._touches_left = 0  # of landmarks, before there may be no room for more
        self._proposed = np.zeros((L, 0), dtype=np.int64)
        self._places = np.zeros((3, N), dtype=np.int64)
        self._dt = np.zeros(L)
        self._how: How = LINEAR, np.zeros((0, LOOK)), np.zeros((0, 4)), np.zeros((0, 3)), np.zeros(3)
        self._returns = (np.zeros((0, N)), np.zeros((0, N)), np.zeros((0, N), dtype=np.int64), np.zeros(0))

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
        """See `Estimator.reset`: particles are drawn from the prior."""
        prior = self._prior(pose, pose_cov, seeds, target, target_cov, lanes)
        chosen = prior.lanes
        self._state[chosen] = np.zeros((), dtype=LANE)
        self._ids[chosen] = -1
        cleared = self._index[chosen]
        clear(cleared, self._maps.shape[1], self._store, self.max_landmarks)
        self._index[chosen] = cleared
        self._log_w[chosen], self._w[chosen], self._used[chosen] = 0.0, 1.0 / self.num_particles, 0
        for i, lane in enumerate(chosen):
            key = lane_key(prior.seeds[i], _KEY_PURPOSE)
            self._state["key"][lane] = key
            self._start(lane, prior.pose[i], prior.pose_cov[i], key)
            if prior.target is not None and prior.target_cov is not None:
                self._target[lane, 0] = target_rows(prior.target[i], prior.target_cov[i])[:, None]
                self._log_hypothesis[lane, 0] = 0.0
                self._state["hypotheses"][lane] = 1
        self._resample_lanes(self.all_lanes[:0])  # compiled now, not in the middle of an episode
        self.belief.mark_stale()

    def _start(self, lane: int, mean: Floats, cov: Floats, key: np.uint64) -> None:
        """Draw one lane's particles from the prior."""
        self._pose[lane] = draw_start(mean, cov, key, self.num_particles)

    def predict(self, control: Floats, dt: float | Floats, *, lanes: Ints | None = None) -> None:
        """See `Estimator.predict`: robot and target in each particle."""
        chosen = self.all_lanes if lanes is None else lanes
        self._dt[:] = dt
        self._resample(chosen)
        self._move(chosen, control)
        if self.target is not None:
            predict_target = predict_twist_lanes if self.target.kind == "twist" else predict_velocity_lanes
            predict_target(chosen, self._dt, self.models, self._state, self._target)
        self.belief.mark_stale()

    def _move(self, chosen: Ints, control: Floats) -> None:
        """Each particle draws its own motion."""
        move_lanes(chosen, control, self._dt, self.models, self._state, self._pose, self._normals)

    def update(self, scan: Scan, *, lanes: Ints | None = None) -> None:
        """See `Estimator.update`: EKFs inside each particle, then the weights."""
        chosen = self.all_lanes if lanes is None else lanes
        self._resample(chosen)
        self._widen(scan)
        if self.association == "known":
            is_due = update_lanes(
                chosen, scan.ranges, scan.bearings, scan.labels, scan.count, self._proposed, self.models, self._state,
                self._ids, self._pose, self._maps, self._points, self._ancestors, self._index, self._target,
                self._log_hypothesis, self._log_w, self._w, self._scratch, self.gate, self.islands,
                self.resample_threshold, self._how[0],
            )  # fmt: skip
        else:
            is_due = update_nearest_lanes(
                chosen, scan.ranges, scan.bearings, scan.labels, scan.count, scan.complete, self.models, self._state,
                self._pose, self._pose_cov, self._maps, self._used, self._exists, self._target, self._log_hypothesis,
                self._log_w, self._w, self._scratch, self._normals, *self._returns, self.match_gate, self.new_gate,
                log_odds(self.remove_below), self.islands, self.resample_threshold, self._how,
            )  # fmt: skip
        self._is_due = self._is_due or is_due
        self.belief.mark_stale()

    def _widen(self, scan: Scan) -> None:
        """Room for a sweep: scratch, and space in the map for what it may touch."""
        width = scan.ranges.shape[1]
        if self._touches_left < width:
            self._maps, self._points, self._ancestors = make_room(
                self._maps, self._points, self._ancestors, self._index, int(scan.count.max()), self.max_landmarks
            )
            self._touches_left = touches_left(self._maps, self._index, self.max_landmarks)
        self._touches_left -= width
        if self._proposed.shape[1] < width:
            self._proposed = np.zeros((self.num_lanes, width), dtype=np.int64)
        if self.association != "known" and self._returns[0].shape[0] < width:
            shape = (width, self.num_particles)
            self._returns = (np.zeros(shape), np.zeros(shape), np.zeros(shape, dtype=np.int64), np.zeros(width))

    def _resample(self, chosen: Ints) -> None:
        if self._store == TREE or self._is_due:  # else, as is usual, not even a kernel call
            self._resample_lanes(chosen)
            self._is_due = len(chosen) < self.num_lanes and bool(self._state["due"].any())

    def _resample_lanes(self, chosen: Ints) -> None:
        resample_lanes(
            chosen, self._state, self._pose, self._pose_cov, self._maps, self._points, self._ancestors, self._index,
            self._target, self._log_hypothesis, self._log_w, self._w, self._used, self._exists, self._places,
            self.islands,
        )  # fmt: skip

    def _fill_core(self, buffers: dict[str, Any]) -> None:
        fill_pose_lanes(self._pose, self._pose_cov, self._w, self._scratch, buffers["pose"], buffers["pose_cov"])
        if self.target is None:
            return
        filled = [buffers[name] for name in _TARGET_BUFFERS]
        if not self._state["hypotheses"].all():
            for buffer in filled:
                buffer[...] = 0
        fill_target_lanes(
            self.models, self._state, self._pose, self._pose_cov, self._target, self._log_hypothesis, self._w,
            self._scratch, *filled,
        )  # fmt: skip
        buffers["target_position"][:] = buffers["target_mean"][:, :2]
        buffers["target_position_cov"][:] = buffers["target_cov"][:, :2, :2]

    def _fill_map(self, buffers: dict[str, Any]) -> None:
        filled = [buffers[name] for name in _MAP_BUFFERS]
        for buffer in filled:
            buffer[...] = 0
        buffers["landmark_id"].fill(-1)
        fill_map_lanes(
            self._state, self._ids, self._used, self._pose, self._pose_cov, self._maps, self._points,
            self._ancestors, self._index, self._w, self.association != "known", self._exists, self._scratch, *filled,
        )  # fmt: skip

    @property
    def counts(self) -> dict[str, Ints]:
        """See `Estimator.counts`; the events are explained in `particle.layout`."""
        return {name: self._state[name].copy() for name in EVENTS}

    def particles(self, lane: int) -> tuple[Floats, Floats]:
        """See `Belief.particles`."""
        return self._pose[lane].T.copy(), self._w[lane].copy()

    def map_bytes(self) -> Ints:
        """Bytes that hold each lane's maps of all particles at this moment: [L].

        Counted is what the numbers and the links between them need: "dense", five doubles per landmark and particle;
        "lazy", the columns in use, the collapsed landmarks, the rows of ancestors in use and two links per landmark;
        "tree", the leaves and nodes that somebody refers to, the roots, and columns not yet put back. Room kept for
        later (unused buffers and nodes) is not counted.
        """
        return bytes_in_use(self._maps, self._points, self._ancestors, self._index, self._state["count"])

    def get_state(self) -> dict[str, Any]:
        """See `Estimator.get_state`."""
        return {name: getattr(self, f"_{name}").copy() for name in _STATE} | {"models": self.models.copy()}

    def set_state(self, state: dict[str, Any]) -> None:
        """See `Estimator.set_state`."""
        for name in _STATE:
            setattr(self, f"_{name}", state[name].copy())
        self._is_due, self._touches_left = bool(self._state["due"].any()), 0
        self.models[...] = state["models"]
        self.belief.mark_stale()
