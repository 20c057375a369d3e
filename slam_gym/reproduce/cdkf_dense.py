"""Tian et al. 2010, Figures 5, 6 and 8 and the right half of Table 1: a loop past 135 landmarks."""

from pathlib import Path

import numpy as np

from slam_gym.reproduce.cdkf_batches import loop, measure_batches
from slam_gym.reproduce.cdkf_loop import outcome
from slam_gym.reproduce.experiment import Choice, Experiment, Outcome
from slam_gym.reproduce.study import Study
from slam_gym.results import write_atomic
from slam_gym.scenario import Scenario

SHARES = ("18.54", "0")


def run(study: Study) -> Outcome:
    """Batches of 45 runs, each past 135 landmarks of its own."""
    preset = Scenario.load("tian-dense")
    maps = study.folder / "work" / "maps"

    def scenario_of(batch: int) -> Scenario:
        return loop(study, "tian-dense", draw_map(preset, batch, maps / f"map-{batch}.csv"))

    batches = measure_batches(study, scenario_of)
    choice = Choice(
        "map", "135 landmarks uniform over 250 x 200 m about the route, another map for each batch",
        "the paper shows its map only as a picture; the share in the region depends on the map",
    )  # fmt: skip
    return outcome(batches, scenario_of(0), SHARES, choice)


def draw_map(scenario: Scenario, seed: int, path: Path) -> Path:
    """Landmarks uniform over the scenario's arena, as a CSV file."""
    marks, (width, height) = scenario.landmarks, scenario.arena.size
    unit = np.random.default_rng(seed).uniform(-0.5, 0.5, (int(scenario.max_landmarks), 2))
    points = unit * (width, height) + (marks.center_x, marks.center_y)
    text = "x_m,y_m\n" + "".join(f"{x:.6f},{y:.6f}\n" for x, y in points)
    write_atomic(path, lambda file: file.write_text(text, encoding="utf-8"))
    return path


EXPERIMENT = Experiment(
    "cdkf-dense", "tian-2010", "Figures 5, 6, 8 and Table 1 (135 landmarks)",
    "the same past 135 landmarks", run,
)  # fmt: skip
