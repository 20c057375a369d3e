"""`slam-gym train`: a policy from trial and error."""

import shlex
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from agents.sb3.sweep import SeedReport
    from agents.sb3.training import Trained

MISSING = 'training needs Stable-Baselines3 and torch: pip install -c constraints.txt ".[rl]" in the folder of slam-gym'


@dataclass(frozen=True)
class Train:
    """Train a policy with Stable-Baselines3 on many worlds at once.

    Writes into --out: best/ and latest/ (policies: weights and JSON), evaluations.csv, config.json, tensorboard/ and
    checkpoint.pt. The same command gives the same weights, interrupted and resumed or not.

    Examples:
      slam-gym train
          PPO in the default scenario, two million decisions

      slam-gym train --algo sac --scenario discovery --seed 1 --out runs/finder
      slam-gym train --steps 3e6 --hyperparams gamma=0.99 n_epochs=10 --reward track=0.5 effort=0.05
      slam-gym train --teacher pursuit-hunt --target-cloud 256
          learns first what a searcher does, then what it does not: the best recipe known here
      slam-gym train --seeds 0 1 2 3 4 --out runs/five
          five trainings side by side: what to expect of the recipe, not of one seed

      slam-gym train --seed 1 --resume    the same command with --resume: goes on after Ctrl-C, or for more --steps

      tensorboard --logdir runs                                          watch it learn
      slam-gym evaluate runs/finder          see what it has learned, in worlds that it was not trained in
    """

    algo: Literal["ppo", "sac"] = "ppo"
    """The algorithm."""
    scenario: str = "default"
    """Name (`slam-gym list scenarios`) or path of a TOML file."""
    estimator: str = "ri-ekf"
    """Whose belief the policy sees; options as NAME:key=value,key=value."""
    steps: float | None = None
    """Decisions of all lanes together, such as 2e6; default: the hyperparameters'."""
    seed: int = 0
    """Of weights, exploration and worlds."""
    seeds: tuple[int, ...] = ()
    """Instead of --seed: a training for each, in the folders seed-0, seed-1, ... of --out."""
    jobs: int | None = None
    """Trainings at once, of several --seeds; default: one per CPU, of this machine or of the cluster."""
    backend: Literal["processes", "ray"] = "processes"
    """processes: on this machine. ray: on a Ray cluster whose machines share the disk of --out (extra `cluster`)."""
    address: str | None = None
    """Of the Ray cluster, "auto" for the one this machine belongs to; default: Ray is started here."""
    num_envs: int | None = None
    """Lanes; default: the hyperparameters'."""
    hold: int | None = None
    """Simulation steps that an action lasts; default: the scenario's, or where that is one what comes near 0.4 s."""
    action: Literal["twist", "wheels", "steering"] | None = None
    """Kind of action; default: the robot's usual one."""
    reward: tuple[str, ...] = ()
    """Weights of reward terms to change, such as effort=0.05."""
    set: tuple[str, ...] = ()
    """Scenario settings to change, such as sensor.max_range=5 or "landmarks.count=[5, 30]"."""
    teacher: str = ""
    """A policy (`slam-gym list policies`) to imitate before the first trial, such as pursuit; PPO only, with
    hyperparameters of its own."""
    teacher_decisions: int = 100_000
    """That the teacher comments on, and then as many in which only the critic learns."""
    nearest_landmarks: int = 8
    """Landmarks in the observation."""
    sectors: int = 8
    """Directions in the observation."""
    target_cloud: int = 0
    """Points that follow a lost target and are summarised in the observation, such as 256; 0: its Gaussian alone."""
    target_cloud_options: tuple[str, ...] = ()
    """Of that cloud (`estimators.TargetCloud`), such as evasive=true: it learns whether the target flees."""
    hyperparams: tuple[str, ...] = ()
    """Hyperparameters to change, such as gamma=0.99 learning_rate=lin_1e-3."""
    hyperparams_file: Path | None = None
    """YAML in RL-Zoo's format, instead of the built-in one."""
    evaluate_every: int = 50_000
    """Decisions between two evaluations, each followed by a checkpoint."""
    evaluation_runs: int = 64
    """Worlds of an evaluation, always the same and never trained in."""
    threads: int = 1
    """Of torch; weights are the same bit for bit where this is the same."""
    out: Path | None = None
    """Folder; default: runs/ALGO-SCENARIO-ESTIMATOR-SEED (without the seed for several)."""
    resume: bool = False
    """Go on from the checkpoint in --out; same settings, --steps may have grown."""

    def run(self) -> int:
        """Train, print, write."""
        from rich.console import Console

        from slam_gym.evaluation_backend import workers
        from slam_gym.results import file_stem

        console = Console(stderr=True)
        try:
            with console.status("loading torch and Stable-Baselines3"):
                from agents.sb3.sweep import sweep
                from agents.sb3.training import check_numbers, train
        except ImportError as error:
            raise ImportError(f"{MISSING} ({error})") from error
        check_numbers(self)
        parts = (self.algo, Path(self.scenario).stem, self.estimator, *([] if self.seeds else [self.seed]))
        out = self.out or Path("runs") / file_stem(*parts)
        command = shlex.join(["slam-gym", *sys.argv[1:]])
        try:
            with progress_bars(console, bool(self.seeds)) as report:
                if self.seeds:
                    with workers(self.jobs, self.backend, self.address) as crew:
                        trained = sweep(self, out, crew, command=command, report=report)
                else:
                    trained = [train(self, out, command=command, report=partial(report, self.seed))]
        except KeyboardInterrupt:
            console.print(stopped(out), soft_wrap=True)
            raise
        summarise(trained, Console())
        return 0


