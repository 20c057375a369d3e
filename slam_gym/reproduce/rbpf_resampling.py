"""Wang and Wang 2019, Section 2.2: resampling only when the effective number of particles is low."""

import numpy as np
from matplotlib.figure import Figure

from slam_gym.consistency import in95_run
from slam_gym.palette import styles
from slam_gym.plots import new_figure
from slam_gym.reproduce.experiment import Choice, Drawing, Experiment, Grid, Outcome
from slam_gym.reproduce.rbpf_world import MAP, QUICK_RUNS, ROBOT, RUNS, choices, world
from slam_gym.reproduce.study import UNSCORED, Sample, Study
from slam_gym.reproduce.verdict import Claim, smaller, with_interval

PARTICLES = {"rbpf": 50, "fastslam1": 200}
ADAPTIVE, ALWAYS = 0.5, 1.0
LONG_STEPS, LONG_RUNS, QUICK_LONG_RUNS = 3200, 30, 4


def label(family: str, threshold: float) -> str:
    """An estimator that resamples below that share of its particles."""
    return f"{family}:particles={PARTICLES[family]},resample_threshold={threshold:g}"


def run(study: Study) -> Outcome:
    """Adaptive against constant resampling, in short runs and in runs ten times as long."""
    estimators = [label(family, threshold) for family in PARTICLES for threshold in (ADAPTIVE, ALWAYS)]
    fields = (ROBOT, MAP, "pose_nees")
    driver = label("fastslam1", ADAPTIVE)
    short = study.measure("short runs", world(), estimators, runs=study.size(RUNS, QUICK_RUNS),
                          driver=driver, fields=fields)  # fmt: skip
    long = study.measure("long runs", world(max_steps=LONG_STEPS), estimators,
                         runs=study.size(LONG_RUNS, QUICK_LONG_RUNS), driver=driver, fields=fields)  # fmt: skip
    return Outcome(
        claims=_claims(short, long),
        choices=[*choices(), Choice("threshold", "half the particles; against resampling at every sweep", "as printed"),
                 Choice("runs", f"320 steps as in slamto, and {LONG_STEPS}", "particles run out of variety over time")],
        grids=[_table("320 steps", short, estimators), _table(f"{LONG_STEPS} steps", long, estimators)],
        drawings=[Drawing("nees", "Share of long runs inside the 95 % bounds", _figure(long, estimators))],
    )  # fmt: skip


def _claims(short: Sample, long: Sample) -> list[Claim]:
    adaptive, always = label("rbpf", ADAPTIVE), label("rbpf", ALWAYS)
    return [
        smaller("Adaptive resampling takes fewer resampling steps", short.events[adaptive]["resampled"],
                short.events[always]["resampled"], digits=1, unit="per run"),
        smaller("It makes the robot's path more accurate", short.of_runs(adaptive, ROBOT), short.of_runs(always, ROBOT),
                unit="m", digits=5),
        smaller("It makes the map more accurate", short.of_runs(adaptive, MAP), short.of_runs(always, MAP), unit="m",
                digits=5),
        smaller("It makes the map more accurate in long runs", long.of_runs(adaptive, MAP), long.of_runs(always, MAP),
                unit="m", digits=5),
    ]  # fmt: skip


def _table(title: str, sample: Sample, labels: list[str]) -> Grid:
    rows = [
        [name, f"{sample.events[name]['resampled'].mean():.1f}", with_interval(sample.of_runs(name, ROBOT), 4),
         with_interval(sample.of_runs(name, MAP), 4),
         f"{100.0 * in95_run(sample.values[name]['pose_nees'][:, UNSCORED:], 3):.0f}"]
        for name in labels
    ]  # fmt: skip
    columns = ("estimator", "resamplings per run", "robot error [m]", "landmark error [m]", "robot inside 95 % [%]")
    return Grid(
        title, columns, rows, "In brackets 95 % intervals over runs. A threshold of 1 resamples at every sweep."
    )


def _figure(sample: Sample, labels: list[str]) -> Figure:
    figure, axis = new_figure(8.0, 3.6)
    for name, (colour, dash) in styles(labels).items():
        nees = sample.values[name]["pose_nees"][:, UNSCORED:]
        parts = np.array_split(nees, 40, axis=1)
        times = [part.mean() for part in np.array_split(sample.time[UNSCORED:], 40)]
        axis.plot(times, [100.0 * in95_run(part, 3) for part in parts], color=colour, linestyle=dash, label=name)
    axis.axhline(95.0, color="#999999", linewidth=0.8)
    axis.set_ylim(0.0, 100.0)
    axis.set_xlabel("time [s]")
    axis.set_ylabel("inside 95 % [%]")
    figure.legend(loc="outside upper center", ncols=2, frameon=False, fontsize=9)
    return figure


EXPERIMENT = Experiment(
    "rbpf-resampling",
    "wang-2019",
    "Section 2.2: Eq. (14)",
    "adaptive resampling against resampling at every sweep",
    run,
)
