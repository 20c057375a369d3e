"""A scenario's own drive, recorded once and replayed: what a control step of the papers' worlds costs a filter."""

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from estimators.interface import Floats, Scan
from slam_gym.benchmark.floors import dsyrk_work
from slam_gym.benchmark.timing import Work
from slam_gym.episode import Episode
from slam_gym.scenario import Scenario
from slam_gym.simulation import make_estimator
from slam_gym.specs import Spec

DRIVES: dict[str, tuple[str, ...]] = {
    "tian-sparse": ("ekf", "fej-ekf", "ri-ekf", "cdkf:budget=10"),
    "geng-hu": ("ekf", "fej-ekf", "ri-ekf", "ri-taylor-ekf"),
}
"""Scenarios and the estimators that are driven through them."""
YARDSTICK = 47, 20  # rows and rank of the `dsyrk` that is measured beside
REPEATS = 50  # of the yardstick at a time
PART = 200  # control steps measured at a time: short enough to end before another program takes the processor


@dataclass(frozen=True)
class Drive:
    """What one run of a scenario hands an estimator: controls [T][1, 2] and the sweep after each, None where none."""

    scenario: Scenario
    start: Floats
    start_cov: Floats
    controls: list[Floats]
    sweeps: list[Scan | None]


def record_drive(name: str, seed: int = 0, longest: int | None = None) -> Drive:
    """A scenario driven by its own policy to its end, or for `longest` steps."""
    scenario = Scenario.load(name)
    episode = Episode(scenario, ["dead-reckoning"], seed=seed)
    world = episode.simulation.world
    start, start_cov = world.start_pose[0].copy(), world.start_cov[0].copy()
    controls: list[Floats] = []
    sweeps: list[Scan | None] = []
    while not episode.finished and (longest is None or len(controls) < longest):
        before = episode.step_count
        episode.step()
        if episode.step_count == before:
            break  # the policy has nothing left to do
        controls.append(world.odometry.copy())
        sweeps.append(deepcopy(world.scan) if episode.simulation.due(None) is not None else None)
    return Drive(scenario, start, start_cov, controls, sweeps)


class Replay:
    """A drive through one estimator, by its bound kernels where it has them, in parts of `PART` control steps."""

    def __init__(self, spec: str, drive: Drive) -> None:
        chosen = Spec.parse(spec)
        self.drive, self.estimator = drive, make_estimator(drive.scenario, chosen.name, chosen.options)
        self.parts = [self._part(at) for at in range(0, len(drive.controls), PART)]

    def _part(self, at: int) -> Work:
        estimator, dt = self.estimator, float(self.drive.scenario.dt)
        steps, nothing, lanes = np.full(1, dt), Scan.empty(1, 1), estimator.all_lanes
        pairs = list(zip(self.drive.controls, self.drive.sweeps, strict=True))[at : at + PART]
        calls: list[Any] = []
        for control, sweep in pairs:
            bound = estimator.bound_calls(control, steps, nothing if sweep is None else sweep)
            if bound is None:
                calls.append(lambda _, control=control: estimator.predict(control, dt))
                calls += [] if sweep is None else [lambda _, sweep=sweep: estimator.update(sweep)]
            else:
                calls += [bound.predict] if sweep is None else [bound.predict, bound.update]

        def work() -> None:
            for call in calls:
                call(lanes)

        return work

    def begin(self) -> None:
        """Back to the start."""
        self.estimator.reset(self.drive.start, self.drive.start_cov, seeds=0)


def _least(replays: Mapping[str, Replay], rounds: int) -> tuple[dict[str, float], float]:
    """Seconds of each whole replay, the sum of its parts' least times; and the yardstick's."""
    best = {name: np.full(len(replay.parts), np.inf) for name, replay in replays.items()}
    yardstick, unit = dsyrk_work(*YARDSTICK), np.inf
    with threadpool_limits(1):
        for _ in range(rounds):
            for name, replay in replays.items():
                replay.begin()
                for i, part in enumerate(replay.parts):
                    best[name][i] = min(best[name][i], _seconds(part))
                    unit = min(unit, _seconds(yardstick, REPEATS) / REPEATS)
    return {name: float(times.sum()) for name, times in best.items()}, unit


def _seconds(work: Work, times: int = 1) -> float:
    began = perf_counter()
    for _ in range(times):
        work()
    return perf_counter() - began


def drive_rows(name: str, specs: Sequence[str], rounds: int = 20, longest: int | None = None) -> list[dict[str, Any]]:
    """Rows (scenario, name, microseconds per control step, times as long as the yardstick)."""
    drive = record_drive(name, longest=longest)
    seconds, unit = _least({spec: Replay(spec, drive) for spec in specs}, rounds)
    steps = len(drive.controls)
    return [
        {"scenario": name, "name": spec, "microseconds": 1e6 * second / steps, "times_dsyrk": second / steps / unit}
        for spec, second in seconds.items()
    ]
