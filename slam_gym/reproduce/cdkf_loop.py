"""The loop of Tian et al. 2010: batches of runs past few or many landmarks, and what its figures show of them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from slam_gym import policies
from slam_gym.consistency import in95_mean
from slam_gym.palette import GREY, styles
from slam_gym.plots import new_figure
from slam_gym.reproduce.experiment import Choice, Drawing, Grid, Outcome
from slam_gym.reproduce.figures import POSE_DOF, nees_panels
from slam_gym.reproduce.study import UNSCORED, Study, available
from slam_gym.reproduce.verdict import Claim, faster, printed, smaller, with_interval
from slam_gym.scenario import Scenario
from slam_gym.simulation import Simulation
from slam_gym.specs import Spec

Floats = NDArray[np.float64]

CDKF, FASTSLAM, EKF = "cdkf:budget=10", "fastslam2:particles=10", "ekf"
BESIDE = ("ideal-ekf", "fej-ekf", "ri-ekf", "ri-cdkf:budget=10", "oc-ekf")
PAPER_RUNS = 45
BATCHES, QUICK_BATCHES, QUICK_RUNS = 10, 2, 4
LANDMARKS_FILE, WAYPOINTS_FILE = "webmap_landmarks.csv", "webmap_waypoints.csv"
TIMED_RUNS, TIME_WINDOWS = 3, 100


@dataclass(frozen=True, slots=True)
class Batch:
    """One repetition of the paper's 45 runs; everything by estimator's label.

    Attributes:
        mse: [R] mean over the run of the squared position error [m^2].
        nees: [R] mean pose NEES of each run.
        median: of the pose NEES over runs and steps.
        mean_nees: [T] mean over runs.
        share: of the steps at which that mean lies in its 95 % region, Eq. (44).
        microseconds: filter time per control step.
    """

    time: Floats
    mse: dict[str, Floats]
    nees: dict[str, Floats]
    median: dict[str, float]
    mean_nees: dict[str, Floats]
    share: dict[str, float]
    microseconds: dict[str, float]


def loop(study: Study, preset: str, landmarks: Path | None = None) -> Scenario:
    """The preset along the published route where it is given; landmarks: a CSV file in place of the preset's."""
    scenario = Scenario.load(preset)
    if study.webmap is not None:
        route = {"file": str(study.webmap / WAYPOINTS_FILE), "follow": "commands"}
        scenario = scenario.replace("policy.options", route)
    if landmarks is not None:
        scenario = Scenario.load(scenario, **{"landmarks.layout": "file", "landmarks.file": str(landmarks)})
    return scenario


def published_landmarks(study: Study) -> Path | None:
    """The published map's file, if the user has it."""
    return None if study.webmap is None else study.webmap / LANDMARKS_FILE


def measure_batches(study: Study, scenario_of: Callable[[int], Scenario]) -> list[Batch]:
    """The paper's experiment as often as the size allows, each batch with noise of its own."""
    runs = study.size(PAPER_RUNS, QUICK_RUNS)
    number = study.size(BATCHES, QUICK_BATCHES)
    batches = []
    for b in range(number):
        sample = study.measure(
            f"batch {b + 1} of {number}", scenario_of(b), [CDKF, FASTSLAM, EKF, *available(*BESIDE)], runs=runs, seed=b,
            fields=("robot_error", "pose_nees"),
        )  # fmt: skip
        labels, nees = sample.labels, {k: v["pose_nees"][:, UNSCORED:] for k, v in sample.values.items()}
        batches.append(
            Batch(
                time=sample.time,
                mse={k: np.square(sample.values[k]["robot_error"]).mean(axis=1) for k in labels},
                nees={k: nees[k].mean(axis=1) for k in labels},
                median={k: float(np.median(nees[k])) for k in labels},
                mean_nees={k: sample.over_time(k, "pose_nees") for k in labels},
                share={k: in95_mean(nees[k], POSE_DOF, batch=runs)[0] for k in labels},
                microseconds={k: sample.microseconds(k) for k in labels},
            )
        )
    return batches


