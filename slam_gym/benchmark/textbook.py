"""Motion and return of the joint state (robot, constant-velocity target, landmarks) in dense matrices, for libraries.

The arithmetic of `estimators.gaussian.ekf` as a textbook has it; what the adapters of other packages plug in.
"""

import math

import numpy as np

from estimators.interface import TARGET, Floats
from slam_gym.benchmark.stream import DT, MOTION, SENSOR, TARGET_MODEL

ROBOT, TARGET_ROW, FIRST_LANDMARK = 3, 3, 7


def wrap(angle: float) -> float:
    """Within [-pi, pi)."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def row_of(label: int, ids: list[int]) -> int:
    """Where the thing of a label stands in the state."""
    return TARGET_ROW if label == TARGET else FIRST_LANDMARK + 2 * ids.index(label)


def moved(x: Floats, control: tuple[float, float]) -> Floats:
    """The state [n] one step later."""
    v, w = control
    x = x.copy()
    x[2] = wrap(x[2] + w * DT)
    x[0] += v * DT * math.cos(x[2])
    x[1] += v * DT * math.sin(x[2])
    x[3:5] += DT * x[5:7]
    return x


def motion_jacobian(x: Floats, control: tuple[float, float]) -> Floats:
    """F [n, n] at the state before the step."""
    v, w = control
    heading = x[2] + w * DT
    F = np.eye(len(x))
    F[0, 2], F[1, 2] = -v * DT * math.sin(heading), v * DT * math.cos(heading)
    F[3, 5] = F[4, 6] = DT
    return F


def motion_noise(x: Floats, control: tuple[float, float]) -> Floats:
    """Q [n, n] at the state before the step."""
    v, w = control
    c, s = math.cos(x[2] + w * DT), math.sin(x[2] + w * DT)
    B = np.array([[DT * c, -v * DT * DT * s], [DT * s, v * DT * DT * c], [0.0, DT]])
    std = [
        MOTION.speed_std + MOTION.speed_std_per_speed * abs(v),
        MOTION.turn_std + MOTION.turn_std_per_turn * abs(w) + MOTION.turn_std_per_speed * abs(v),
    ]
    Q = np.zeros((len(x), len(x)))
    Q[:ROBOT, :ROBOT] = (B * np.square(std)) @ B.T
    q = TARGET_MODEL.acceleration_density**2
    for position, velocity in ((3, 5), (4, 6)):
        Q[position, position], Q[velocity, velocity] = q * DT**3 / 3, q * DT
        Q[position, velocity] = Q[velocity, position] = q * DT**2 / 2
    return Q


def expected(x: Floats, j: int) -> Floats:
    """Range and bearing [2] of the point at row j."""
    dx, dy = x[j] - x[0], x[j + 1] - x[1]
    return np.array([math.hypot(dx, dy), wrap(math.atan2(dy, dx) - x[2])])


def return_jacobian(x: Floats, j: int) -> Floats:
    """H [2, n] of the point at row j."""
    dx, dy = x[j] - x[0], x[j + 1] - x[1]
    r = math.hypot(dx, dy)
    A = np.array([[dx / r, dy / r], [-dy / r**2, dx / r**2]])
    H = np.zeros((2, len(x)))
    H[:, :2], H[:, j : j + 2], H[1, 2] = -A, A, -1.0
    return H


def return_noise(x: Floats, j: int) -> Floats:
    """R [2, 2] of a return of the point at row j."""
    r = math.hypot(x[j] - x[0], x[j + 1] - x[1])
    return np.diag([(SENSOR.range_std + SENSOR.range_std_per_range * r) ** 2, SENSOR.bearing_std**2])
