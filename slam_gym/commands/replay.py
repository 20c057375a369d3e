"""`slam-gym replay`: recorded robots through the same estimators and metrics as simulated ones."""

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import Console

    from slam_gym.recording import Recording
    from slam_gym.replay_models import ReplayModels
    from slam_gym.results import Results

ESTIMATORS = ("dead-reckoning", "ekf", "fej-ekf", "ri-ekf", "cdkf", "slamto", "independent")
ACCURACY = (
    # title, summary column, digits, NEES when honest (0: not a NEES)
    ("robot", "robot_error_rmse", 2, 0),
    ("heading", "heading_error_rmse", 3, 0),
    ("landmarks", "landmark_error_rmse", 2, 0),
    ("target\n< 2 s", "target_error_lt2", 2, 0),
    ("target\n2-15 s", "target_error_2_15", 2, 0),
    ("target\n> 15 s", "target_error_gt15", 2, 0),
    ("us", "predict_us", 0, 0),
)
CONSISTENCY = (
    ("pose", "pose_nees_mean", 1, 3),
    ("median", "pose_nees_median", 1, 3),
    ("landmarks", "landmark_nees_mean", 1, 2),
    ("target\n< 2 s", "target_nees_lt2", 1, 2),
    ("target\n2-15 s", "target_nees_2_15", 1, 2),
    ("target\n> 15 s", "target_nees_gt15", 1, 2),
)
LEGEND = """\
Target by the time since it was last seen. us: filter time per prediction.
R x: the variances of the sensor's noise times that."""

POOLED = {
    # title: heading, column of `pooled_table`, digits
    "RMSE [m, rad]": (
        ("robot", "robot_error", 2),
        ("heading", "heading_error", 3),
        ("target\n< 2 s", "target_error_lt2", 2),
        ("target\n2-15 s", "target_error_2_15", 2),
        ("target\n> 15 s", "target_error_gt15", 2),
    ),
    "NEES over its nominal value: 1 when honest": (
        ("pose", "pose_nees", 2),
        ("least", "pose_nees_least", 2),
        ("most", "pose_nees_most", 2),
        ("inside", "pose_inside", 2),
        ("target\n< 2 s", "target_nees_median_lt2", 2),
        ("target\n2-15 s", "target_nees_median_2_15", 2),
        ("target\n> 15 s", "target_nees_median_gt15", 2),
    ),
}
POOLED_LEGEND = """\
pose: mean over all samples; least, most: of one observing robot; inside: share within one run's 95 % bound (0.95).
Target: median, by the time since it was last seen. pooled.csv holds its mean too."""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What every replay can be told."""

    estimators: tuple[str, ...] = ESTIMATORS
    """Names, with options as `ekf:gate=20`; `slam-gym list` shows them."""
    noise_inflation: float = 1.0
    """Also replay with the sensor's noise variances times this. Errors of real sensors are correlated in time, and
    white noise of their size makes filters overconfident; 16 is a fair remedy for MRCLAM."""
    association: Literal["known", "nearest"] = "known"
    """Use the landmarks' ids, or hide them."""
    gate: float = 13.8
    """NIS (2 degrees of freedom) above which a labelled return is taken for a mis-read label; `inf` for none.
    Particle filters work better without and take one only as their own option: `slamto:gate=400`."""
    command_delay: float | None = None
    """[s] from a command to its motion; by default 0.2 for MRCLAM, for logs the scenario's."""
    calibration: str | None = None
    """Fitted numbers of the robot: a file of `slam-gym calibrate`, or `mrclam-7` or `mrclam-other` (the MRCLAM robots,
    fitted on set 7 and on another set). They correct the recording and replace the models and the delay;
    `recorded-ri-ekf` uses all of them."""
    sample_rate: float = 1.0
    """[Hz] at which errors and NEES are scored."""
    out: Path | None = None
    """Results folder; by default results/replay-NAME, with a number if that is taken."""
    report: bool = True
    """Draw the pictures and the HTML page too."""


