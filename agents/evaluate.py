"""`slam-gym evaluate`: how good a policy is, in worlds it has never seen."""

import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

if TYPE_CHECKING:
    import pandas as pd

    from slam_gym.specs import Spec

TABLE = "evaluation.csv"
ESTIMATOR = "ri-ekf"  # whose belief a policy acts on that was not trained on another's
SEED = "seed"  # the one setting in which trainings of one configuration differ
IRRELEVANT = ("out", "resume", "threads", "evaluate_every", SEED)  # settings that change no policy, but for the seed
VERDICTS = {"win": "[green]win[/green]", "tie": "tie", "loss": "[red]loss[/red]", "": ""}
NOT_WORSE = "not worse"  # a tie whose interval excludes being worse by the margin


@dataclass(frozen=True)
class Evaluate:
    """Evaluate a policy in worlds that no training has seen, against others in the same worlds.

    Says win, tie or loss for each metric: a policy wins only where the 95 % interval of the difference says so. Several
    run folders of one configuration are seeds of one training: then the training seed is the unit, and the interval
    is what to expect of the next seed.

    Examples:
      slam-gym evaluate ppo
          the policy that comes with slam-gym, against pursuit

      slam-gym evaluate runs/mine
          a training, in the scenario it was trained for

      slam-gym evaluate runs/mine-0 runs/mine-1 runs/mine-2 --runs 400
          three seeds of one configuration

      slam-gym evaluate ppo --scenarios default discovery --against pursuit oracle --estimator ekf
          in several scenarios, against several policies, on another filter's belief; with pursuit and an oracle also
          the share of the gap between them that is closed
    """

    policies: Annotated[tuple[str, ...], tyro.conf.Positional]
    """A policy (`slam-gym list policies`) with its options, or run folders of `slam-gym train`."""
    against: tuple[str, ...] = ("pursuit",)
    """Policies to compare with."""
    scenarios: tuple[str, ...] = ()
    """Names or TOML files; none: the one that the policy was trained in, with its --set; else default."""
    estimator: str = ""
    """Whose belief everybody acts on; none: the one that the policy was trained with, else ri-ekf."""
    runs: int = 200
    """Worlds of each scenario."""
    seed: int = 0
    """Of the worlds; they are drawn for another purpose than those of training, whatever the seeds."""
    set: tuple[str, ...] = ()
    """Scenario settings to change, such as sensor.max_range=5."""
    steps: int | None = None
    """Simulation steps of a run instead of the scenario's."""
    margin: float = 0.1
    """Share of the other's mean within which a policy counts as not worse."""
    jobs: int | None = None
    """Processes; default: one per CPU."""
    out: Path | None = None
    """Folder of the results; default: results/evaluate-POLICY."""
    resume: bool = False
    """Go on with what is done in --out; same settings, --runs may have grown."""

    def run(self) -> int:
        """Compare, judge, print, write."""
        from rich.console import Console

        from slam_gym.commands.compare import progress_bar
        from slam_gym.commands.summary import print_gaps
        from slam_gym.evaluation import compare
        from slam_gym.gaps import gap_table
        from slam_gym.policies import parse
        from slam_gym.results import file_stem, write_atomic
        from slam_gym.specs import parse_settings
        from slam_gym.verdicts import pool

        if not self.margin >= 0.0:
            raise ValueError(f"--margin must be zero or more; got {self.margin}")
        candidates, others = [parse(text) for text in self.policies], [parse(text) for text in self.against]
        trained = training_settings(candidates)
        scenarios, changes = self.scenarios, tuple(self.set)
        if not scenarios:
            scenarios = (trained.get("scenario", "default"),)
            changes = (*trained.get("set", ()), *changes)
        estimator = self.estimator or trained.get("estimator", ESTIMATOR)
        out = self.out or Path("results") / file_stem("evaluate", *(Path(text).name for text in self.policies))
        with progress_bar() as progress:
            results = compare(
                scenarios, [estimator], [*others, *candidates], runs=self.runs, seed=self.seed, steps=self.steps,
                overrides=parse_settings(changes), out=out, resume=self.resume, jobs=self.jobs,
                command=shlex.join(["slam-gym", *sys.argv[1:]]), progress=progress,
            )  # fmt: skip
        labels = [spec.label for spec in candidates]
        name = labels[0] if len(labels) == 1 else f"{len(labels)} training seeds"
        table = judgement(results.runs, labels, [spec.label for spec in others], self.margin)
        write_atomic(out / TABLE, lambda file: table.to_csv(file, index=False))
        console = Console()
        print_judgement(table, console, self.margin)
        print_gaps(gap_table(pool(results.runs, labels, name)), console)
        console.print(f"Tables: {out} ({TABLE} and those of `slam-gym compare`)", soft_wrap=True, highlight=False)
        console.print(f"Pictures: slam-gym report {out}", soft_wrap=True, highlight=False)
        return 0


