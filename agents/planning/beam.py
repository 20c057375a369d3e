"""The best of many plans: a beam over sequences of commands, each judged by the belief that it leads to."""

import math

from agents.planning.lookahead import drive, grow, look
from agents.planning.state import MARK, TARGET
from agents.planning.visibility import chance_seen
from estimators.kernels.angles import wrap
from estimators.kernels.jit import inline, jit

PURSUE = 0  # number of the command that drives at the target
_NEGLIGIBLE = 0.02  # chance of a return below which a landmark is not looked at


@inline
def _command(number, x, commands, seconds, stand_off, limits):
    """Speed and turn rate: that of the table, or those that lead to the stand-off distance, facing the target."""
    v, w = commands[number, 0], commands[number, 1]
    low, high, turn_max, curvature = limits
    if number == PURSUE:
        dx, dy = x[TARGET] - x[0], x[TARGET + 1] - x[1]
        bearing = wrap(math.atan2(dy, dx) - x[2])
        v = (math.sqrt(dx * dx + dy * dy) - stand_off) * math.cos(bearing) / seconds if abs(bearing) < 1.57 else 0.0
        v, w = min(max(v, low), high), bearing / seconds
    turn_max = min(turn_max, abs(v) * curvature)
    return v, min(max(w, -turn_max), turn_max)


@inline
def _place_cost(x, pillars, num_pillars, radius, weights, stand_off):
    """What a pose costs by itself: nearness to pillars, and distance to the target off the stand-off."""
    dx, dy = x[TARGET] - x[0], x[TARGET + 1] - x[1]
    off = math.sqrt(dx * dx + dy * dy) - stand_off
    cost = weights[2] * off * off
    margin = weights[4]
    if radius > 0.0 and margin > 0.0:
        for j in range(num_pillars):
            ex, ey = pillars[j, 0] - x[0], pillars[j, 1] - x[1]
            square = ex * ex + ey * ey
            if square < (radius + margin) * (radius + margin):
                depth = (radius + margin - math.sqrt(square)) / margin
                cost += weights[3] * depth * depth
    return cost


@inline
def _look_around(x, P, n, pillars, num_pillars, softness, sweeps, model, B):
    """Expected looks at the target and the landmarks; returns the chance that the target is seen."""
    seen = chance_seen(x, P, TARGET, pillars, num_pillars, softness, model)
    hard = softness < 0.0
    if hard:
        seen = 1.0 if seen > 0.5 * model.detection_probability else 0.0
    if seen > 0.0:
        look(x, P, n, TARGET, seen, sweeps, model, B)
    for at in range(MARK, n, 2):
        chance = chance_seen(x, P, at, pillars, num_pillars, softness, model)
        if hard:
            chance = 1.0 if chance > 0.5 * model.detection_probability else 0.0
        if chance > _NEGLIGIBLE:
            look(x, P, n, at, chance, sweeps, model, B)
    return seen


@jit
def best_command(
    x, P, n, pillars, num_pillars, commands, horizon, width, weights, timing, stand_off, limits, model, xs, Ps, costs,
    firsts, keep, kept, B,
):  # fmt: skip
    """Number of the command that begins the cheapest plan found.

    A plan is `horizon` segments, each one command. Of all plans up to a segment the `width` cheapest go on. A plan
    costs, summed over its segments,

        tr P_target + weights[0] tr P_pose + weights[1] (1 - chance that the target is seen)
        + weights[2] (distance - stand-off)^2 + weights[3] (depth into the margin weights[4] around a pillar)^2
        + weights[6] (unless the command is pursuit).

    A plan whose pose alone makes it dearer than the `width` best so far is dropped before its covariance is computed.

    Args:
        x, P, n: the belief's rows, see `state`.
        pillars: [>= num_pillars, 2].
        num_pillars: in use.
        commands: [C, 2] speed [m/s], turn rate [rad/s]; the first stands for pursuit.
        horizon: segments.
        width: of the beam.
        weights: (pose, unseen, distance, pillar, margin [m], softness [m], departure).
        timing: (seconds, steps, sweeps, density) of a segment; density of the target's acceleration.
        stand_off: [m].
        limits: (lowest, highest speed [m/s], turn rate [rad/s], curvature [1/m]).
        model: a `MODEL` record.
        xs, Ps, costs, firsts: [2, width C, ...] scratch: the plans of this segment and of the one before.
        keep, kept: [width] scratch.
        B: [n, 2] scratch.
    """
    seconds, steps, sweeps, density = timing
    for i in range(n):
        xs[1, 0, i] = x[i]
        for k in range(n):
            Ps[1, 0, i, k] = P[i, k]
    costs[1, 0] = 0.0
    keep[0] = 0
    parents = 1
    for depth in range(horizon):
        now, before = depth % 2, 1 - depth % 2
        room = width if depth < horizon - 1 else 1
        found = 0
        for b in range(parents):
            parent = keep[b]
            for number in range(commands.shape[0]):
                child = b * commands.shape[0] + number
                y, Q = xs[now, child], Ps[now, child]
                y[:n] = xs[before, parent, :n]
                v, w = _command(number, y, commands, seconds, stand_off, limits)
                dx, dy, heading = drive(y, v, w, seconds)
                cost = costs[before, parent] + (0.0 if number == PURSUE else weights[6])
                cost += _place_cost(y, pillars, num_pillars, model.landmark_radius, weights, stand_off)
                if found == room and cost >= costs[now, kept[room - 1]]:
                    continue
                Q[:n, :n] = Ps[before, parent, :n, :n]
                grow(Q, n, dx, dy, heading, v, w, seconds, steps, model, density)
                seen = _look_around(y, Q, n, pillars, num_pillars, weights[5], sweeps, model, B)
                cost += Q[TARGET, TARGET] + Q[TARGET + 1, TARGET + 1]
                cost += weights[0] * (Q[0, 0] + Q[1, 1] + Q[2, 2]) + weights[1] * (1.0 - seen)
                costs[now, child] = cost
                firsts[now, child] = number if depth == 0 else firsts[before, parent]
                if found == room and cost >= costs[now, kept[room - 1]]:
                    continue
                at = min(found, room - 1)
                while at > 0 and cost < costs[now, kept[at - 1]]:
                    kept[at] = kept[at - 1]
                    at -= 1
                kept[at] = child
                found = min(found + 1, room)
        for b in range(found):
            keep[b] = kept[b]
        parents = found
    return firsts[(horizon - 1) % 2, keep[0]]
