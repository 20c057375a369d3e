"""The compressed extended Kalman filter: the joint EKF, at a cost that hardly knows the size of the map."""

from typing import Any, ClassVar

import numpy as np

from estimators.gaussian.belief import fill_core
from estimators.gaussian.ekf import EKF, predict, update
from estimators.gaussian.layout import Call
from estimators.gaussian.postponed import (
    ASLEEP,
    PAST,
    STRIP,
    SUMS,
    adopt,
    awaken,
    bring_up,
    fill_map,
    join,
    past_slots,
    restart,
)
from estimators.gaussian.shrinking import has_shrunk, is_sharp
from estimators.gaussian.vague_target import AT_MEAN, sort_out, take_back
from estimators.interface import Belief, Floats, Ints, Scan
from estimators.kernels.association import slot_of
from estimators.kernels.bound import LATER, bind
from estimators.kernels.gaussian import BLOCK, ROBOT
from estimators.kernels.jit import inline, jit
from estimators.kernels.left_looking import scratch
from estimators.kernels.range_bearing import usable
from estimators.kernels.simd import aligned_zeros

ACTIVE = 32  # landmarks


@inline
def look_up(lane, count, ids, a_count, a_ids, ranges, bearings, labels, num_returns, slots):
    """Which landmark each return awakens, into `slots`, or ASLEEP; (how many such returns, how many of new ones)."""
    known, new = 0, 0
    for k in range(num_returns):
        label = labels[lane, k]
        slots[lane, k] = ASLEEP
        if label < 0 or not usable(ranges[lane, k], bearings[lane, k]):
            continue
        if slot_of(a_ids, lane, a_count[lane], label) >= 0:
            continue
        landmark = slot_of(ids, lane, count[lane], label)
        if landmark >= 0:
            slots[lane, k] = landmark
            known += 1
        else:
            new += 1
    return known, new


@jit
def compressed_update(
    mu, P, models, n_t, count, ids, first, next_id, target_known, pending, counters, last_dt, ranges, bearings, labels,
    counts, code, gates, slots, cost, work, lanes, a_mu, a_P, a_count, a_ids, a_first, whole, live, roots, rows, C,
    weights, block, line, low_rank,
):  # fmt: skip
    """`ekf.update` of the active part; a sweep that holds more landmarks than it has room for is taken by the whole.

    So is one whose returns are very sharp (`estimators.gaussian.shrinking`). Afterwards `slots` names landmarks of the
    whole state.
    """
    capacity = a_ids.shape[1]
    for i in range(lanes.size):
        lane = lanes[i]
        n = counts[lane]
        known, new = look_up(lane, count, ids, a_count, a_ids, ranges, bearings, labels, n, slots)
        fits = count[lane] + new <= ids.shape[1]
        if not fits or a_count[lane] + 2 * known + new > capacity:
            bring_up(
                lane, mu, P, a_mu, a_P, n_t, count, a_count, a_ids, whole, live, roots, rows, C, weights, block, line,
                low_rank,
            )  # fmt: skip
            known, new = look_up(lane, count, ids, a_count, a_ids, ranges, bearings, labels, n, slots)
        fits = fits and a_count[lane] + 2 * known + new <= capacity
        if fits:
            for k in range(n):
                if slots[lane, k] != ASLEEP and live[lane, slots[lane, k]] == ASLEEP:
                    join(lane, slots[lane, k], mu, P, a_mu, a_P, n_t, a_count, a_ids, whole, live, ids, roots, rows)
            if is_sharp(lane, a_P, models[lane], n_t, a_count, a_ids, target_known, ranges, bearings, labels, n):
                fits = False
                bring_up(
                    lane, mu, P, a_mu, a_P, n_t, count, a_count, a_ids, whole, live, roots, rows, C, weights, block,
                    line, low_rank,
                )  # fmt: skip
        if not fits:
            update(
                mu, P, models, n_t, count, ids, first, next_id, target_known, pending, counters, last_dt, ranges,
                bearings, labels, counts, code, gates, slots, cost, work, lanes[i : i + 1],
            )  # fmt: skip
            restart(lane, mu, P, a_mu, a_P, n_t, a_count, a_ids, live, roots, rows)
            continue
        before = a_count[lane]
        update(
            a_mu, a_P, models, n_t, a_count, a_ids, a_first, next_id, target_known, pending, counters, last_dt, ranges,
            bearings, labels, counts, code, gates, slots, cost, work, lanes[i : i + 1],
        )  # fmt: skip
        adopt(lane, before, count, ids, first, a_count, a_ids, a_first, whole, live)
        for k in range(n):
            if slots[lane, k] >= 0:
                slots[lane, k] = whole[lane, slots[lane, k]]
        if has_shrunk(lane, P, a_P, n_t, a_count, a_ids, whole):
            bring_up(
                lane, mu, P, a_mu, a_P, n_t, count, a_count, a_ids, whole, live, roots, rows, C, weights, block, line,
                low_rank,
            )  # fmt: skip


