"""One piece of a comparison's work: a few runs side by side, every estimator on them, as one file of records."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slam_gym import policies
from slam_gym.evaluation_plan import POLICY_SEEDS, WORLD_SEEDS, Combination, Mode, Plan, run_seeds
from slam_gym.policy_view import PolicyView
from slam_gym.records import FIELDS, LANDMARK, TRACK, Records
from slam_gym.results import write_atomic
from slam_gym.simulation import Simulation
from slam_gym.specs import Spec

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

WARM_UP_STEPS = 24  # enough for a few sweeps in every preset
_warm: set[str] = set()  # what this process has compiled or loaded


@dataclass(frozen=True, slots=True)
class Unit:
    """Runs of one combination, and the file that they end in."""

    combination: int
    runs: tuple[int, ...]
    path: Path


def run_unit(plan: Plan, unit: Unit) -> Unit:
    """Simulate a unit's runs and keep the records; called in worker processes."""
    combination = plan.combinations[unit.combination]
    warm_up(combination, combination.estimators)
    records = simulate(combination, plan.seed, unit.runs, mode=plan.mode, tracks=plan.tracks, score_map=plan.score_map)
    arrays: dict[str, Any] = {name: a for e, part in enumerate(records) for name, a in part.to_arrays(str(e)).items()}
    write_atomic(unit.path, partial(np.savez, **arrays))
    return unit


def warm_up(combination: Combination, estimators: Sequence[Spec]) -> None:
    """A few steps for nothing, once per process: compiling and loading kernels must not count as filter time."""
    todo = tuple(spec for spec in estimators if _warm_key(combination, spec) not in _warm)
    if todo:
        short = combination.scenario.replace("max_steps", min(WARM_UP_STEPS, int(combination.scenario.max_steps)))
        simulate(Combination(short, combination.policy, todo, 0), 0, [0], tracks=1)
        _warm.update(_warm_key(combination, spec) for spec in todo)


def _warm_key(combination: Combination, spec: Spec) -> str:
    return f"{combination.scenario.name} {combination.policy.label} {spec.label}"


def simulate(
    combination: Combination,
    seed: int,
    runs: Sequence[int],
    *,
    mode: Mode = "shared",
    tracks: int = 0,
    score_map: bool = True,
) -> list[Records]:
    """Run every estimator on the same worlds.

    Args:
        combination: scenario, policy, estimators.
        seed: of the comparison; each run's own is spawned from it.
        runs: indices of the runs, side by side in lanes.
        mode: one policy drives on the driver's belief and all estimators process the same data, or each estimator
            drives a policy of its own.
        tracks: runs with an index below this are recorded in full.
        score_map: whether landmarks are scored.

    Returns:
        One `Records` per estimator, in order.
    """
    if mode == "shared":
        return _Episodes(combination, combination.estimators, combination.driver, seed, runs, tracks, score_map).run()
    each = [_Episodes(combination, (spec,), 0, seed, runs, tracks, score_map) for spec in combination.estimators]
    return [episodes.run()[0] for episodes in each]


