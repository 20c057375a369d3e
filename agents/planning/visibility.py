"""How likely a return is, when neither the robot nor the point nor the pillars are where they are believed to be."""

import math

from estimators.kernels.angles import wrap
from estimators.kernels.cloud_evidence import EDGE, SHARPEST, share_beyond
from estimators.kernels.jit import inline

_FULL_CIRCLE = 2.0 * math.pi - 1e-6


@inline
def chance_seen(x, P, at, pillars, num_pillars, softness, model):
    """Probability of a return from the point in rows at, at + 1: in range, in view, behind no pillar.

    Each edge (range, field of view, a pillar's rim) is crossed by an error that is taken as uniform, with the deviation
    that the point has relative to the robot; along the line of sight it grows from none at the robot. `softness`
    [m] is added to that deviation; a negative one makes every edge hard: the mean decides. A landmark is a pillar too
    and does not hide itself: only those nearer than the point by their radius count.
    """
    dx, dy = x[at] - x[0], x[at + 1] - x[1]
    r = math.sqrt(dx * dx + dy * dy) + 1e-9
    edge = SHARPEST
    if softness >= 0.0:
        east = P[at, at] + P[0, 0] - 2.0 * P[at, 0]
        north = P[at + 1, at + 1] + P[1, 1] - 2.0 * P[at + 1, 1]
        edge = EDGE * (math.sqrt(max(0.5 * (east + north), 0.0)) + softness)
    chance = model.detection_probability * share_beyond(model.max_range - r, edge)
    if model.field_of_view < _FULL_CIRCLE:
        off = abs(wrap(math.atan2(dy, dx) - x[2]))
        chance *= share_beyond(0.5 * model.field_of_view - off, edge / max(r, edge))
    radius = model.landmark_radius
    if radius > 0.0 and chance > 0.0:
        for j in range(num_pillars):
            ex, ey = pillars[j, 0] - x[0], pillars[j, 1] - x[1]
            along = (ex * dx + ey * dy) / r
            if along <= 0.0 or along >= r - radius:
                continue
            across = abs(ex * dy - ey * dx) / r
            rim = max(edge * along / r, SHARPEST)
            if across < radius + rim:
                chance *= 1.0 - share_beyond(radius - across, rim)
    return chance
