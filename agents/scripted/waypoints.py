"""Drive a route of waypoints."""

import math
from importlib.resources import files
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from estimators.interface import Belief
from estimators.kernels.angles import wrap
from estimators.kernels.jit import inline, jit
from estimators.registry import unknown_name
from slam_gym.policies import Floats, Ints, Policy, PolicyContext

PACKAGED = "slam_gym.scenarios"  # where a bare file name is looked for when it is not found as a path
COLUMNS = ("x_m", "y_m")


@inline
def _steer(x, y, heading, steering, point_x, point_y, rate, limit):
    """New steering angle: towards the point, at most `rate` further than before, within the limit."""
    change = wrap(math.atan2(point_y - y, point_x - x) - heading - steering)
    steering += max(-rate, min(rate, change))
    return max(-limit, min(limit, steering))


@jit
def _follow(pose, points, settings, bicycle, steering, next_point, finished, command):
    """One command per lane: steer to the next point.

    Where the last point is reached, a lane keeps its command for one more decision, as the standard simulator does;
    at the next one it is finished and stops.

    pose [L, 3]; points [n, 2]; settings: (speed, radius [m], steering change per decision, steering limit, turn gain,
    turn limit); steering [L], next_point [L], finished [L]: state; command [L, 2]: output.
    """
    speed, radius, rate, limit, gain, turn_limit = settings
    for lane in range(command.shape[0]):
        x, y, heading = pose[lane]
        i = next_point[lane]
        if i == points.shape[0]:
            finished[lane] = True
            command[lane, 0] = 0.0
            command[lane, 1] = steering[lane] if bicycle else 0.0
            continue
        if math.hypot(points[i, 0] - x, points[i, 1] - y) < radius:
            i += 1
            next_point[lane] = i
            if i == points.shape[0]:
                continue
        command[lane, 0] = speed
        if bicycle:
            steering[lane] = _steer(x, y, heading, steering[lane], points[i, 0], points[i, 1], rate, limit)
            command[lane, 1] = steering[lane]
        else:
            bearing = wrap(math.atan2(points[i, 1] - y, points[i, 0] - x) - heading)
            command[lane, 0] = speed * max(0.0, math.cos(bearing))
            command[lane, 1] = max(-turn_limit, min(turn_limit, gain * bearing))


@jit
def _integrate(pose, command, dt, steps, wheelbase, bicycle):
    """Move nominal poses [L, 3] on without noise; Eq. (15), Tian et al. 2010, or Eq. (16), Wu and Sun 2013."""
    for lane in range(pose.shape[0]):
        x, y, heading = pose[lane]
        v, turn = command[lane]
        for _ in range(steps):
            if bicycle:
                x += v * dt * math.cos(heading + turn)
                y += v * dt * math.sin(heading + turn)
                heading = wrap(heading + v * dt * math.sin(turn) / wheelbase)
            else:
                heading = wrap(heading + turn * dt)
                x += v * dt * math.cos(heading)
                y += v * dt * math.sin(heading)
        pose[lane, 0] = x
        pose[lane, 1] = y
        pose[lane, 2] = heading


