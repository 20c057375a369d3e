"""The figures of Tian et al. 2010 that a loop gives: error by run, time and NEES by step."""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from slam_gym.palette import GREY, styles
from slam_gym.plots import new_figure
from slam_gym.reproduce.cdkf_batches import CDKF, EKF, FASTSLAM, Batch, Floats
from slam_gym.reproduce.driving import clock, drive, seconds_per_step
from slam_gym.reproduce.figures import nees_panels
from slam_gym.reproduce.study import UNSCORED
from slam_gym.scenario import Scenario
from slam_gym.specs import Spec

TIME_WINDOWS = 100


def mmse_by_run(batch: Batch) -> Figure:
    """Figures 3 and 5: the mean square error of each run."""
    figure, axis = new_figure(9.0, 3.6)
    for label, (colour, dash) in styles((CDKF, FASTSLAM, EKF)).items():
        axis.plot(1 + np.arange(len(batch.mse[label])), batch.mse[label], color=colour, linestyle=dash, marker="o",
                  markersize=3, linewidth=1.1, label=label)  # fmt: skip
    axis.set_xlabel("run")
    axis.set_ylabel("MMSE [m^2]")
    axis.legend(frameon=False, fontsize=9)
    return figure


def nees_by_step(batch: Batch, runs: int) -> Figure:
    """Figures 7 and 8: the mean NEES at each step with its region."""
    beside = {label: line for label, line in batch.mean_nees.items() if label not in (CDKF, FASTSLAM)}
    panels: list[tuple[str, Mapping[str, Floats]]] = [
        ("(a) CDKF", {CDKF: batch.mean_nees[CDKF]}),
        ("(b) FastSLAM 2.0, 10 particles", {FASTSLAM: batch.mean_nees[FASTSLAM]}),
        ("beside them", beside),
    ]
    steps = np.arange(UNSCORED, len(batch.time), dtype=np.float64)
    cut = [(title, {k: v[UNSCORED:] for k, v in lines.items()}) for title, lines in panels]
    return nees_panels(steps, cut, runs, "control step")


def step_times(scenario: Scenario, repetitions: int = 3) -> dict[str, Floats]:
    """[T] seconds that each control step took a single robot's filter: the least of a few repetitions."""
    specs = [Spec.parse(label) for label in (CDKF, FASTSLAM)]
    estimators = [(spec.name, spec.options) for spec in specs]
    each = [seconds_per_step([clock(step) for step in drive(scenario, estimators, 0)]) for _ in range(repetitions)]
    least = np.min(each, axis=0)
    return {spec.label: least[:, e] for e, spec in enumerate(specs)}


def time_by_step(seconds: dict[str, Floats]) -> Figure:
    """Figures 4 and 6: time along the loop."""
    figure, axis = new_figure(9.0, 3.4)
    for label, (colour, dash) in styles(seconds).items():
        parts = np.array_split(1e6 * seconds[label][1:], TIME_WINDOWS)  # the first step loads the kernels
        steps = np.cumsum([len(part) for part in parts])
        axis.plot(steps, [part.mean() for part in parts], color=colour, linestyle=dash, linewidth=1.3, label=label)
    axis.set_ylim(bottom=0.0)
    axis.set_xlabel("control step")
    axis.set_ylabel("time per step [us]")
    axis.set_title(f"means of {TIME_WINDOWS} stretches", fontsize=9, color=GREY)
    axis.legend(frameon=False, fontsize=9)
    return figure
