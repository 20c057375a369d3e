"""Results as tables for a terminal of 100 columns, without the spreads for one of 80."""

import math
from collections.abc import Callable, Mapping
from typing import Any

import pandas as pd
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from slam_gym import policies
from slam_gym.gaps import METRICS, is_clear, share_text
from slam_gym.results import Results
from slam_gym.specs import is_reference

NEES_SUSPECT = 1.5  # times its expectation: shown in red
NAME_WIDTH = 24
WIDE = 96  # columns from which the spreads over runs are printed too
SENTENCES = 14  # paired differences printed; the rest stays in the files

Row = Mapping[Any, Any]
COLUMNS: tuple[tuple[str, str, Callable[[Row], str]], ...] = (
    ("robot\n[m]", "robot_error_rmse", lambda row: with_spread(row, "robot_error_rmse")),
    ("heading\n[rad]", "heading_error_rmse", lambda row: number(row["heading_error_rmse"], 4)),
    ("target\n[m]", "target_error_rmse", lambda row: with_spread(row, "target_error_rmse")),
    ("relative\n[m]", "target_error_rel_rmse", lambda row: with_spread(row, "target_error_rel_rmse")),
    ("map\n[m]", "landmark_error_rmse", lambda row: number(row["landmark_error_rmse"])),
    ("pose\nNEES", "pose_nees_mean", lambda row: nees(row["pose_nees_mean"], 3)),
    ("target\nNEES", "target_nees_mean", lambda row: nees(row["target_nees_mean"], 2)),
    ("di-\nverged", "diverged", lambda row: str(int(row["diverged"])) if row["diverged"] else "-"),
    ("lost\n[%]", "lost_share", lambda row: number(100.0 * row["lost_share"], 1)),
    ("time\n[us]", "predict_us", lambda row: number(row["predict_us"] + row["update_us"], 1)),
)


def print_results(results: Results, console: Console) -> None:
    """One table per scenario and policy, then the paired differences."""
    for (scenario, policy), group in results.summary.groupby(["scenario", "policy"], sort=False):
        told = " (told the truth)" * policies.is_reference(str(policy))
        title = f"{scenario}, policy {policy}{told}: {int(group['n_runs'].max())} runs"
        present = [column for column in COLUMNS if group[column[1]].notna().any()]
        if not group["target_error_rmse"].notna().any():  # a world without a target loses none
            present = [column for column in present if column[1] != "lost_share"]
        elif len(group) > 1 and group["lost_share"].nunique() == 1:  # shared data: said once
            title += f", target lost {100.0 * group['lost_share'].iloc[0]:.1f} % of the time"
            present = [column for column in present if column[1] != "lost_share"]
        table = Table(title=title, title_justify="left", title_style="bold", box=None, padding=(0, 1),
                      collapse_padding=True, pad_edge=False)  # fmt: skip
        table.add_column("estimator", overflow="fold", max_width=NAME_WIDTH)  # gives way before any number does
        for heading, _, _ in present:
            table.add_column(escape(heading), justify="right", no_wrap=True)
        for row in group.to_dict("records"):
            name = str(row["estimator"])
            cells = [make(row) if console.width >= WIDE else make(row).partition("±")[0] for _, _, make in present]
            table.add_row(name + (" *" if is_reference(name) else ""), *cells)
        console.print(table)
    console.print(_legend(results, console.width >= WIDE), style="dim", highlight=False)
    print_paired(results.paired, console)
    print_gaps(results.gaps, console)


def _legend(results: Results, spreads: bool) -> str:
    text = (
        f"RMSE{' ± standard deviation' if spreads else ''} over runs; relative: the target in the robot's frame; "
        "NEES: mean, 3 (pose) and 2 (target) when honest, red where far above; lost: unseen for over 2 s; "
        "time: predict + update."
    )
    if any(map(is_reference, set(results.summary["estimator"]))):
        text += "\n* is told the truth to linearise at: a reference, not a filter that one could use."
    return text


def print_paired(paired: pd.DataFrame, console: Console) -> None:
    """The differences in words, those of position first."""
    if not len(paired):
        return
    wanted = paired[paired["metric"].isin(["robot_error_rmse", "target_error_rel_rmse", "lost_share", "find_time"])]
    console.print("\nPaired differences, run by run:", style="bold")
    for text in list(wanted["sentence"])[:SENTENCES]:
        console.print(f"  {text}", highlight=False, markup=False)
    if len(wanted) > SENTENCES or len(wanted) < len(paired):
        console.print("  ... and more in paired.csv and the report.", style="dim")


def print_gaps(gaps: pd.DataFrame, console: Console) -> None:
    """How much of the way from pursuit to the oracle each policy goes: a block per scenario, a column per metric."""
    if not len(gaps):
        return
    metrics = [metric for metric in METRICS if any(map(is_clear, gaps[gaps["metric"] == metric].to_dict("records")))]
    table = Table(title="\nGap closed: 0 is pursuit, 1 the oracle (95 % interval)",
                  title_justify="left", title_style="bold", box=None, padding=(0, 1), collapse_padding=True,
                  pad_edge=False)  # fmt: skip
    table.add_column("", no_wrap=True)
    for metric in metrics:
        table.add_column(METRICS[metric][0], justify="right", no_wrap=True)
    several = gaps["estimator"].nunique() > 1
    for scenario, group in gaps.groupby("scenario", sort=False):
        table.add_row(f"[bold]{escape(str(scenario))}[/bold]")
        for (policy, estimator), rows in group.groupby(["policy", "estimator"], sort=False):
            told = {row["metric"]: share_text(row) for row in rows.to_dict("records") if is_clear(row)}
            name = f"{policy}, {estimator}" if several else str(policy)
            table.add_row(f"  {escape(name)}", *(told.get(metric, "-") for metric in metrics))
    console.print(table)
    console.print("-: no gap to speak of. Means of pursuit, policy and oracle: gaps.csv and the report.", style="dim")


def number(value: float, digits: int = 3) -> str:
    """A number in at most 8 characters; a dash where undefined."""
    if value is None or math.isnan(value):
        return "-"
    return f"{value:.{digits}f}" if abs(value) < 1e4 else f"{value:.1e}"


def with_spread(row: Row, name: str) -> str:
    """Value and standard deviation over runs."""
    spread = row.get(f"{name}_sd", math.nan)
    return number(row[name]) + (f"±{number(spread)}" if math.isfinite(spread) else "")


def nees(value: float, dof: int) -> str:
    """A NEES, red where it is far above its expectation."""
    text = number(value, 2 if not value >= 1000.0 else 0)
    return f"[red]{text}[/red]" if value > NEES_SUSPECT * dof else text
