"""The factors of the graph, made of GTSAM's: odometry, returns, priors, and the target's motion.

Keys: x_k the robot's pose at node k, l_j the landmark of slot j; a constant-velocity target has its position t_k and
velocity v_k at the nodes that saw it, a twist target its pose y_k.

The noise of a displacement has rank 2 (two controls, three coordinates), and a known start none; GTSAM needs
invertible covariances. `regular` makes each variance larger by `SHARE` of itself and the square of `FLOOR`.
"""

from typing import Any

import gtsam
import numpy as np

from estimators.interface import Floats
from estimators.kernels.motion import acceleration_noise
from estimators.smoothing.events import Sighting
from estimators.smoothing.odometry import turned

FLOOR = 1e-5  # [m], [rad], [m/s]
SHARE = 1e-4  # of a variance
WEAK_HEADING_STD = np.pi / np.sqrt(3.0)  # [rad], of a twist target at its first sighting: any direction


def pose_key(node: int) -> int:
    """Of the robot at a node."""
    return gtsam.symbol("x", node)


def landmark_key(slot: int) -> int:
    """Of the landmark in a slot."""
    return gtsam.symbol("l", slot)


def target_keys(node: int, twist: bool) -> list[int]:
    """Of the target at a node: one pose, or position and velocity."""
    if twist:
        return [gtsam.symbol("y", node)]
    return [gtsam.symbol("t", node), gtsam.symbol("v", node)]


def regular(cov: Floats) -> Floats:
    """The covariance [n, n] made invertible: see the head of this file. Position coordinates share their floor."""
    variance = np.diag(cov).copy()
    variance[:2] = variance[:2].mean()
    return 0.5 * (cov + cov.T) + np.diag(SHARE * variance + FLOOR * FLOOR)


def gaussian(cov: Floats) -> Any:
    """GTSAM's noise model of a covariance."""
    return gtsam.noiseModel.Gaussian.Covariance(regular(cov))


def pose2(pose: Floats) -> Any:
    """GTSAM's pose of (x, y, heading)."""
    return gtsam.Pose2(*pose)


def pose_prior(key: int, pose: Floats, cov: Floats) -> Any:
    """A pose known with a covariance in world axes; GTSAM's is in the pose's own."""
    return gtsam.PriorFactorPose2(key, pose2(pose), gaussian(turned(cov, pose[2])))


def velocity_prior(keys: list[int], state: Floats, cov: Floats) -> Any:
    """A constant-velocity target's (x, y, velocity_x, velocity_y) known with a covariance."""
    root = np.linalg.inv(np.linalg.cholesky(regular(cov)))
    rows = gtsam.JacobianFactor(
        keys[0], root[:, :2], keys[1], root[:, 2:], np.zeros(4), gtsam.noiseModel.Unit.Create(4)
    )
    at = gtsam.Values()
    at.insert(keys[0], state[:2])
    at.insert(keys[1], state[2:])
    return gtsam.LinearContainerFactor(rows, at)


def displacement(first: int, second: int, moved: Floats, spread: Floats) -> Any:
    """Motion between two poses; its covariance, given in the first one's axes, turned into the second one's."""
    return gtsam.BetweenFactorPose2(first, second, pose2(moved), gaussian(turned(spread, moved[2])))


def drift_cov(dt: float, density: float) -> Floats:
    """White acceleration over dt: covariance [4, 4] of (position, velocity)."""
    position, cross, velocity = acceleration_noise(density, dt)
    return np.kron([[position, cross], [cross, velocity]], np.eye(2))


def constant_velocity(first: list[int], second: list[int], dt: float, density: float) -> Any:
    """White acceleration over dt between two states (position, velocity)."""
    eye, none = np.eye(2), np.zeros((2, 2))
    by = [np.vstack(blocks) for blocks in ((-eye, none), (-dt * eye, -eye), (eye, none), (none, eye))]

    def error(factor: Any, values: Any, jacobians: Any) -> Floats:
        total = np.zeros(4)
        for i, key in enumerate(factor.keys()):
            total += by[i] @ values.atPoint2(key)
            if jacobians is not None:
                jacobians[i] = by[i]
        return total

    return gtsam.CustomFactor(gaussian(drift_cov(dt, density)), [*first, *second], error)


def sighting(pose: int, point: int, seen: Sighting, point_is_pose: bool) -> Any:
    """Range and bearing of a point, or of the position of a pose, from a pose."""
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([seen.bearing_std, seen.range_std]))
    make = gtsam.BearingRangeFactorPose2 if point_is_pose else gtsam.BearingRangeFactor2D
    return make(pose, point, gtsam.Rot2(seen.bearing), seen.distance, noise)


def any_heading(key: int, heading: float) -> Any:
    """Next to nothing about a pose's heading, so that a short chord leaves it determined."""
    return gtsam.PoseRotationPrior2D(key, gtsam.Rot2(heading), gtsam.noiseModel.Isotropic.Sigma(1, WEAK_HEADING_STD))