@dataclass(frozen=True, kw_only=True)
class Mrclam(Settings):
    r"""Replay an MRCLAM data set: one robot does SLAM, another is the moving target.

    PATH is a folder as published (Barcodes.dat, Landmark_Groundtruth.dat, RobotN_Odometry.dat, RobotN_Measurement.dat,
    RobotN_Groundtruth.dat; plain or .gz). Robot errors and NEES are against the recorded truth, those of the target
    also by the time since it was last seen.

    Example: slam-gym replay mrclam MRCLAM_Dataset7 --robot 5 --target 1 --estimators ekf ri-ekf --noise-inflation 16
             slam-gym replay mrclam MRCLAM_Dataset7 --robot all --target all --calibration mrclam-other \
                 --estimators ri-ekf recorded-ri-ekf --no-report
    """

    path: Annotated[Path, tyro.conf.Positional]
    """Folder of the data set."""
    robot: int | Literal["all"]
    """Number of the robot that does SLAM; `all`: every one, pooled."""
    target: int | Literal["all"]
    """Number of the robot that is tracked; `all`: every other one."""
    odometry_calibration: str = "mrclam"
    """`mrclam` (speed 0.935, turn 0.948, bias -0.0023 rad/s: measured on another recording of the same robots), `none`,
    or SPEED,TURN,BIAS: true = scale x logged, and the bias added while the robot is commanded to move."""

    def run(self) -> int:
        """Load, replay, show."""
        from slam_gym import mrclam
        from slam_gym.replay_models import mrclam_models, parse_calibration

        models = mrclam_models(parse_calibration(self.odometry_calibration))
        pairs = mrclam.pairs(self.path, self.robot, self.target)
        return _replay(self, [mrclam.load(self.path, *pair) for pair in pairs], models)


@dataclass(frozen=True, kw_only=True)
class Log(Settings):
    """Replay a recording of your own robot: a folder of CSV files or one NPZ file.

    odometry.csv (time, speed, turn_rate) and measurements.csv (time, label, range, bearing), and if you have them
    truth.csv (time, x, y, heading), target.csv (time, x, y), landmarks.csv (id, x, y), sweeps.csv (time). Seconds,
    metres, radians, left positive; a label is a landmark's id, `target` or `unknown`. `slam-gym export log` writes an
    example; the docstring of `slam_gym.log_format` tells all.

    Example: slam-gym replay log my_robot/ --scenario my_robot.toml --estimators ekf ri-ekf
    """

    path: Annotated[Path, tyro.conf.Positional]
    """Folder or .npz file."""
    scenario: str = "default"
    """Scenario whose numbers the filters believe (motion noise, sensor noise, target): a name or a TOML file."""

    def run(self) -> int:
        """Load, replay, show."""
        from slam_gym import log_format
        from slam_gym.replay_models import scenario_models
        from slam_gym.scenario import Scenario

        recording = log_format.load(self.path)
        return _replay(self, [recording], scenario_models(Scenario.load(self.scenario), recording))


@dataclass(frozen=True)
class Replay:
    """Pass a recorded robot through the estimators and score them against the recorded truth.

    Example: slam-gym replay mrclam MRCLAM_Dataset7 --robot 5 --target 1 --estimators ekf ri-ekf --noise-inflation 16
    """

    source: Annotated[
        Annotated[Mrclam, tyro.conf.subcommand("mrclam", prefix_name=False)]
        | Annotated[Log, tyro.conf.subcommand("log", prefix_name=False)],
        tyro.conf.arg(name=""),
    ]
    """Where the recording comes from."""

    def run(self) -> int:
        """Whichever was chosen."""
        return self.source.run()


