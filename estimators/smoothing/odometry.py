"""What happened since the last node of a trajectory: the robot's odometry, and the motion of a twist target.

A smoother keeps one pose per sweep, not per control. In between, displacement and covariance are composed in the axes
of the last node; for a target that is the motion since it was last seen.

    moved [L, 3], spread [L, 3, 3]         robot: displacement (x, y, heading) and its covariance
    drift [L, 3], drift_spread [L, 3, 3]   twist target, likewise
    elapsed [L]                            seconds since the target's last node
"""

import numpy as np

from estimators.gaussian.ekf import predict_robot
from estimators.interface import Floats
from estimators.kernels.angles import wrap
from estimators.kernels.gaussian import ROBOT, move_heading_body
from estimators.kernels.jit import inline, jit
from estimators.kernels.motion import unicycle, unicycle_noise
from estimators.models import TWIST


@inline
def drift_on(drift, drift_spread, lane, model, dt):
    """Compose one step of a twist target's own motion."""
    speed, turn_rate, heading = model.target_speed, model.target_turn_rate, drift[lane, 2]
    dx, dy, turn = unicycle(speed, turn_rate, dt, heading)
    q00, q01, q02, q11, q12, q22 = unicycle_noise(
        speed, turn_rate, dt, heading, model.target_speed_std, model.target_turn_std
    )
    move_heading_body(drift_spread, lane, ROBOT, 0, -dy, dx, q00, q01, q02, q11, q12, q22)
    drift[lane, 0] += dx
    drift[lane, 1] += dy
    drift[lane, 2] = wrap(heading + turn)


@jit
def compose(moved, spread, drift, drift_spread, elapsed, models, pending, control, dt, last_dt, lanes):
    """One step of the named lanes."""
    for i in range(lanes.size):
        lane = lanes[i]
        step = dt[lane]
        if not step > 0.0:
            continue
        predict_robot(moved, spread, lane, ROBOT, models[lane], control[lane, 0], control[lane, 1], step)
        if models[lane].target_kind == TWIST:
            drift_on(drift, drift_spread, lane, models[lane], step)
        elapsed[lane] += step
        pending[lane, 3] += 1.0
        last_dt[lane] = step


def turned(cov: Floats, angle: float) -> Floats:
    """A covariance [3, 3] over (x, y, heading) in axes that lie at `angle` in the ones it is given in."""
    R = np.eye(3)
    R[:2, :2] = [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    return R @ cov @ R.T


def carry(pose: Floats, moved: Floats, spread: Floats) -> tuple[Floats, Floats, Floats]:
    """Move a pose [3] on by a displacement in its own axes: the pose reached, F [3, 3] and Q [3, 3] in world axes."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    dx, dy = c * moved[0] - s * moved[1], s * moved[0] + c * moved[1]
    F = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
    reached = np.array([pose[0] + dx, pose[1] + dy, (pose[2] + moved[2] + np.pi) % (2.0 * np.pi) - np.pi])
    return reached, F, turned(spread, -pose[2])
