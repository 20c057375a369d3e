"""Tian et al. 2010, Figure 1 and Eqs. (40)-(42): memory against the number of landmarks, by formula and in bytes."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from slam_gym.palette import styles
from slam_gym.plots import new_figure
from slam_gym.reproduce.cdkf_batches import CDKF, EKF, FASTSLAM, loop
from slam_gym.reproduce.cdkf_dense import draw_map
from slam_gym.reproduce.driving import drive
from slam_gym.reproduce.experiment import Choice, Drawing, Experiment, Grid, Outcome, as_texts
from slam_gym.reproduce.study import Study
from slam_gym.reproduce.verdict import fact
from slam_gym.scenario import Scenario
from slam_gym.simulation import Simulation
from slam_gym.specs import Spec

BUDGET, WINDOW, PARTICLES = 10, 10, 10  # MAXLM, m and PMAX of the paper
COUNTS = (12, 20, 35, 60, 85, 110, 135)
DOUBLE = 8  # bytes
LABELS = (CDKF, EKF, FASTSLAM)


def numbers_stored(landmarks: int) -> dict[str, int]:
    """Numbers that each filter stores; Eqs. (40)-(42), Tian et al. 2010."""
    small, joint = 3 + 2 * BUDGET, 3 + 2 * landmarks
    return {
        CDKF: small + small**2 + WINDOW * landmarks,
        EKF: joint + joint**2,
        FASTSLAM: PARTICLES * ((3 + 3**2) + landmarks * (2 + 2**2)),
    }


def run(study: Study) -> Outcome:
    """Formulas, and the bytes of our filters after a loop past as many landmarks."""
    measured: dict[str, list[float]] = {label: [] for label in LABELS}
    kept = []
    for i, count in enumerate(COUNTS):
        study.progress(f"{count} landmarks", i, len(COUNTS))
        found, most = bytes_after_loop(study, count)
        kept.append(most)
        for label in LABELS:
            measured[label].append(found[label])
    formula = {label: [float(DOUBLE * numbers_stored(count)[label]) for count in COUNTS] for label in LABELS}
    rows = [[count, *(numbers_stored(count)[label] for label in LABELS), kept[i],
             *(f"{measured[label][i] / 1e3:.1f}" for label in LABELS)] for i, count in enumerate(COUNTS)]  # fmt: skip
    columns = ("landmarks", *(f"{label}, numbers by formula" for label in LABELS), "most landmarks that the CDKF held",
               *(f"{label}, kB measured" for label in LABELS))  # fmt: skip
    return Outcome(
        claims=[*_claims(formula, "by formula"), *_claims(measured, "in bytes")],
        choices=_choices(),
        grids=[Grid("Memory", columns, as_texts(rows), "Formulas: Eqs. (40)-(42). Bytes: all arrays of a filter's "
                    "state, with a map as large as the run filled it.")],
        drawings=[Drawing("memory", "Memory against the number of landmarks", _figure(formula, measured))],
    )  # fmt: skip


def bytes_after_loop(study: Study, count: int) -> tuple[dict[str, float], int]:
    """Bytes of each filter's state, and the most landmarks that the budget let stay."""
    preset = Scenario.load("tian-dense").replace("landmarks.count", count)
    scenario = loop(study, "tian-dense", draw_map(preset, 0, study.folder / "work" / "maps" / f"{count}.csv"))
    if study.quick:
        scenario = scenario.replace("max_steps", 2000)
    most = most_kept(scenario)
    capacity = {CDKF: most, EKF: count, FASTSLAM: count}
    return {label: state_bytes(scenario, label, capacity[label]) for label in LABELS}, most


def most_kept(scenario: Scenario) -> int:
    """Drive the loop once on the CDKF and watch its map; a sweep that shows more than the budget keeps all of it."""
    spec = Spec.parse(CDKF)
    steps = drive(scenario, [(spec.name, spec.options)], 0)
    return max(int(simulation.estimators[0].belief.landmark_count[0]) for simulation in steps)


def state_bytes(scenario: Scenario, label: str, capacity: int) -> float:
    """Bytes of all arrays of one lane's state, with room for that many landmarks."""
    spec = Spec.parse(label)
    built = Simulation(scenario, [(spec.name, {**spec.options, "max_landmarks": capacity})])
    return float(_bytes(built.estimators[0].get_state()))


def _bytes(state: Any) -> int:
    if isinstance(state, dict):
        return sum(_bytes(part) for part in state.values())
    return int(state.nbytes) if isinstance(state, np.ndarray) else 0


def _claims(lines: dict[str, list[float]], how: str) -> list[Any]:
    least = all(lines[CDKF][i] < min(lines[EKF][i], lines[FASTSLAM][i]) for i in range(len(COUNTS)))
    grows = {label: _degree(lines[label]) for label in LABELS}
    text = ", ".join(f"{label} {grows[label]:.2f}" for label in LABELS)
    return [
        fact(f"Figure 1, {how}: the CDKF needs least", "; ".join(
            f"{label} {lines[label][0] / 1e3:.1f} to {lines[label][-1] / 1e3:.1f} kB" for label in LABELS
        ), least, basis=f"at each of {len(COUNTS)} map sizes from {COUNTS[0]} to {COUNTS[-1]} landmarks"),
        fact(f"Figure 1, {how}: the EKF grows with the square of the number of landmarks, the others linearly at most",
             f"exponent at {COUNTS[-1]} landmarks: {text}",
             grows[EKF] > 1.5 and max(grows[CDKF], grows[FASTSLAM]) < 1.5,
             basis="growth exponent between the two largest maps, above or below 1.5"),
    ]  # fmt: skip


def _degree(values: list[float]) -> float:
    return float(np.log(values[-1] / values[-2]) / np.log(COUNTS[-1] / COUNTS[-2]))


def _choices() -> list[Choice]:
    return [
        Choice("sizes", "MAXLM = 10, m = 10, 10 particles", "as in the paper's simulation"),
        Choice("bytes", "the arrays of `get_state()` for one robot, in double precision", "the paper counts numbers"),
        Choice("the CDKF's map", "room for the most landmarks that one loop left in it", "a sweep that shows more "
               "landmarks than the budget keeps them all, which Eq. (40) leaves out"),
    ]  # fmt: skip


def _figure(formula: dict[str, list[float]], measured: dict[str, list[float]]) -> Figure:
    figure, axes = new_figure(10.0, 3.8, ncols=2, sharey=True)
    for axis, lines, title in zip(
        axes, (formula, measured), ("Eqs. (40)-(42), 8 bytes a number", "measured"), strict=True
    ):
        for label, (colour, dash) in styles(LABELS).items():
            axis.plot(COUNTS, np.array(lines[label]) / 1e3, color=colour, linestyle=dash, marker="o", markersize=4,
                      label=label)  # fmt: skip
        axis.set_title(title, fontsize=10, loc="left")
        axis.set_xlabel("landmarks")
        axis.set_yscale("log")
    axes[0].set_ylabel("memory [kB]")
    axes[0].legend(frameon=False, fontsize=9)
    return figure


EXPERIMENT = Experiment(
    "cdkf-memory", "tian-2010", "Figure 1 and Eqs. (40)-(42)",
    "memory of CDKF, EKF and FastSLAM against the number of landmarks", run,
)  # fmt: skip
