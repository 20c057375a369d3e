"""What the loop of Tian et al. 2010 shows: claims, table and figures, the same for few landmarks and for many."""

import numpy as np
from numpy.typing import NDArray

from slam_gym.reproduce.cdkf_batches import CDKF, EKF, FASTSLAM, Batch
from slam_gym.reproduce.cdkf_figures import mmse_by_run, nees_by_step, step_times, time_by_step
from slam_gym.reproduce.experiment import Choice, Drawing, Grid, Outcome
from slam_gym.reproduce.verdict import Claim, faster, printed, smaller, with_interval
from slam_gym.scenario import Scenario

Floats = NDArray[np.float64]


def outcome(batches: list[Batch], scenario: Scenario, shares: tuple[str, str], map_choice: Choice) -> Outcome:
    """Claims, table and figures. shares: Table 1's per cent of the CDKF and of FastSLAM 2."""
    runs = len(batches[0].mse[CDKF])
    return Outcome(
        claims=_claims(batches, shares),
        choices=[map_choice, *_choices()],
        grids=[_table(batches)],
        drawings=[
            Drawing("mmse", f"MMSE of each run of the first batch of {runs}", mmse_by_run(batches[0])),
            Drawing("time", "Filter time along the loop, one robot", time_by_step(step_times(scenario))),
            Drawing(
                "nees", f"NEES of the pose, mean over the first batch of {runs} runs", nees_by_step(batches[0], runs)
            ),
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
        Choice("start", "known exactly", "Eqs. (38)-(39) start it one sigma off; a scenario can (robot.start_noise)"),
        Choice("association", "known", "the paper does not say"),
        Choice("repetitions", "batches of the paper's 45 runs, each with noise of its own", "so that the spread of the "
               "paper's single batch is known: Table 1 is put against the spread of a batch"),
    ]  # fmt: skip
