"""Wu and Sun 2013, Figure 6 in spirit: recorded robots with SLAMTO, and on their wheel odometry alone."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from estimators.interface import TARGET
from slam_gym import mrclam
from slam_gym.plots import trajectories
from slam_gym.recording import Recording
from slam_gym.replay import replay
from slam_gym.replay_models import mrclam_models
from slam_gym.reproduce.experiment import Choice, Drawing, Experiment, Grid, Outcome
from slam_gym.reproduce.study import Study
from slam_gym.reproduce.verdict import Claim, faster

ODOMETRY, SLAMTO = "dead-reckoning", "slamto:particles=300"
ESTIMATORS = (ODOMETRY, SLAMTO, "ekf", "ri-ekf")
INFLATION = 16.0  # of the sensor's variances: these recordings' errors last for seconds
SHOWN = f"{SLAMTO} (R x{INFLATION:g})"
COLUMNS = {
    "robot_error_rmse": ("robot RMSE [m]", 2),
    "landmark_error_rmse": ("landmark RMSE [m]", 2),
    "target_error_lt2": ("target RMSE, seen < 2 s ago [m]", 2),
    "pose_nees_median": ("pose NEES, median", 1),
}


def run(study: Study) -> Outcome:
    """Every robot of the data set, with the other robot that it sees most for a target."""
    if study.mrclam is None:
        return Outcome(missing="it needs recordings, which do not come with slam-gym: name the folder of an MRCLAM "
                       "data set with --mrclam")  # fmt: skip
    robots = robot_numbers(study.mrclam)[: 2 if study.quick else None]
    summaries, first = [], None
    for i, robot in enumerate(robots):
        study.progress(f"robot {robot}", i, len(robots))
        recording = best_recording(study.mrclam, robot)
        found = replay(recording, ESTIMATORS, mrclam_models(), inflations=(1.0, INFLATION))
        summaries.append(found.summary)
        first = first or found
    summary = pd.concat(summaries, ignore_index=True)
    shown = [ODOMETRY, SHOWN]
    drawings = []
    if first is not None:
        tracks, landmarks = (frame[frame["estimator"].isin(shown)] for frame in (first.tracks, first.landmarks))
        caption = f"{recording_name(summary)}: wheel odometry alone, and SLAMTO; crosses are surveyed landmarks"
        drawings = [Drawing("paths", caption, trajectories(tracks, landmarks))]
    return Outcome(_claims(summary), _choices(), [_table(summary)], drawings, [_honesty(summary)])


def recording_name(summary: pd.DataFrame) -> str:
    """What the first recording is called."""
    return str(summary["scenario"].iloc[0])


def robot_numbers(folder: Path) -> list[int]:
    """The robots whose odometry is there."""
    found = [re.match(r"Robot(\d+)_Odometry\.dat", path.name) for path in sorted(folder.glob("Robot*_Odometry.dat*"))]
    return sorted({int(match[1]) for match in found if match})


def best_recording(folder: Path, robot: int) -> Recording:
    """The robot's recording with the target that it sees most often."""
    others = [mrclam.load(folder, robot, other) for other in robot_numbers(folder) if other != robot]
    return max(others, key=lambda recording: int((recording.labels == TARGET).sum()))


def _of(summary: pd.DataFrame, label: str, column: str) -> NDArray[np.float64]:
    return summary.loc[summary["estimator"] == label, column].to_numpy(dtype=float)


def _claims(summary: pd.DataFrame) -> list[Claim]:
    odometry = _of(summary, ODOMETRY, "robot_error_rmse")
    return [
        faster("Figure 6 (b) against (d): with SLAMTO the robot's path is truer than on wheel odometry alone "
               "(errors, odometry over SLAMTO)", _of(summary, SHOWN, "robot_error_rmse"), odometry, paper="pictures"),
        faster("the target, seen within 2 s, is placed better (errors, odometry over SLAMTO)",
               _of(summary, SHOWN, "target_error_lt2"), _of(summary, ODOMETRY, "target_error_lt2"),
               paper="two pictures"),
    ]  # fmt: skip


def _table(summary: pd.DataFrame) -> Grid:
    rows = []
    for label in dict.fromkeys(summary["estimator"]):
        found = [(_of(summary, label, column), digits) for column, (_, digits) in COLUMNS.items()]
        rows.append([label, *(f"{x.mean():.{digits}f}" if np.isfinite(x).all() else "-" for x, digits in found)])
    columns = ("estimator", *(title for title, _ in COLUMNS.values()))
    number = summary["scenario"].nunique()
    note = f"Means over {number} recordings of about a quarter of an hour: {', '.join(summary['scenario'].unique())}."
    return Grid("Recorded robots", columns, rows, note)


def _honesty(summary: pd.DataFrame) -> str:
    plain, inflated = (np.mean(_of(summary, label, "pose_nees_median")) for label in (SLAMTO, SHOWN))
    return (
        f"No filter is honest on these recordings: the median of SLAMTO's pose NEES is {plain:.0f} with white noise of "
        f"the measured size and {inflated:.0f} with {INFLATION:g} times its variance, where 2.4 would be right."
    )


def _choices() -> list[Choice]:
    return [
        Choice("robots", "the robots of an MRCLAM data set, each with the robot that it sees most for a target",
               "the paper's recording is not published; these move through landmarks and see each other likewise"),
        Choice("noise", f"the sensor's variances times {INFLATION:g}, and once as measured",
               "its errors last for seconds, which white noise cannot express"),
        Choice("picture", "truth, belief and map instead of laser points", "the data set has no laser scans"),
    ]  # fmt: skip


EXPERIMENT = Experiment(
    "slamto-robots", "wu-2013", "Figure 6, in spirit", "recorded robots (--mrclam): SLAMTO against wheel odometry", run
)
