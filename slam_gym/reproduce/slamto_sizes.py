"""Wu and Sun 2013, Figures 4 and 5: errors against a size, with bars, and whether they fall and saturate."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from slam_gym.plots import new_figure
from slam_gym.reproduce.experiment import Drawing, Grid, Outcome
from slam_gym.reproduce.figures import with_bars
from slam_gym.reproduce.slamto_world import NAMES, ROBOT, TARGET, Floats, choices
from slam_gym.reproduce.verdict import HOLDS, Claim, smaller, with_interval

Errors = dict[str, list[Floats]]  # field -> [R] per size


def outcome(sizes: Sequence[int], errors: Errors, what: str, beside: dict[str, Errors]) -> Outcome:
    """Claims, table and figure. errors: SLAMTO's; beside: other estimators' by label."""
    rows = [
        [str(size), *(with_interval(line[name][i], 4) for line in (errors, *beside.values()) for name in NAMES)]
        for i, size in enumerate(sizes)
    ]
    columns = (what, *(f"{label}, {NAMES[name]} [m]" for label in ("slamto", *beside) for name in NAMES))
    return Outcome(
        claims=claims(sizes, errors, what),
        choices=choices(),
        grids=[Grid(f"Errors against the number of {what}", columns, rows, "In brackets 95 % intervals over runs.")],
        drawings=[Drawing("errors", f"Error against the number of {what}: mean and standard deviation over runs",
                          _figure(sizes, errors, what))],
    )  # fmt: skip


def claims(sizes: Sequence[int], errors: Errors, what: str) -> list[Claim]:
    """That both errors fall, and fall less and less; and that the target's is the larger one throughout."""
    middle = len(sizes) // 2
    found = []
    for name, who in NAMES.items():
        first, half, last = errors[name][0], errors[name][middle], errors[name][-1]
        found += [
            smaller(f"The {who}'s error is smaller with {sizes[middle]} {what} than with {sizes[0]}", half, first,
                    unit="m", paper="a curve"),
            smaller(f"It saturates: from {sizes[middle]} to {sizes[-1]} {what} the {who} gains less than from "
                    f"{sizes[0]} to {sizes[middle]}", half - last, first - half, unit="m", paper="a curve"),
        ]  # fmt: skip
    statement = f"The target's error is larger than the robot's, at {sizes[0]} {what} as at {sizes[-1]}"
    ends = [smaller(statement, errors[ROBOT][i], errors[TARGET][i], unit="m", paper="a curve") for i in (0, -1)]
    return [*found, max(ends, key=lambda claim: claim.outcome != HOLDS)]


def _figure(sizes: Sequence[int], errors: Errors, what: str) -> Figure:
    figure, axis = new_figure(7.5, 4.0)
    lines = {NAMES[name]: ([e.mean() for e in errors[name]], [e.std(ddof=1) for e in errors[name]]) for name in NAMES}
    with_bars(axis, sizes, lines, f"number of {what}")
    axis.set_ylabel("position error [m]")
    axis.set_ylim(bottom=0.0)
    return figure