def outcome(
    study: Study, batches: list[Batch], scenario: Scenario, shares: tuple[str, str], map_choice: Choice
) -> Outcome:
    """Claims, table and figures. shares: Table 1's per cent of the CDKF and of FastSLAM 2."""
    runs = len(batches[0].mse[CDKF])
    return Outcome(
        claims=_claims(batches, shares),
        choices=[map_choice, *_choices()],
        grids=[_table(batches)],
        drawings=[
            Drawing("mmse", f"MMSE of each run of the first batch of {runs}", _mmse(batches[0])),
            Drawing("time", "Filter time along the loop, one robot", _time(_times(scenario, study))),
            Drawing("nees", f"NEES of the pose, mean over the first batch of {runs} runs", _nees(batches[0], runs)),
        ],
        remarks=_remarks(batches),
    )


def _claims(batches: list[Batch], shares: tuple[str, str]) -> list[Claim]:
    def share(label: str) -> Floats:
        return np.array([batch.share[label] for batch in batches])

    def runs_of(values: str, label: str) -> Floats:
        return np.concatenate([getattr(batch, values)[label] for batch in batches])

    def times(label: str) -> list[float]:
        return [batch.microseconds[label] for batch in batches]

    return [
        printed("Table 1: steps in the region, CDKF", shares[0], share(CDKF), paper_runs=1, unit="%", scale=100.0),
        printed("Table 1: steps in the region, FastSLAM 2.0 with 10 particles", shares[1], share(FASTSLAM),
                paper_runs=1, unit="%", scale=100.0),
        smaller("Table 1: the CDKF is more often in the region than FastSLAM 2.0", share(FASTSLAM), share(CDKF),
                digits=3, paper=f"{shares[1]} % against {shares[0]} %"),
        smaller("MMSE figure: the CDKF's mean square error is smaller", runs_of("mse", CDKF), runs_of("mse", FASTSLAM),
                digits=2, unit="m^2", skewed=True, paper="a curve"),
        faster("Time figure: the CDKF takes less time than FastSLAM 2.0", times(CDKF), times(FASTSLAM),
               paper="a curve"),
        smaller("Conclusion 1: second-order interpolation makes the filter more consistent than an EKF (mean NEES)",
                runs_of("nees", CDKF), runs_of("nees", EKF), digits=2, skewed=True),
    ]  # fmt: skip


def _table(batches: list[Batch]) -> Grid:
    rows = []
    for label in batches[0].mse:
        shares = 100.0 * np.array([batch.share[label] for batch in batches])
        mse = np.concatenate([batch.mse[label] for batch in batches])
        nees = np.concatenate([batch.nees[label] for batch in batches])
        rows.append([
            label, with_interval(nees, 2) if nees.mean() < 1e3 else f"{nees.mean():.1e}",
            f"{np.median([batch.median[label] for batch in batches]):.3g}",
            with_interval(shares, 1), f"{shares.min():.1f} to {shares.max():.1f}",
            with_interval(mse, 1), f"{np.sqrt(mse.mean()):.2f}",
            f"{np.mean([batch.microseconds[label] for batch in batches]):.1f}",
        ])  # fmt: skip
    runs = sum(len(batch.mse[CDKF]) for batch in batches)
    columns = ("estimator", "ANEES (3)", "median", "in the region [%]", "range over batches", "MMSE [m^2]",
               "position RMSE [m]", "time per step [us]")  # fmt: skip
    note = f"{len(batches)} batches, {runs} runs; in brackets 95 % intervals; time per robot, many robots side by side."
    return Grid("All filters on the same data", columns, rows, note)


def _remarks(batches: list[Batch]) -> list[str]:
    ours = np.concatenate([batch.mse[CDKF] for batch in batches])
    theirs = np.concatenate([batch.mse[FASTSLAM] for batch in batches])
    remarks = [
        f"The CDKF's error is the smaller one in {100.0 * (ours < theirs).mean():.0f} % of the runs; FastSLAM 2.0's "
        f"mean square error is {theirs.mean() / ours.mean():.2f} times as large."
    ]
    if "ideal-ekf" in batches[0].share:
        shares = 100.0 * np.array([batch.share["ideal-ekf"] for batch in batches])
        remarks.append(
            f"One batch of {len(ours) // len(batches)} runs is a weak test: even the EKF that is handed the truth to "
            f"linearise at has between {shares.min():.0f} and {shares.max():.0f} % of its steps in the region, because "
            "NEES is strongly correlated in time."
        )
    return remarks