class Waypoints(Policy):
    """Drives once along a route of points, then stops and reports itself finished.

    A bicycle steers as in the paper of Tian et al. 2010 (the law of the simulator that its map comes from): the wheels
    turn towards the next point, no faster than the steering rate and no farther than the steering limit. A unicycle
    turns towards the next point at a rate proportional to its bearing and drives as fast as it faces it. A point is
    reached at less than `radius` from it.

    Args:
        context: models and limits.
        num_lanes: L.
        file: CSV with the columns x_m, y_m: a path, or the name of a file that comes with slam-gym.
        points: [[x, y], ...] instead of a file. Without both: a rectangle of 60 % of the arena.
        follow: "belief": steer by the believed pose; "commands": steer by the pose that the commands alone give from
            the known start. Where the truth executes commands cleanly and only the reported odometry is disturbed (the
            scenarios tian-sparse and tian-dense), the second drives exactly along the route.
        speed: [m/s]; default: the robot's highest.
        radius: [m].
        turn_gain: [1/s], unicycle.

    Raises:
        ValueError: a missing or foreign file, fewer than two points, numbers out of range.
    """

    summary = "drives one loop along the points of a CSV file"

    def __init__(
        self,
        context: PolicyContext,
        num_lanes: int = 1,
        *,
        file: str | None = None,
        points: ArrayLike | None = None,
        follow: Literal["belief", "commands"] = "belief",
        speed: float | None = None,
        radius: float = 1.0,
        turn_gain: float = 2.0,
    ) -> None:
        super().__init__(context, num_lanes)
        if follow not in ("belief", "commands"):
            raise ValueError(f"waypoints: {unknown_name('follow', str(follow), ['belief', 'commands'])}")
        if file is not None and points is not None:
            raise ValueError("waypoints: give a file or points, not both")
        speed = context.speed_max if speed is None else speed
        for name, value in (("speed", speed), ("radius", radius), ("turn_gain", turn_gain)):
            if not 0.0 < value < math.inf:
                raise ValueError(f"waypoints: {name} must be a positive number; got {value!r}")
        self.points = _route(context, file, points)  # [n, 2]
        self._settings = (
            float(speed), float(radius), context.steering_rate * context.dt, context.steering_max, float(turn_gain),
            context.turn_max,
        )  # fmt: skip
        self._by_commands = follow == "commands"
        self._pose: Floats = np.tile(np.asarray(context.start, dtype=np.float64), (num_lanes, 1))  # [L, 3], nominal
        self._steering = np.zeros(num_lanes)
        self._next = np.zeros(num_lanes, dtype=np.int64)

    def reset(self, lanes: Ints, seeds: Ints) -> None:
        """Back to the start of the route, wheels straight."""
        self._pose[lanes] = self.context.start
        self._steering[lanes] = 0.0
        self._next[lanes] = 0
        self.finished[lanes] = False

    def act(self, observation: Floats | None, belief: Belief) -> Floats:
        """Steer to the next point; see `Policy.act`."""
        bicycle, motion = self.context.is_bicycle, self.context.motion
        pose = self._pose if self._by_commands else belief.pose
        _follow(pose, self.points, self._settings, bicycle, self._steering, self._next, self.finished, self.command)
        if self._by_commands:
            _integrate(self._pose, self.command, self.context.step_dt, self.context.hold, motion.wheelbase, bicycle)
        return self.to_action(self.command)


def _route(context: PolicyContext, file: str | None, points: ArrayLike | None) -> Floats:
    if file is not None:
        return read_waypoints(file)
    if points is None:
        x, y = 0.3 * context.arena[0], 0.3 * context.arena[1]
        points = [[x, -y], [x, y], [-x, y], [-x, -y]]
    found = np.asarray(points, dtype=np.float64)
    if found.ndim != 2 or found.shape[1] != 2 or len(found) < 2 or not np.isfinite(found).all():
        raise ValueError(f"waypoints: points must be at least two finite pairs [x, y]; got shape {found.shape}")
    return np.ascontiguousarray(found)


def read_waypoints(file: str) -> Floats:
    """Points [n, 2] of a CSV file with the header x_m,y_m.

    Raises:
        ValueError: no such file, other columns, or something that is not a finite number.
    """
    path = Path(file)
    if not path.is_file():
        path = Path(str(files(PACKAGED).joinpath(Path(file).name)))
        if not path.is_file():
            raise ValueError(f"waypoints: there is no file {str(file)!r}; give the path of a CSV file with x_m,y_m")
    lines = path.read_text().split()
    if not lines or tuple(lines[0].split(",")) != COLUMNS:
        raise ValueError(
            f"waypoints: {path} must start with the line x_m,y_m; got {lines[0] if lines else 'nothing'!r}"
        )
    try:
        rows = np.array([[float(number) for number in line.split(",")] for line in lines[1:]])
    except ValueError as error:
        raise ValueError(f"waypoints: {path} holds something that is not a pair of numbers: {error}") from error
    if rows.ndim != 2 or rows.shape[1] != 2 or len(rows) < 2 or not np.isfinite(rows).all():
        raise ValueError(f"waypoints: {path} must hold at least two rows of two finite numbers; got shape {rows.shape}")
    return rows
