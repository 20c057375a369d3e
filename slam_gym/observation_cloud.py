"""An observation that says where a lost target may be, from the weighted points of a target cloud.

One Gaussian spreads a lost target's probability over ever larger ellipses; a cloud (`estimators.TargetCloud`) also
knows where the robot has looked in vain. Beside what `slam_gym.observation` lists:

| block   | size | what                                                                                             |
|---------|------|--------------------------------------------------------------------------------------------------|
| sectors | S    | as ever while the target is seen; else the cloud's weight in each sector of directions           |
| cloud   | S    | mean distance of that weight from the robot, in sensor ranges, at most `FAR`; 0 in empty sectors |
"""

import math
from typing import Any

import numpy as np

from estimators.interface import Belief
from estimators.kernels.jit import jit
from slam_gym.observation import FAR, TARGET_SIZE, Observer, _cut, _sector
from slam_gym.scenario import Scenario
from slam_gym.world import World

SEEN = 1  # place of "seen in the latest sweep" in a row


@jit
def _summarise(pose, points, weights, unit, mass, at, out):
    """Every lane's cloud by sector.

    pose [L, 3]; points [L, N, 2], weights [L, N]; unit [m]; mass [S]: scratch; at: where the block `cloud` begins;
    out [L, n]: rows that are filled but for it.
    """
    count = mass.shape[0]
    for lane in range(out.shape[0]):
        c, s = math.cos(pose[lane, 2]), math.sin(pose[lane, 2])
        seen = out[lane, SEEN] > 0.0
        for i in range(count):
            mass[i] = out[lane, at + i] = 0.0
        for p in range(points.shape[1]):
            east, north = points[lane, p, 0] - pose[lane, 0], points[lane, p, 1] - pose[lane, 1]
            i = _sector(c * east + s * north, c * north - s * east, count)
            mass[i] += weights[lane, p]
            out[lane, at + i] += weights[lane, p] * math.hypot(east, north) / unit
        for i in range(count):
            if not seen:
                out[lane, TARGET_SIZE + i] = _cut(mass[i], 0.0, 1.0)
            out[lane, at + i] = _cut(out[lane, at + i] / mass[i], 0.0, FAR) if mass[i] > 0.0 else 0.0


class CloudObserver(Observer):
    """`Observer` of a belief that a target cloud accompanies; the block `cloud` stands last.

    Args:
        scenario, num_lanes, nearest, sectors: see `Observer`.
    """

    def __init__(self, scenario: Scenario, num_lanes: int, nearest: int = 8, sectors: int = 8) -> None:
        super().__init__(scenario, num_lanes, nearest, sectors)
        self.blocks["cloud"] = slice(self.size, self.size + sectors)
        self.size += sectors
        self.low = np.append(self.low, np.zeros(sectors, dtype=np.float32))
        self.high = np.append(self.high, np.full(sectors, FAR, dtype=np.float32))
        self._mass = np.zeros(sectors)
        self.out = np.zeros((num_lanes, self.size), dtype=np.float32)

    def observe(self, belief: Belief, world: World) -> Any:
        """[L, n] a fresh array; see `Observer.observe`."""
        super().observe(belief, world)
        self.fill_cloud(belief)
        return self.out.copy()

    def fill_cloud(self, belief: Belief) -> None:
        """Fill the cloud's part of `out`, after the kernel of `bound` has filled the others; zeros without a cloud."""
        if not belief.has_target_cloud:  # a scenario without a target
            return
        points, weights = belief.target_cloud
        unit, start = float(self.settings[0]), self.blocks["cloud"].start
        _summarise(belief.pose, points, weights, unit, self._mass, start, self.out)
