"""The simulation of Wu and Sun 2013: what its experiments share."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from slam_gym.reproduce.experiment import Choice
from slam_gym.scenario import Scenario

Floats = NDArray[np.float64]

SLAMTO = "slamto:particles=200"  # of experiments 1 to 3
PAPER_RUNS = 20
RUNS, QUICK_RUNS = 100, 20
ROBOT, TARGET = "robot_error", "target_error"
NAMES = {ROBOT: "robot", TARGET: "target"}


def world(landmarks: int = 20, **settings: Any) -> Scenario:
    """The preset with another number of landmarks, or other dotted settings."""
    return Scenario.load("slamto", **{"landmarks.count": landmarks, **settings})


def choices() -> list[Choice]:
    """What the paper leaves open in all its simulations."""
    return [
        Choice("time step", "0.02 s, noise figures are standard deviations of rates", "not given; with these the "
               "odometry alone errs by as much as the paper's independent row, and experiment 1 comes out"),
        Choice("target", "3 m/s and 1 rad/s: a circle of 3 m", "not given; it fits the 10 x 10 m arena and Figure 3"),
        Choice("follower", "starts 4 m behind on the circle, v <= 4 m/s, w <= 2 rad/s, keeps 1.5 m", "not given"),
        Choice("sensor", "7 m, 180 deg: about 8 of 20 landmarks in view", "not given"),
        Choice("start", "poses of robot and target known", "not given; Figure 3 shows no search"),
        Choice("driver", "the robot follows what SLAMTO believes; all estimators process the same data", "paired "
               "comparisons need one path"),
        Choice("landmarks", "uniform over the arena, new ones each run", "as the paper says of experiment 3"),
    ]  # fmt: skip
