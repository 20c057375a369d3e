"""Weighted points that say where a lost target may be, beside any estimator: what NOT seeing it teaches."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimators.interface import Bools, Estimator, Floats, Ints, Scan
from estimators.kernels.cloud_flight import PRIOR
from estimators.kernels.cloud_life import FOLLOWING, LOST, NEVER, begin, fill, foresee, learn, look, miss, move
from estimators.kernels.cloud_motion import ROWS
from estimators.kernels.random import lane_key

_KEY_PURPOSE = 23  # keeps the cloud's stream apart from others that are given the same seed
_BELIEF = (
    "target_position", "target_position_cov", "target_velocity", "target_velocity_cov", "target_heading",
    "target_heading_var",
)  # fmt: skip


class TargetCloud:
    """N weighted points per lane that stand for the target where one Gaussian cannot: while it is lost.

    A companion of ANY estimator: it reads its `Belief`, its models and the scans. While the target is seen, the points
    are draws from the Gaussian belief. The first complete sweep without a return of it makes it LOST, and from then on
    the points live by themselves until the next return:

    1. they are drawn from the Gaussian belief (position, and velocity or heading by the lane's `TargetModel`); a target
       that was never seen has them spread evenly over the arena, or over a disc around the robot;
    2. `predict` moves them with the target model's own noise. A lost target also manoeuvres: at rate `turn_rate` a
       point sets out anew at the same speed, towards a place drawn evenly from the arena (in any direction where there
       is no arena), and at the arena's walls it does so at once;
    3. NEGATIVE INFORMATION: at every complete sweep without a return, w <- w (1 - p_d), where p_d is the probability
       that the sensor would have reported the point: `detection_probability` if it is in range, in the field of view
       and behind no mapped pillar (`SensorModel.landmark_radius` about the landmarks' means). Edges are as soft as
       pose and pillars are uncertain;
    4. with `evasive`, whether the target flees is learned while it is seen (`estimators.kernels.cloud_flight`): log
       odds of courses straight away from the robot against others. As many points as it is likely to then flee from
       a robot within the sensor's range, and along the walls;
    5. below `threshold` x N effective points they are resampled systematically, the copies roughened, and a share
       `scatter` of them is born anew anywhere, so that a wrong model can be unlearned.

    The points stand in `belief.target_cloud`: positions [L, N, 2] in the world's frame and weights [L, N] that sum to
    one, valid until the next call. `predict` and `update` come after the estimator's own.

    Where not to use it: as a consistent posterior. The pose's error, which all points share, counts as if each had its
    own, and the manoeuvres are a guess at what targets do.

    Args:
        estimator: whose belief it accompanies; needs a target model.
        num_points: N.
        arena: (width, height) [m] about the origin in which the target moves; None: no bounds known.
        negative_information: False: sweeps without a return say nothing (for comparison).
        evasive: whether to learn that the target flees.
        turn_rate: [1/s] at which a lost target takes a new direction.
        prior_radius: [m] of the disc without an arena; None: twice the sensor's range.
        scatter: share of points born anew at each resampling, in [0, 1].
        roughening: of resampled copies, in units of the cloud's spread / sqrt(N).
        miss_floor: least factor 1 - p_d, in (0, 1].
        threshold: of resampling, share of N in [0, 1].

    Raises:
        ValueError: an estimator without a target, or a number out of its range.

    Reference: Stone, Theory of Optimal Search, 1975; Bourgault, Furukawa and Durrant-Whyte, "Coordinated decentralized
    search for a lost target in a Bayesian world", IROS 2003; roughening: Gordon, Salmond and Smith 1993.
    """

    def __init__(
        self,
        estimator: Estimator,
        num_points: int = 256,
        *,
        arena: tuple[float, float] | None = None,
        negative_information: bool = True,
        evasive: bool = False,
        turn_rate: float = 0.25,
        prior_radius: float | None = None,
        scatter: float = 0.01,
        roughening: float = 0.2,
        miss_floor: float = 0.02,
        threshold: float = 0.5,
    ) -> None:
        if estimator.target is None:
            raise ValueError("a target cloud needs an estimator built with a target model; this one has target=None")
        if isinstance(num_points, bool) or not isinstance(num_points, (int, np.integer)) or num_points < 2:
            raise ValueError(f"num_points must be a whole number of at least 2; got {num_points!r}")
        radius = 2.0 * estimator.sensor.max_range if prior_radius is None else prior_radius
        half_width, half_height = (math.inf, math.inf) if arena is None else (0.5 * arena[0], 0.5 * arena[1])
        _check_range("arena", min(half_width, half_height), 1e-9, math.inf)
        _check_range("turn_rate", turn_rate, 0.0, math.inf)
        _check_range("prior_radius", radius, 1e-9, math.inf)
        _check_range("roughening", roughening, 0.0, math.inf)
        for name, value in (("scatter", scatter), ("threshold", threshold)):
            _check_range(name, value, 0.0, 1.0)
        _check_range("miss_floor", miss_floor, 1e-12, 1.0)
        self.estimator, self.num_points, self.negative_information = estimator, int(num_points), negative_information
        self.evasive = bool(evasive)
        self._settings = tuple(
            map(float, (half_width, half_height, radius, turn_rate, scatter, roughening, miss_floor, threshold))
        )
        L, N = estimator.num_lanes, self.num_points
        self._rows: Floats = np.zeros((L, ROWS, N))
        self._w: Floats = np.full((L, N), 1.0 / N)
        self._key = np.zeros(L, dtype=np.uint64)
        self._step: Ints = np.zeros(L, dtype=np.int64)
        self._mode: Ints = np.full(L, FOLLOWING, dtype=np.int64)
        self._evasion: Floats = np.full(L, PRIOR if evasive else NEVER)
        self._since: Floats = np.zeros(L)
        self._scratch: Floats = np.zeros((ROWS, N))
        self._noise: Floats = np.zeros((3, N))
        self._whole: Ints = np.zeros((3, N), dtype=np.int64)
        self._missed: Ints = np.zeros(L, dtype=np.int64)
        self._points: Floats = np.zeros((L, N, 2))
        self._weights: Floats = np.full((L, N), 1.0 / N)
        self._stale = True
        estimator.belief.attach_cloud(self)

    @property
    def lost(self) -> Bools:
        """[L] whether the points live by themselves: the target was not in the latest complete sweep."""
        return np.asarray(self._mode == LOST)

    def reset(self, lanes: Ints | None, seeds: ArrayLike) -> None:
        """A new episode in the named lanes (None: all), after the estimator's own reset; seeds [n]: of the draws."""
        chosen = self.estimator.all_lanes if lanes is None else np.asarray(lanes, dtype=np.int64)
        for lane, seed in zip(chosen, np.broadcast_to(np.asarray(seeds, dtype=np.int64), chosen.shape), strict=True):
            self._key[lane] = lane_key(int(seed), _KEY_PURPOSE)
        if self.evasive:
            self._evasion[chosen] = PRIOR
        self._since[chosen] = 0.0
        belief = self.estimator.belief
        begin(
            chosen, self._rows, self._w, self._key, self._step, self._mode, self.estimator.models, belief.target_known,
            belief.pose, self._settings,
        )  # fmt: skip
        self._stale = True

    def predict(self, dt: float | Floats, lanes: Ints | None = None) -> None:
        """Move the points of lost targets by dt seconds (scalar or [L])."""
        steps = np.broadcast_to(np.asarray(dt, dtype=np.float64), (self.estimator.num_lanes,))
        chosen = self.estimator.all_lanes if lanes is None else lanes
        move(
            chosen, self._rows, self._scratch, self._key, self._step, self._mode, self.estimator.models, steps,
            self._pose(), self._evasion, self._settings,
        )  # fmt: skip
        self._since[chosen] += steps[chosen]
        self._stale = True

    def update(self, scan: Scan, lanes: Ints | None = None) -> None:
        """Take in one sweep, after the estimator has (arrays in `scan` span all L lanes)."""
        chosen = self.estimator.all_lanes if lanes is None else lanes
        belief = self.estimator.belief
        known = belief.target_known
        if self.evasive:
            learn(
                chosen, scan.labels, scan.count, known, belief.pose, belief.target_position, belief.target_velocity,
                self._since, self.estimator.models, self._evasion, self._settings,
            )  # fmt: skip
        n = look(scan.labels, scan.count, chosen, known, scan.complete, self._mode, self._missed)
        self._stale = True
        if n == 0:
            return
        copies, source, destination = self._whole
        miss(
            self._missed[:n], self._rows, self._w, self._key, self._step, self._mode, self.estimator.models, known,
            belief.pose, belief.pose_cov, self._gaussian(), belief.landmark_mapped, belief.landmark_rel,
            belief.landmark_rel_cov, self.negative_information, self._settings, self._scratch[0], copies, source,
            destination,
        )  # fmt: skip

    def _pose(self) -> Floats:
        """[L, 3] of the robots that targets may flee from; where none does nobody reads it, and it is not refreshed."""
        belief = self.estimator.belief
        return belief.pose if self.evasive else np.asarray(belief.buffers["pose"])

    def _gaussian(self) -> tuple[Any, ...]:
        belief = self.estimator.belief
        return tuple(getattr(belief, name) for name in _BELIEF)

    def points(self) -> tuple[Floats, Floats]:
        """Positions [L, N, 2] and weights [L, N], valid until the next call; see `Belief.target_cloud`."""
        if self._stale:
            self._stale = False
            fill(
                self._rows, self._w, self._key, self._step, self._mode, self.estimator.models,
                self.estimator.belief.target_known, self._gaussian(), self._scratch, self._points, self._weights,
            )  # fmt: skip
        return self._points, self._weights

    def foresee(self, lane: int, dt: float, ahead: Floats) -> None:
        """Where one lane's points will be after dt, 2 dt, ... seconds if nothing is seen: written to `ahead` [T, N, 2].

        One way that each may go, drawn from the model they move by; the cloud itself stays as it is.
        """
        foresee(
            lane, self._rows, self._key, self._step, self._mode, self.estimator.models,
            self.estimator.belief.target_known, self._gaussian(), dt, self._pose(), self._evasion,
            self._settings, self._scratch, self._noise, ahead,
        )  # fmt: skip

    def get_state(self) -> dict[str, NDArray[Any]]:
        """Everything that changes between calls, as copies; `set_state` goes on from there bit for bit."""
        arrays = {"rows": self._rows, "w": self._w, "key": self._key, "step": self._step, "mode": self._mode,
                  "evasion": self._evasion, "since": self._since}  # fmt: skip
        return {name: array.copy() for name, array in arrays.items()}

    def set_state(self, state: dict[str, NDArray[Any]]) -> None:
        """Restore what `get_state` returned; the estimator's own state is restored apart."""
        for name, array in state.items():
            getattr(self, f"_{name}")[:] = array
        self._stale = True


def _check_range(name: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:
        raise ValueError(f"TargetCloud: {name} must be a number from {low:g} to {high:g}; got {value!r}")
