"""Whether a target flees from the robot, learned from the courses that are seen, and points that do so too."""

import math

from estimators.kernels.cloud_motion import COSINE, HALF_HEIGHT, HALF_WIDTH, SINE, X, Y
from estimators.kernels.jit import inline

STRAIGHT = 0.87  # cosine between a course and straight away from which on a target looks as if it fled
FLED, CHANCE = 0.92, 0.5  # how often one that flees looks so, and one that does not and is followed
SURE = 3.0  # greatest log odds either way: what was learned is not for ever
PRIOR = -1.0  # log odds of a target that has not been seen yet
SLOW = 0.3  # [m/s] below which a course says nothing
CROWDED = 1.5  # [m] from a wall, where no target can go as it likes
SIDE_STEP, SIDE_STEPS = 0.5, 13  # [rad] by which a fleeing point turns off a wall, and ways that it looks at


@inline
def flees(log_odds, from_x, from_y, x, y, vx, vy, reach, seconds, settings):
    """Log odds that a target flees, after its course (vx, vy) at (x, y) was seen from (from_x, from_y).

    Bayes' rule for "within 30 deg of straight away, or not", where what a target does within one second counts as one
    observation. The course tells only within `reach` [m] and away from the walls.
    """
    dx, dy = x - from_x, y - from_y
    square, speed = dx * dx + dy * dy, math.sqrt(vx * vx + vy * vy)
    if square > reach * reach or speed < SLOW:
        return log_odds
    if abs(x) > settings[HALF_WIDTH] - CROWDED or abs(y) > settings[HALF_HEIGHT] - CROWDED:
        return log_odds
    away = dx * vx + dy * vy > STRAIGHT * speed * math.sqrt(square)
    told = math.log(FLED / CHANCE) if away else math.log((1.0 - FLED) / (1.0 - CHANCE))
    return min(max(log_odds + seconds * told, -SURE), SURE)


@inline
def run_away(log_odds, rows, x, y, reach, settings):
    """As many points as the target is likely to flee turn from a robot within reach, as straight as the walls allow.

    rows [5, N]; (x, y) the robot's place. A share 1 / (1 + exp(-log_odds)) of the points takes part, the first ones.
    """
    half_x, half_y = settings[HALF_WIDTH], settings[HALF_HEIGHT]
    for p in range(int(rows.shape[1] / (1.0 + math.exp(-log_odds)) + 0.5)):
        dx, dy = rows[X, p] - x, rows[Y, p] - y
        if dx * dx + dy * dy > reach * reach:
            continue
        away = math.atan2(dy, dx)
        for i in range(SIDE_STEPS):
            way = away + SIDE_STEP * ((i + 1) // 2) * (1.0 if i % 2 == 0 else -1.0)
            c, s = math.cos(way), math.sin(way)
            if abs(rows[X, p] + c) <= half_x and abs(rows[Y, p] + s) <= half_y:
                rows[COSINE, p], rows[SINE, p] = c, s
                break