class _Episodes:
    """Runs side by side, from start to end, and what is recorded of them."""

    def __init__(
        self,
        combination: Combination,
        estimators: Sequence[Spec],
        driver: int,
        seed: int,
        runs: Sequence[int],
        tracks: int,
        score_map: bool = True,
    ) -> None:
        scenario, lanes = combination.scenario, len(runs)
        self.scenario, self.driver, self.score_map = scenario, driver, score_map
        self.run_index = np.asarray(runs, dtype=np.int64)
        self.seeds = run_seeds(seed, WORLD_SEEDS, runs)
        specs = [(spec.name, spec.options) for spec in estimators]
        self.simulation = Simulation(scenario, specs, num_lanes=lanes, allow_truth=True, timed=True)
        context = policies.PolicyContext.from_scenario(scenario)
        self.action_map = context.action_map
        self.policy = policies.make(combination.policy.name, context, lanes, **combination.policy.options)
        self.policy.reset(np.arange(lanes), run_seeds(seed, POLICY_SEEDS, runs))
        self.view = PolicyView(self.policy, scenario)
        self.view.attach(self.simulation, driver)
        self.simulation.reset(self.seeds)
        self.max_steps, self.hold = int(scenario.max_steps), int(scenario.hold)
        # A step's numbers lie together, so that to keep them is one plain copy.
        self.values = np.full((len(specs), self.max_steps, lanes, len(FIELDS)), np.nan)
        self.age = np.full((lanes, self.max_steps), np.nan)
        self.steps = np.zeros(lanes, dtype=np.int64)
        self.effort = np.zeros(lanes)
        self.drawn = np.flatnonzero(self.run_index < tracks)
        self.rows: list[list[Floats]] = [[] for _ in specs]
        self.final: list[list[Floats]] = [[] for _ in specs]

    def run(self) -> list[Records]:
        """Step until every run is over."""
        simulation, going = self.simulation, np.arange(len(self.run_index))
        action = command = np.zeros((len(going), 2))
        for step in range(self.max_steps):
            if step % self.hold == 0:
                shown = self.view.observe(simulation, self.driver)
                action = np.asarray(self.policy.act(shown, simulation.estimators[self.driver].belief))
                command = self.action_map.to_command(action)
                going = self._stop(going)
                if not going.size:
                    break
            simulation.advance(command, None if going.size == len(self.run_index) else going)
            self.steps[going] += 1
            self.effort[going] += 0.5 * np.square(np.clip(action[going], -1.0, 1.0)).sum(axis=1)
            self._record(step, going)
        self._stop(going, everything=True)
        return [self._records(e) for e in range(len(simulation.estimators))]

    def _stop(self, going: Ints, everything: bool = False) -> Ints:
        """Lanes that go on; the maps of those drawn that do not are kept."""
        over = np.full(going.shape, True) if everything else self.policy.finished[going]
        for lane in going[over]:
            if lane in self.drawn:
                for e in range(len(self.final)):
                    self.final[e].append(self._map(e, lane))
        return going[~over]

    def _record(self, step: int, going: Ints) -> None:
        world = self.simulation.world
        if world.has_target:
            self.age[going, step] = world.time_since_seen[going]
        drawn = [int(lane) for lane in self.drawn if self.steps[lane] == step + 1]
        for e in range(len(self.values)):
            self.simulation.measure(e, score_map=self.score_map)
            self.values[e, step] = self.simulation.meters[e].values
            for lane in drawn:
                self.rows[e].append(self._track(e, lane, step))

    def _track(self, e: int, lane: int, step: int) -> Floats:
        world, belief = self.simulation.world, self.simulation.estimators[e].belief
        cov = belief.pose_cov[lane]
        row = [self.run_index[lane], step + 1, (step + 1) * self.scenario.dt, *world.pose[lane], *belief.pose[lane],
               cov[0, 0], cov[0, 1], cov[1, 1]]  # fmt: skip
        truth = world.target[lane, :2] if world.has_target else [np.nan] * 2
        believed = [np.nan] * 5
        if world.has_target and belief.target_known[lane]:
            cov = belief.target_position_cov[lane]
            believed = [*belief.target_position[lane], cov[0, 0], cov[0, 1], cov[1, 1]]
        return np.array([*row, *truth, *believed, float(world.has_target and world.target_detected[lane])])

    def _map(self, e: int, lane: int) -> Floats:
        """True landmarks with their estimates; under unknown association also the estimates that match none."""
        world, belief = self.simulation.world, self.simulation.estimators[e].belief
        count = int(world.landmark_count[lane])
        table = np.full((count, len(LANDMARK)), np.nan)
        table[:, 0], table[:, 1] = self.run_index[lane], np.arange(count)
        table[:, 2:4], table[:, 4] = world.landmarks[lane, :count], world.landmark_radius[lane, :count]
        for slot in np.flatnonzero(belief.landmark_mapped[lane]):
            cov, identity = belief.landmark_cov[lane, slot], int(belief.landmark_id[lane, slot])
            estimate = [*belief.landmark_mean[lane, slot], cov[0, 0], cov[0, 1], cov[1, 1]]
            if world.labelled and 0 <= identity < count:
                table[identity, 5:] = estimate
            else:
                extra = [float(self.run_index[lane]), -1.0, np.nan, np.nan, 0.0, *estimate]
                table = np.vstack([table, extra])
        return table

    def _records(self, e: int) -> Records:
        simulation = self.simulation
        last = max(1, int(self.steps.max()))
        values = self.values[e, :last].swapaxes(0, 1)  # [R, T, F]
        over = np.arange(last) >= self.steps[:, None]  # [R, T]
        values[over] = np.nan
        # An estimate that is no number is infinitely wrong: counted, never dropped.
        values[~over & np.isnan(values[:, :, 0]), 0] = np.inf
        timing = [simulation.predict_seconds[e], simulation.predict_calls[e],
                  simulation.update_seconds[e], simulation.update_calls[e]]  # fmt: skip
        return Records(
            run=self.run_index,
            seed=self.seeds,
            steps=self.steps.copy(),
            values=values,
            age=self.age[:, :last],
            time=np.arange(1, last + 1, dtype=np.float64) * self.scenario.dt,
            collisions=np.array(simulation.world.collisions, dtype=np.int64),
            effort=self.effort / np.maximum(self.steps, 1),
            counts={name: np.array(n, dtype=np.int64) for name, n in simulation.estimators[e].counts.items()},
            timing=np.array(timing, dtype=np.float64),
            tracks=_stack(self.rows[e], len(TRACK)),
            landmarks=_stack(self.final[e], len(LANDMARK)),
        )


def _stack(rows: Sequence[Any], width: int) -> Floats:
    return np.vstack(rows) if rows else np.empty((0, width))
