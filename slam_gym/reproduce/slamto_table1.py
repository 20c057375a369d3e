"""Wu and Sun 2013, Table 1: the target inside the SLAM filter against a separate target filter."""

import numpy as np
from matplotlib.figure import Figure

from slam_gym.palette import GREY, styles
from slam_gym.plots import new_figure
from slam_gym.reproduce.experiment import Drawing, Experiment, Grid, Outcome
from slam_gym.reproduce.slamto_world import QUICK_RUNS, ROBOT, TARGET, choices, world
from slam_gym.reproduce.study import Sample, Study
from slam_gym.reproduce.verdict import Claim, printed, smaller, with_interval
from slam_gym.specs import Spec

PAPER_RUNS, PARTICLES, LANDMARKS = 100, 300, 100
MORE_RUNS = 400  # the differences are small
FEWER = (20, 3)  # landmarks; where joint estimation has more to give
HEADING = "target_heading_error"
JOINT = Spec.parse(f"slamto:particles={PARTICLES}")
APART = Spec("independent, particles", "independent", {"slam": "fastslam1", "slam_options": {"particles": PARTICLES}})
EKF, APART_EKF, ODOMETRY = Spec.parse("ekf"), Spec("independent, ekf", "independent", {}), Spec.parse("dead-reckoning")
PRINTED = {
    JOINT.label: {ROBOT: "0.043", HEADING: "0.052", TARGET: "0.062"},
    APART.label: {ROBOT: "0.095", HEADING: "0.062", TARGET: "0.132"},
}
WORDS = {ROBOT: ("robot position", "m"), HEADING: ("target heading", "rad"), TARGET: ("target position", "m")}


def run(study: Study) -> Outcome:
    """Joint and independent estimation on the same data, with as many landmarks as the paper, and with fewer."""
    runs = study.size(MORE_RUNS, QUICK_RUNS)
    estimators = [JOINT, APART, EKF, APART_EKF, ODOMETRY]
    samples = {
        count: study.measure(f"{count} landmarks", world(count), estimators, runs=runs, driver=JOINT.label)
        for count in (LANDMARKS, *FEWER)
    }
    return Outcome(
        claims=_claims(samples[LANDMARKS]),
        choices=choices(),
        grids=[_errors(samples[LANDMARKS]), _consistency(samples)],
        drawings=[Drawing("table", "Table 1 as bars: ours with 95 % intervals, the paper's as crosses",
                          _figure(samples[LANDMARKS]))],
        remarks=[_odometry(samples[LANDMARKS])],
    )  # fmt: skip


def _claims(sample: Sample) -> list[Claim]:
    claims = [
        printed(f"{words} error, {who}", PRINTED[label][name], sample.of_runs(label, name), paper_runs=PAPER_RUNS,
                unit=unit)
        for label, who in ((JOINT.label, "joint"), (APART.label, "independent"))
        for name, (words, unit) in WORDS.items()
    ]  # fmt: skip
    for name, (words, unit) in WORDS.items():
        numbers = f"{PRINTED[JOINT.label][name]} against {PRINTED[APART.label][name]} {unit}"
        claims.append(
            smaller(f"Joint estimation has the smaller {words} error", sample.of_runs(JOINT.label, name),
                    sample.of_runs(APART.label, name), unit=unit, paper=numbers)
        )  # fmt: skip
    return claims


def _errors(sample: Sample) -> Grid:
    rows = [[label, *(with_interval(sample.of_runs(label, name), 4) for name in WORDS)] for label in sample.labels]
    columns = ("estimator", *(f"{words} error [{unit}]" for words, unit in WORDS.values()))
    return Grid(f"{LANDMARKS} landmarks, {PARTICLES} particles", columns, rows, "In brackets 95 % intervals over runs.")


def _consistency(samples: dict[int, Sample]) -> Grid:
    labels = (JOINT.label, APART.label, EKF.label, APART_EKF.label)
    rows = [
        [label, *(f"{np.nanmean(sample.values[label]['target_nees'][:, 1:]):.1f}" for sample in samples.values())]
        for label in labels
    ]
    columns = ("estimator", *(f"{count} landmarks" for count in samples))
    note = "Mean over runs and steps; 2 when honest. A filter that takes the estimated pose for exact is too sure."
    return Grid("What joint estimation buys: NEES of the target's position", columns, rows, note)


def _odometry(sample: Sample) -> str:
    robot, target = (sample.of_runs(ODOMETRY.label, name).mean() for name in (ROBOT, TARGET))
    return (
        f"Dead reckoning alone gives {robot:.3f} m for the robot and {target:.3f} m for the target, the paper's "
        f"independent estimation {PRINTED[APART.label][ROBOT]} and {PRINTED[APART.label][TARGET]} m."
    )


def _figure(sample: Sample) -> Figure:
    figure, axes = new_figure(10.0, 3.4, ncols=len(WORDS))
    labels = [JOINT.label, APART.label, ODOMETRY.label]
    for axis, (name, (words, unit)) in zip(axes, WORDS.items(), strict=True):
        for i, (label, (colour, _)) in enumerate(styles(labels).items()):
            errors = sample.of_runs(label, name)
            half = 1.96 * errors.std(ddof=1) / np.sqrt(errors.size)
            axis.bar(i, errors.mean(), yerr=half, color=colour, width=0.6, capsize=4)
            if label in PRINTED:
                axis.plot(i, float(PRINTED[label][name]), "x", color=GREY, markersize=9, markeredgewidth=2)
        axis.set_xticks(range(len(labels)), ["joint", "independent", "odometry"])
        axis.set_ylabel(f"{words} error [{unit}]")
    return figure


EXPERIMENT = Experiment(
    "slamto-table1", "wu-2013", "Table 1", "joint estimation against a separate target filter, 100 landmarks", run
)
