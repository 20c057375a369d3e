"""Is a policy better than another? Win, tie or loss by metric, from the runs of one `evaluation.compare`.

A policy wins where the 95 % interval of its difference from the baseline lies below zero (less is better everywhere),
loses where it lies above, and ties otherwise. Of one policy the world is the unit: differences are paired by world. Of
several trainings that differ in their seed alone, the training seed is: see `slam_gym.stats.crossed_difference`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from slam_gym.stats import crossed_difference, paired_difference

WIN, TIE, LOSS = "win", "tie", "loss"


@dataclass(frozen=True, slots=True)
class Metric:
    """A column of the table of runs that policies are judged by."""

    column: str
    words: str
    unit: str = ""
    scale: float = 1.0  # from the table's unit to the printed one
    judged: bool = True  # False: shown without a verdict


METRICS = (
    Metric("target_error_capped", "target error", "m"),
    Metric("target_error_rel_capped", "target, robot frame", "m"),
    Metric("lost_share", "track lost", "%", 100.0),
    Metric("find_time", "time to find", "s"),
    Metric("robot_error_mean", "robot error", "m"),
    Metric("effort", "effort"),
    Metric("target_nees_mean", "target NEES (honest: 2)", judged=False),
)


@dataclass(frozen=True, slots=True)
class Difference:
    """A mean difference, candidate less baseline, with its interval; `n` worlds, and the seeds they were driven by."""

    difference: float
    low: float
    high: float
    n: int
    seeds: int

    @property
    def verdict(self) -> str:
        """Win, tie or loss."""
        if self.high < 0.0:
            return WIN
        return LOSS if self.low > 0.0 else TIE

    def not_worse(self, margin: float) -> bool:
        """Whether the interval excludes being worse by the margin or more: non-inferiority."""
        return self.high < margin


def judge(runs: pd.DataFrame, candidates: Sequence[str], baseline: str, *, margin: float = 0.1) -> pd.DataFrame:
    """One row per scenario, estimator and metric.

    Args:
        runs: `Results.runs` with the candidates' and the baseline's runs in the same worlds.
        candidates: labels of policies; several are trainings that differ in their seed.
        baseline: label of the policy they are compared with.
        margin: share of the baseline's mean that counts as "not worse".

    Returns:
        Columns scenario, estimator, baseline, metric, unit, policy_value, baseline_value, difference, low, high (95 %),
        worlds, seeds, verdict ("" where a metric is only shown), not_worse. Metrics undefined in a scenario are left
        out.

    Raises:
        ValueError: a label without runs.
    """
    for label in (*candidates, baseline):
        if label not in set(runs["policy"]):
            raise ValueError(f"no runs of policy {label!r}; there are {', '.join(map(repr, runs['policy'].unique()))}")
    rows: list[dict[str, Any]] = []
    for (scenario, estimator), group in runs.groupby(["scenario", "estimator"], sort=False):
        for metric in METRICS:
            if metric.column not in group:
                continue
            table = group.pivot(index="run", columns="policy", values=metric.column) * metric.scale
            values, reference = table[list(candidates)].to_numpy().T, table[baseline].to_numpy()  # [k, n], [n]
            found = _difference(values, reference)
            if found.n == 0:
                continue
            both = np.isfinite(values).all(axis=0) & np.isfinite(reference)
            against = float(reference[both].mean())
            rows.append({
                "scenario": scenario, "estimator": estimator, "baseline": baseline, "metric": metric.words,
                "unit": metric.unit, "policy_value": float(values[:, both].mean()), "baseline_value": against,
                "difference": found.difference, "low": found.low, "high": found.high, "worlds": found.n,
                "seeds": found.seeds, "verdict": found.verdict if metric.judged else "",
                "not_worse": metric.judged and found.not_worse(margin * against),
            })  # fmt: skip
    return pd.DataFrame(rows)


def pool(runs: pd.DataFrame, candidates: Sequence[str], label: str) -> pd.DataFrame:
    """The runs with the candidates' replaced by their mean in each world, under one label."""
    chosen = runs["policy"].isin(list(candidates))
    key = ["scenario", "estimator", "run"]
    mean = runs[chosen].groupby(key, sort=False).mean(numeric_only=True).reset_index().assign(policy=label)
    return pd.concat([runs[~chosen], mean], ignore_index=True)


def _difference(values: Any, reference: Any) -> Difference:
    """Of k policies' values [k, n] from the reference [n]."""
    if len(values) == 1:
        one = paired_difference(values[0], reference)
        return Difference(one.difference, one.low, one.high, one.n, 1)
    many = crossed_difference(values - reference)
    return Difference(many.difference, many.low, many.high, many.worlds, many.seeds)
