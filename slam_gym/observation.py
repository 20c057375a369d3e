"""What a policy sees: the belief in the robot's own frame, as one flat row of bounded numbers. Never the truth.

Lengths are in units of the sensor's range and cut at `FAR` of them, speeds in units of the robot's top speed, so that
one network fits robots of any size. With K landmarks (`nearest`) and S sectors (`sectors`), in this order:

| block         | size | what                                                                                       |
|---------------|------|--------------------------------------------------------------------------------------------|
| target        | 11   | known (0/1); seen in the latest sweep (0/1); time since seen / 10 s, at most 1; range; sine |
|               |      | and cosine of the bearing; velocity forward and left, along the robot's axes; standard      |
|               |      | deviations forward and left; their correlation                                              |
| sectors       | S    | probability that the target lies in each sector of directions, the first centred straight   |
|               |      | ahead, then to the left around the robot                                                    |
| robot         | 9    | x, y; sine and cosine of the heading; standard deviations of the position along and across  |
|               |      | the heading, of the heading [rad]; reported speed; reported turn rate or steering angle, of  |
|               |      | the highest                                                                                 |
| walls         | 4    | distance to the arena's border ahead, left, behind, right (0 outside)                       |
| landmarks     | 5 K  | the K nearest in the map, nearest first: range, sine and cosine of the bearing, standard    |
|               |      | deviations forward and left; zeros where there are fewer                                    |
| landmark_mask | K    | 1 where a row holds a landmark                                                              |

Covariances are relative to the robot and include the cross terms with its pose. Where there is no target, or it is
not known yet, its numbers are zero. The sectors hold: the whole mass in the sector of the estimate while the target is
seen; else the share of 64 equally probable points of its Gaussian; the same in each while it is not known.
"""

import math
from collections.abc import Callable
from operator import itemgetter
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from estimators.interface import Belief
from estimators.kernels.bound import LATER, Bound, bind
from estimators.kernels.jit import inline, jit
from slam_gym.scenario import Scenario
from slam_gym.scenario_fields import low_high, middle
from slam_gym.world import World
from slam_gym.world_state import ODOMETRY, SINCE_SEEN, STEP

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FAR = 5.0  # [sensor ranges] where lengths are cut
FAST = 3.0  # [top speeds] where speeds are cut
TURNED = 4.0  # [rad] where the heading's standard deviation is cut
FORGOTTEN = 10.0  # [s] since seen that counts as 1
TARGET_SIZE, ROBOT_SIZE, WALLS_SIZE, ROW = 11, 9, 4, 5
RINGS, SPOKES = 4, 16  # of the equally probable points

_UNIT, _SPEED, _TURN, _SWEEP, _DT, _HAS_TARGET = range(6)  # of `settings`
_BELIEF = itemgetter(
    "pose", "pose_cov", "target_known", "target_rel", "target_rel_cov", "target_rel_velocity", "landmark_mapped",
    "landmark_rel", "landmark_rel_cov",
)  # fmt: skip


@inline
def _cut(value, low, high):
    """Within [low, high]; what is no number becomes `low`."""
    return (value if value < high else high) if value > low else low


@inline
def _std(variance, unit):
    return _cut(math.sqrt(_cut(variance, 0.0, 1e300)) / unit, 0.0, FAR)


@inline
def seen_now(since, step, sweep, dt):
    """Whether the latest sweep holds a return of the target. since: [s] since seen, counted from the start before."""
    return since < sweep - 0.5 * dt and since < (step - 0.5) * dt


@inline
def _sector(x, y, count):
    """The sector of a direction: number 0 is centred ahead, the others follow to the left."""
    turns = math.atan2(y, x) / (2.0 * math.pi) + 0.5 / count
    return min(int((turns - math.floor(turns)) * count), count - 1)


