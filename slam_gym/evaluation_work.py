"""The work of a comparison: cut into units, shared out among workers that have their kernels compiled."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

from estimators import registry
from slam_gym import policies as policy_registry
from slam_gym.evaluation_backend import Own, Task, Workers
from slam_gym.evaluation_folder import finished_runs
from slam_gym.evaluation_plan import Combination, Plan
from slam_gym.evaluation_unit import Unit, run_unit, warm_up
from slam_gym.exercise import exercise
from slam_gym.specs import Spec

Progress = Callable[[str, int, int], None]  # (what is being done, runs done, runs in all)

LEAST = "dead-reckoning"  # the estimator with least to compile
MAX_LANES = 32  # of a unit: beyond it nothing is gained, and a kill loses more
UNITS_PER_JOB = 4  # at most: so that workers end at about the same time
ENOUGH_LANES = 24  # of a unit: from here on a step's work in Python is small beside the filters'
MAX_VALUES = 30_000_000  # numbers that a unit holds in memory at once (240 MB)


def do_work(
    plan: Plan, wanted: Sequence[int], folder: Path, crew: Workers, chunk: int | None, progress: Progress
) -> None:
    """Everything that is not done yet."""
    units: list[Unit] = []
    for index, combination in enumerate(plan.combinations):
        done = finished_runs(folder, index)
        missing = [run for run in wanted if run not in done]
        size = chunk or chunk_size(combination, len(missing), crew.jobs, len(plan.combinations))
        for first in range(0, len(missing), size):
            runs = tuple(missing[first : first + size])
            units.append(Unit(index, runs, folder / "parts" / f"{index:03d}" / f"{runs[0]:06d}.npz"))
    total = len(wanted) * len(plan.combinations)
    finished = total - sum(len(unit.runs) for unit in units)
    if not units:
        return
    progress("compiling", finished, total)
    _warm_up(plan, crew)
    progress("simulating", finished, total)
    for unit in crew.results([(run_unit, (plan, unit)) for unit in units]):
        if not unit.path.is_file():
            raise OSError(f"a worker has done {str(unit.path)!r}, which is not here: do the machines share that disk?")
        finished += len(unit.runs)
        progress(plan.combinations[unit.combination].name, finished, total)


def own_classes(plan: Plan) -> Own:
    """What the plan names of classes that the calling script has registered."""
    estimators = registry.registered(spec.name for c in plan.combinations for spec in c.estimators)
    return estimators, policy_registry.registered(c.policy.name for c in plan.combinations)


def chunk_size(combination: Combination, runs: int, jobs: int, combinations: int) -> int:
    """Runs in a unit: few enough to occupy all workers, many enough to be worth a step's work in Python."""
    held = int(combination.scenario.max_steps) * len(combination.estimators) * 16
    most = max(1, min(MAX_LANES, MAX_VALUES // held))
    units_per_job = min(UNITS_PER_JOB, math.ceil(combinations * runs / (jobs * ENOUGH_LANES)))
    return max(1, min(most, math.ceil(combinations * runs / (jobs * max(1, units_per_job)))))


def _warm_up(plan: Plan, crew: Workers) -> None:
    """Fill the cache of compiled kernels once, each in one process, before all workers need it.

    One compiles the world, with the estimator that has least to compile; the others meanwhile only estimators.
    """
    if crew.is_here:
        return  # run_unit warms up its own process
    seen: dict[str, tuple[Combination, Spec]] = {}
    for combination in plan.combinations:
        for spec in combination.estimators:
            seen.setdefault(spec.name, (combination, spec))
    world: Task = (warm_up, (plan.combinations[0], (Spec.parse(LEAST),)))
    alone: list[Task] = [(exercise, (combination.scenario, spec)) for combination, spec in seen.values()]
    together: list[Task] = [(warm_up, (combination, (spec,))) for combination, spec in seen.values()]
    for _ in crew.results([world, *alone, *together]):
        pass
