"""How much of the gap between plain pursuit and an oracle a policy closes, from a comparison's runs."""

import math
from typing import Any

import pandas as pd

from slam_gym.policies import is_reference
from slam_gym.stats import gap_closed

BASELINE = "pursuit"
METRICS = {
    "target_error_capped": ("target error", "m"),
    "lost_share": ("share of time lost", ""),
    "find_time": ("time to find", "s"),
    "robot_error_mean": ("robot error", "m"),
}
"""Columns of the run table: words and unit; those that a table lacks are left out."""
COLUMNS = ["scenario", "policy", "estimator", "metric", "baseline", "value", "reference", "closed", "low", "high", "n"]


def gap_table(runs: pd.DataFrame) -> pd.DataFrame:
    """Gap closed = (pursuit - policy) / (pursuit - oracle), of means over the same worlds.

    One row per scenario, estimator, metric and policy other than those two. Empty where "pursuit" or a policy that is
    told the truth is missing. Where one policy drove all estimators the share of time lost repeats for each.

    Columns: scenario, policy, estimator, metric; baseline, value, reference: pursuit's mean, the policy's, the
    oracle's; closed, low, high: the share and its 95 % interval; n: runs (`slam_gym.stats.Gap`).
    """
    rows: list[dict[str, Any]] = []
    for (scenario, estimator), group in runs.groupby(["scenario", "estimator"], sort=False):
        by_policy = {name: part.set_index("run") for name, part in group.groupby("policy", sort=False)}
        base = next((name for name in by_policy if str(name).partition(":")[0] == BASELINE), None)
        oracle = next((name for name in by_policy if is_reference(str(name))), None)
        if base is None or oracle is None:
            continue
        for policy, part in by_policy.items():
            if policy not in (base, oracle):
                key = {"scenario": scenario, "policy": policy, "estimator": estimator}
                rows += [{**key, **row} for row in _rows(by_policy[base], part, by_policy[oracle])]
    return pd.DataFrame(rows, columns=COLUMNS)


def _rows(base: pd.DataFrame, part: pd.DataFrame, oracle: pd.DataFrame) -> list[dict[str, Any]]:
    common = base.index.intersection(part.index).intersection(oracle.index)
    rows = []
    for metric in METRICS:
        if metric not in base:
            continue
        b, x, o = (frame.loc[common, metric] for frame in (base, part, oracle))
        found = gap_closed(b, x, o)
        if found.n and not (b.equals(x) and b.equals(o)):
            means = dict(zip(("baseline", "value", "reference"), found.means, strict=True))
            rows.append({"metric": metric, **means, "closed": found.closed, "low": found.low, "high": found.high,
                         "n": found.n})  # fmt: skip
    return rows


def is_clear(row: Any) -> bool:
    """Whether pursuit and the oracle differ enough for a row's share to have an interval."""
    return math.isfinite(row["low"]) and math.isfinite(row["high"])


def share_text(row: Any) -> str:
    """A row's share with its interval; in words where there is no gap to speak of."""
    if not is_clear(row):
        return "no clear gap"
    return f"{row['closed']:.2f} ({row['low']:.2f} to {row['high']:.2f})"
