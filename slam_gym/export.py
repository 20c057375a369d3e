"""A simulated run as a recording: what a robot would have logged, with the truth, in the formats that replay reads."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estimators.interface import TARGET, UNKNOWN
from slam_gym.episode import Episode
from slam_gym.recording import Recording
from slam_gym.scenario import Scenario

Floats = NDArray[np.float64]

EPOCH = 1_000_000_000.0  # [s] at which an exported data set starts, as recorded ones start at some date
DRIVER = "ri-ekf"  # whose belief the policy acts on
ROBOT, TARGET_ROBOT, FIRST_LANDMARK = 1, 2, 6  # subjects of an exported MRCLAM set; landmarks begin at 6 as published
FIRST_BARCODE, MISREAD_BARCODE = 5, 4  # barcode = subject + 5; 4 belongs to nobody


def record(
    scenario: Scenario,
    *,
    policy: str | tuple[str, Mapping[str, Any]] | None = None,
    seed: int = 0,
    steps: int | None = None,
) -> Recording:
    """Simulate one run and keep what the robot reported and sensed, and the truth.

    Args:
        scenario: the world; its landmarks' ids become labels if the scenario tells them.
        policy: who drives; None: the scenario's own.
        seed: of the world.
        steps: simulation steps; None: the scenario's `max_steps`.

    Raises:
        ValueError: steps below 1, or an unknown policy.
    """
    if steps is not None and steps < 1:
        raise ValueError(f"steps must be at least 1; got {steps}")
    episode = Episode(scenario if steps is None else scenario.replace("max_steps", steps), [DRIVER], policy=policy,
                      seed=seed)  # fmt: skip
    world = episode.simulation.world
    odometry, measurements, sweeps = [], [], []
    truth, target = [[0.0, *world.pose[0]]], [[0.0, *world.target[0, :2], world.target_heading[0]]]
    while not episode.finished:
        begin = episode.time
        episode.step()
        now = episode.time
        if now == begin:  # the policy has finished
            break
        odometry.append([begin, *world.odometry[0]])
        truth.append([now, *world.pose[0]])
        target.append([now, *world.target[0, :2], world.target_heading[0]])
        if world.due[0]:
            sweeps.append([now])
            scan, n = world.scan, world.scan.count[0]
            measurements += [[now, scan.labels[0, k], scan.ranges[0, k], scan.bearings[0, k]] for k in range(n)]
    odometry.append([episode.time, 0.0, 0.0])
    count = world.landmark_count[0]
    tables: dict[str, Any] = {
        "odometry": odometry,
        "measurements": measurements,
        "sweeps": sweeps,
        "truth": truth,
        "landmarks": np.column_stack([np.arange(count), world.landmarks[0, :count]]),
    }
    if world.has_target:
        tables["target"] = target
    return Recording.from_tables(scenario.name, tables)


def mrclam_files(recording: Recording) -> dict[str, Floats]:
    """A recording with known landmark ids as the files of an MRCLAM set, for `slam_gym.mrclam.save`.

    The robot is robot 1. The target is robot 2, with commands taken from its path and no measurements of its own.
    Returns of unknown origin get a barcode that is not in Barcodes.dat, as mis-read ones do.

    Raises:
        ValueError: no truth, or no return has a label.
    """
    if recording.truth is None:
        raise ValueError("an MRCLAM set holds the true path; this recording has none")
    labels = recording.labels
    if len(labels) and (labels == UNKNOWN).all():
        raise ValueError("an MRCLAM set names what was seen, and no return here has a label; use `export log` instead")
    subjects = np.where(labels == TARGET, TARGET_ROBOT, labels + FIRST_LANDMARK)
    codes = np.where(labels == UNKNOWN, MISREAD_BARCODE, subjects + FIRST_BARCODE)
    when = np.repeat(recording.sweep_times, np.diff(recording.sweep_first)) + EPOCH
    landmarks = recording.landmark_ids + FIRST_LANDMARK
    known = [ROBOT, *([TARGET_ROBOT] if recording.target is not None else []), *landmarks]
    zeros = np.zeros((len(landmarks), 2))
    files = {
        "Barcodes": np.column_stack([known, np.array(known) + FIRST_BARCODE]),
        "Landmark_Groundtruth": np.column_stack([landmarks, recording.landmarks, zeros]),
        f"Robot{ROBOT}_Odometry": np.column_stack([recording.command_times + EPOCH, recording.commands]),
        f"Robot{ROBOT}_Measurement": np.column_stack([when, codes, recording.ranges, recording.bearings]),
        f"Robot{ROBOT}_Groundtruth": np.column_stack([recording.truth.times + EPOCH, recording.truth.poses]),
    }
    if recording.target is not None:
        path = np.column_stack([recording.target.times + EPOCH, recording.target.poses])
        files[f"Robot{TARGET_ROBOT}_Odometry"] = _commands(path)
        files[f"Robot{TARGET_ROBOT}_Measurement"] = np.zeros((0, 4))
        files[f"Robot{TARGET_ROBOT}_Groundtruth"] = path
    return {name: np.asarray(rows, dtype=np.float64) for name, rows in files.items()}


def _commands(path: Floats) -> Floats:
    """Time, speed [m/s] and turn rate [rad/s] between the points (time, x, y, heading) of a path."""
    dt = np.diff(path[:, 0])
    forward = np.hypot(np.diff(path[:, 1]), np.diff(path[:, 2])) / dt
    return np.column_stack([path[:-1, 0], forward, np.diff(np.unwrap(path[:, 3])) / dt])