def _choices() -> list[Choice]:
    return [
        Choice("vehicle", "3 m/s, steering at most 30 deg at 20 deg/s, a waypoint reached within 1 m, a sweep every 8 "
               "control steps of 0.025 s", "the paper names none; the simulator that its map and noise come from, and "
               "its count of 8,779 steps, say so (its 400 and 50 Hz are 40 and 5 Hz)"),
        Choice("noise", "drawn anew at each control step, on the control handed to the filter; the truth drives the "
               "nominal control", "as that simulator does"),
        Choice("start", "known exactly", "Eqs. (38)-(39), a start off by one sigma, change no figure visibly"),
        Choice("association", "known", "the paper does not say"),
        Choice("repetitions", "batches of the paper's 45 runs, each with noise of its own", "so that the spread of the "
               "paper's single batch is known: Table 1 is put against the spread of a batch"),
    ]  # fmt: skip


def _mmse(batch: Batch) -> Figure:
    figure, axis = new_figure(9.0, 3.6)
    for label, (colour, dash) in styles((CDKF, FASTSLAM, EKF)).items():
        axis.plot(1 + np.arange(len(batch.mse[label])), batch.mse[label], color=colour, linestyle=dash, marker="o",
                  markersize=3, linewidth=1.1, label=label)  # fmt: skip
    axis.set_xlabel("run")
    axis.set_ylabel("MMSE [m^2]")
    axis.legend(frameon=False, fontsize=9)
    return figure


def _nees(batch: Batch, runs: int) -> Figure:
    beside = {label: line for label, line in batch.mean_nees.items() if label not in (CDKF, FASTSLAM)}
    panels: list[tuple[str, Mapping[str, Floats]]] = [
        ("(a) CDKF", {CDKF: batch.mean_nees[CDKF]}),
        ("(b) FastSLAM 2.0, 10 particles", {FASTSLAM: batch.mean_nees[FASTSLAM]}),
        ("beside them", beside),
    ]
    steps = np.arange(UNSCORED, len(batch.time), dtype=np.float64)
    cut = [(title, {k: v[UNSCORED:] for k, v in lines.items()}) for title, lines in panels]
    return nees_panels(steps, cut, runs, "control step")


def _times(scenario: Scenario, study: Study) -> dict[str, Floats]:
    """[T] seconds that each control step took a single robot's filter: the least of a few repetitions."""
    best: dict[str, Floats] = {}
    for repetition in range(TIMED_RUNS):
        study.progress("timing", repetition, TIMED_RUNS)
        for label, seconds in _drive(scenario).items():
            best[label] = np.minimum(best[label], seconds) if label in best else seconds
    return best


def _drive(scenario: Scenario) -> dict[str, Floats]:
    specs = [Spec.parse(label) for label in (CDKF, FASTSLAM)]
    simulation = Simulation(scenario, [(s.name, s.options) for s in specs], num_lanes=1, timed=True)
    simulation.reset([0])
    context = policies.PolicyContext.from_scenario(scenario)
    chosen: Any = scenario.policy
    policy = policies.make(chosen.name, context, 1, **chosen.options)
    policy.reset(np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64))
    spent = []
    for _ in range(scenario.max_steps):
        command = context.action_map.to_command(policy.act(None, simulation.estimators[0].belief))
        if policy.finished[0]:
            break
        simulation.advance(command)
        spent.append(simulation.predict_seconds + simulation.update_seconds)
    each = np.diff(np.array(spent), axis=0, prepend=0.0)
    return {spec.label: each[:, e] for e, spec in enumerate(specs)}


def _time(seconds: dict[str, Floats]) -> Figure:
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
