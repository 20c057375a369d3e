"""`slam-gym train`: a policy from trial and error."""

import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from agents.sb3.training import Report, Trained

MISSING = "training needs Stable-Baselines3 and torch: pip install 'slam-gym[rl]'"


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
      slam-gym train --teacher pursuit-search --target-cloud 256
          learns first what a searcher does, then what it does not: the best recipe known here
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
    """Folder; default: runs/ALGO-SCENARIO-ESTIMATOR-SEED."""
    resume: bool = False
    """Go on from the checkpoint in --out; same settings, --steps may have grown."""

    def run(self) -> int:
        """Train, print, write."""
        from rich.console import Console

        from slam_gym.results import file_stem

        try:
            from agents.sb3.training import check_numbers, train
        except ImportError as error:
            raise ImportError(f"{MISSING} ({error})") from error
        check_numbers(self)
        out = self.out or Path("runs") / file_stem(self.algo, Path(self.scenario).stem, self.estimator, self.seed)
        console = Console(stderr=True)
        try:
            with progress_bar(console) as report:
                trained = train(self, out, command=shlex.join(["slam-gym", *sys.argv[1:]]), report=report)
        except KeyboardInterrupt:
            console.print(f"Stopped; the same command with --resume goes on. Until then: {out}", soft_wrap=True)
            raise
        summarise(trained, Console())
        return 0


def summarise(trained: "Trained", console: Any) -> None:
    """Say how good the best policy is and how to use it."""
    best = trained.best
    console.print(f"Best after {best['steps']:,.0f} decisions: {describe(best)}", highlight=False, soft_wrap=True)
    for line in (
        f"Policy: {trained.out / 'best'}",
        f"Weights of the latest: {trained.digest}",
        f"Next: slam-gym evaluate {trained.out}",
    ):
        console.print(line, soft_wrap=True, highlight=False)


def describe(row: dict[str, float]) -> str:
    """An evaluation in words."""
    parts = [f"return {row['return']:.1f}"]
    if "target_error" in row:
        parts += [f"target error {row['target_error']:.2f} m", f"lost {100 * row['lost']:.1f} %"]
    return ", ".join([*parts, f"robot error {row['robot_error']:.2f} m"])


@contextmanager
def progress_bar(console: Any) -> Iterator["Report"]:
    """A bar on a terminal; a line per evaluation everywhere."""
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (TextColumn("training"), BarColumn(), MofNCompleteColumn(), TextColumn("decisions"), TimeElapsedColumn(),
               TextColumn("left"), TimeRemainingColumn(), TextColumn("{task.fields[rate]}"))  # fmt: skip
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("training", total=None, rate="")

        def report(done: int, total: int, row: dict[str, float] | None) -> None:
            speed = bar.tasks[0].speed
            bar.update(task, completed=done, total=total, rate=f"{speed:,.0f}/s" if speed else "")
            if row is not None:
                console.print(f"{done:>11,} decisions: {describe(row)}", highlight=False, soft_wrap=True)

        yield report