@inline
def _target(out, lane, at, known, seen, since, rel, cov, velocity, settings):
    out[lane, at] = 1.0 if known else 0.0
    out[lane, at + 1] = 1.0 if seen else 0.0
    out[lane, at + 2] = _cut(since / FORGOTTEN, 0.0, 1.0)
    if not known:
        for i in range(3, TARGET_SIZE):
            out[lane, at + i] = 0.0
        return
    x, y, unit = rel[lane, 0], rel[lane, 1], settings[_UNIT]
    r = math.hypot(x, y)
    out[lane, at + 3] = _cut(r / unit, 0.0, FAR)
    out[lane, at + 4] = _cut(y / r, -1.0, 1.0) if r > 0.0 else 0.0
    out[lane, at + 5] = _cut(x / r, -1.0, 1.0) if r > 0.0 else 1.0
    out[lane, at + 6] = _cut(velocity[lane, 0] / settings[_SPEED], -FAST, FAST)
    out[lane, at + 7] = _cut(velocity[lane, 1] / settings[_SPEED], -FAST, FAST)
    out[lane, at + 8], out[lane, at + 9] = _std(cov[lane, 0, 0], unit), _std(cov[lane, 1, 1], unit)
    product = cov[lane, 0, 0] * cov[lane, 1, 1]
    out[lane, at + 10] = _cut(cov[lane, 0, 1] / math.sqrt(product), -1.0, 1.0) if product > 0.0 else 0.0


@inline
def _sectors(out, lane, at, known, seen, rel, cov, points, borders, count, has_target):
    """A point lies in sector i if it is left of that one's right border and not left of the next one's."""
    start = 1.0 / count if has_target and not known else 0.0
    for i in range(count):
        out[lane, at + i] = start
    if not known:
        return
    x, y = rel[lane, 0], rel[lane, 1]
    if seen:
        out[lane, at + _sector(x, y, count)] = 1.0
        return
    l00 = math.sqrt(max(cov[lane, 0, 0], 1e-12))
    l10 = cov[lane, 0, 1] / l00
    l11 = math.sqrt(max(cov[lane, 1, 1] - l10 * l10, 0.0))
    left_over = points.shape[1]
    for i in range(1, count):
        right_x, right_y, left_x, left_y = borders[i, 0], borders[i, 1], borders[i + 1, 0], borders[i + 1, 1]
        inside = 0
        for p in range(points.shape[1]):
            east, north = x + l00 * points[0, p], y + l10 * points[0, p] + l11 * points[1, p]
            left = right_x * north - right_y * east >= 0.0
            inside += left & (left_x * north - left_y * east < 0.0)
        out[lane, at + i] = inside / points.shape[1]
        left_over -= inside
    out[lane, at] = left_over / points.shape[1]


@inline
def _to_border(x, y, c, s, half_x, half_y):
    """Distance from (x, y) in direction (c, s) to the border of the rectangle; 0 from outside."""
    if not (abs(x) < half_x and abs(y) < half_y):
        return 0.0
    along_x = (half_x - x) / c if c > 0.0 else ((half_x + x) / -c if c < 0.0 else math.inf)
    along_y = (half_y - y) / s if s > 0.0 else ((half_y + y) / -s if s < 0.0 else math.inf)
    return min(along_x, along_y)


@inline
def _robot(out, lane, at, pose, cov, border, v, w, settings):
    x, y, unit = pose[lane, 0], pose[lane, 1], settings[_UNIT]
    c, s = math.cos(pose[lane, 2]), math.sin(pose[lane, 2])
    out[lane, at], out[lane, at + 1] = _cut(x / unit, -FAR, FAR), _cut(y / unit, -FAR, FAR)
    out[lane, at + 2], out[lane, at + 3] = _cut(s, -1.0, 1.0), _cut(c, -1.0, 1.0)
    xx, xy, yy = cov[lane, 0, 0], cov[lane, 0, 1], cov[lane, 1, 1]
    out[lane, at + 4] = _std(c * c * xx + 2.0 * c * s * xy + s * s * yy, unit)
    out[lane, at + 5] = _std(s * s * xx - 2.0 * c * s * xy + c * c * yy, unit)
    out[lane, at + 6] = _cut(math.sqrt(_cut(cov[lane, 2, 2], 0.0, 1e300)), 0.0, TURNED)
    out[lane, at + 7] = _cut(v / settings[_SPEED], -FAST, FAST)
    out[lane, at + 8] = _cut(w / settings[_TURN], -FAST, FAST)
    at += ROBOT_SIZE
    for side in range(WALLS_SIZE):
        out[lane, at + side] = _cut(_to_border(x, y, c, s, border[lane, 0], border[lane, 1]) / unit, 0.0, FAR)
        c, s = -s, c


