"""The joint Gaussian over L lanes: its arrays, options and life; every filter of the family derives from it.

A filter adds two kernels, `_prediction` and `_correction`. The state:

    mu [L, n_max], P [L, n_max, n_max]   robot (x, y, heading), target (n_t), a filter's own `extra_states` (n_e),
                                         landmark of slot j at 3 + n_t + n_e + 2 j; n_max = 3 + n_t + n_e + 2 M rounded
                                         up to a multiple of BLOCK; unused rows are zero
    count [L], ids [L, M], first [L, M, 3], next_id [L]   landmarks in the map, their ids (-1: empty slot), their
                                         first estimates and log odds of existence, landmarks created so far
    target_known [L], pending [L, 4]     whether the target is in the state; see `growth` for one seen but once
    counters [L, K]                      what went wrong, named by COUNTERS
"""

import math
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from estimators.gaussian.belief import fill_core, fill_map
from estimators.gaussian.existence import hide_doubtful, revise_map
from estimators.gaussian.sweep import COUNTERS
from estimators.gaussian.vague_target import AT_MEAN, sort_out, take_back
from estimators.interface import Belief, BoundCalls, Estimator, Floats, Ints, Scan
from estimators.kernels.association import JCBB, KNOWN, NEAREST
from estimators.kernels.bound import LATER, bind, chain
from estimators.kernels.existence import REMOVE_BELOW, check_remove_below, log_odds
from estimators.kernels.gaussian import BLOCK, ROBOT
from estimators.kernels.joint_compatibility import joint_gates, scratch_shape
from estimators.kernels.left_looking import scratch
from estimators.kernels.simd import aligned_zeros
from estimators.models import MotionModel, SensorModel, TargetModel

MATCH_GATE = 9.21  # chi-square, 2 dof, 99 %
NEW_GATE = 25.0  # NIS beyond which an unlabelled return is a landmark of its own
Call = tuple[Any, ...]
"""A kernel and its arguments, `LATER` in the place of the lanes."""

_FIRST_HEADINGS = ("gaussian-sum", "two-sightings")
_ASSOCIATIONS = {"known": KNOWN, "nearest": NEAREST, "jcbb": JCBB}
_STATE = ("mu", "P", "count", "ids", "first", "next_id", "target_known", "pending", "counters", "last_dt", "models")


