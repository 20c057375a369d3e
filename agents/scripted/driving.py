"""From a place to a command: the helpers that the scripted policies' kernels share."""

import math

from estimators.kernels.angles import wrap
from estimators.kernels.jit import inline

ARRIVED = 0.5  # [m] from a place: close enough


@inline
def clip(value, low, high):
    """The value within [low, high]."""
    return max(low, min(high, value))


@inline
def largest_variance(p00, p01, p11):
    """Largest eigenvalue of a symmetric 2 x 2 matrix."""
    return 0.5 * (p00 + p11) + math.sqrt(0.25 * (p00 - p11) ** 2 + p01 * p01)


@inline
def drive_to(x, y, distance, stand_off, gains, lead, lead_turn):
    """Speed and turn rate towards a point (x, y) in the robot's frame, stopping `stand_off` before it.

    The speed is projected on the line of sight: a point abeam asks for a turn, not for speed.
    """
    bearing = math.atan2(y, x)
    speed = gains[0] * (distance - stand_off) * math.cos(bearing) + lead
    if abs(bearing) > 0.5 * math.pi:
        speed = 0.0  # first turn to face it
    return speed, gains[1] * bearing + lead_turn


@inline
def set_command(command, lane, speed, turn, limits):
    """Write a command within the limits (lowest, highest speed, turn rate)."""
    command[lane, 0] = clip(speed, limits[0], limits[1])
    command[lane, 1] = clip(turn, -limits[2], limits[2])


@inline
def drive_to_place(lane, pose, x, y, gains, limits, command):
    """Command towards (x, y) in the world; says whether the robot has arrived, and then commands nothing."""
    east, north = x - pose[lane, 0], y - pose[lane, 1]
    distance = math.hypot(east, north)
    if distance <= ARRIVED:
        return True
    bearing = wrap(math.atan2(north, east) - pose[lane, 2])
    ahead, left = distance * math.cos(bearing), distance * math.sin(bearing)
    speed, turn = drive_to(ahead, left, distance, 0.0, gains, 0.0, 0.0)
    set_command(command, lane, speed, turn, limits)
    return False
