"""Wang and Wang 2019, Section 2.1: the improved proposal needs fewer particles and maps better."""

from matplotlib.figure import Figure

from slam_gym.consistency import in95_run
from slam_gym.plots import new_figure
from slam_gym.reproduce.experiment import Choice, Drawing, Experiment, Grid, Outcome
from slam_gym.reproduce.figures import with_bars
from slam_gym.reproduce.rbpf_world import DRIVER, MAP, QUICK_RUNS, ROBOT, RUNS, choices, world
from slam_gym.reproduce.study import UNSCORED, Floats, Sample, Study
from slam_gym.reproduce.verdict import Claim, smaller, with_interval
from slam_gym.specs import Spec
from slam_gym.stats import paired_difference

PARTICLES = (10, 20, 50, 100)
FEW, MANY = 20, 100
FAMILIES = ("fastslam1", "rbpf", "fastslam2")
BOXES = ([0.02, 0.02, 0.005], [0.05, 0.05, 0.02])  # half widths: x [m], y [m], heading [rad]
BOX_PARTICLES = 50


def label(family: str, particles: int) -> str:
    """An estimator of so many particles."""
    return f"{family}:particles={particles}"


def literal(box: list[float]) -> Spec:
    """Eq. (10) as printed, with half widths of the box."""
    return Spec(f"rbpf, box {box}", "rbpf", {"particles": BOX_PARTICLES, "proposal": "literal", "box": box})


def run(study: Study) -> Outcome:
    """Three proposals with ever more particles, and the printed box, on the same data."""
    grown = [label(family, size) for family in FAMILIES for size in PARTICLES]
    sample = study.measure(
        "proposals", world(), [*grown, *map(literal, BOXES)], runs=study.size(RUNS, QUICK_RUNS), driver=DRIVER,
        fields=(ROBOT, MAP, "target_error", "pose_nees"),
    )  # fmt: skip
    return Outcome(
        claims=_claims(sample),
        choices=[*choices(), Choice("world", "the preset slamto, the robot driven by one filter's belief",
                                    "short, fast, with noisy odometry: where a proposal matters")],
        grids=[_table(sample)],
        drawings=[Drawing("particles", "Robot's error against the number of particles", _figure(sample))],
        remarks=[_equals_fastslam2(sample)],
    )  # fmt: skip


def _claims(sample: Sample) -> list[Claim]:
    def errors(name: str, family: str, particles: int) -> Floats:
        return sample.of_runs(label(family, particles), name)

    claims = [
        smaller(f"With {FEW} particles the improved proposal errs less", errors(ROBOT, "rbpf", FEW),
                errors(ROBOT, "fastslam1", FEW), unit="m"),
        smaller(f"It needs fewer particles: {FEW} err less than {MANY} from the motion model",
                errors(ROBOT, "rbpf", FEW), errors(ROBOT, "fastslam1", MANY), unit="m"),
        smaller(f"With {FEW} particles its map is more accurate", errors(MAP, "rbpf", FEW),
                errors(MAP, "fastslam1", FEW), unit="m"),
    ]  # fmt: skip
    return claims + [
        smaller(f"Eq. (10) as printed: samples in a box of half widths {box} do so too ({BOX_PARTICLES} particles)",
                sample.of_runs(literal(box).label, ROBOT), errors(ROBOT, "fastslam1", BOX_PARTICLES), unit="m")
        for box in BOXES
    ]  # fmt: skip


def _table(sample: Sample) -> Grid:
    rows = []
    for name in sample.labels:
        nees = sample.values[name]["pose_nees"][:, UNSCORED:]
        rows.append([
            name, with_interval(sample.of_runs(name, ROBOT), 4), with_interval(sample.of_runs(name, MAP), 4),
            f"{100.0 * in95_run(nees, 3):.0f}", f"{sample.microseconds(name):.1f}",
        ])  # fmt: skip
    columns = ("estimator", "robot error [m]", "landmark error [m]", "robot inside 95 % [%]", "time per step [us]")
    return Grid("All proposals on the same data", columns, rows, "In brackets 95 % intervals over runs; inside: share "
                "of runs and steps whose NEES lies within one run's bounds.")  # fmt: skip


def _equals_fastslam2(sample: Sample) -> str:
    a, b = (label(family, BOX_PARTICLES) for family in ("rbpf", "fastslam2"))
    found = paired_difference(sample.of_runs(a, ROBOT), sample.of_runs(b, ROBOT))
    times = sample.microseconds(a) / sample.microseconds(b)
    return (
        f"Whitened, the improved proposal is FastSLAM 2's: with {BOX_PARTICLES} particles the robot's error differs by "
        f"{found.difference:+.5f} m [{found.low:+.5f}, {found.high:+.5f}], at {times:.1f} times the computing time."
    )


def _figure(sample: Sample) -> Figure:
    figure, axis = new_figure(7.5, 4.0)
    lines = {}
    for family in FAMILIES:
        errors = [sample.of_runs(label(family, size), ROBOT) for size in PARTICLES]
        lines[family] = ([e.mean() for e in errors], [1.96 * e.std(ddof=1) / len(e) ** 0.5 for e in errors])
    with_bars(axis, PARTICLES, lines, "particles")
    axis.set_ylabel("robot error [m]")
    return figure


EXPERIMENT = Experiment(
    "rbpf-proposal", "wang-2019", "Section 2.1: Eqs. (8)-(13)",
    "the improved proposal against the motion model and FastSLAM 2, particle for particle", run,
)  # fmt: skip
