"""Wang and Wang 2019 on landmarks: the worlds, and what "traditional" and "improved" mean there."""

import math
from typing import Any

from slam_gym.reproduce.experiment import Choice
from slam_gym.scenario import Scenario

ROBOT, MAP = "robot_error", "landmark_error"
RUNS, QUICK_RUNS = 100, 20
DRIVER = "fastslam1:particles=100"
SPACING = 1.0  # [m] between landmarks along the ring: about ten in view
SPEED = 0.5  # [m] per step


def world(**settings: Any) -> Scenario:
    """The preset `slamto`: 20 landmarks and a target, short runs of fast motion."""
    return Scenario.load("slamto", **settings)


def ring(landmarks: int) -> Scenario:
    """One way round a ring of so many landmarks with about ten in view: at its end all are in the map."""
    radius = SPACING * landmarks / (2.0 * math.pi)
    settings = {
        "name": f"ring-{landmarks}", "landmarks.count": landmarks, "landmarks.ring_radius": radius,
        "landmarks.ring_width": min(2.0, radius), "landmarks.ring_gap": min(1.0, radius), "robot.start_x": radius,
        "max_steps": math.ceil(2.0 * math.pi * radius / SPEED), "arena.width": 3.0 * radius + 20.0,
        "arena.height": 3.0 * radius + 20.0, "policy.options": {"speed": SPEED, "turn_rate": SPEED / radius},
    }  # fmt: skip
    return Scenario.load("geng-l1", **settings)


def choices() -> list[Choice]:
    """What holds for all experiments of this paper."""
    return [
        Choice("map", "landmarks with known association, a small EKF each", "the paper's Eq. (2) has these; its "
               "experiment has a grid map of one laser recording, which is not published: its Figure 4, two pictures "
               "of that map, cannot be reproduced here"),
        Choice("traditional", "fastslam1: poses drawn from the motion model", "Section 1 of the paper"),
        Choice("improved", "rbpf: 10 samples around the mode, whitened by the Hessian there, importance weights; "
               "resampling below half the particles", "Eqs. (8)-(14); Eq. (10) leaves the width of its box open"),
        Choice("storage", "its time and bytes are measured on fastslam2, once round a ring of landmarks", "the same "
               "proposal in closed form, so that the map's share of the time is largest"),
        Choice("numbers", "orders only", "the text prints no number"),
    ]  # fmt: skip