def stopped(out: Path) -> str:
    """What to say after Ctrl-C: whether there is anything to go on from."""
    from agents.sb3.callbacks import CHECKPOINT

    if not any(out.rglob(CHECKPOINT)):
        return "Stopped before the first evaluation (--evaluate-every decisions): there is nothing to go on from."
    return f"Stopped; the same command with --resume goes on. Until then: {out}"


def summarise(trained: Sequence["Trained"], console: Any) -> None:
    """Say how good the best policies are and how to use them."""
    for one in trained:
        best = one.best
        for line in (
            f"Best after {best['steps']:,.0f} decisions: {describe(best)}",
            f"Policy: {one.out / 'best'}",
            f"Weights of the latest: {one.digest}",
        ):
            console.print(line, soft_wrap=True, highlight=False)
    folders = " ".join(str(one.out) for one in trained)
    console.print(f"Next: slam-gym evaluate {folders}", soft_wrap=True, highlight=False)


def describe(row: dict[str, float]) -> str:
    """An evaluation in words."""
    parts = [f"return {row['return']:.1f}"]
    if "target_error" in row:
        parts += [f"target error {row['target_error']:.2f} m", f"lost {100 * row['lost']:.1f} %"]
    return ", ".join([*parts, f"robot error {row['robot_error']:.2f} m"])


@contextmanager
def progress_bars(console: Any, several: bool = False) -> Iterator["SeedReport"]:
    """A bar for each seed on a terminal; a line per evaluation everywhere, with the seed where there are several."""
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("decisions"),
        TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn(), TextColumn("{task.fields[rate]}"),
    )  # fmt: skip
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        tasks: dict[int, Any] = {}

        def report(seed: int, done: int, total: int, row: dict[str, float] | None) -> None:
            if seed not in tasks:
                tasks[seed] = bar.add_task(f"training, seed {seed}", total=None, rate="")
            task = tasks[seed]
            speed = bar.tasks[list(tasks).index(seed)].speed
            bar.update(task, completed=done, total=total, rate=f"{speed:,.0f}/s" if speed else "")
            if row is not None:
                whose = f"seed {seed}: " if several else ""
                console.print(f"{whose}{done:>11,} decisions: {describe(row)}", highlight=False, soft_wrap=True)

        yield report
