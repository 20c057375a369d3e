"""Incremental smoothing: the whole trajectory, the map and the target's path as one least-squares problem."""

import math
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from estimators.gaussian.growth import MAX_HEADING_VARIANCE, MAX_SIGHTINGS
from estimators.gaussian.layout import MATCH_GATE, NEW_GATE, Call, GaussianEstimator
from estimators.interface import BoundCalls, Floats, Ints, Scan
from estimators.kernels.association import TARGET_SLOT
from estimators.kernels.bound import LATER
from estimators.kernels.gaussian import ROBOT
from estimators.models import MotionModel, SensorModel, TargetModel
from estimators.smoothing.events import GOES_ON, STARTS, UNSEEN, Motion, Prior, Sighting, Sweep
from estimators.smoothing.odometry import carry, compose
from estimators.smoothing.sorting import sort_returns

NEEDED = 'isam2 needs GTSAM: pip install -c constraints.txt ".[smoothing]" in the folder of slam-gym'
_KINDS = ("constant-velocity", "twist")
_ARRAYS = ("moved", "spread", "drift", "drift_spread", "elapsed", "indeterminate")


class ISAM2(GaussianEstimator):
    """Incremental smoothing and mapping (iSAM2, by GTSAM): every pose is kept, and linearised anew as it improves.

    **Graph.** One pose per sweep that saw something; between two, the composed odometry with the covariance of
    `MotionModel`'s law (rank 2; `estimators.smoothing.factors` says how it is made invertible). Each return is a
    range-bearing factor between a pose and a landmark or the target. The target, once seen, has a state beside each
    pose: position and velocity, tied by white acceleration (constant-velocity), or a pose, tied by its composed motion
    (twist). Minimised is the sum of squared whitened residuals, min sum |h_i(x) - z_i|^2_R + |f_k(x) - x_{k+1}|^2_Q.

    **Solution.** Each sweep is one step of iSAM2: only the part of the Bayes tree that it touches is eliminated anew,
    and variables that moved by more than `relinearize_threshold` are linearised anew.

    **Belief.** The last pose, target and landmarks, moved on by what came since. Covariances are marginals of the
    tree, computed when the belief is read: robot and target together, and all landmarks with them only if the map is
    asked for.

    **Growth.** A landmark or target enters where it is seen. A twist target waits for a second sighting whose chord
    makes a usable heading. Seen again after an absence, the target is guessed to be where it is seen; beyond the
    model's `reinitialise_nis` or `reinitialise_spread` its chain is cut and a new one starts.

    Needs GTSAM: `pip install -c constraints.txt ".[smoothing]"` in the folder of slam-gym.

    Args:
        motion: how the robot moves. sensor, target, association, gate, match_gate, new_gate: see `GaussianEstimator`.
        relinearize_threshold: change [m, rad] of a variable above which it is linearised anew; smaller is closer to the
            exact least-squares solution, and slower.
        iterations: Gauss-Newton steps per sweep; the solution lags behind by a few hundredths of a deviation with 1, by
            a thousandth with 2.

    When to use: as the reference of accuracy: no filter that forgets the past can linearise it anew. For noise so
    strong that filters diverge.

    Known weakness: about a millisecond per sweep and another per reading of the map; both grow with the length of the
    run. Unlabelled returns and a finite `gate` need the whole covariance at each sweep; an unlabelled false alarm
    stays in the map.

    Counted beside `GaussianEstimator`'s: "indeterminate", sweeps left out because no solution exists with them, and
    readings whose covariance could not be computed (the last one then stands).

    Reference: Kaess, Johannsson, Roberts, Ila, Leonard and Dellaert, "iSAM2: incremental smoothing and mapping using
    the Bayes tree", IJRR 2012.
    """

    name: ClassVar[str] = "isam2"
    summary: ClassVar[str] = "incremental smoothing of the whole trajectory (extra `smoothing`): the accuracy reference"
    mean_is_all: ClassVar[bool] = False

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
        relinearize_threshold: float = 0.05,
        iterations: int = 1,
    ) -> None:
        if isinstance(iterations, bool) or not isinstance(iterations, int | np.integer) or iterations < 1:
            raise ValueError(f"iterations must be a whole number of steps per sweep, at least 1; got {iterations!r}")
        if not relinearize_threshold > 0.0:
            raise ValueError(f"relinearize_threshold must be positive [m, rad]; got {relinearize_threshold!r}")
        if target is not None and target.kind not in _KINDS:
            raise ValueError(f"isam2 knows targets of kind {' and '.join(map(repr, _KINDS))}; got {target.kind!r}")
        try:
            from estimators.smoothing.graph import Graph
        except ImportError as error:
            raise ImportError(NEEDED) from error
        self._make_graph = Graph
        self.iterations = int(iterations)
        self.threshold = float(relinearize_threshold)
        self.gated = association != "known" or math.isfinite(gate)  # each return is held against the covariance
        super().__init__(
            motion, sensor, target, num_lanes=num_lanes, max_landmarks=max_landmarks, association=association,
            gate=gate, match_gate=match_gate, new_gate=new_gate, remove_below=0.0,
        )  # fmt: skip

    def _allocate(self) -> None:
        super()._allocate()
        L = self.num_lanes
        self.graphs: list[Any] = [None] * L  # None: never reset
        self.held: list[tuple[int, Sighting] | None] = [None] * L  # a twist target's first sighting, with its node
        self.lane_targets: list[TargetModel | None] = [self.target] * L
        self.moved: Floats = np.zeros((L, ROBOT))
        self.spread: Floats = np.zeros((L, ROBOT, ROBOT))
        self.drift: Floats = np.zeros((L, 3))
        self.drift_spread: Floats = np.zeros((L, 3, 3))
        self.elapsed: Floats = np.zeros(L)
        self.indeterminate: Ints = np.zeros(L, dtype=np.int64)
        self.core_fresh = np.zeros(L, dtype=np.bool_)  # whether mu and P hold robot and target as they are now
        self.map_fresh = np.zeros(L, dtype=np.bool_)  # and the landmarks

    def set_models(self, lane: int, motion: MotionModel, sensor: SensorModel, target: TargetModel | None) -> None:
        """See `Estimator.set_models`."""
        super().set_models(lane, motion, sensor, target)
        self.lane_targets[lane] = target

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
        super().reset(pose, pose_cov, seeds=seeds, target=target, target_cov=target_cov, lanes=lanes)
        end = ROBOT + self.n_t
        for lane in self.all_lanes if lanes is None else np.atleast_1d(np.asarray(lanes)):
            for name in _ARRAYS:
                getattr(self, name)[lane] = 0
            mu, P, known = self.mu[lane].copy(), self.P[lane].copy(), bool(self.target_known[lane])
            prior = Prior(
                mu[:ROBOT], P[:ROBOT, :ROBOT], self.lane_targets[lane], mu[ROBOT:end] if known else None,
                P[ROBOT:end, ROBOT:end] if known else None, self.threshold, self.iterations,
            )  # fmt: skip
            self.graphs[lane], self.held[lane] = self._make_graph(prior), None
            self._mark(lane)

    def _mark(self, lanes: Any) -> None:
        """What `mu` and `P` hold of these lanes is the past."""
        self.core_fresh[lanes] = self.map_fresh[lanes] = False

    def predict(self, control: Floats, dt: float | Floats, *, lanes: Ints | None = None) -> None:
        """See `Estimator.predict`."""
        super().predict(control, dt, lanes=lanes)
        self._mark(self.all_lanes if lanes is None else lanes)

    def update(self, scan: Scan, *, lanes: Ints | None = None) -> None:
        """See `Estimator.update`."""
        chosen = self.all_lanes if lanes is None else lanes
        if self.gated:
            self._refresh_map(chosen)
        elif self.n_t > 0 and np.isfinite([self.models["reinitialise_nis"], self.models["reinitialise_spread"]]).any():
            self._refresh_core(chosen)
        before = self.count.copy()
        super().update(scan, lanes=lanes)
        for lane in chosen:
            self._take_lane(int(lane), scan, int(before[lane]))
        self._mark(chosen)

    def bound_calls(self, control: Floats, dt: Floats, scan: Scan) -> BoundCalls | None:
        """None: the graph is no kernel."""
        return None

    def _prediction(self, control: Floats, dt: Floats) -> Call:
        return (
            compose, self.moved, self.spread, self.drift, self.drift_spread, self.elapsed, self.models, self.pending,
            control, dt, self.last_dt, LATER,
        )  # fmt: skip

    def _correction(self, scan: Scan) -> Call:
        """The kernel's part of an update: what each return is."""
        return (
            sort_returns, self.mu, self.P, self.models, self.n_t, self.count, self.ids, self.next_id, self.target_known,
            self.pending, self.counters, scan.ranges, scan.bearings, scan.labels, scan.count, self.association_code,
            self.gates, self.gated, self.cost, self.slots, LATER,
        )  # fmt: skip

    def _take_lane(self, lane: int, scan: Scan, before: int) -> None:
        """One lane's sorted sweep becomes a node of its graph; `before`: landmarks before the sweep."""
        seen = self._sightings(lane, scan, before)
        target = [one for one in seen if one.slot == TARGET_SLOT]
        known, hold = bool(self.target_known[lane]), False
        if target and not known and self._is_twist(lane):
            hold = not self._chord_is_usable(lane, target[0])
        if hold:
            seen = [one for one in seen if one.slot != TARGET_SLOT]
        if not seen and not hold:
            return
        what = GOES_ON if known else STARTS if target and not hold else UNSEEN
        graph = self.graphs[lane]
        if not graph.take(Sweep(self._motion(lane), tuple(seen), what, self.held[lane])):
            self._undo(lane, before)
            return
        self.moved[lane], self.spread[lane] = 0.0, 0.0
        for slot in range(before, int(self.count[lane])):
            self.first[lane, slot, :2] = graph.landmark(slot)
        if what != UNSEEN or (hold and self.pending[lane, 0] == 1.0):  # else a longer chord is waited for
            self.drift[lane], self.drift_spread[lane], self.elapsed[lane] = 0.0, 0.0, 0.0
            self.held[lane] = (graph.node, target[0]) if hold else None
            self.pending[lane, 3] = 0.0
        if what == STARTS:
            self.pending[lane, 0], self.target_known[lane] = 0.0, True

    def _motion(self, lane: int) -> Motion:
        """What happened since the last node."""
        return Motion(
            self.moved[lane].copy(), self.spread[lane].copy(), float(self.elapsed[lane]), self.drift[lane].copy(),
            self.drift_spread[lane].copy(),
        )  # fmt: skip

    def _undo(self, lane: int, before: int) -> None:
        """The sweep was left out: so are its landmarks."""
        self.indeterminate[lane] += 1
        self.ids[lane, before:] = -1
        self.count[lane] = before
        if not self.target_known[lane]:
            self.pending[lane, 0] = 0.0

    def _sightings(self, lane: int, scan: Scan, before: int) -> list[Sighting]:
        """The returns of a lane that are used; noise at the expected range, at the measured one for what is new."""
        model, graph = self.models[lane], self.graphs[lane]
        seen: list[Sighting] = []
        position = carry(graph.pose, self.moved[lane], self.spread[lane])[0][:2]
        grown, quadrature = float(model["range_std_per_range"]), bool(model["range_law"])
        for k in range(int(scan.count[lane])):
            slot, distance = int(self.slots[lane, k]), float(scan.ranges[lane, k])
            if slot != TARGET_SLOT and slot < 0:
                continue
            expected = distance
            if 0 <= slot < before and grown > 0.0:
                expected = float(np.hypot(*(graph.landmark(slot) - position)))
            base = float(model["range_std"])
            std = math.hypot(base, grown * expected) if quadrature else base + grown * expected
            bearing_std = float(model["bearing_std"])
            is_new = slot >= before and slot not in {one.slot for one in seen}
            seen.append(Sighting(slot, distance, float(scan.bearings[lane, k]), std, bearing_std, is_new))
        return seen

    def _is_twist(self, lane: int) -> bool:
        target = self.lane_targets[lane]
        return target is not None and target.kind == "twist"

    def _chord_is_usable(self, lane: int, seen: Sighting) -> bool:
        """Whether the chord from the held sighting makes a heading; counts the sighting.

        The chord's deviation is judged by the returns' own noise across it and the target's turn noise since.
        """
        self.pending[lane, 0] += 1.0
        held = self.held[lane]
        if held is None or self.pending[lane, 0] == 1.0:
            self.pending[lane, 0], self.held[lane] = 1.0, None
            return False
        graph = self.graphs[lane]
        chord = self._place(carry(graph.pose, self.moved[lane], self.spread[lane])[0], seen)
        chord = chord - self._place(graph.pose_at(held[0]), held[1])
        square, steps = float(chord @ chord), float(self.pending[lane, 3])
        if steps == 0.0 or not square > 0.0:
            return False
        noise = sum(max(one.range_std, one.bearing_std * one.distance) ** 2 for one in (seen, held[1]))
        usable = noise / square + self.drift_spread[lane, 2, 2] / 3.0 <= MAX_HEADING_VARIANCE
        return bool(usable) or self.pending[lane, 0] >= MAX_SIGHTINGS

    @staticmethod
    def _place(pose: Floats, seen: Sighting) -> Floats:
        angle = pose[2] + seen.bearing
        return pose[:2] + seen.distance * np.array([math.cos(angle), math.sin(angle)])

    def _refresh_core(self, lanes: Ints) -> None:
        """Bring robot and target in `mu` and `P` up to date."""
        for lane in lanes:
            if self.core_fresh[lane] or self.graphs[lane] is None:
                continue
            self.core_fresh[lane] = True
            mean, F, Q = self._present(lane)
            n = len(mean)
            self.mu[lane, :n] = mean
            cov = self._marginals(lane, 0)
            if cov is not None:
                self.P[lane, :n, :n] = F @ cov @ F.T + Q

    def _refresh_map(self, lanes: Ints) -> None:
        """Bring the landmarks up to date too, with their cross covariances; robot and target stay as they are."""
        self._refresh_core(lanes)
        for lane in lanes:
            if self.map_fresh[lane] or self.graphs[lane] is None:
                continue
            self.map_fresh[lane] = True
            count, begin = int(self.count[lane]), ROBOT + self.n_t
            for slot in range(count):
                j = begin + 2 * slot
                self.mu[lane, j : j + 2] = self.graphs[lane].landmark(slot)
            cov = self._marginals(lane, count) if count else None
            if cov is None:
                continue
            _, F, _ = self._present(lane)
            n, end = len(F), begin + 2 * count
            self.P[lane, :n, begin:end] = F @ cov[:n, n:]
            self.P[lane, begin:end, :n] = self.P[lane, :n, begin:end].T
            self.P[lane, begin:end, begin:end] = cov[n:, n:]

    def _marginals(self, lane: int, count: int) -> Floats | None:
        """The graph's covariance over pose, target where known, and landmarks; None where it has none."""
        try:
            return self.graphs[lane].joint(bool(self.target_known[lane]), count)
        except (RuntimeError, ValueError):
            self.indeterminate[lane] += 1
            return None

    def _present(self, lane: int) -> tuple[Floats, Floats, Floats]:
        """Robot and target moved on from their nodes to now: mean, F and Q."""
        graph = self.graphs[lane]
        mean, F, Q = carry(graph.pose, self.moved[lane], self.spread[lane])
        if not self.target_known[lane]:
            return mean, F, Q
        moved, A, B = graph.drifted(self._motion(lane))
        n = len(moved)
        zero = np.zeros((ROBOT, n))
        return np.append(mean, moved), np.block([[F, zero], [zero.T, A]]), np.block([[Q, zero], [zero.T, B]])

    def _fill_core(self, buffers: dict[str, Any]) -> None:
        self._refresh_core(self.all_lanes)
        super()._fill_core(buffers)

    def _fill_map(self, buffers: dict[str, Any]) -> None:
        self._refresh_map(self.all_lanes)
        super()._fill_map(buffers)

    def joint(self, lane: int) -> tuple[Floats, Floats]:
        """See `Belief.joint`."""
        self._refresh_map(np.array([lane]))
        return super().joint(lane)

    @property
    def counts(self) -> dict[str, Ints]:
        """See the class."""
        return super().counts | {"indeterminate": self.indeterminate.copy()}

    @property
    def _state_names(self) -> tuple[str, ...]:
        return (*super()._state_names, *_ARRAYS)

    def get_state(self) -> dict[str, Any]:
        """See `Estimator.get_state`: graphs as the events that made them."""
        graphs = [None if graph is None else (graph.prior, tuple(graph.history)) for graph in self.graphs]
        return super().get_state() | {"graphs": graphs, "held": list(self.held), "targets": list(self.lane_targets)}

    def set_state(self, state: dict[str, Any]) -> None:
        """See `Estimator.set_state`."""
        super().set_state(state)
        self.graphs = [None if events is None else self._make_graph.again(*events) for events in state["graphs"]]
        self.held, self.lane_targets = list(state["held"]), list(state["targets"])
        self.core_fresh[:] = self.map_fresh[:] = False
