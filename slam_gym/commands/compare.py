"""`slam-gym compare`: many runs, a table, a report."""

import re
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from slam_gym.evaluation import Progress
    from slam_gym.results import Results


@dataclass(frozen=True)
class Compare:
    """Compare estimators and policies over many simulated runs, everyone on the same random draws.

    Prints a table, writes tables (Parquet, CSV), trajectories (TUM), pictures and report.html into --out.

    Examples:
      slam-gym compare
          the default scenario under pursuit, every estimator

      slam-gym compare --scenarios slamto --estimators slamto:particles=500 slamto ekf --runs 400
          options follow a colon; the first estimator is what the others are compared with

      slam-gym compare --scenarios open evasive --policies pursuit random --mode closed-loop
          every estimator drives its own policy, so its errors have consequences

      slam-gym compare --set sensor.max_range=4 "landmarks.count=[5, 30]" --out results/short-sight
          change numbers of the scenario; [low, high] is drawn anew for each run

      slam-gym compare --mode closed-loop --estimators ri-ekf --policies pursuit receding-horizon oracle
          with pursuit and the oracle (told the truth) a table says how much of the gap between them others close

      slam-gym compare --scenarios default evasive-hard --sweep target.speed=0.6,0.9,1.2
          each value is a scenario of its own, with the same random draws

      slam-gym compare --runs 4000 --out a --shard 1/2      on one machine, and 2/2 with --out b on another;
      slam-gym merge a b --out all                          then put them together

      slam-gym compare --runs 4000 --backend ray --address auto
          on a Ray cluster: the same numbers; what a lost worker was doing is done again

      slam-gym compare --runs 4000 --out a --resume         go on after Ctrl-C, a crash, or for more runs
    """

    scenarios: tuple[str, ...] = ("default",)
    """Names (`slam-gym list scenarios`) or paths of TOML files."""
    estimators: tuple[str, ...] = ()
    """Names, with options as NAME:key=value,key=value; none: the scenario's own choice."""
    policies: tuple[str, ...] = ()
    """Who drives, written likewise, or the folder of a training; none: the scenario's own."""
    runs: int = 40
    """Worlds per scenario and policy."""
    seed: int = 0
    """World i of a seed is the same for every estimator, policy and scenario."""
    mode: Literal["shared", "closed-loop"] = "shared"
    """shared: one policy drives and all estimators process the same data. closed-loop: each drives its own."""
    driver: str = ""
    """Whose belief the policy acts on when data are shared; none: ri-ekf, else fej-ekf, else the first estimator."""
    set: tuple[str, ...] = ()
    """Scenario settings, key=value, such as sensor.max_range=5 (`slam-gym list default` shows the keys)."""
    sweep: tuple[str, ...] = ()
    """Settings with several values, key=v1,v2,v3 (all combinations of several): each makes a scenario of its own."""
    estimator_options: str = ""
    """Options by estimator as JSON, such as '{"slamto": {"particles": 500}}'."""
    noise_inflation: float | None = None
    """Factor on the measurement covariance that the filters assume, for errors correlated in time."""
    steps: int | None = None
    """Simulation steps of a run instead of the scenario's."""
    burn_in: int | None = None
    """First steps that are not scored instead of the scenario's (at least 1: the covariance there is singular)."""
    jobs: int | None = None
    """Workers at once; default: one per CPU, of this machine or of the cluster."""
    backend: Literal["processes", "ray"] = "processes"
    """processes: on this machine. ray: on a Ray cluster whose machines share the disk of --out (extra `cluster`)."""
    address: str | None = None
    """Of the Ray cluster, "auto" for the one this machine belongs to; default: Ray is started here."""
    out: Path | None = None
    """Folder of the results; default: results/compare-SCENARIO."""
    resume: bool = False
    """Go on with what is done in --out; same settings, --runs may have grown."""
    shard: str = "1/1"
    """i/n: only every n-th run, from the i-th; `slam-gym merge` puts the folders together."""

    def run(self) -> int:
        """Compare, print, write, draw."""
        from rich.console import Console

        from slam_gym.commands.summary import print_results
        from slam_gym.evaluation import compare
        from slam_gym.results import file_stem
        from slam_gym.specs import Spec, parse_options, parse_settings, parse_sweep

        out = self.out or Path("results") / file_stem("compare", *(Path(s).stem for s in self.scenarios))
        options: dict[str, Any] = {}
        if self.estimator_options:
            chosen = [Spec.parse(name).name for name in self.estimators]
            options = parse_options(self.estimator_options, chosen or None)
        with progress_bar() as progress, said_how_to_go_on(out):
            results = compare(
                self.scenarios, self.estimators or None, self.policies or None,
                runs=self.runs, seed=self.seed, mode=self.mode, driver=self.driver or None, steps=self.steps,
                burn_in=self.burn_in, overrides=parse_settings(self.set), sweep=parse_sweep(self.sweep),
                estimator_options=options,
                noise_inflation=self.noise_inflation, out=out, resume=self.resume, shard=parse_shard(self.shard),
                jobs=self.jobs, backend=self.backend, address=self.address,
                command=shlex.join(["slam-gym", *sys.argv[1:]]), progress=progress,
            )  # fmt: skip
        finish(results, Console(), print_results)
        return 0


@contextmanager
def said_how_to_go_on(out: Path) -> Iterator[None]:
    """After a Ctrl-C: what is done is kept, and which call goes on with it."""
    try:
        yield
    except KeyboardInterrupt:
        if any(out.glob("parts/*/*")):
            print(f"\nStopped; the same command with --resume goes on. Until then: {out}", file=sys.stderr)
        raise


def finish(results: "Results", console: Any, print_results: Any) -> None:
    """Print the tables, draw the report, say where everything is."""
    from slam_gym.report import write_report

    print_results(results, console)
    with console.status("drawing the report"):
        page = write_report(results)
    console.print(f"Report: {page}", soft_wrap=True, highlight=False)
    console.print(f"Tables: {results.path} (Parquet, CSV, TUM)", soft_wrap=True, highlight=False)


def parse_shard(text: str) -> tuple[int, int]:
    """(i, n) of "i/n".

    Raises:
        ValueError: written otherwise.
    """
    found = re.fullmatch(r"(\d+)/(\d+)", text)
    if not found:
        raise ValueError(f"--shard is written i/n, such as 1/4; got {text!r}")
    return int(found[1]), int(found[2])


@contextmanager
def progress_bar(units: str = "runs") -> Iterator["Progress"]:
    """A bar on a terminal; a line now and then elsewhere. units: what is counted."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn(units),
               TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn())  # fmt: skip
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task("starting", total=None)

        def report(what: str, done: int, total: int) -> None:
            bar.update(task, description=what, completed=done, total=total)
            if not console.is_terminal:
                console.print(f"{what}: {done} of {total} {units}", highlight=False)

        yield report
