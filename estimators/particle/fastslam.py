"""FastSLAM 1 and FastSLAM 2, with the moving target in each particle."""

from typing import Any, ClassVar

import numpy as np

from estimators.interface import Floats, Ints, Scan
from estimators.kernels.association import DROPPED, NEW, TARGET_SLOT, slot_by_label
from estimators.kernels.borrow import borrow
from estimators.kernels.jit import jit
from estimators.models import NO_TARGET
from estimators.particle.columns import gather_weights
from estimators.particle.gaussian_pose import POSE_COV_ROWS, condition_on_point, draw_poses, predict_poses
from estimators.particle.layout import OPEN, REFUSED, USED
from estimators.particle.looks import LOOK, propose_from_looks_lanes
from estimators.particle.map_storage import open_column
from estimators.particle.slamto import SLAMTO
from estimators.particle.steps import FLUSH, begin_sweep
from estimators.particle.target import position_rows


@jit
def carry_lanes(lanes, control, dt, models, state, pose, pose_cov):
    """Every particle's Gaussian through one step, nothing drawn. control [L, 2], dt [L]."""
    pose, pose_cov = borrow(pose), borrow(pose_cov)
    for lane in lanes:
        if dt[lane] > 0.0:
            state[lane].step += 1
            x, c = pose[lane], pose_cov[lane]
            predict_poses(
                x[0], x[1], x[2], c[0], c[1], c[2], c[3], c[4], c[5], models[lane], control[lane, 0], control[lane, 1],
                dt[lane],
            )  # fmt: skip


@jit
def propose_lanes(
    lanes, ranges, bearings, labels, count, proposed, models, state, ids, pose, pose_cov, maps, points, ancestors,
    index, target, log_w, w, scratch, normals, gate,
):  # fmt: skip
    """Condition every pose on the returns of known points, weigh it by their likelihood, draw it.

    proposed: [L, K] written, for the update that follows. A sweep without a usable return leaves the poses as they
    are; a target whose heading is open takes no part here, its likelihood is weighed given the drawn pose.
    """
    ids, pose, pose_cov, maps, points = borrow(ids), borrow(pose), borrow(pose_cov), borrow(maps), borrow(points)
    ancestors, index, target = borrow(ancestors), borrow(index), borrow(target)
    log_w, w, scratch, normals = borrow(log_w), borrow(w), borrow(scratch), borrow(normals)
    for lane in lanes:
        begin_sweep(pose[lane], scratch)
        taken, usable = 0, 0
        has_target = models[lane].target_kind != NO_TARGET
        for k in range(count[lane]):
            proposed[lane, k] = OPEN
            distance, bearing = ranges[lane, k], bearings[lane, k]
            slot = slot_by_label(ids, lane, state[lane].count, labels[lane, k], distance, bearing, has_target)
            usable += slot != DROPPED
            if slot == DROPPED or slot == NEW or (slot == TARGET_SLOT and state[lane].hypotheses != 1):
                continue
            is_target = slot == TARGET_SLOT
            if is_target:
                point = target[lane, 0]
            else:
                point = open_column(slot, maps[lane], points[lane], ancestors[lane], index[lane])
            limit = models[lane].reinitialise_nis if is_target else gate
            p00, p01, p11 = position_rows(point)
            if condition_on_point(
                pose[lane], pose_cov[lane], point[0], point[1], p00, p01, p11, w[lane], scratch, scratch[2:4], distance,
                bearing, models[lane], limit,
            ):  # fmt: skip
                proposed[lane, k] = USED
                taken += 1
                if taken % FLUSH == 0:
                    gather_weights(log_w[lane], scratch[2], scratch[3])
            elif not is_target:
                proposed[lane, k] = REFUSED
                state[lane].gated += 1
        gather_weights(log_w[lane], scratch[2], scratch[3])
        if usable > 0:
            draw_poses(state[lane].key, state[lane].step, pose[lane], pose_cov[lane], normals)


class FastSLAM1(SLAMTO):
    """FastSLAM 1.0 with the moving target as one more small filter: `slamto` that resamples at every update.

    Montemerlo, Thrun, Koller and Wegbreit, "FastSLAM: a factored solution to the simultaneous localization and
    mapping problem", AAAI 2002. Particles draw their poses from the motion model alone, each landmark is an EKF given
    the particle's path, and the weight is the product of the returns' likelihoods.

    What differs from `slamto` is one default and nothing else: `resample_threshold` is 1, as the original resamples
    after every sweep that weighs the particles differently. With `resample_threshold=0.5` the two are the same filter,
    number for number; without a target it is the original. In experiment 1 the default makes no measurable difference
    (400 runs: robot 0.039 m, target 0.067 m, as `slamto`).

    Args:
        particles, islands, association, gate, match_gate, new_gate: see `SLAMTO`.
        resample_threshold: share of the particles, in [0, 1]; 1 resamples at every weighted update.
    """

    name: ClassVar[str] = "fastslam1"
    summary: ClassVar[str] = "FastSLAM 1.0 (Montemerlo et al. 2002) and the target: slamto, resampled at every update"

    def __init__(self, *models: Any, resample_threshold: float = 1.0, **options: Any) -> None:
        super().__init__(*models, resample_threshold=resample_threshold, **options)


