"""One step of the world, as one kernel call: robot, target, sensor."""

from estimators.kernels.borrow import borrow
from estimators.kernels.jit import subroutine
from slam_gym.world_numbers import NONE
from slam_gym.world_robot import move_robot
from slam_gym.world_sensor import sense
from slam_gym.world_state import STEP
from slam_gym.world_target import move_target


@subroutine
def step(lanes, command, numbers, x, k, b):
    """Advance the lanes [n] by dt and take the sweeps that are due.

    Args:
        command: [L, 2] (speed [m/s], turn rate [rad/s] or steering angle [rad]).
        numbers: [L] `WORLD`.
        x, k, b: the blocks of `world_state`.
    """
    numbers, command, x, k, b = borrow(numbers), borrow(command), borrow(x), borrow(k), borrow(b)
    for n in range(lanes.shape[0]):
        lane = lanes[n]
        w = numbers[lane]
        move_robot(lane, w, command, x, k, b)
        if w.target_kind != NONE:
            move_target(lane, w, x, k)
        k[k[STEP] + lane] += 1
        sense(lane, w, x, k, b)
