"""Results as tables for a terminal of 100 columns."""

import math
from collections.abc import Callable
from typing import Any

import pandas as pd
from rich.console import Console
from rich.table import Table

from slam_gym.results import Results

NEES_SUSPECT = 1.5  # times its expectation: shown in red
SENTENCES = 12  # paired differences printed; the rest stays in the files

Row = dict[str, Any]
COLUMNS: tuple[tuple[str, str, Callable[[Row], str]], ...] = (
    ("robot", "robot_error_rmse", lambda row: with_spread(row, "robot_error_rmse")),
    ("heading", "heading_error_rmse", lambda row: number(row["heading_error_rmse"], 4)),
    ("target", "target_error_rmse", lambda row: with_spread(row, "target_error_rmse")),
    ("relative", "target_error_rel_rmse", lambda row: number(row["target_error_rel_rmse"])),
    ("landmarks", "landmark_error_rmse", lambda row: number(row["landmark_error_rmse"])),
    ("pose\nNEES", "pose_nees_mean", lambda row: nees(row["pose_nees_mean"], 3)),
    ("target\nNEES", "target_nees_mean", lambda row: nees(row["target_nees_mean"], 2)),
    ("diverged", "diverged", lambda row: str(int(row["diverged"])) if row["diverged"] else "-"),
    ("lost", "lost_share", lambda row: percent(row["lost_share"])),
    ("us", "predict_us", lambda row: number(row["predict_us"] + row["update_us"], 1)),
)


def print_results(results: Results, console: Console) -> None:
    """One table per scenario and policy, then the paired differences."""
    from estimators.registry import get

    for (scenario, policy), group in results.summary.groupby(["scenario", "policy"], sort=False):
        table = Table(title=f"{scenario}, policy {policy}: {int(group['n_runs'].max())} runs", title_justify="left",
                      padding=(0, 1), box=None, header_style="bold")  # fmt: skip
        present = [column for column in COLUMNS if group[column[1]].notna().any()]
        table.add_column("estimator", no_wrap=True)
        for title, _, _ in present:
            table.add_column(title, justify="right", no_wrap=True)
        for row in group.to_dict("records"):
            name = str(row["estimator"])
            table.add_row(name + (" *" if _is_reference(name, get) else ""), *(make(row) for _, _, make in present))
        console.print(table)
    console.print(_legend(results), style="dim", highlight=False)
    print_paired(results.paired, console)


def _is_reference(name: str, get: Callable[[str], Any]) -> bool:
    from estimators.interface import TruthAware

    try:
        return issubclass(get(name.partition(":")[0]), TruthAware)
    except (ValueError, ImportError):  # results of a plug-in that is not installed here
        return False


def _legend(results: Results) -> str:
    lines = [
        "RMSE in m and rad, ± standard deviation over runs; relative: target in the robot's frame;",
        "NEES: 3 (pose) and 2 (target) when honest; lost: time with the target unseen for over 2 s;",
        "us: filter time per step, predict + update.",
    ]
    if any(_starred(results)):
        lines.append("* is told the truth to linearise at: a reference, not a filter one could use.")
    return "\n".join(lines)


def _starred(results: Results) -> list[bool]:
    from estimators.registry import get

    return [_is_reference(name, get) for name in set(results.summary["estimator"])]


def print_paired(paired: pd.DataFrame, console: Console) -> None:
    """The differences in words, those of position first."""
    if not len(paired):
        return
    wanted = paired[paired["metric"].isin(["robot_error_rmse", "target_error_rel_rmse", "lost_share"])]
    console.print("\nPaired differences, run by run:", style="bold")
    for text in list(wanted["sentence"])[:SENTENCES]:
        console.print(f"  {text}", highlight=False, markup=False)
    if len(wanted) > SENTENCES or len(wanted) < len(paired):
        console.print("  ... and more in paired.csv and the report.", style="dim")


def number(value: float, digits: int = 3) -> str:
    """A number in at most 8 characters; a dash where undefined."""
    if value is None or math.isnan(value):
        return "-"
    return f"{value:.{digits}f}" if abs(value) < 1e4 else f"{value:.1e}"


def with_spread(row: Row, name: str) -> str:
    """Value and standard deviation over runs."""
    spread = row.get(f"{name}_sd", math.nan)
    return number(row[name]) + (f" ±{number(spread)}" if math.isfinite(spread) else "")


def nees(value: float, dof: int) -> str:
    """A NEES, red where it is far above its expectation."""
    text = number(value, 2 if not value >= 1000.0 else 0)
    return f"[red]{text}[/red]" if value > NEES_SUSPECT * dof else text


def percent(value: float) -> str:
    """A share in per cent."""
    return "-" if math.isnan(value) else f"{100.0 * value:.1f}%"
