"""The benchmark as a Markdown page: the same tables in the terminal and in BENCHMARKS.md."""

from collections.abc import Sequence
from typing import Any

from slam_gym.benchmark.decisions import ESTIMATOR, SCENARIO, SLOWEST
from slam_gym.benchmark.drives import YARDSTICK
from slam_gym.benchmark.maps import PARTICLES
from slam_gym.benchmark.measure import growth

HEAD = """\
# Benchmarks

`slam-gym benchmark` wrote this page (`--write`). Times depend on the machine; the ratios, each between works
measured in turn in one process (the least of many short measurements), hardly do. A step of a filter is one prediction
and nine returns, eight landmarks and the target.
"""
DECISION_TIMES = ("mean", "slowest", "longest", "lane_mean", "lane_longest")


def page(found: dict[str, Any], command: str) -> str:
    """Markdown of what `measure` returned."""
    sections = {
        "environment": _environment, "filters": _filters, "blas": _blas, "decisions": _decisions,
        "training": _training, "landmarks": _growth,
    }  # fmt: skip
    parts = [section(found) for key, section in sections.items() if found.get(key)]
    return "\n".join([HEAD, _machine(found, command), *parts])


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)]) + "\n"


def _machine(found: dict[str, Any], command: str) -> str:
    one = found["machine"]
    versions = ", ".join(f"{name} {number}" for name, number in one["versions"].items())
    return (
        f"Measured by `{command}` on {one['processor']}, {one['cores']} cores, vectors {one['vectors']}; "
        f"{one['system']}; {versions}. One core's peak, BLAS's `dgemm`: {found['peak_gflops']:.0f} GFLOP/s.\n"
    )


def _environment(found: dict[str, Any]) -> str:
    rows = [
        [row["name"], _digits(row["microseconds"]), f"{row['per_second']:,.0f}", f"{row['times_numpy']:.1f}"]
        for row in found["environment"]
    ]
    return "## A step of the environment\n\nScenario `open`, 20 landmarks, the joint EKF, an update each step.\n\n" + (
        _table(["", "us per lane and step", "per second", "times as fast as clean NumPy"], rows)
    )


def _filters(found: dict[str, Any]) -> str:
    rows = [[row["name"], _digits(row["microseconds"]), f"{row['times_ours']:.1f}"] for row in found["filters"]]
    return (
        "## A step of a filter\n\n20 landmarks. FilterPy and Stone Soup run the same joint EKF on the same returns and "
        "believe the same to 1e-9; iSAM2 smooths the whole trajectory.\n\n"
        + _table(["", "us per step", f"times as long as `{found['filters'][0]['name']}`"], rows)
    )


def _blas(found: dict[str, Any]) -> str:
    return (
        "## Against BLAS\n\nA whole step of `ekf` (prediction, nine linearisations, gains, covariance) against `dsyrk` "
        "of the same size and rank 18, which is the covariance's arithmetic alone.\n\n"
        + _ratios("ekf", found["blas"])
        + "\n`compressed-ekf` on a whole circle of driving, with all that it puts off until it has to be done.\n\n"
        + _ratios("compressed-ekf", found["compressed"])
        + _yardstick(found)
    )


def _yardstick(found: dict[str, Any]) -> str:
    rows, rank = YARDSTICK
    head = (
        f"\nIn units of `dsyrk` of {rows} rows and rank {rank}, measured beside: a control step of the papers' own "
        "drives, their sweeps included; an update by one more return in every particle; an update by ten returns with "
        "a resampling.\n\n"
    )
    lines = [
        [f"{row['scenario']}, `{row['name']}`: a control step", _digits(row["microseconds"]),
         _digits(row["times_dsyrk"]), ""]
        for row in found["drives"]
    ] + [
        [f"`{row['name']}`, {PARTICLES} particles: a return", _digits(1e-3 * row["nanoseconds"] * PARTICLES),
         _digits(row["times_dsyrk"]), ""]
        for row in found["returns"]
    ] + [
        [f"`slamto`, {PARTICLES} particles, {row['landmarks']:,} landmarks: update, resampling",
         _digits(row["microseconds"]), _digits(row["times_dsyrk"]), f"{row['megabytes']:.2f}"]
        for row in found["maps"]
    ]  # fmt: skip
    return head + _table(["", "us", "times `dsyrk`", "MB of maps"], lines)


def _decisions(found: dict[str, Any]) -> str:
    rows = [[f"`{row['name']}`", *(_digits(row[key]) for key in DECISION_TIMES)] for row in found["decisions"]]
    lanes = f"mean per lane of {found['decisions'][0]['lanes']}"
    return (
        f"## A decision of a policy\n\nScenario `{SCENARIO}` on the belief of `{ESTIMATOR}`, a decision each step: "
        "processor time, with what is made of the belief and the observation for it; the upkeep of a target cloud is "
        f"part of the world's step. Slowest: the median of the slowest {100.0 * SLOWEST:.0f} %, among them the plans "
        "of who looks for a lost target.\n\n"
        + _table(["policy, us per decision", "mean", "slowest", "longest", lanes, "longest per lane"], rows)
    )


def _training(found: dict[str, Any]) -> str:
    rows = [[row["name"], f"{row['per_second']:,.0f}", f"{100.0 * row['of_stub']:.0f} %"] for row in found["training"]]
    return (
        "## Training\n\nPPO of Stable-Baselines3 on one thread, rollout and learning, in the same scenario. What is "
        "missing to 100 % is the environment's share of the time.\n\n"
        + _table(["environment", "decisions per second", "of the stub's"], rows)
    )


def _ratios(name: str, rows: Sequence[dict[str, Any]]) -> str:
    lines = [
        [str(row["landmarks"]), _digits(row["microseconds"]), _digits(row["blas_microseconds"]),
         f"{row['times_blas']:.2f}"]
        for row in rows
    ]  # fmt: skip
    return _table(["landmarks", f"`{name}`, us", "`dsyrk`, us", "ratio"], lines)


def _growth(found: dict[str, Any]) -> str:
    parts = [
        "## Growth\n\nThe exponent p of cost ~ size^p is fitted to the upper half of the sizes; kilobytes are what the "
        "estimator keeps.\n",
        _sizes(found["landmarks"], "landmarks"),
        _sizes(found["particles"], "particles"),
        _table(
            ["lanes", "us per lane and step"],
            [[f"{row['lanes']:,}", _digits(row["microseconds"])] for row in found["lanes"]],
        ),
    ]
    return "\n".join(parts)


def _sizes(rows: Sequence[dict[str, Any]], key: str) -> str:
    """One line per size, two columns per filter."""
    names = list(dict.fromkeys(row["name"] for row in rows))
    sizes = list(dict.fromkeys(row[key] for row in rows))
    cells = {(row["name"], row[key]): row for row in rows}
    head = [key, *(text for name in names for text in (f"`{name}`, us", "kB"))]
    lines = []
    for size in sizes:
        mine = [cells[name, size] for name in names]
        lines.append([f"{size:,}", *(text for row in mine for text in (_digits(row["microseconds"]),
                                                                       f"{row['bytes'] / 1e3:,.0f}"))])  # fmt: skip
    lines.append(["exponent", *(text for name in names for text in (f"{growth(rows, key, name):.2f}", ""))])
    return _table(head, lines)


def _digits(value: float) -> str:
    """Three significant digits."""
    if value >= 100.0:
        return f"{value:,.0f}"
    return f"{value:.1f}" if value >= 10.0 else f"{value:.2f}"
