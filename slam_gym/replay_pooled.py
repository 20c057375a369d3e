"""Several recordings, pooled: one row per estimator over every pair of robot and target.

A single recorded robot says little about honesty: its NEES is correlated over minutes. Pooled over all pairs, and shown
with the most and the least confident observer, it says more.
"""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy.stats import chi2

from slam_gym.recording import Floats
from slam_gym.records import Records
from slam_gym.stats import split_by_age

AGES = ("lt2", "2_15", "gt15")  # seconds since the target was last seen
POSE_DOF, TARGET_DOF = 3, 2
TARGET_MEDIAN = float(chi2.median(TARGET_DOF))


def pooled_table(rows: Sequence[tuple[str, str, Records]]) -> pd.DataFrame:
    """One row per estimator, over all samples of all recordings.

    Columns: robot_error, heading_error (RMSE); pose_nees, the mean NEES over its 3 degrees of freedom, with the
    smallest and largest observer's, and the share inside one run's 95 % bound; per age of the target's last sighting
    target_error (RMSE), target_nees (mean over 2) and target_nees_median over its nominal value. 1 is honest.

    Args:
        rows: (estimator, observer, records), the observer being the robot that did SLAM.
    """
    found = []
    for name in dict.fromkeys(estimator for estimator, _, _ in rows):
        mine = [(observer, records) for estimator, observer, records in rows if estimator == name]
        found.append({"estimator": name, "recordings": len(mine), **_pose(mine), **_target([r for _, r in mine])})
    return pd.DataFrame(found)


def _together(records: Sequence[Records], field: str) -> Floats:
    return np.concatenate([one[field].ravel() for one in records])


def _pose(mine: Sequence[tuple[str, Records]]) -> dict[str, float]:
    records = [one for _, one in mine]
    nees = _together(records, "pose_nees") / POSE_DOF
    observers = [
        _mean(_together([one for who, one in mine if who == observer], "pose_nees") / POSE_DOF)
        for observer in dict.fromkeys(who for who, _ in mine)
    ]
    inside = np.where(np.isnan(nees), np.nan, nees * POSE_DOF <= chi2.isf(0.05, POSE_DOF))
    return {
        "robot_error": _rms(_together(records, "robot_error")),
        "heading_error": _rms(_together(records, "heading_error")),
        "pose_nees": _mean(nees),
        "pose_nees_least": min(observers),
        "pose_nees_most": max(observers),
        "pose_inside": _mean(inside),
    }


def _target(records: Sequence[Records]) -> dict[str, float]:
    age = np.concatenate([one.age.ravel() for one in records])
    errors = split_by_age(_together(records, "target_error"), age)
    nees = split_by_age(_together(records, "target_nees"), age)
    row: dict[str, float] = {}
    for suffix in AGES:
        row[f"target_error_{suffix}"] = _rms(errors[suffix])
        row[f"target_nees_{suffix}"] = _mean(nees[suffix]) / TARGET_DOF
        some = nees[suffix][~np.isnan(nees[suffix])]
        row[f"target_nees_median_{suffix}"] = float(np.median(some)) / TARGET_MEDIAN if len(some) else np.nan
    return row


def _mean(values: Floats) -> float:
    some = values[~np.isnan(values)]
    return float(some.mean()) if len(some) else np.nan


def _rms(values: Floats) -> float:
    return float(np.sqrt(_mean(values**2)))