class FastSLAM2(SLAMTO):
    """FastSLAM 2.0 with the moving target: each particle looks at the sweep before it draws its pose.

    Montemerlo, Thrun, Koller and Wegbreit, "FastSLAM 2.0: an improved particle filtering algorithm for simultaneous
    localization and mapping that provably converges", IJCAI 2003.

    1. predict: each particle's pose is a Gaussian, carried through the motion model, cov = F cov F' + G Q G'; nothing
       is drawn until something is seen. The target's EKF is predicted as in `slamto`;
    2. update: the pose is conditioned on one return after the other in Kalman form, S = H_x P_x H_x' + H_m P_m H_m' + R
       (P_m: the landmark's or the target's covariance). An odometry step's covariance has rank 2 and a known start
       rank 0, so P_x is never inverted;
    3. weight: the product of these innovations' densities, the sweep's likelihood with the pose integrated out;
    4. draw: the pose is drawn from the Gaussian and its covariance is zero again; then each landmark and the target
       take the same return given the drawn pose, as in `slamto`;
    5. systematic resampling as in `slamto`.

    The target takes part in the proposal once its heading is settled; while it is a Gaussian sum, and at first
    sightings, returns are weighed given the drawn pose. Between sweeps the belief is a mixture of Gaussians:
    `belief.pose_cov` and the relative covariances contain each particle's own, while `belief.particles` gives the
    Gaussians' means.

    With "nearest", returns are matched at the predicted pose with its covariance, in each particle for itself.

    What to expect: in the paper's experiment 1 of `slamto` (400 runs, 320 steps) 20 of these particles do what 200 of
    FastSLAM 1 do (robot 0.039 m, target 0.067 m); 200 reach 0.035 m and 0.065 m, with 89 % of the pose's and 94 % of
    the target's NEES inside the 95 % bounds. The weakness stays that of all particle filters here (see `slamto`):
    resampling loses the map's uncertainty along the common past, so that over long runs the covariances are too small,
    unless the particles live on `islands`.
    Returns are linearised one after the other at the pose that those before have left, and iterated only where the
    point's spread as seen exceeds a fifth of its distance.

    Args:
        particles, resample_threshold, islands, association, gate, match_gate, new_gate: see `SLAMTO`; the gate is on
            the NIS with S as above.
    """

    name: ClassVar[str] = "fastslam2"
    summary: ClassVar[str] = "FastSLAM 2.0 (Montemerlo et al. 2003) and the target: poses drawn after looking"
    _pose_cov_rows: ClassVar[int] = POSE_COV_ROWS

    def _allocate(self) -> None:
        super()._allocate()
        self._normals = np.zeros((4, self.num_particles))
        self._slots = np.zeros(0, dtype=np.int64)

    def _start(self, lane: int, mean: Floats, cov: Floats, key: np.uint64) -> None:
        """The prior as every particle's Gaussian: drawn when something is seen."""
        self._pose[lane] = mean[:, None]
        self._pose_cov[lane] = (0.5 * (cov + cov.T))[np.triu_indices(3)][:, None]

    def _move(self, chosen: Ints, control: Floats) -> None:
        """The Gaussians move."""
        carry_lanes(chosen, control, self._dt, self.models, self._state, self._pose, self._pose_cov)

    def update(self, scan: Scan, *, lanes: Ints | None = None) -> None:
        """See `Estimator.update`: poses conditioned and drawn, then the maps."""
        chosen = self.all_lanes if lanes is None else lanes
        self._resample(chosen)
        self._widen(scan)
        if self.association == "known":
            propose_lanes(
                chosen, scan.ranges, scan.bearings, scan.labels, scan.count, self._proposed, self.models, self._state,
                self._ids, self._pose, self._pose_cov, self._maps, self._points, self._ancestors, self._index,
                self._target, self._log_w, self._w, self._scratch, self._normals, self.gate,
            )  # fmt: skip
        super().update(scan, lanes=lanes)


class LookingFilter(FastSLAM2):
    """FastSLAM 2 with another proposal, made of all returns that a particle sees at once: see `particle.looks`.

    A filter sets `_how`: the proposal's kind, room for the looks, and what the kind needs (samples, work, box).
    """

    def update(self, scan: Scan, *, lanes: Ints | None = None) -> None:
        """See `Estimator.update`: poses improved and drawn, then the maps."""
        chosen = self.all_lanes if lanes is None else lanes
        self._resample(chosen)
        self._widen(scan)
        kind, looks, samples, work, box = self._how
        if len(looks) < scan.ranges.shape[1]:
            looks = np.zeros((scan.ranges.shape[1], LOOK))
            self._how = kind, looks, samples, work, box
            self._slots = np.zeros(len(looks), dtype=np.int64)
        if self.association == "known":
            propose_from_looks_lanes(
                chosen, scan.ranges, scan.bearings, scan.labels, scan.count, self._proposed, self.models, self._state,
                self._ids, self._pose, self._pose_cov, self._maps, self._points, self._ancestors, self._index,
                self._target, self._log_w, looks, self._slots, kind, samples, work, box, self._normals,
            )  # fmt: skip
        SLAMTO.update(self, scan, lanes=lanes)