def training_settings(candidates: Sequence["Spec"]) -> dict[str, Any]:
    """What the candidates were trained with; empty for a policy that was not, or not by `slam-gym train`.

    Raises:
        ValueError: several policies that are not seeds of one configuration.
    """
    from slam_gym.policies import TRAINED

    told = [_training(Path(spec.options["path"])) if spec.name == TRAINED else {} for spec in candidates]
    if len(candidates) > 1 and not all(told):
        raise ValueError(
            "several policies are evaluated together only where they are run folders of one training with different "
            "seeds; name the others with --against"
        )
    for spec, other in zip(candidates[1:], told[1:], strict=True):
        _same_configuration(candidates[0].label, told[0], spec.label, other)
    return dict(told[0].get("settings", {})) if told else {}


def _training(path: Path) -> dict[str, Any]:
    from agents.sb3.policy_file import find_policy, read_settings

    return dict(read_settings(find_policy(path))["training"])


def _same_configuration(name: str, one: Mapping[str, Any], other_name: str, other: Mapping[str, Any]) -> None:
    for part in ("settings", "hyperparameters"):
        a, b = one.get(part, {}), other.get(part, {})
        for key in {**a, **b}:
            if key not in IRRELEVANT and a.get(key) != b.get(key):
                raise ValueError(
                    f"{other_name!r} is not the same training as {name!r} with another seed: {key} is {b.get(key)!r}, "
                    f"not {a.get(key)!r}. Evaluate them one at a time"
                )
    if one.get("settings", {}).get(SEED) == other.get("settings", {}).get(SEED):
        raise ValueError(f"{name!r} and {other_name!r} are trainings with the same seed; name each seed once")


def judgement(runs: "pd.DataFrame", candidates: Sequence[str], others: Sequence[str], margin: float) -> "pd.DataFrame":
    """The candidates against each of the others."""
    import pandas as pd

    from slam_gym.verdicts import judge

    return pd.concat([judge(runs, candidates, other, margin=margin) for other in others], ignore_index=True)


def print_judgement(table: "pd.DataFrame", console: Any, margin: float) -> None:
    """One table per scenario and opponent."""
    from rich.markup import escape
    from rich.table import Table

    for (scenario, estimator, other), group in table.groupby(["scenario", "estimator", "baseline"], sort=False):
        seeds, worlds = int(group["seeds"].max()), int(group["worlds"].max())
        unit = f"{seeds} training seeds in " if seeds > 1 else ""
        printed = Table(title=f"{scenario}, {estimator}: {unit}{worlds} worlds, against {escape(str(other))}",
                        title_justify="left", title_style="bold", box=None, pad_edge=False)  # fmt: skip
        for heading in ("", "policy", "other", "change", "95 % interval", ""):
            printed.add_column(heading, justify="left" if not heading else "right", no_wrap=True)
        for row in group.to_dict("records"):
            printed.add_row(*_cells(row))
        console.print(printed)
    unit = "The training seed is the unit" if table["seeds"].max() > 1 else "The world is the unit"
    console.print(
        f"{unit}; a win or a loss is an interval without zero, {NOT_WORSE}: one below +{margin:.0%} of the other. "
        "Errors and NEES are means over steps and worlds. "
        "Target errors count at most 8 m a step, and 8 m while the target is not known; lost: unseen for over 2 s.",
        style="dim", highlight=False,
    )  # fmt: skip


def _cells(row: Mapping[Any, Any]) -> list[str]:
    from rich.markup import escape

    unit = f" [{row['unit']}]" if row["unit"] else ""
    digits = 1 if row["unit"] in ("%", "s") else 3
    numbers = [f"{row[name]:.{digits}f}" for name in ("policy_value", "baseline_value")]
    change, low, high = (f"{row[name]:+.{digits}f}" for name in ("difference", "low", "high"))
    verdict = NOT_WORSE if row["verdict"] == "tie" and row["not_worse"] else VERDICTS[row["verdict"]]
    return [escape(f"{row['metric']}{unit}"), *numbers, change, f"{low} to {high}", verdict]
