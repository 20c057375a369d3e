"""The loop of Tian et al. 2010: its world, and batches of its 45 runs."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from slam_gym.consistency import in95_mean
from slam_gym.reproduce.figures import POSE_DOF
from slam_gym.reproduce.study import UNSCORED, Study, available
from slam_gym.scenario import Scenario

Floats = NDArray[np.float64]

CDKF, FASTSLAM, EKF = "cdkf:budget=10", "fastslam2:particles=10", "ekf"
BESIDE = ("ideal-ekf", "fej-ekf", "ri-ekf", "ri-cdkf:budget=10", "oc-ekf")
PAPER_RUNS = 45
BATCHES, QUICK_BATCHES, QUICK_RUNS = 10, 2, 4
LANDMARKS_FILE, WAYPOINTS_FILE = "webmap_landmarks.csv", "webmap_waypoints.csv"


@dataclass(frozen=True, slots=True)
class Batch:
    """One repetition of the paper's 45 runs; everything by estimator's label.

    Attributes:
        mse: [R] mean over the run of the squared position error [m^2].
        nees: [R] mean pose NEES of each run.
        median: of the pose NEES over runs and steps.
        mean_nees: [T] mean over runs.
        share: of the steps at which that mean lies in its 95 % region, Eq. (44).
        microseconds: filter time per control step.
    """

    time: Floats
    mse: dict[str, Floats]
    nees: dict[str, Floats]
    median: dict[str, float]
    mean_nees: dict[str, Floats]
    share: dict[str, float]
    microseconds: dict[str, float]


def loop(study: Study, preset: str, landmarks: Path | None = None) -> Scenario:
    """The preset along the published route where it is given; landmarks: a CSV file in place of the preset's."""
    scenario = Scenario.load(preset)
    if study.webmap is not None:
        route = {"file": str(study.webmap / WAYPOINTS_FILE), "follow": "commands"}
        scenario = scenario.replace("policy.options", route)
    if landmarks is not None:
        scenario = Scenario.load(scenario, **{"landmarks.layout": "file", "landmarks.file": str(landmarks)})
    return scenario


def published_landmarks(study: Study) -> Path | None:
    """The published map's file, if the user has it."""
    return None if study.webmap is None else study.webmap / LANDMARKS_FILE


def measure_batches(study: Study, scenario_of: Callable[[int], Scenario]) -> list[Batch]:
    """The paper's experiment as often as the size allows, each batch with noise of its own."""
    runs = study.size(PAPER_RUNS, QUICK_RUNS)
    number = study.batches or study.size(BATCHES, QUICK_BATCHES)
    batches = []
    for b in range(number):
        sample = study.measure(
            f"batch {b + 1}", scenario_of(b), [CDKF, FASTSLAM, EKF, *available(*BESIDE)], runs=runs, seed=b,
            fields=("robot_error", "pose_nees"),
        )  # fmt: skip
        labels, nees = sample.labels, {k: v["pose_nees"][:, UNSCORED:] for k, v in sample.values.items()}
        batches.append(
            Batch(
                time=sample.time,
                mse={k: np.square(sample.values[k]["robot_error"]).mean(axis=1) for k in labels},
                nees={k: nees[k].mean(axis=1) for k in labels},
                median={k: float(np.median(nees[k])) for k in labels},
                mean_nees={k: sample.over_time(k, "pose_nees") for k in labels},
                share={k: in95_mean(nees[k], POSE_DOF, batch=runs)[0] for k in labels},
                microseconds={k: sample.microseconds(k) for k in labels},
            )
        )
    return batches