@inline
def _landmarks(out, lane, at, K, mapped, rel, cov, nearest, unit):
    """The K nearest by insertion into `nearest` [2, K] (squared distance, slot); ties go to the earlier slot."""
    found = 0
    for slot in range(mapped.shape[1]):
        if not mapped[lane, slot]:
            continue
        d = rel[lane, slot, 0] ** 2 + rel[lane, slot, 1] ** 2
        if not d < math.inf or (found == K and not d < nearest[0, K - 1]):
            continue
        i = found if found < K else K - 1
        while i > 0 and nearest[0, i - 1] > d:
            nearest[0, i], nearest[1, i] = nearest[0, i - 1], nearest[1, i - 1]
            i -= 1
        nearest[0, i], nearest[1, i] = d, slot
        found = min(found + 1, K)
    for i in range(K):
        row, there = at + ROW * i, i < found
        out[lane, at + ROW * K + i] = 1.0 if there else 0.0
        if not there:
            for j in range(ROW):
                out[lane, row + j] = 0.0
            continue
        slot, r = int(nearest[1, i]), math.sqrt(nearest[0, i])
        out[lane, row] = _cut(r / unit, 0.0, FAR)
        out[lane, row + 1] = _cut(rel[lane, slot, 1] / r, -1.0, 1.0) if r > 0.0 else 0.0
        out[lane, row + 2] = _cut(rel[lane, slot, 0] / r, -1.0, 1.0) if r > 0.0 else 1.0
        out[lane, row + 3], out[lane, row + 4] = _std(cov[lane, slot, 0, 0], unit), _std(cov[lane, slot, 1, 1], unit)


@jit
def _observe(
    lanes, pose, pose_cov, known, rel, rel_cov, rel_velocity, mapped, landmark_rel, landmark_rel_cov, x, k, border,
    settings, points, borders, nearest, sectors, out,
):  # fmt: skip
    """The rows of the lanes [n]. x, k: the world's blocks, of which only what the robot is told is read.

    out: [L, size] float32.
    """
    has_target = settings[_HAS_TARGET] > 0.0
    for i in range(lanes.shape[0]):
        lane = lanes[i]
        since, step = x[k[SINCE_SEEN] + lane], k[k[STEP] + lane]
        seen = has_target and known[lane] and seen_now(since, step, settings[_SWEEP], settings[_DT])
        _target(out, lane, 0, known[lane], seen, since if has_target else 0.0, rel, rel_cov, rel_velocity, settings)
        at = TARGET_SIZE
        _sectors(out, lane, at, known[lane], seen, rel, rel_cov, points, borders, sectors, has_target)
        at += sectors
        command = k[ODOMETRY] + 2 * lane
        _robot(out, lane, at, pose, pose_cov, border, x[command], x[command + 1], settings)
        at += ROBOT_SIZE + WALLS_SIZE
        _landmarks(out, lane, at, nearest.shape[1], mapped, landmark_rel, landmark_rel_cov, nearest, settings[_UNIT])


def equally_probable_points() -> Floats:
    """[64, 2] points that stand for a standard normal of the plane, each for the same probability."""
    ring = (np.arange(RINGS) + 0.5) / RINGS
    radius = np.repeat(np.sqrt(-2.0 * np.log(1.0 - ring)), SPOKES)
    turn = (np.tile(np.arange(SPOKES), RINGS) + np.repeat(np.arange(RINGS), SPOKES) / RINGS) / SPOKES
    return radius[:, None] * np.column_stack([np.cos(2.0 * np.pi * turn), np.sin(2.0 * np.pi * turn)])


