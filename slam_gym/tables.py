"""Tidy frames of what estimators did: one row per run, per estimator, per step; differences of pairs.

Columns are described in `RUNS` and `SUMMARY`'s makers below; angles in radians, lengths in metres.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from slam_gym.consistency import diverged, in95_run
from slam_gym.metrics import LOST_AFTER
from slam_gym.records import LANDMARK, TRACK, Records
from slam_gym.reward import ERROR_CAP
from slam_gym.stats import (
    Floats,
    Paired,
    column_mean,
    consistency,
    mean_sd,
    paired_difference,
    pooled_rms,
    row_mean,
    row_median,
    row_rms,
    split_by_age,
)

KEY = ("scenario", "policy", "estimator")
ERRORS = (
    "robot_error", "heading_error", "target_error", "target_error_rel", "target_velocity_error",
    "target_heading_error", "landmark_error", "landmark_gospa",
)  # fmt: skip
CAPPED = ("target_error", "target_error_rel")
"""Errors that are also averaged with at most `ERROR_CAP` a step, and that much while the target is not known: else a
policy that never finds it would have no error."""
NEES = {"pose": 3, "target": 2, "target_state": 0, "landmark": 2}
"""Degrees of freedom; 0: those of the filter's own target model."""
UNBOUNDED = "landmark"
"""Its NEES is a mean over one map, whose landmarks share the pose's error: no chi-squared bounds hold for it."""
SERIES = ("robot_error", "heading_error", "target_error", "target_error_rel", "landmark_error",
          "pose_nees", "target_nees", "landmark_nees")  # fmt: skip
PAIRED = {
    "robot_error_rmse": ("robot RMSE", "m"),
    "target_error_rmse": ("target RMSE", "m"),
    "target_error_rel_rmse": ("relative target RMSE", "m"),
    "lost_share": ("share of time lost", ""),
    "find_time": ("time to find", "s"),
}


def run_table(key: tuple[str, str, str], records: Records, *, burn_in: int = 0, target_dof: int = 4) -> pd.DataFrame:
    """One row per run.

    For each error its mean, RMSE and last value, for those of the target also the capped mean (`CAPPED`); for each
    NEES its mean, median and share inside one run's 95 % bounds; target error (RMSE) and NEES (mean) by the time since
    the target was last seen; lost, diverged, counters.

    Args:
        key: scenario, policy, estimator.
        records: what happened.
        burn_in: first steps that are not scored.
        target_dof: size of the target's own state.
    """
    scored = slice(burn_in, None)
    columns: dict[str, Any] = dict(zip(KEY, key, strict=True))
    columns.update(run=records.run, seed=records.seed, steps=records.steps)
    for name in ERRORS:
        values = records[name][:, scored]
        columns[f"{name}_mean"], columns[f"{name}_rmse"] = row_mean(values), row_rms(values)
        columns[f"{name}_end"] = _last(records[name], records.steps)
    age = records.age[:, scored]
    for name in CAPPED:
        capped = np.fmin(records[name][:, scored], ERROR_CAP)
        columns[f"{name}_capped"] = row_mean(np.where(np.isnan(age), np.nan, capped))
    for kind, dof in NEES.items():
        values = records[f"{kind}_nees"][:, scored]
        columns[f"{kind}_nees_mean"], columns[f"{kind}_nees_median"] = row_mean(values), row_median(values)
        if kind != UNBOUNDED:
            columns[f"{kind}_nees_in95_run"] = np.array([in95_run(row, dof or target_dof) for row in values])
    for suffix, values in split_by_age(records["target_error"][:, scored], age).items():
        columns[f"target_error_{suffix}"] = row_rms(values)
    for suffix, values in split_by_age(records["target_nees"][:, scored], age).items():
        columns[f"target_nees_{suffix}"] = row_mean(values)
    columns["lost_share"] = row_mean(_lost(age))
    columns["lost_end"] = _last(_lost(records.age), records.steps)
    columns["find_time"], columns["never_found"] = _found(records)
    columns["diverged"] = _diverged(records)
    columns["landmark_count"] = _last(records["landmark_count"], records.steps)
    columns["collisions"], columns["effort"] = records.collisions, records.effort
    columns.update({f"count_{name}": values for name, values in records.counts.items()})
    return pd.DataFrame(columns)