class GaussianEstimator(Estimator):
    """Base of the filters whose belief is one joint Gaussian over robot, target and landmarks.

    Args:
        motion, sensor, target, num_lanes, max_landmarks: see `Estimator`.
        association: "known", by the labels of the returns; "nearest", gated maximum likelihood with mutual exclusion,
            or "jcbb", the largest jointly compatible set of pairings (`kernels.joint_compatibility`); in the last two
            labels other than TARGET are not looked at.
        gate: NIS (2 dof) above which a labelled return is rejected; infinity: none.
        match_gate: NIS below which an unlabelled return may be matched to a landmark or the target; "jcbb" tests sets
            of pairings at the same level.
        new_gate: NIS above which, against everything, an unlabelled return is a new landmark; what lies between
            the two gates is dropped.
        remove_below: "nearest" and "jcbb": probability of existence below which a landmark is removed, and with which
            false alarms are kept out of the belief (`kernels.existence`); 0 keeps and shows everything.
        budget: largest number of landmarks kept; beyond it the least valuable are marginalised. None: no budget.
        first_heading: what to make of a twist target seen for the first time: "gaussian-sum", eight headings, known at
            once (`estimators.gaussian.first_heading`; labelled returns only); "two-sightings", unknown until a chord
            tells its heading.
    """

    extra_states: ClassVar[int] = 0  # rows between the target and the map
    mean_is_all: ClassVar[bool] = True  # nothing lies beside mu and P that hypotheses or iterated updates would miss

    def __init__(
        self,
        motion: MotionModel,
        sensor: SensorModel,
        target: TargetModel | None,
        *,
        num_lanes: int = 1,
        max_landmarks: int,
        association: Literal["known", "nearest", "jcbb"] = "known",
        gate: float = math.inf,
        match_gate: float = MATCH_GATE,
        new_gate: float = NEW_GATE,
        remove_below: float = REMOVE_BELOW,
        budget: int | None = None,
        first_heading: Literal["gaussian-sum", "two-sightings"] = "gaussian-sum",
    ) -> None:
        super().__init__(motion, sensor, target, num_lanes=num_lanes, max_landmarks=max_landmarks)
        if association not in _ASSOCIATIONS:
            raise ValueError(f"association must be one of {', '.join(map(repr, _ASSOCIATIONS))}; got {association!r}")
        for name, value in (("gate", gate), ("match_gate", match_gate), ("new_gate", new_gate)):
            if not value > 0.0:
                raise ValueError(f"{name} must be a positive NIS (chi-square, 2 dof); got {value!r}")
        if new_gate < match_gate:
            raise ValueError(f"new_gate must be at least match_gate ({match_gate}); got {new_gate}")
        check_remove_below(remove_below)
        if first_heading not in _FIRST_HEADINGS:
            choices = ", ".join(map(repr, _FIRST_HEADINGS))
            raise ValueError(f"first_heading must be one of {choices}; got {first_heading!r}")
        self.association, self.first_heading = association, first_heading
        self.remove_below = 0.0 if association == "known" else float(remove_below)
        self.association_code = _ASSOCIATIONS[association]
        joint = joint_gates(match_gate, max_landmarks + 1) if self.association_code == JCBB else ()
        self.gates: Floats = np.array([gate, match_gate, new_gate, *joint])
        self._allocate()
        self.budget = self._make_budget(budget)
        self.bank = self._make_bank()

    def _allocate(self) -> None:
        L, M = self.num_lanes, self.max_landmarks
        self.n_t = len(self.target_names)
        before_map = self.n_t + self.extra_states
        self.n_max = -(-(ROBOT + before_map + 2 * M) // BLOCK) * BLOCK
        self.mu: Floats = aligned_zeros(L, self.n_max)
        self.P: Floats = aligned_zeros(L, self.n_max, self.n_max)
        self.count: Ints = np.zeros(L, dtype=np.int64)
        self.ids: Ints = np.full((L, M), -1, dtype=np.int64)
        self.first: Floats = np.zeros((L, M, 3))
        self.next_id: Ints = np.zeros(L, dtype=np.int64)
        self.target_known = np.zeros(L, dtype=np.bool_)
        self.pending: Floats = np.zeros((L, 4))
        self.counters: Ints = np.zeros((L, len(COUNTERS)), dtype=np.int64)
        self.last_dt: Floats = np.zeros(L)
        self.work: Floats = scratch(self.n_max)  # see `left_looking`
        self.slots: Ints = np.zeros((L, 0), dtype=np.int64)  # scratch: the last sweep's association
        self.cost: Floats = np.zeros((0, M + 1))  # scratch
        self._dt: Floats = np.zeros(L)
        self._control_shape = (L, 2)
        core, marks = ([self.belief.buffers[name] for name in names] for names in (Belief._CORE, Belief._MAP))
        self._core = bind(fill_core, self.mu, self.P, self.models, self.target_known, *core, LATER)
        self._map = bind(fill_map, self.mu, self.P, before_map, self.count, self.ids, *marks, LATER)
        if self.remove_below > 0.0:
            self._map = chain(self._map, bind(hide_doubtful, self.first, self.count, *marks, LATER))

    def _make_budget(self, budget: int | None) -> Any:
        if budget is None:
            return None
        from estimators.gaussian.landmark_budget import LandmarkBudget

        return LandmarkBudget(self, budget)

    def _make_bank(self) -> Any:
        kind, labelled = self.target.kind if self.target is not None else None, self.association_code == KNOWN
        if kind == "imm" and not self.mean_is_all:
            raise ValueError(f'{self.name} knows targets of kind "twist" and "constant-velocity"; got "imm"')
        if kind == "imm":
            if not labelled:
                raise ValueError(f'a target of kind "imm" needs association="known"; got {self.association!r}')
            from estimators.gaussian.manoeuvres import ManoeuvreBank

            return ManoeuvreBank(self)
        if kind == "twist" and labelled and self.mean_is_all and self.first_heading == "gaussian-sum":
            from estimators.gaussian.first_heading import HeadingBank

            return HeadingBank(self)
        return None

    def like(self, num_lanes: int, target: TargetModel | None) -> Self:
        """Another filter of the same class and options that goes by labels and keeps no hypotheses."""
        return type(self)(
            self.motion, self.sensor, target, num_lanes=num_lanes, max_landmarks=self.max_landmarks,
            gate=float(self.gates[0]), budget=None if self.budget is None else self.budget.limit,
            first_heading="two-sightings", **self._own_options(),
        )  # fmt: skip

    def _own_options(self) -> dict[str, Any]:
        """Options beyond those of the family, for `like`."""
        return {}

    def reset(
        self,
        pose: ArrayLike,
        pose_cov: ArrayLike,
        *,
        seeds: ArrayLike,
        target: ArrayLike | None = None,
        target_cov: ArrayLike | None = None,
        lanes: Ints | None = None,
    ) -> None:
        """See `Estimator.reset`."""
        prior = self._prior(pose, pose_cov, seeds, target, target_cov, lanes)
        chosen = prior.lanes
        for name in ("mu", "P", "count", "first", "next_id", "target_known", "pending", "counters", "last_dt"):
            getattr(self, name)[chosen] = 0
        self.ids[chosen] = -1
        self.mu[chosen, :ROBOT] = prior.pose
        self.P[chosen, :ROBOT, :ROBOT] = 0.5 * (prior.pose_cov + np.swapaxes(prior.pose_cov, 1, 2))
        if prior.target is not None and prior.target_cov is not None:
            end = ROBOT + self.n_t
            self.mu[chosen, ROBOT:end] = prior.target
            if self.target_names[2] == "heading":
                self.mu[chosen, end - 1] = (prior.target[:, 2] + math.pi) % (2.0 * math.pi) - math.pi
            self.P[chosen, ROBOT:end, ROBOT:end] = 0.5 * (prior.target_cov + np.swapaxes(prior.target_cov, 1, 2))
            self.target_known[chosen] = True
        if self.budget is not None:
            self.budget.reset(chosen)
        self._after_reset(chosen)
        if self.bank is not None:
            self.bank.close(chosen)
            self.bank.admit(chosen)
        self.belief.mark_stale()

    def _after_reset(self, lanes: Ints) -> None:
        """A filter's own state, after the common part was reset."""

    def after_change(self, lanes: Ints) -> None:
        """The target's mean was set from outside: what a filter keeps beside it follows."""

    def linear_points(self) -> tuple[Floats, int, int]:
        """Where robot and target are linearised: an array, the target's first column in it, the kind of filter."""
        return self.mu, ROBOT, AT_MEAN

    def predict(self, control: Floats, dt: float | Floats, *, lanes: Ints | None = None) -> None:
        """See `Estimator.predict`."""
        if control.shape != self._control_shape:
            raise ValueError(f"control must have shape {list(self._control_shape)}; got {list(control.shape)}")
        if isinstance(dt, float):
            if dt != self._dt[0]:
                self._dt = np.full(self.num_lanes, dt)
            step = self._dt
        else:
            step = np.array(np.broadcast_to(np.asarray(dt, dtype=np.float64), (self.num_lanes,)))
        chosen = self.all_lanes if lanes is None else lanes
        if self.bank is not None:
            chosen = self.bank.predict(control, step, chosen)
        _run(self._prediction(control, step), chosen)
        self.belief.mark_stale()

    def update(self, scan: Scan, *, lanes: Ints | None = None) -> None:
        """See `Estimator.update`."""
        self.make_room(scan.ranges.shape[1])
        chosen = self.all_lanes if lanes is None else lanes
        if self.bank is not None:
            chosen = self.bank.update(scan, chosen)
        for call in self._corrections(scan):
            _run(call, chosen)
        if self.bank is not None:
            self.bank.admit(chosen)
        self.belief.mark_stale()

    def bound_calls(self, control: Floats, dt: Floats, scan: Scan) -> BoundCalls | None:
        """See `Estimator.bound_calls`."""
        if self.bank is not None:
            return None
        self.make_room(scan.ranges.shape[1])
        return BoundCalls(
            bind(*self._prediction(control, dt)),
            chain(*(bind(*call) for call in self._corrections(scan))),
            chain(self._core, self._map),
            self._scratch(),
        )

    def _scratch(self) -> tuple[Any, ...]:
        """Arrays without a lane that kernels write; a filter with more of them adds its own."""
        return self.work, self.cost

    def make_room(self, width: int) -> None:
        """Give the scratch of an association room for sweeps of that width."""
        if width >= self.slots.shape[1]:
            self.slots = np.zeros((self.num_lanes, width + 1), dtype=np.int64)  # a column more: `sweep.WITHHELD`
            joint = self.association_code == JCBB
            shape = scratch_shape(width, self.max_landmarks) if joint else (width, self.max_landmarks + 1)
            self.cost = np.zeros(shape)

    def _corrections(self, scan: Scan) -> list[Call]:
        """What an update consists of, in order."""
        calls = [self._correction(scan)]
        if self.n_t > 0:
            points, at, kind = self.linear_points()
            gate = float(self.gates[0]) if self.mean_is_all else -1.0  # nothing fits: nothing is iterated
            first = (
                sort_out, self.mu, self.P, self.models, self.n_t, self.count, self.target_known, self.pending,
                self.counters, self.slots, points, at, gate, scan.ranges, scan.bearings, scan.labels, scan.count, LATER,
            )  # fmt: skip
            last = (
                take_back, self.mu, self.P, self.work, self.models, self.n_t, self.count, self.slots, points, at, kind,
                scan.ranges, scan.bearings, scan.labels, scan.count, LATER,
            )  # fmt: skip
            calls = [first, *calls, last]
        if self.remove_below > 0.0:
            revision = (
                revise_map, self.mu, self.P, self.models, self.n_t, self.count, self.ids, self.first, self.counters,
                scan.ranges, scan.bearings, scan.count, scan.complete, float(self.gates[2]),
                log_odds(self.remove_below), self.slots, LATER,
            )  # fmt: skip
            calls.append(revision)
        if self.budget is not None:
            calls.append(self.budget.keeping(scan))
        return calls

    def _prediction(self, control: Floats, dt: Floats) -> Call:
        """The filter's prediction. control: [L, 2], dt: [L]."""
        raise NotImplementedError

    def _correction(self, scan: Scan) -> Call:
        """The filter's update; leaves each return's slot in `slots`."""
        raise NotImplementedError

    def _refresh(self) -> None:
        """Mean and covariance as they are now, where a bank has moved its members."""
        if self.bank is not None:
            self.bank.refresh()

    def _fill_core(self, buffers: dict[str, Any]) -> None:
        self._refresh()
        self._core(self.all_lanes)

    def _fill_map(self, buffers: dict[str, Any]) -> None:
        self._refresh()
        self._map(self.all_lanes)

    @property
    def counts(self) -> dict[str, Ints]:
        """What went wrong since `reset`: see `sweep.COUNTERS`, and `landmark_budget.COUNTERS` under a budget."""
        found = {name: self.counters[:, i].copy() for i, name in enumerate(COUNTERS)}
        return found if self.budget is None else found | self.budget.counts

    def joint(self, lane: int) -> tuple[Floats, Floats]:
        """Mean [n] and covariance [n, n] over robot, target (where it is known) and mapped landmarks, as copies."""
        self._refresh()
        skip = 0 if self.target_known[lane] else self.n_t
        rows = np.arange(ROBOT + self.n_t + self.extra_states + 2 * self.count[lane])
        rows = rows[(rows < ROBOT) | (rows >= ROBOT + skip)]
        return self.mu[lane, rows], self.P[lane][np.ix_(rows, rows)]

    @property
    def _state_names(self) -> tuple[str, ...]:
        """Arrays that change between calls; a filter with more adds their names."""
        return _STATE

    def get_state(self) -> dict[str, Any]:
        """See `Estimator.get_state`."""
        state: dict[str, Any] = {name: getattr(self, name).copy() for name in self._state_names}
        if self.budget is not None:
            state["budget"] = self.budget.get_state()
        if self.bank is not None:
            state["bank"] = self.bank.get_state()
        return state

    def set_state(self, state: dict[str, Any]) -> None:
        """See `Estimator.set_state`."""
        for name in self._state_names:
            getattr(self, name)[...] = state[name]
        if self.budget is not None:
            self.budget.set_state(state["budget"])
        if self.bank is not None:
            self.bank.set_state(state["bank"])
        self.belief.mark_stale()


def _run(call: Call, lanes: Ints) -> None:
    kernel, *arguments = call
    kernel(*(lanes if argument is LATER else argument for argument in arguments))
