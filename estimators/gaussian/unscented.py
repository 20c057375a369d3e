"""UKF-SLAM: a joint Gaussian propagated through the unscented transform, on the kernels of the CDKF."""

import math
from typing import Any, ClassVar

from estimators.gaussian.sigma_point import SigmaPointFilter
from estimators.models import MotionModel, SensorModel, TargetModel

VARIABLES = 5  # that a function here depends on: pose and control, pose and point, pose and return


class UKF(SigmaPointFilter):
    """Unscented Kalman filter of robot, target and landmarks: sigma points instead of Jacobians.

    Every function here depends on five variables: the pose and two noisy controls, the pose and a point, the pose and
    the two numbers of a return. With lam = alpha^2 (5 + kappa), D1 and D2 the half differences and half second
    differences of f at +-sqrt(lam) columns of the Cholesky factor (`estimators.gaussian.interpolation`):

        mean f(x) + e, e = sum D2 / lam      covariance sum (D1 D1' + D2 D2') / lam + (beta - alpha^2) e e'

    which is the usual weighted sum over eleven sigma points, written so that bearings need no averaging around the
    circle and that the part of the map which f does not touch costs nothing. Returns are taken one after another.

    Args:
        motion, sensor, target, num_lanes, max_landmarks: see `Estimator`.
        alpha: spread of the sigma points, as a share of that which kappa sets.
        beta: weight of the centre in a covariance, beyond its weight in the mean.
        kappa: above -5; at 0 and with alpha = 1 and beta >= 0 every covariance is positive semidefinite by
            construction. Julier's choice for Gaussians, -2, does not promise that: `counts["not_positive"]` tells.
        **options: see `GaussianEstimator`.

    When to use: as the reference that papers compare with.

    Known weakness: that of the EKF. Moments are not what makes SLAM filters overconfident; taking slopes at different
    estimates of the same point is, and sigma points do so as well. `ri-cdkf` cures it.

    Reference: Julier and Uhlmann, "Unscented filtering and nonlinear estimation", 2004; Wan and van der Merwe 2000.
    """

    name: ClassVar[str] = "ukf"
    summary: ClassVar[str] = "unscented Kalman filter: sigma points instead of Jacobians"

    def __init__(
        self,
        motion: MotionModel,
        sensor: SensorModel,
        target: TargetModel | None,
        *,
        num_lanes: int = 1,
        max_landmarks: int,
        alpha: float = 1.0,
        beta: float = 0.0,
        kappa: float = 0.0,
        **options: Any,
    ) -> None:
        super().__init__(motion, sensor, target, num_lanes=num_lanes, max_landmarks=max_landmarks, **options)
        if not 0.0 < alpha < math.inf:
            raise ValueError(f"alpha must be a positive number (1 leaves the spread to kappa); got {alpha!r}")
        if not math.isfinite(beta):
            raise ValueError(f"beta must be a finite number (0 for none); got {beta!r}")
        if not -VARIABLES < kappa < math.inf:
            raise ValueError(f"kappa must be above -{VARIABLES}, the number of variables; got {kappa!r}")
        lam = alpha * alpha * (VARIABLES + kappa)
        self.rule[:] = math.sqrt(lam), 1.0 / lam, beta - alpha * alpha
        self._chosen = {"alpha": alpha, "beta": beta, "kappa": kappa}

    def _own_options(self) -> dict[str, Any]:
        return self._chosen