def _whole(name: str, value: Any, low: int, high: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise ValueError(f"{name} must be a whole number from {low} to {high}; got {value!r}")
    return value


class Observer:
    """Turns beliefs into observations; see the module for what is in them.

    Args:
        scenario: whose units and arena count; of a number that is a range the highest, of the turn rate the middle.
        num_lanes: L.
        nearest: K, landmarks shown.
        sectors: S, directions told apart.

    Attributes:
        blocks: name of each block -> its slice of the flat row.
        size: n, of the flat row.
        low, high: [n] float32, bounds.
        border: [L, 2] half the arena's width and height [m], as known to the policy.
        out: [L, n] float32, the last observation.
        scratch: arrays that `bound` writes and nobody reads.

    Raises:
        ValueError: numbers that are not whole or out of reach.
    """

    def __init__(self, scenario: Scenario, num_lanes: int, nearest: int = 8, sectors: int = 8) -> None:
        K, S = _whole("nearest_landmarks", nearest, 1, 1000), _whole("sectors", sectors, 2, 64)
        self.num_lanes, self.sectors = num_lanes, S
        sizes = {
            "target": TARGET_SIZE, "sectors": S, "robot": ROBOT_SIZE, "walls": WALLS_SIZE, "landmarks": ROW * K,
            "landmark_mask": K,
        }  # fmt: skip
        ends = np.cumsum(list(sizes.values()))
        self.blocks = {name: slice(int(end) - size, int(end)) for (name, size), end in zip(sizes.items(), ends,
                                                                                        strict=True)}  # fmt: skip
        self.size = int(ends[-1])
        low, high = self._bounds(K, S)
        self.low, self.high = np.array(low, dtype=np.float32), np.array(high, dtype=np.float32)
        self.border: Floats = np.tile(np.array(scenario.arena.size) / 2.0, (num_lanes, 1))
        robot, bicycle = scenario.robot, scenario.robot.kind == "bicycle"
        turn = middle(robot.steering_max if bicycle else robot.turn_max)
        self.settings: Floats = np.array([
            low_high(scenario.sensor.max_range)[1], low_high(robot.speed_max)[1], turn,
            scenario.dt * scenario.sensor_period, scenario.dt, scenario.has_target,
        ])  # fmt: skip
        self._points, self._nearest = np.ascontiguousarray(equally_probable_points().T), np.zeros((2, K))
        turns = 2.0 * np.pi * (np.arange(S + 1) - 0.5) / S
        self._borders: Floats = np.column_stack([np.cos(turns), np.sin(turns)])
        self.scratch = (self._nearest,)
        self.out: NDArray[np.float32] = np.zeros((num_lanes, self.size), dtype=np.float32)
        self._all = np.arange(num_lanes)
        self._belief: Belief | None = None  # with the world, what `_fill` is bound to
        self._world: World | None = None
        self._fill: Callable[..., None] = _observe

    @staticmethod
    def _bounds(K: int, S: int) -> tuple[list[float], list[float]]:
        low = [0, 0, 0, 0, -1, -1, -FAST, -FAST, 0, 0, -1] + [0] * S
        high = [1, 1, 1, FAR, 1, 1, FAST, FAST, FAR, FAR, 1] + [1] * S
        low += [-FAR, -FAR, -1, -1, 0, 0, 0, -FAST, -FAST] + [0] * WALLS_SIZE
        high += [FAR, FAR, 1, 1, FAR, FAR, TURNED, FAST, FAST] + [FAR] * WALLS_SIZE
        return low + [0, -1, -1, 0, 0] * K + [0] * K, high + [FAR, 1, 1, FAR, FAR] * K + [1] * K

    def space(self, kind: str) -> spaces.Box | spaces.Dict:
        """The space of one lane's observation: "box", or "dict" of the same numbers by block."""
        if kind == "box":
            return spaces.Box(self.low, self.high, dtype=np.float32)
        parts: dict[str, spaces.Space[Any]] = {
            name: spaces.Box(self.low[s], self.high[s], dtype=np.float32) for name, s in self.blocks.items()
        }
        return spaces.Dict(parts)

    def observe(self, belief: Belief, world: World) -> NDArray[np.float32]:
        """[L, n] a fresh array. Of the world only sweeps' ages and odometry are read, which the robot is told."""
        belief.refresh()
        if belief is not self._belief or world is not self._world:
            self._belief, self._world, self._fill = belief, world, self.bound(belief, world)
        self._fill(self._all)
        return self.out.copy()

    def bound(self, belief: Belief, world: World) -> Bound:
        """The kernel that fills the rows of `out` that it is given, from a fresh belief."""
        return bind(
            _observe, LATER, *_BELIEF(belief.buffers), world.floats, world.integers, self.border, self.settings,
            self._points, self._borders, self._nearest, self.sectors, self.out,
        )  # fmt: skip

    def split(self, flat: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
        """Blocks by name of flat rows [..., n], as contiguous copies."""
        return {name: flat[..., where].copy() for name, where in self.blocks.items()}
