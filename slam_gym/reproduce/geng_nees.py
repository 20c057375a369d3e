"""Geng 2024, Figures 2 to 4: NEES of the standard, the ideal and the improved EKF."""

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from slam_gym.reproduce.experiment import Choice, Drawing, Experiment, Grid, Outcome
from slam_gym.reproduce.figures import nees_panels
from slam_gym.reproduce.study import Sample, Study, available
from slam_gym.reproduce.verdict import Claim, smaller, with_interval
from slam_gym.scenario import Scenario

STANDARD, IDEAL, IMPROVED = "ekf", "ideal-ekf", "taylor-ekf"
BESIDE = ("fej-ekf", "ri-ekf", "ri-taylor-ekf", "cdkf", "oc-ekf")
PRESETS = ("geng-hu", "geng-l1", "geng-m1", "geng-m2")
SHOWN = "geng-m1"
RUNS, QUICK_RUNS = 60, 10
SHOWN_RUNS = 50  # the figures' mean is over so many


def run(study: Study) -> Outcome:
    """All four noise settings; the paper gives none."""
    samples = {}
    for preset in PRESETS:
        samples[preset] = study.measure(
            preset, Scenario.load(preset), [STANDARD, IDEAL, IMPROVED, *available(*BESIDE)],
            runs=study.size(RUNS, QUICK_RUNS), fields=("robot_error", "pose_nees"),
        )  # fmt: skip
    return Outcome(
        claims=[claim for preset, sample in samples.items() for claim in _claims(preset, sample)],
        choices=_choices(),
        grids=[_table(samples)],
        drawings=[Drawing("nees", f"NEES of the pose, mean over runs ({SHOWN})", _figure(samples[SHOWN]))],
        remarks=[_wins(preset, sample) for preset, sample in samples.items()],
    )


def _scored(preset: str, sample: Sample, label: str) -> NDArray[np.float64]:
    """[R] mean NEES of each run after the steps that the preset does not score."""
    return np.asarray(sample.values[label]["pose_nees"][:, Scenario.load(preset).burn_in :].mean(axis=1))


def _claims(preset: str, sample: Sample) -> list[Claim]:
    standard, ideal, improved = (_scored(preset, sample, label) for label in (STANDARD, IDEAL, IMPROVED))
    pairs = (
        ("the ideal EKF has a lower NEES than the standard one", ideal, standard, "Figures 2 and 3"),
        ("the improved EKF has a lower NEES than the standard one", improved, standard, "Figures 2 and 4"),
        ("the improved EKF has a lower NEES than the ideal one", improved, ideal, "Figures 3 and 4"),
    )
    return [smaller(f"{preset}: {words}", a, b, digits=3, skewed=True, paper=figures) for words, a, b, figures in pairs]


def _table(samples: dict[str, Sample]) -> Grid:
    first = samples[PRESETS[0]]
    rows = [[label, *(_cell(preset, sample, label) for preset, sample in samples.items())] for label in first.labels]
    columns = ("estimator", *(f"{preset}: ANEES (3) / RMSE [m]" for preset in samples))
    return Grid("All filters on the same data", columns, rows, "In brackets 95 % intervals over runs.")


def _cell(preset: str, sample: Sample, label: str) -> str:
    error = np.sqrt(np.square(sample.values[label]["robot_error"]).mean())
    return f"{with_interval(_scored(preset, sample, label), 2)} / {error:.3f}"


def _wins(preset: str, sample: Sample) -> str:
    ideal, improved = (_scored(preset, sample, label) for label in (IDEAL, IMPROVED))
    share = 100.0 * (improved < ideal).mean()
    return f"{preset}: the improved filter's NEES is lower than the ideal one's in {share:.0f} % of the runs."


def _figure(sample: Sample) -> Figure:
    runs = min(SHOWN_RUNS, len(sample.values[STANDARD]["pose_nees"]))
    lines = {label: sample.values[label]["pose_nees"][:runs, 1:].mean(axis=0) for label in sample.labels}
    panels = [
        ("Figure 2: standard EKF", {STANDARD: lines[STANDARD]}),
        ("Figure 3: ideal EKF", {IDEAL: lines[IDEAL]}),
        ("Figure 4: improved EKF (FEJ and Taylor net)", {IMPROVED: lines[IMPROVED]}),
        ("beside them", {label: lines[label] for label in sample.labels if label not in (STANDARD, IDEAL, IMPROVED)}),
    ]
    return nees_panels(sample.time[1:], panels, runs, "time [s]")


def _choices() -> list[Choice]:
    return [
        Choice("world", "circles among 20 landmarks on a ring of 4 m half width, differential drive", "the paper says "
               "nothing of its simulation; this is that of the works it builds on"),
        Choice("noise", "four settings: wheels 1 to 3 %, range 0.1 to 0.2 m, bearing 1 to 3 deg", "what the improved "
               "filter gains depends on it"),
        Choice("Taylor net", "a second-order net in the Hermite basis per landmark seen, its slopes held to FEJ's "
               "observability, its curvature added to the noise", "the paper gives no equation of its net; free slopes "
               "destroy what FEJ gives (`slam-gym list taylor-ekf`)"),
        Choice("measure", "mean NEES of each run, paired", "the paper shows curves"),
    ]  # fmt: skip


EXPERIMENT = Experiment(
    "geng-nees", "geng-2024", "Figures 2 to 4", "NEES of the standard, the ideal and the improved EKF", run
)
