"""Wu and Sun 2013, experiment 1 and Figure 3: errors of robot and target, early and late."""

import numpy as np
from matplotlib.figure import Figure

from slam_gym.consistency import in95_run
from slam_gym.palette import GREY, styles
from slam_gym.plots import new_figure, trajectories
from slam_gym.reproduce.experiment import Choice, Drawing, Experiment, Grid, Outcome
from slam_gym.reproduce.slamto_world import PAPER_RUNS, QUICK_RUNS, ROBOT, SLAMTO, TARGET, Floats, choices, world
from slam_gym.reproduce.study import ERRORS, UNSCORED, Sample, Study, available
from slam_gym.reproduce.verdict import Claim, printed, smaller, with_interval
from slam_gym.stats import row_mean

BESIDE = ("slamto:particles=1000", "fastslam2:particles=20", "fastslam2:particles=200", "unscented-fastslam", "ekf",
          "ri-ekf", "dead-reckoning")  # fmt: skip
MORE_RUNS = 400
ROBOT_ERROR, TARGET_ERROR = ("0.0393", "0.0136"), ("0.0639", "0.0104")  # mean and standard deviation
RELATIVE = "target_error_rel"
EARLY_ERROR, LATE_ERROR = "0.0736", "0.0542"


def run(study: Study) -> Outcome:
    """Runs of the paper's first experiment."""
    sample = study.measure(
        "experiment 1", world(), [SLAMTO, *available(*BESIDE)], runs=study.size(MORE_RUNS, QUICK_RUNS), driver=SLAMTO,
        tracks=1, fields=(*ERRORS, RELATIVE),
    )  # fmt: skip
    early, late = halves(sample, TARGET)
    return Outcome(
        claims=_claims(sample, early, late),
        choices=[
            *choices(),
            Choice("early and late", "the first and the second half of a run", "Figure 3 marks points a, b, c on the "
                   "path of one run; nearness to the target is what should matter"),
        ],
        grids=[_table(sample)],
        drawings=[
            Drawing("path", "One run: truth, belief, 95 % ellipses", trajectories(*sample.drawn([SLAMTO, "ekf"]))),
            Drawing("errors", "Error over time, mean over runs", _errors(sample)),
        ],
        remarks=[_spread(sample), _where_from(sample)],
    )  # fmt: skip


def halves(sample: Sample, name: str) -> tuple[Floats, Floats]:
    """[R] SLAMTO's mean of a metric in the first and in the second half of each run."""
    errors = sample.values[SLAMTO][name]
    middle = errors.shape[1] // 2
    return row_mean(errors[:, :middle]), row_mean(errors[:, middle:])


def _claims(sample: Sample, early: Floats, late: Floats) -> list[Claim]:
    robot, target = sample.of_runs(SLAMTO, ROBOT), sample.of_runs(SLAMTO, TARGET)
    return [
        printed("Robot error, mean of 20 runs", ROBOT_ERROR[0], robot, paper_runs=PAPER_RUNS, unit="m"),
        printed("Target error, mean of 20 runs", TARGET_ERROR[0], target, paper_runs=PAPER_RUNS, unit="m"),
        smaller("The target's error is larger than the robot's", robot, target, unit="m"),
        printed("Target error early in the run", EARLY_ERROR, early, paper_runs=PAPER_RUNS, unit="m"),
        printed("Target error late in the run", LATE_ERROR, late, paper_runs=PAPER_RUNS, unit="m"),
        smaller("The target's error falls as the robot comes near", late, early, unit="m",
                paper=f"{LATE_ERROR} against {EARLY_ERROR} m"),
    ]  # fmt: skip


def _table(sample: Sample) -> Grid:
    rows = []
    for label in sample.labels:
        nees = sample.values[label]["pose_nees"][:, UNSCORED:]
        target_nees = sample.values[label]["target_nees"][:, UNSCORED:]
        rows.append([
            label, with_interval(sample.of_runs(label, ROBOT), 4), with_interval(sample.of_runs(label, TARGET), 4),
            f"{np.median(nees):.1f}", f"{100.0 * in95_run(nees, 3):.0f}", f"{100.0 * in95_run(target_nees, 2):.0f}",
            f"{sample.microseconds(label):.1f}",
        ])  # fmt: skip
    columns = ("estimator", "robot error [m]", "target error [m]", "robot NEES, median", "robot inside 95 % [%]",
               "target inside 95 % [%]", "time per step [us]")  # fmt: skip
    return Grid("All estimators on the same data", columns, rows, "Inside: share of runs and steps within one run's "
                "95 % bounds. In brackets 95 % intervals over runs.")  # fmt: skip


def _spread(sample: Sample) -> str:
    robot, target = (sample.of_runs(SLAMTO, name) for name in (ROBOT, TARGET))
    return (
        f"Standard deviation over runs: robot {robot.std(ddof=1):.4f} m (the paper prints {ROBOT_ERROR[1]}), target "
        f"{target.std(ddof=1):.4f} m ({TARGET_ERROR[1]})."
    )


def _where_from(sample: Sample) -> str:
    robot, target = (tuple(half.mean() for half in halves(sample, name)) for name in (ROBOT, RELATIVE))
    return (
        f"From the first half to the second the robot's own error goes from {robot[0]:.4f} to {robot[1]:.4f} m, the "
        f"target's in the robot's frame, where nearness counts, from {target[0]:.4f} to {target[1]:.4f} m."
    )


def _errors(sample: Sample) -> Figure:
    figure, axes = new_figure(9.0, 5.0, nrows=2, sharex=True)
    shown = [label for label in sample.labels if label in (SLAMTO, "ekf", "dead-reckoning")]
    for axis, name in zip(axes, (ROBOT, TARGET), strict=True):
        for label, (colour, dash) in styles(shown).items():
            axis.plot(sample.time, sample.over_time(label, name), color=colour, linestyle=dash, label=label)
        axis.set_ylabel(f"{name.replace('_', ' ')} [m]")
        axis.set_ylim(bottom=0.0)
    middle = sample.time[len(sample.time) // 2]
    axes[1].axvline(middle, color=GREY, linestyle=":", linewidth=1.0, label="early | late")
    axes[1].legend(frameon=False, fontsize=9)
    axes[1].set_xlabel("time [s]")
    return figure


EXPERIMENT = Experiment(
    "slamto-1", "wu-2013", "Experiment 1 and Figure 3",
    "errors of robot and target with 200 particles and 20 landmarks, early and late", run,
)  # fmt: skip
