"""How far a belief is from the truth, and whether it knows: errors and NEES of one instant.

Nothing here touches an environment: a `Meter` takes a `Belief` and arrays of truth, so a simulated world, a recorded
robot and a user's own loop are measured by the same code. What is made of many instants and runs (ANEES, shares inside
the chi-square bounds, divergence) is in `slam_gym.consistency`, landmarks without ids in `slam_gym.assignment`; the
names of both are importable from here too.
"""

from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from estimators.interface import Belief
from estimators.kernels.bound import LATER, Bound, bind, chain
from slam_gym.assignment import LANDMARK_GATE, gospa, match_landmarks
from slam_gym.consistency import anees, diverged, in95_mean, in95_run, nees, nees_bounds, nis
from slam_gym.metrics_kernels import COORDINATES, METRIC, measure, measure_map

__all__ = [
    "LANDMARK_GATE", "LOST_AFTER", "METRIC", "Meter", "anees", "diverged", "gospa", "in95_mean", "in95_run",
    "match_landmarks", "nees", "nees_bounds", "nis",
]  # fmt: skip

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

LOST_AFTER = 2.0  # [s] without a return of the target: its track counts as lost

_BELIEF = itemgetter(
    "pose", "pose_cov", "target_known", "target_mean", "target_cov", "target_position", "target_position_cov",
    "target_velocity", "target_heading", "target_rel",
)  # fmt: skip
_MAP = itemgetter("landmark_mapped", "landmark_mean", "landmark_cov")


class Meter:
    """Measures beliefs of L lanes against the truth.

    Args:
        num_lanes: L.
        max_landmarks: M, the estimators' capacity.
        landmark_gate: [m], see `match_landmarks`.

    Attributes:
        record: [L] of `METRIC`, refilled by each `measure`; values [L, F]: the same numbers, its fields in order.
    """

    def __init__(self, num_lanes: int, max_landmarks: int, *, landmark_gate: float = LANDMARK_GATE) -> None:
        self.num_lanes, self.max_landmarks = int(num_lanes), int(max_landmarks)
        self.landmark_gate = float(landmark_gate)
        self.record: NDArray[np.void] = np.zeros(self.num_lanes, dtype=METRIC)
        self.values: Floats = self.record.view(np.float64).reshape(self.num_lanes, -1)
        self.values.fill(np.nan)
        self._all = np.arange(self.num_lanes)
        self._no_target = np.full((self.num_lanes, 4), np.nan)
        self._match = np.full((self.num_lanes, self.max_landmarks), -1, dtype=np.int64)
        self._names: tuple[str, ...] | None = None
        self._codes: Ints = np.empty(0, dtype=np.int64)
        self._truth, self._work = np.zeros(len(COORDINATES)), np.zeros((1, 1))

    def _learn(self, names: tuple[str, ...]) -> None:
        """Which truth each coordinate of the target's state is compared with; none where one is unheard of."""
        codes = [COORDINATES.get(name, -1) for name in names]
        self._names = names
        self._codes = np.array(codes if -1 not in codes else [], dtype=np.int64)
        self._work = np.zeros((len(codes) + 1, max(len(codes), 1)))

    @property
    def scratch(self) -> tuple[Floats, Floats]:
        """Arrays that `bound` writes and nobody reads: threads need their own."""
        return self._truth, self._work

    def measure(
        self,
        belief: Belief,
        world_pose: Floats,
        world_target: Floats | None,
        world_landmarks: Floats | None = None,
        landmark_count: Ints | None = None,
        labelled: bool = True,
        *,
        target_heading: Floats | None = None,
        lanes: Ints | None = None,
    ) -> NDArray[np.void]:
        """Compare a belief with the truth.

        Args:
            belief: of L lanes.
            world_pose: [L, 3] true (x, y, heading).
            world_target: [L, 4] true (x, y, velocity_x, velocity_y); None in a world without a target.
            world_landmarks: [L, N, 2] by id; None: the map is not looked at (and not refreshed: cheaper).
            landmark_count: [L] how many of the N exist; None: all.
            labelled: whether a landmark's id in the belief is the world's (known association). Otherwise each
                estimated landmark is matched with a true one by `match_landmarks`, and GOSPA is computed.
            target_heading: [L] the true one; None: the direction of its velocity.
            lanes: [n] which to measure; None: all. The others' records stay as they were.

        Returns:
            [L] records of `METRIC`: `self.record`, overwritten by the next call.
        """
        lanes = self._all if lanes is None else lanes
        if belief.target_names != self._names:
            self._learn(belief.target_names)
        if world_target is None:
            world_target = self._no_target
        if target_heading is None:
            target_heading = np.arctan2(world_target[:, 3], world_target[:, 2])
        belief.pose  # noqa: B018  (refreshes robot and target)
        measure(
            lanes, *_BELIEF(belief.buffers), world_pose, world_target, target_heading,
            self._codes, self._truth, self._work, self.values,
        )  # fmt: skip
        if world_landmarks is not None:
            if landmark_count is None:
                landmark_count = np.full(self.num_lanes, world_landmarks.shape[1], dtype=np.int64)
            match = belief.landmark_id  # refreshes the map
            if not labelled:
                match = self._match_lanes(belief, world_landmarks, landmark_count, lanes)
            measure_map(lanes, *_MAP(belief.buffers), match, world_landmarks, landmark_count, self.values)
        return self.record

    def bound(
        self,
        belief: Belief,
        world_pose: Floats,
        world_target: Floats | None,
        world_landmarks: Floats,
        landmark_count: Ints,
        target_heading: Floats,
    ) -> Bound:
        """`measure` of ever the same arrays with labels, for the lanes to be given; the belief must be fresh.

        Without labels a `landmark_count` of none leaves the map's size.
        """
        if belief.target_names != self._names:
            self._learn(belief.target_names)
        core = bind(
            measure, LATER, *_BELIEF(belief.buffers), world_pose,
            self._no_target if world_target is None else world_target, target_heading,
            self._codes, self._truth, self._work, self.values,
        )  # fmt: skip
        marks = bind(
            measure_map, LATER, *_MAP(belief.buffers), belief.buffers["landmark_id"], world_landmarks, landmark_count,
            self.values,
        )  # fmt: skip
        return chain(core, marks)

    def _match_lanes(self, belief: Belief, landmarks: Floats, count: Ints, lanes: Ints) -> Ints:
        for lane in lanes:
            slots = np.flatnonzero(belief.landmark_mapped[lane])
            found, truth = belief.landmark_mean[lane, slots], landmarks[lane, : count[lane]]
            self._match[lane] = -1
            self._match[lane, slots] = match_landmarks(found, truth, self.landmark_gate)
            self.record["landmark_gospa"][lane] = gospa(found, truth, self.landmark_gate)
        return self._match