def _lost(age: Floats) -> Floats:
    return np.where(np.isnan(age), np.nan, (age > LOST_AFTER).astype(np.float64))


def _found(records: Records) -> tuple[Floats, Floats]:
    """[s] until the target is first seen, the run's length where it never is; and 1 where it never is, else 0.

    NaN where there is no target. Before the first return the age counts from the start.
    """
    steps = np.asarray(records.steps, dtype=np.int64)
    seen = records.age < records.time - 0.5 * (records.time[0])
    found = seen.any(axis=1)
    last = records.time[np.maximum(steps, 1) - 1]
    first = np.where(found, records.time[seen.argmax(axis=1)], last)
    there = ~np.isnan(records.age[:, 0])
    return np.where(there, first, np.nan), np.where(there, (~found).astype(np.float64), np.nan)


def _last(values: Floats, steps: Any) -> Floats:
    """Each run's value at its end."""
    at = np.asarray(steps, dtype=np.int64)
    last = values[np.arange(len(at)), np.maximum(at, 1) - 1]
    return np.where(at > 0, last, np.nan)


def _diverged(records: Records) -> np.ndarray[Any, np.dtype[np.bool_]]:
    pose, error = records["pose_nees"], records["robot_error"]
    return np.array([bool(diverged(pose[i, :n], error[i, :n])[0]) for i, n in enumerate(records.steps)], dtype=np.bool_)


def summary_row(
    key: tuple[str, str, str], records: Records, runs: pd.DataFrame, *, burn_in: int = 0, target_dof: int = 4
) -> dict[str, Any]:
    """One estimator over all runs.

    `<error>_mean` is the mean over runs of their means with the runs' standard deviation `_mean_sd`; `<error>_rmse`
    the root of the mean square over runs, `_rmse_sd` the standard deviation of the runs' own; `_nees_in95_mean`, of
    all but landmarks, with `_nees_batch` runs averaged; `diverged` counts runs; times are microseconds per lane and
    call.
    """
    row: dict[str, Any] = {**dict(zip(KEY, key, strict=True)), "n_runs": len(runs)}
    for name in ERRORS:
        row[f"{name}_mean"], row[f"{name}_mean_sd"] = mean_sd(runs[f"{name}_mean"])
        row[f"{name}_rmse"], row[f"{name}_rmse_sd"] = pooled_rms(runs[f"{name}_rmse"])
    for kind, dof in NEES.items():
        found = consistency(records[f"{kind}_nees"][:, burn_in:], dof or target_dof)
        row[f"{kind}_nees_mean"], row[f"{kind}_nees_median"] = found.mean, found.median
        if kind != UNBOUNDED:
            row[f"{kind}_nees_in95_run"], row[f"{kind}_nees_in95_mean"] = found.in95_run, found.in95_mean
            row[f"{kind}_nees_batch"] = found.batch
    for suffix in ("lt2", "2_15", "gt15"):
        row[f"target_error_{suffix}"] = pooled_rms(runs[f"target_error_{suffix}"])[0]
        row[f"target_nees_{suffix}"] = mean_sd(runs[f"target_nees_{suffix}"])[0]
    row["lost_share"], row["lost_end"] = mean_sd(runs["lost_share"])[0], mean_sd(runs["lost_end"])[0]
    row["find_time"], row["never_found"] = mean_sd(runs["find_time"])[0], mean_sd(runs["never_found"])[0]
    row["diverged"] = int(runs["diverged"].sum())
    row["landmark_count"] = mean_sd(runs["landmark_count"])[0]
    for name in ("collisions", "effort", *(f"{name}_capped" for name in CAPPED)):
        row[name] = mean_sd(runs[name])[0]
    row["predict_us"] = _microseconds(records.timing[0], records.timing[1])
    row["update_us"] = _microseconds(records.timing[2], records.timing[3])
    return row


def _microseconds(seconds: float, calls: float) -> float:
    return float(1e6 * seconds / calls) if calls > 0 else math.nan


