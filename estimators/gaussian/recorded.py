"""The right-invariant EKF of a recorded robot: correlated errors, scales and biases, mis-read labels.

Its kernels: `recorded_motion`, `recorded_returns` (one return), `recorded_sweep` (all of them).
"""

import math
from collections.abc import Mapping
from typing import Any, ClassVar, Literal

import numpy as np

from estimators.gaussian.layout import MATCH_GATE, NEW_GATE, Call, GaussianEstimator
from estimators.gaussian.recorded_motion import (
    BEARING_BIAS,
    EXTRA,
    RANGE_SCALE,
    SPEED_SCALE,
    TURN_BIAS,
    TURN_SCALE,
    predict,
)
from estimators.gaussian.recorded_sweep import update
from estimators.gaussian.robot_errors import RobotErrors
from estimators.interface import Floats, Ints, Scan
from estimators.kernels.bound import LATER
from estimators.kernels.gaussian import ROBOT
from estimators.models import MotionModel, SensorModel, TargetModel


class RecordedRIEKF(GaussianEstimator):
    """Right-invariant EKF that is honest on recorded robots: scales, biases, slow errors, mis-read labels.

    **State.** As `ri-ekf`, and five constants with priors: errors of the odometry's speed and turn scale (dv, dw), a
    turn bias b, the sensor's range scale s and bearing bias beta. Zero at the start; not part of `Belief.joint`.

    **Motion.** ds = v dt (1 + dv), dheading = w dt (1 + dw) + b dt, b while the robot is commanded to move, v and w
    after the motion model's calibration. To the motion model's noise come the sideways variance `lateral_noise` |ds|
    and the heading variance `turn_noise` |dheading|; a robot commanded to stand gets `still_noise` times the model's.
    A constant-velocity target wanders: dv = (-v / tau - kappa (p - c)) dt + white acceleration.

    **Measurement.** h = [rho (1 + s), atan2(D) - heading + beta]. An error that changes slowly says little new: with
    D the seconds since this label was last seen, the variances are multiplied by (1 + f) / (1 - f), f = exp(-D / tau_r)
    for the range, f = exp(-D / tau_b) sab^2 / (sab^2 + sb^2) for the bearing: the information rate of a first-order
    process, without a state. A target out of sight for more than `target_fresh` is linearised where it is MEASURED,
    A = grad h there, with the heading's column -A J (p - p_r). Update and retraction as in `ri-ekf`.

    **Labels.** Returns beyond the gates are rejected; landmark returns within are weighted by (4 + 2) / (4 + NIS) (for
    `weight_dof` = 4). A label rejected `restart_after` times in a row at about the same place starts anew there.

    Args:
        motion: how the robot moves. sensor, target: see `GaussianEstimator`, as all options but `budget` and
            `remove_below`.
        errors: a `RobotErrors` or its numbers by name; the defaults add nothing to `ri-ekf`.

    When to use: recorded robots (`slam-gym replay --calibration`; `docs/recorded_robots.md`).

    Known weakness: the numbers must have been fitted (`slam-gym calibrate`). What is common to all landmarks seen
    together is modelled only as a constant. `TargetModel.reinitialise_spread` is not used.

    Reference: as `ri-ekf`; Student t weights: Lange, Little and Taylor, "Robust statistical modeling using the t
    distribution", JASA 84(408), 1989.
    """

    name: ClassVar[str] = "recorded-ri-ekf"
    summary: ClassVar[str] = "right-invariant EKF for recorded robots: scales, biases, slow errors, mis-read labels"
    mean_is_all: ClassVar[bool] = False
    extra_states: ClassVar[int] = EXTRA

    def __init__(
        self,
        motion: MotionModel,
        sensor: SensorModel,
        target: TargetModel | None,
        *,
        num_lanes: int = 1,
        max_landmarks: int,
        association: Literal["known", "nearest", "jcbb"] = "known",
        gate: float = math.inf,
        match_gate: float = MATCH_GATE,
        new_gate: float = NEW_GATE,
        errors: RobotErrors | Mapping[str, float] | None = None,
    ) -> None:
        try:
            self.errors = errors if isinstance(errors, RobotErrors) else RobotErrors(**(errors or {}))
        except TypeError as error:
            names = ", ".join(RobotErrors.__dataclass_fields__)
            raise ValueError(f"errors must be a RobotErrors or a mapping of its numbers ({names}); {error}") from error
        super().__init__(
            motion, sensor, target, num_lanes=num_lanes, max_landmarks=max_landmarks, association=association,
            gate=gate, match_gate=match_gate, new_gate=new_gate, remove_below=0.0,
        )  # fmt: skip

    def _allocate(self) -> None:
        super()._allocate()
        L, M = self.num_lanes, self.max_landmarks
        self.packed = self.errors.pack()
        self.clock: Floats = np.zeros(L)
        self.seen: Floats = np.full((L, M + 1), -np.inf)  # [s] by slot, the target last
        self.rejected: Floats = np.zeros((L, M + 1, 3))  # how often in a row, and where
        self.corrected: Floats = np.zeros((2, L, 0))  # scratch

    def _after_reset(self, lanes: Ints) -> None:
        self.clock[lanes], self.seen[lanes], self.rejected[lanes] = 0.0, -np.inf, 0.0
        for which, std in (
            (SPEED_SCALE, self.errors.speed_scale_std),
            (TURN_SCALE, self.errors.turn_scale_std),
            (TURN_BIAS, self.errors.turn_bias_std),
            (RANGE_SCALE, self.errors.range_scale_std),
            (BEARING_BIAS, self.errors.bearing_bias_std),
        ):
            row = ROBOT + self.n_t + which
            self.P[lanes, row, row] = std * std

    def make_room(self, width: int) -> None:
        """See `GaussianEstimator.make_room`."""
        super().make_room(width)
        if width > self.corrected.shape[2]:
            self.corrected = np.zeros((2, self.num_lanes, width))

    def _corrections(self, scan: Scan) -> list[Call]:
        return [self._correction(scan)]  # a vague target is linearised where it is measured, not forgotten

    def _prediction(self, control: Floats, dt: Floats) -> Call:
        return (
            predict, self.mu, self.P, self.models, self.packed, self.n_t, self.count, self.target_known, self.pending,
            self.clock, control, dt, self.last_dt, LATER,
        )  # fmt: skip

    def _correction(self, scan: Scan) -> Call:
        return (
            update, self.mu, self.P, self.models, self.packed, self.n_t, self.count, self.ids, self.first, self.next_id,
            self.target_known, self.pending, self.counters, self.last_dt, self.clock, self.seen, self.rejected,
            scan.ranges, scan.bearings, scan.labels, scan.count, self.association_code, self.gates, self.slots,
            self.cost, self.corrected, self.work, LATER,
        )  # fmt: skip

    @property
    def constants(self) -> dict[str, Floats]:
        """The five constants' estimates [L] and, under `..._std`, their deviations."""
        names, found = ("speed_scale", "turn_scale", "turn_bias", "range_scale", "bearing_bias"), {}
        for row, name in enumerate(names, start=ROBOT + self.n_t):
            found[name], found[f"{name}_std"] = self.mu[:, row].copy(), np.sqrt(self.P[:, row, row])
        return found

    @property
    def _state_names(self) -> tuple[str, ...]:
        return (*super()._state_names, "clock", "seen", "rejected")

    def joint(self, lane: int) -> tuple[Floats, Floats]:
        """See `GaussianEstimator.joint`; without the five constants."""
        mean, cov = super().joint(lane)
        start = ROBOT + (self.n_t if self.target_known[lane] else 0)
        rows: Any = np.r_[:start, start + EXTRA : len(mean)]
        return mean[rows], cov[np.ix_(rows, rows)]
