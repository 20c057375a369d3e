"""Claims of a paper against measured intervals, and the verdict that follows from them.

A printed number holds if a repetition of the paper's own experiment, with as many runs as it made, would give that
number or a more distant one in more than 5 % of cases: it lies in the 95 % prediction interval of a mean of that many
runs. An order ("A is smaller than B") holds if the 95 % interval of the paired difference lies on that side of zero.
All claims hold: "reproduces"; some: "reproduces in part"; none: "does not reproduce".
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import t as student

from slam_gym.stats import Paired, paired_difference

Floats = NDArray[np.float64]

HOLDS, FAILS, TIE = "holds", "does not hold", "no difference shown"
REPRODUCES, IN_PART, NOT, NOT_RUN = "reproduces", "reproduces in part", "does not reproduce", "not run"
NO_NUMBER = "no number printed"
PROBABILITY = 0.95


@dataclass(frozen=True, slots=True)
class Claim:
    """One statement of a paper and what became of it.

    Attributes:
        statement: in words.
        paper: its number as printed.
        ours: what was measured, with its interval.
        outcome: HOLDS, FAILS or TIE.
        basis: how that was decided.
    """

    statement: str
    paper: str
    ours: str
    outcome: str
    basis: str


def verdict(claims: Sequence[Claim]) -> str:
    """REPRODUCES, IN_PART or NOT; NOT_RUN without any claim."""
    if not claims:
        return NOT_RUN
    held = sum(claim.outcome == HOLDS for claim in claims)
    return REPRODUCES if held == len(claims) else IN_PART if held else NOT


def mean_interval(values: ArrayLike, *, future_runs: float = math.inf) -> tuple[float, float, float]:
    """Mean of runs with its 95 % t interval.

    Args:
        values: [R] one number per run; what is not finite makes the mean so.
        future_runs: m; finite: the interval that holds the mean of m further runs (a prediction interval).
    """
    x = np.asarray(values, dtype=np.float64).ravel()
    mean = float(x.mean())
    if x.size < 2:
        return mean, -math.inf, math.inf
    half = float(student.ppf(0.5 + 0.5 * PROBABILITY, x.size - 1) * x.std(ddof=1))
    half *= math.sqrt(1.0 / x.size + 1.0 / future_runs)
    return mean, mean - half, mean + half


def with_interval(values: ArrayLike, digits: int, scale: float = 1.0) -> str:
    """The mean and its 95 % interval: "0.040 [0.038, 0.041]"."""
    mean, low, high = (scale * number for number in mean_interval(values))
    return f"{mean:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]"


def printed(
    statement: str, number: str, values: ArrayLike, *, paper_runs: int, unit: str = "", scale: float = 1.0
) -> Claim:
    """A number of the paper against ours.

    Args:
        statement: what it is.
        number: as printed; its last digit says how far it is rounded.
        values: [R] ours, one per run of what the paper averages `paper_runs` of.
        paper_runs: how many the paper averaged.
        unit: of the printed number.
        scale: printed number over ours (100 for per cent).
    """
    digits = len(number.partition(".")[2])
    ours = scale * np.asarray(values, dtype=np.float64)
    _, low, high = mean_interval(ours, future_runs=paper_runs)
    rounding = 0.5 * 10.0**-digits
    holds = low - rounding <= float(number) <= high + rounding
    digits = max(digits, 1)
    what = f"a mean of {paper_runs} runs lies" if paper_runs > 1 else "a single repetition lies"
    return Claim(
        statement,
        f"{number} {unit}".strip(),
        f"{with_interval(ours, digits)} {unit}".strip() + f", n = {ours.size}",
        HOLDS if holds else FAILS,
        f"{what} in [{low:.{digits}f}, {high:.{digits}f}] in 95 % of cases",
    )


def smaller(
    statement: str, less: ArrayLike, more: ArrayLike, *, paper: str = NO_NUMBER, digits: int = 4, unit: str = "",
    skewed: bool = False,
) -> Claim:  # fmt: skip
    """That the first is smaller than the second, run by run.

    Args:
        statement: in words.
        less: [R] what is said to be smaller, one number per run.
        more: [R] the same runs of the other.
        paper: the numbers printed, as text.
        digits: of the difference.
        unit: of the difference.
        skewed: take the interval from a bootstrap over runs.
    """
    found = paired_difference(less, more, method="bootstrap" if skewed else "t")
    return Claim(statement, paper, difference_text(found, digits, unit), side(found), basis_text(skewed))


def side(found: Paired) -> str:
    """Whether a difference that is claimed to be negative is."""
    if found.n < 2 or not found.clear:
        return TIE
    return HOLDS if found.high < 0.0 else FAILS


def difference_text(found: Paired, digits: int, unit: str) -> str:
    """The difference and its interval."""
    numbers = f"{found.difference:+.{digits}f} [{found.low:+.{digits}f}, {found.high:+.{digits}f}]"
    return f"difference {numbers} {unit}".strip() + f", n = {found.n}"


def basis_text(skewed: bool) -> str:
    """How the interval of a paired difference was made."""
    how = "bootstrap over runs" if skewed else "Student's t over runs"
    return f"paired difference, 95 % interval ({how})"


def faster(statement: str, quick: ArrayLike, slow: ArrayLike, *, paper: str = NO_NUMBER) -> Claim:
    """That the first takes less than the second (time, memory): the interval of the mean ratio, slow over quick."""
    logs = np.log(np.asarray(slow, dtype=np.float64) / np.asarray(quick, dtype=np.float64))
    mean, low, high = mean_interval(logs)
    outcome = HOLDS if low > 0.0 else FAILS if high < 0.0 else TIE
    interval = f" [{math.exp(low):.2f}, {math.exp(high):.2f}]" if logs.size > 1 else ""
    ours = f"ratio {math.exp(mean):.2f}{interval}, n = {logs.size}"
    return Claim(statement, paper, ours, outcome, "geometric mean of paired ratios, 95 % t interval")


def fact(
    statement: str, ours: str, holds: bool, *, paper: str = NO_NUMBER, basis: str = "exact, nothing random"
) -> Claim:
    """Something that is so or not, without chance."""
    return Claim(statement, paper, ours, HOLDS if holds else FAILS, basis)