@jit
def awaken_above(
    limit, mu, P, a_mu, a_P, n_t, count, a_count, a_ids, whole, live, roots, rows, C, weights, block, line,
    low_rank, lanes,
):  # fmt: skip
    """Bring those lanes up to date whose map is above the limit: landmarks are going to be removed."""
    for i in range(lanes.size):
        lane = lanes[i]
        if count[lane] > limit:
            bring_up(
                lane, mu, P, a_mu, a_P, n_t, count, a_count, a_ids, whole, live, roots, rows, C, weights, block, line,
                low_rank,
            )  # fmt: skip


class CompressedEKF(EKF):
    """Joint EKF whose landmarks out of sight wait: equal to `ekf` up to rounding, for maps of hundreds and more.

    **Idea.** A sweep sees a few landmarks, and the covariance of the others changes through robot, target and those few
    alone. So those looked at lately (the active ones, at most `active`) are filtered exactly as in `ekf`, beside a
    record of as many rows of how they have changed since the others were last touched; a step costs what it costs in a
    map of about twice the active landmarks, however large the map. A landmark that comes back is brought up to date by
    itself; all are where the active ones have no room for what a sweep holds (`estimators.gaussian.postponed`: the
    equations, which are exact).

    **Reading.** The belief is right whenever it is read. Robot and target cost nothing more; the map costs
    O(active^2) for each landmark, so a map of a thousand is not to be read at every step if time counts.

    Args:
        motion, sensor, target, num_lanes, max_landmarks: see `Estimator`.
        active: largest number of landmarks filtered at each step, at least 1. More room makes a step dearer and the
            moments rarer at which the whole map is brought up to date; it should be several times what a sweep sees.
            A sweep that holds more is taken by the full filter.
        gate, budget: see `GaussianEstimator`. The other options there are for `association="known"` only. Under a
            budget each removal brings the map up to date, and nothing is saved.

    When to use: maps of more than a hundred landmarks, of which few are seen at a time.

    Known weakness: that of `ekf`. Labels are needed, and a target of kind "imm" is not for it; a twist target seen for
    the first time waits for its second sighting (`first_heading="two-sightings"`).

    Reference: Guivant and Nebot, "Optimization of the simultaneous localization and map-building algorithm for
    real-time implementation", IEEE Transactions on Robotics and Automation 2001.
    """

    name: ClassVar[str] = "compressed-ekf"
    summary: ClassVar[str] = "joint EKF for large maps: landmarks out of sight are brought up to date when needed"
    mean_is_all: ClassVar[bool] = False  # hypotheses copy mu and P, which are not the whole belief here

    def __init__(self, *arguments: Any, active: int = ACTIVE, **options: Any) -> None:
        if isinstance(active, bool) or not isinstance(active, int | np.integer) or active < 1:
            raise ValueError(f"active must be a whole number of landmarks, at least 1; got {active!r}")
        if options.get("association", "known") != "known":
            raise ValueError(
                f'{self.name} knows association="known"; got {options["association"]!r}: unlabelled returns are '
                "compared with every landmark, which the other filters have up to date"
            )
        self.active = int(active)
        super().__init__(*arguments, **options)

    def _own_options(self) -> dict[str, Any]:
        return {"active": self.active}

    def _allocate(self) -> None:
        super()._allocate()
        L, M, first = self.num_lanes, self.max_landmarks, ROBOT + self.n_t
        S = past_slots(self.n_t) + 2 * min(self.active, M)
        n = -(-(first + 2 * S) // BLOCK) * BLOCK
        z = first + 2 * min(self.active, M)
        self.a_mu: Floats = np.zeros((L, n))
        self.a_P: Floats = aligned_zeros(L, n, n)
        self.a_count: Ints = np.full(L, past_slots(self.n_t), dtype=np.int64)
        self.a_ids: Ints = np.full((L, S), PAST, dtype=np.int64)
        self.a_first: Floats = np.zeros((L, S, 3))
        self.whole: Ints = np.zeros((L, S), dtype=np.int64)
        self.live: Ints = np.full((L, M), ASLEEP, dtype=np.int64)
        self.work = scratch(max(n, self.n_max))
        self.roots: Floats = np.zeros((L, z, z))
        self._waking = (  # scratch of `bring_up` and what it consists of
            np.zeros((4, n), dtype=np.int64), np.zeros((z, z)), np.zeros((z + n + 1, z)), np.zeros((z, STRIP)),
            np.zeros(STRIP), aligned_zeros(z, self.n_max),
        )  # fmt: skip
        core, marks = ([self.belief.buffers[name] for name in names] for names in (Belief._CORE, Belief._MAP))
        self._core = bind(fill_core, self.a_mu, self.a_P, self.models, self.target_known, *core, LATER)
        rows, _, weights, block, line, _ = self._waking
        # Scratch of `fill_map`, beside that of `awaken`.
        self._telling = np.zeros((SUMS, STRIP)), np.zeros((1, ROBOT + 2)), np.zeros((1, ROBOT + 2, ROBOT + 2))
        self._map = bind(
            fill_map, self.mu, self.P, self.a_mu, self.a_P, self.n_t, self.count, self.ids, self.a_count, self.a_ids,
            self.whole, self.live, self.roots, rows, weights, block, line, *self._telling, *marks, LATER,
        )  # fmt: skip

    def _after_reset(self, lanes: Ints) -> None:
        for lane in lanes:
            restart(
                lane, self.mu, self.P, self.a_mu, self.a_P, self.n_t, self.a_count, self.a_ids, self.live, self.roots,
                self._waking[0],
            )  # fmt: skip

    def linear_points(self) -> tuple[Floats, int, int]:
        """See `GaussianEstimator.linear_points`."""
        return self.a_mu, ROBOT, AT_MEAN

    def _scratch(self) -> tuple[Any, ...]:
        return (*super()._scratch(), *self._waking, *self._telling)

    def _prediction(self, control: Floats, dt: Floats) -> Call:
        return (
            predict, self.a_mu, self.a_P, self.models, self.n_t, self.a_count, self.target_known, self.pending, control,
            dt, self.last_dt, LATER,
        )  # fmt: skip

    def _correction(self, scan: Scan) -> Call:
        return (
            compressed_update, self.mu, self.P, self.models, self.n_t, self.count, self.ids, self.first, self.next_id,
            self.target_known, self.pending, self.counters, self.last_dt, scan.ranges, scan.bearings, scan.labels,
            scan.count, self.association_code, self.gates, self.slots, self.cost, self.work, LATER, self.a_mu, self.a_P,
            self.a_count, self.a_ids, self.a_first, self.whole, self.live, self.roots, *self._waking,
        )  # fmt: skip

    def _corrections(self, scan: Scan) -> list[Call]:
        calls = [self._correction(scan)]
        if self.n_t > 0:
            first = (
                sort_out, self.a_mu, self.a_P, self.models, self.n_t, self.a_count, self.target_known, self.pending,
                self.counters, self.slots, self.a_mu, ROBOT, float(self.gates[0]), scan.ranges, scan.bearings,
                scan.labels, scan.count, LATER,
            )  # fmt: skip
            last = (
                take_back, self.a_mu, self.a_P, self.work, self.models, self.n_t, self.a_count, self.slots, self.a_mu,
                ROBOT, AT_MEAN, scan.ranges, scan.bearings, scan.labels, scan.count, LATER,
            )  # fmt: skip
            calls = [first, *calls, last]
        if self.budget is not None:
            waking = (
                awaken_above, self.budget.limit, self.mu, self.P, self.a_mu, self.a_P, self.n_t, self.count,
                self.a_count, self.a_ids, self.whole, self.live, self.roots, *self._waking, LATER,
            )  # fmt: skip
            calls += [waking, self.budget.keeping(scan)]
        return calls

    def joint(self, lane: int) -> tuple[Floats, Floats]:
        """See `GaussianEstimator.joint`; O(n^2 active)."""
        mu, P = self.mu[lane : lane + 1].copy(), self.P[lane : lane + 1].copy()
        one = slice(lane, lane + 1)
        awaken(
            0, mu, P, self.a_mu[one], self.a_P[one], self.n_t, self.count[one], self.a_count[one], self.a_ids[one],
            self.whole[one], self.roots[one], *self._waking,
        )  # fmt: skip
        skip = 0 if self.target_known[lane] else self.n_t
        used = np.arange(ROBOT + self.n_t + 2 * self.count[lane])
        used = used[(used < ROBOT) | (used >= ROBOT + skip)]
        return mu[0, used], P[0][np.ix_(used, used)]

    @property
    def _state_names(self) -> tuple[str, ...]:
        return (*super()._state_names, "a_mu", "a_P", "a_count", "a_ids", "a_first", "whole", "live", "roots")
