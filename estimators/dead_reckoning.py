"""Odometry alone: the floor that every filter must beat, and the tracker that follows a target from a given pose."""

from typing import Any

import numpy as np

from estimators.gaussian.considered import keep_pose, put_pose_back
from estimators.gaussian.ekf import observe, predict
from estimators.gaussian.growth import start_target
from estimators.gaussian.layout import Call, GaussianEstimator
from estimators.gaussian.sweep import USED, associate, limit_of, note
from estimators.gaussian.vague_target import CONSIDERED
from estimators.interface import Floats, Scan
from estimators.kernels.angles import wrap
from estimators.kernels.association import TARGET_SLOT
from estimators.kernels.bound import LATER
from estimators.kernels.gaussian import ROBOT, rows_in_use
from estimators.kernels.jit import inline, jit
from estimators.kernels.left_looking import settle
from estimators.kernels.range_bearing import noise_std, offset, offset_noise
from estimators.models import TWIST


@inline
def meet_target(mu, P, lane, n, model, target_known, pending, distance, bearing, dt):
    """Start the target from a return, relative to the pose."""
    dx, dy = offset(distance, bearing, mu[lane, 2])
    std_r, std_b = noise_std(model, distance)
    n00, n01, n11 = offset_noise(dx, dy, std_r, std_b)
    start_target(
        mu, P, lane, n, model, target_known, pending, dx, dy, -dy, dx, n00, n01, n11, mu[lane, 3], mu[lane, 4], dt
    )


@jit
def update(
    mu, P, work, models, n_t, count, ids, target_known, pending, counters, ranges, bearings, labels, num_returns, code,
    gates, cost, slots, last_dt, lanes, kept,
):  # fmt: skip
    """Take the target's returns out of a sweep; nothing else is looked at, and the pose stays as it was.

    The gain of the pose is set to zero and its uncertainty considered in the target's (Schmidt-Kalman).
    """
    for i in range(lanes.size):
        lane = lanes[i]
        model, n = models[lane], rows_in_use(n_t, 0)
        associate(
            lane, mu, P, model, n_t, count, ids, target_known, counters, ranges, bearings, labels, num_returns[lane],
            code, gates, cost, slots,
        )  # fmt: skip
        keep_pose(mu, P, lane, kept)
        for k in range(num_returns[lane]):
            if slots[lane, k] != TARGET_SLOT:
                continue
            if target_known[lane]:
                limit = limit_of(gates[0], model, True)
                outcome, nis = observe(mu, P, work, lane, n, 0, ROBOT, model, ranges[lane, k], bearings[lane, k], limit)
                if outcome == USED:
                    settle(P, work, lane, n, 2)
                put_pose_back(mu, P, lane, kept)
                note(outcome, nis, True, mu, P, lane, n, n_t, model, target_known, pending, counters)
            if not target_known[lane]:
                distance, bearing = ranges[lane, k], bearings[lane, k]
                meet_target(mu, P, lane, n, model, target_known, pending, distance, bearing, last_dt[lane])
        if n_t > 0 and model.target_kind == TWIST:
            mu[lane, 5] = wrap(mu[lane, 5])


class DeadReckoning(GaussianEstimator):
    """Pose by odometry alone, with growing covariance; no map. The target is filtered relative to that pose.

    Sightings never correct the pose: its gain is zero, its uncertainty considered in the target's.

    Args:
        motion, sensor, target, num_lanes, max_landmarks: see `Estimator`.
        **options: see `GaussianEstimator`; a budget has nothing to keep within.

    When to use: as the floor. A filter that is no better than its odometry has lost its way.

    Known weakness: errors grow without bound. And to first order noise moves a robot that is told to stand still
    along its heading alone, so that no covariance says how it strays sideways: by little, but its NEES is in the
    hundred thousands there (`slam-gym run --policy stationary --estimators dead-reckoning ri-ekf`). Filters that see
    anything do not show it.

    Reference: the considered pose is Schmidt's, "Application of state-space methods to navigation problems", 1966.
    """

    name = "dead-reckoning"
    summary = "Odometry alone, no map; the target relative to that pose: the floor"

    def _allocate(self) -> None:
        super()._allocate()
        self.kept: Floats = np.zeros((ROBOT + 1, ROBOT))  # scratch

    def linear_points(self) -> tuple[Floats, int, int]:
        """See `GaussianEstimator.linear_points`."""
        return self.mu, ROBOT, CONSIDERED

    def _scratch(self) -> tuple[Any, ...]:
        return (*super()._scratch(), self.kept)

    def _prediction(self, control: Floats, dt: Floats) -> Call:
        return (
            predict, self.mu, self.P, self.models, self.n_t, self.count, self.target_known, self.pending, control, dt,
            self.last_dt, LATER,
        )  # fmt: skip

    def _correction(self, scan: Scan) -> Call:
        return (
            update, self.mu, self.P, self.work, self.models, self.n_t, self.count, self.ids, self.target_known,
            self.pending, self.counters, scan.ranges, scan.bearings, scan.labels, scan.count, self.association_code,
            self.gates, self.cost, self.slots, self.last_dt, LATER, self.kept,
        )  # fmt: skip