def series_table(key: tuple[str, str, str], records: Records) -> pd.DataFrame:
    """One row per step: means over the runs still going; nothing left out at the start."""
    steps = len(records.time)
    columns: dict[str, Any] = dict(zip(KEY, key, strict=True))
    columns.update(step=np.arange(1, steps + 1), time=records.time)
    columns["runs"] = (records.steps[:, None] > np.arange(steps)[None, :]).sum(axis=0)
    columns.update({name: column_mean(records[name]) for name in SERIES})
    columns["lost"] = column_mean(_lost(records.age))
    return pd.DataFrame(columns)


def track_table(key: tuple[str, str, str], records: Records) -> pd.DataFrame:
    """Truth and belief along the runs that are drawn."""
    return _keyed(key, records.tracks, TRACK, ("run", "step", "target_seen"))


def landmark_table(key: tuple[str, str, str], records: Records) -> pd.DataFrame:
    """The map at the end of the runs that are drawn."""
    return _keyed(key, records.landmarks, LANDMARK, ("run", "id"))


def _keyed(key: tuple[str, str, str], values: Floats, names: Sequence[str], whole: Sequence[str]) -> pd.DataFrame:
    frame = pd.DataFrame(values, columns=list(names)).astype({name: np.int64 for name in whole})
    for position, (name, value) in enumerate(zip(KEY, key, strict=True)):
        frame.insert(position, name, value)
    return frame


def paired_table(runs: pd.DataFrame) -> pd.DataFrame:
    """Differences run by run: every estimator against the first, and every policy against the first policy.

    Columns: scenario, policy, estimator, baseline (an estimator, or "policy NAME"), metric, difference, low, high
    (95 % t interval), n pairs, sentence.
    """
    rows: list[dict[str, Any]] = []
    for (scenario, policy), group in runs.groupby(["scenario", "policy"], sort=False):
        names = list(dict.fromkeys(group["estimator"]))
        for name in names[1:]:
            label = (str(scenario), str(policy), name)
            rows += _pairs(label, names[0], name, _of(group, "estimator", name), _of(group, "estimator", names[0]))
    for (scenario, estimator), group in runs.groupby(["scenario", "estimator"], sort=False):
        names = list(dict.fromkeys(group["policy"]))
        for name in names[1:]:
            label, baseline = (str(scenario), name, str(estimator)), f"policy {names[0]}"
            who = f"{estimator} under policy {name}"
            rows += _pairs(label, baseline, who, _of(group, "policy", name), _of(group, "policy", names[0]))
    columns = [*KEY, "baseline", "metric", "difference", "low", "high", "n", "sentence"]
    return pd.DataFrame(rows, columns=columns)


def _of(group: pd.DataFrame, column: str, name: str) -> pd.DataFrame:
    return group[group[column] == name].set_index("run")


def _pairs(
    key: tuple[str, str, str], baseline: str, who: str, a: pd.DataFrame, b: pd.DataFrame
) -> list[dict[str, Any]]:
    common = a.index.intersection(b.index)
    a, b = a.loc[common], b.loc[common]
    rows = []
    for metric, (words, unit) in PAIRED.items():
        if metric in ("lost_share", "find_time") and a[metric].equals(b[metric]):
            continue  # shared data: the same target was out of sight for all
        found = paired_difference(a[metric], b[metric])
        if found.n == 0:
            continue
        rows.append(
            {**dict(zip(KEY, key, strict=True)), "baseline": baseline, "metric": metric,
             "difference": found.difference, "low": found.low, "high": found.high, "n": found.n,
             "sentence": sentence(who, baseline, words, unit, found)}
        )  # fmt: skip
    return rows


def sentence(who: str, baseline: str, words: str, unit: str, found: Paired) -> str:
    """A paired difference in words."""
    unit = f" {unit}" if unit else ""
    if found.n < 2:
        return f"{who} against {baseline}: {words} {found.difference:+.4f}{unit} in one run; no interval from one run."
    if not found.clear:
        interval = f"95 % CI {found.low:+.4f} to {found.high:+.4f}"
        return f"{who} against {baseline}: {words} no different ({found.difference:+.4f}{unit}, {interval})."
    word, low, high = ("lower", -found.high, -found.low) if found.difference < 0 else ("higher", found.low, found.high)
    interval = f"95 % CI {low:.4f} to {high:.4f}"
    return f"{who} against {baseline}: {words} {abs(found.difference):.4f}{unit} {word} ({interval})."