def _replay(settings: Settings, recordings: "list[Recording]", models: "ReplayModels") -> int:
    """Replay, save, print, report."""
    from dataclasses import replace

    from rich.console import Console

    from slam_gym.replay import replay_many

    console = Console()
    if settings.calibration is not None:
        from slam_gym.calibration import Calibration

        calibration = Calibration.load(settings.calibration)
        recordings = [calibration.corrected(recording) for recording in recordings]
        models = calibration.models(target=models.target is not None)
    if settings.command_delay is not None:
        models = replace(models, command_delay=settings.command_delay)
    inflations = (1.0,) if settings.noise_inflation == 1.0 else (1.0, settings.noise_inflation)
    many, name = len(recordings) > 1, recordings[0].name
    with console.status("replaying") as status:
        results, pooled = replay_many(
            recordings,
            settings.estimators,
            models,
            inflations=inflations,
            association=settings.association,
            gate=settings.gate,
            sample_rate=settings.sample_rate,
            out=_folder(settings.out, f"{name.split(' robot')[0]} pairs" if many else name),
            progress=lambda row: status.update(row if many else f"{name}: {row}"),
        )
        results.config = {"command": shlex.join(["slam-gym", *sys.argv[1:]]), **results.config}
        results.save()
        pooled.to_csv(results.path / "pooled.csv", index=False)
    if many:
        _show_pooled(console, pooled)
        console.print(f"Tables: {results.path} (Parquet, CSV, TUM)", soft_wrap=True, highlight=False, markup=False)
    else:
        _show(console, results, recordings[0])
    if settings.report:
        from slam_gym.report import write_report

        console.print(f"Report: {write_report(results)}", soft_wrap=True, highlight=False, markup=False)
    return 0


def _show_pooled(console: "Console", pooled: "pd.DataFrame") -> None:
    """One row per estimator over all recordings, as two tables."""
    from rich.markup import escape
    from rich.table import Table

    console.print(f"{pooled['recordings'].max()} recordings, pooled\n", highlight=False)
    for title, columns in POOLED.items():
        table = Table(title=escape(title), title_justify="left", padding=(0, 1), box=None, header_style="bold")
        table.add_column("estimator", overflow="fold")
        for heading, *_ in columns:
            table.add_column(heading, justify="right", no_wrap=True)
        for row in pooled.to_dict("records"):
            table.add_row(str(row["estimator"]), *(f"{row[key]:.{digits}f}" for _, key, digits in columns))
        console.print(table)
        console.print()
    console.print(POOLED_LEGEND, style="dim", highlight=False)


def _folder(out: Path | None, name: str) -> Path:
    """A folder that is still free.

    Raises:
        FileExistsError: the folder named by the user holds something.
    """
    if out is None:
        base = Path("results") / f"replay-{'-'.join(name.split())}"
        choices = (base if n == 1 else base.with_name(f"{base.name}-{n}") for n in range(1, 10_000))
        return next(path for path in choices if not path.exists())
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise FileExistsError(f"{str(out)!r} is not an empty folder, and results are never overwritten; name another")
    return out


def _show(console: "Console", results: "Results", recording: "Recording") -> None:
    """The summary as two tables, with what was odd in the files."""
    duration = results.series["time"].max() if len(results.series) else 0.0
    head = f"{recording.name}: {duration:.0f} s, {len(recording.sweep_times)} sweeps\n"
    console.print(head, highlight=False, markup=False)
    _print_table(console, results, "RMSE [m, rad]", ACCURACY)
    _print_table(console, results, "NEES: 3 (pose) and 2 (landmarks, target) when honest", CONSISTENCY)
    console.print(LEGEND, style="dim", highlight=False)
    unscored = () if recording.truth is not None else ("there is no recorded truth, so nothing is scored",)
    for warning in (*unscored, *results.warnings):
        console.print(f"Note: {warning}", highlight=False, soft_wrap=True, markup=False)
    console.print(f"Tables: {results.path} (Parquet, CSV, TUM)", soft_wrap=True, highlight=False, markup=False)


def _print_table(
    console: "Console", results: "Results", title: str, columns: tuple[tuple[str, str, int, int], ...]
) -> None:
    """Columns that hold nothing are left out; so is a table without any."""
    from rich.markup import escape
    from rich.table import Table

    from slam_gym.commands.summary import nees, number

    shown = [column for column in columns if results.summary[column[1]].notna().any()]
    if not shown:
        return
    table = Table(title=escape(title), title_justify="left", padding=(0, 1), box=None, header_style="bold")
    table.add_column("estimator", overflow="fold")
    for heading, *_ in shown:
        table.add_column(heading, justify="right", no_wrap=True)
    for row in results.summary.to_dict("records"):
        cells = [nees(row[key], dof) if dof else number(row[key], digits) for _, key, digits, dof in shown]
        table.add_row(str(row["estimator"]), *cells)
    console.print(table)
    console.print()
