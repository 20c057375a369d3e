"""What is made of many runs: means, spreads, consistency, and paired differences with intervals.

A run is the unit: steps within one are strongly correlated, so spreads and intervals are taken over runs. NaN means
undefined (the target not yet known) and is left out; infinite values (a broken filter) are not.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import t as student

from slam_gym.consistency import in95_mean, in95_run

Floats = NDArray[np.float64]

BATCH = 45  # runs whose mean NEES is put against its bounds, as in Tian et al. 2010
BOOTSTRAP_DRAWS = 2000
AGES = ((0.0, 2.0, "lt2"), (2.0, 15.0, "2_15"), (15.0, math.inf, "gt15"))
"""[s] since the target's last return: from, to, and the suffix of the columns split that way."""


def row_mean(values: ArrayLike) -> Floats:
    """Mean of each row [R, T] over its defined steps; NaN where there are none."""
    x = np.atleast_2d(np.asarray(values, dtype=np.float64))
    defined = ~np.isnan(x)
    count = defined.sum(axis=1)
    total = np.where(defined, x, 0.0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def row_rms(values: ArrayLike) -> Floats:
    """Root mean square of each row [R, T] over its defined steps."""
    return np.sqrt(row_mean(np.square(np.asarray(values, dtype=np.float64))))


def row_median(values: ArrayLike) -> Floats:
    """Median of each row [R, T] over its defined steps."""
    x = np.atleast_2d(np.asarray(values, dtype=np.float64))
    return np.array([np.median(row[~np.isnan(row)]) if not np.isnan(row).all() else np.nan for row in x])


def column_mean(values: ArrayLike) -> Floats:
    """Mean over runs at each step: [R, T] -> [T]."""
    return row_mean(np.ascontiguousarray(np.atleast_2d(np.asarray(values, dtype=np.float64)).T))


def mean_sd(values: ArrayLike) -> tuple[float, float]:
    """Mean and standard deviation (n - 1) over runs; a spread needs two runs."""
    x = _defined(values)
    if not x.size:
        return math.nan, math.nan
    if not np.isfinite(x).all():
        return math.inf, math.nan
    return float(x.mean()), float(x.std(ddof=1)) if x.size > 1 else math.nan


def pooled_rms(rms_of_runs: ArrayLike) -> tuple[float, float]:
    """RMSE over all runs from each run's own (each run weighs the same), and the runs' standard deviation."""
    x = _defined(rms_of_runs)
    return (float(np.sqrt(np.mean(np.square(x)))) if x.size else math.nan), mean_sd(x)[1]


def _defined(values: ArrayLike) -> Floats:
    x = np.asarray(values, dtype=np.float64).ravel()
    return x[~np.isnan(x)]


@dataclass(frozen=True, slots=True)
class Consistency:
    """NEES of a quantity over runs and steps.

    Attributes:
        mean: ANEES, over all runs and steps where it is defined; the degrees of freedom when honest.
        median: of the same.
        in95_run: share of runs and steps inside chi2(d)'s 95 % bounds.
        in95_mean: share of steps at which the mean over a batch of runs lies inside chi2(R d)/R's.
        batch: R.
    """

    mean: float
    median: float
    in95_run: float
    in95_mean: float
    batch: int


def consistency(nees_of_runs: ArrayLike, dof: int, *, batch: int = BATCH) -> Consistency:
    """Summarise the NEES [R, T] (NaN: undefined) of a quantity with `dof` degrees of freedom."""
    values = np.atleast_2d(np.asarray(nees_of_runs, dtype=np.float64))
    defined = _defined(values)
    if not defined.size:
        return Consistency(math.nan, math.nan, math.nan, math.nan, 0)
    share, size = in95_mean(values, dof, batch=batch)
    return Consistency(float(defined.mean()), float(np.median(defined)), in95_run(values, dof), share, size)


def split_by_age(values: ArrayLike, age: ArrayLike) -> dict[str, Floats]:
    """Values [R, T] where the target was last seen that long ago (`AGES`), NaN elsewhere; by suffix."""
    x, seconds = np.asarray(values, dtype=np.float64), np.asarray(age, dtype=np.float64)
    return {
        suffix: np.where((seconds >= low) & ((seconds < high) | math.isinf(high)), x, np.nan)
        for low, high, suffix in AGES
    }


@dataclass(frozen=True, slots=True)
class Paired:
    """Mean of the differences a - b of paired runs with its interval; `n` pairs in which both are finite."""

    difference: float
    low: float
    high: float
    n: int

    @property
    def clear(self) -> bool:
        """Whether the interval leaves out zero."""
        return self.low > 0.0 or self.high < 0.0


def paired_difference(
    a: ArrayLike,
    b: ArrayLike,
    *,
    probability: float = 0.95,
    method: Literal["t", "bootstrap"] = "t",
    seed: int = 0,
) -> Paired:
    """Interval of the mean difference of two methods over the same runs.

    Args:
        a: [R] one number per run.
        b: [R] the same of the other method, same runs in the same order.
        probability: of the interval.
        method: Student's t over the differences, or the percentile bootstrap over runs (for skewed differences).
        seed: of the bootstrap.

    Raises:
        ValueError: lengths differ, an unknown method, or a probability outside (0, 1).
    """
    x, y = np.asarray(a, dtype=np.float64).ravel(), np.asarray(b, dtype=np.float64).ravel()
    if x.shape != y.shape:
        raise ValueError(f"paired runs must come in equal numbers; got {x.size} and {y.size}")
    if not 0.0 < probability < 1.0:
        raise ValueError(f"probability must lie between 0 and 1; got {probability!r}")
    if method not in ("t", "bootstrap"):
        raise ValueError(f"method must be 't' or 'bootstrap'; got {method!r}")
    both = np.isfinite(x) & np.isfinite(y)
    difference = x[both] - y[both]
    n = int(difference.size)
    if n == 0:
        return Paired(math.nan, math.nan, math.nan, 0)
    mean = float(difference.mean())
    if n == 1:
        return Paired(mean, -math.inf, math.inf, 1)
    if method == "t":
        half = float(student.ppf(0.5 + 0.5 * probability, n - 1) * difference.std(ddof=1) / math.sqrt(n))
        return Paired(mean, mean - half, mean + half, n)
    index = np.random.default_rng(seed).integers(n, size=(BOOTSTRAP_DRAWS, n))
    tail = 0.5 * (1.0 - probability)
    low, high = np.quantile(difference[index].mean(axis=1), [tail, 1.0 - tail])
    return Paired(mean, float(low), float(high), n)


@dataclass(frozen=True, slots=True)
class Crossed:
    """Mean of differences over seeds and worlds with its interval, over `seeds` x `worlds` of them."""

    difference: float
    low: float
    high: float
    seeds: int
    worlds: int


def crossed_difference(differences: ArrayLike, *, probability: float = 0.95) -> Crossed:
    """Interval of a mean over training seeds that were all tried in the same worlds.

    The training seed is the unit: what is claimed is claimed of the next training, not of these. In the two-way random
    effects model d_ij = m + seed_i + world_j + e_ij the mean's variance is estimated by s2_seeds / k + s2_worlds / n,
    from the k seeds' and the n worlds' own means; it counts e_ij twice, so the interval is a little too wide.
    Degrees of freedom by Satterthwaite 1946.

    Args:
        differences: [k, n] of a metric, of each seed in each world, from the same baseline; worlds with a value that
            is not finite are left out.
        probability: of the interval.

    Raises:
        ValueError: fewer than two seeds.
    """
    x = np.atleast_2d(np.asarray(differences, dtype=np.float64))
    if len(x) < 2:
        raise ValueError(f"an interval over training seeds needs at least two; got {len(x)}")
    x = x[:, np.isfinite(x).all(axis=0)]
    k, n = x.shape
    if n < 2:
        return Crossed(float(x.mean()) if n else math.nan, -math.inf, math.inf, k, n)
    seeds, worlds = float(x.mean(axis=1).var(ddof=1)) / k, float(x.mean(axis=0).var(ddof=1)) / n
    mean, variance = float(x.mean()), seeds + worlds
    if variance == 0.0:
        return Crossed(mean, mean, mean, k, n)
    dof = variance**2 / (seeds**2 / (k - 1) + worlds**2 / (n - 1))
    half = float(student.ppf(0.5 + 0.5 * probability, dof) * math.sqrt(variance))
    return Crossed(mean, mean - half, mean + half, k, n)


@dataclass(frozen=True, slots=True)
class Gap:
    """Share of the way from a baseline to a reference that a method has gone: 0 the baseline, 1 the reference.

    `low` and `high` are its interval, infinite where baseline and reference cannot be told apart. `n` runs count, those
    in which all three are finite; `means`: of the baseline, the method and the reference in them.
    """

    closed: float
    low: float
    high: float
    n: int
    means: tuple[float, float, float]


def gap_closed(
    baseline: ArrayLike, method: ArrayLike, reference: ArrayLike, *, probability: float = 0.95, seed: int = 0
) -> Gap:
    """(baseline - method) / (baseline - reference), of means over the same runs, with a paired bootstrap interval.

    Runs are drawn with replacement and all three means taken from the same runs, as the worlds' difficulty is common
    to them; percentiles, as a ratio is skewed. Where the interval's share of draws leaves no gap to close, the ratio
    has no bounds (Fieller 1954).

    Args:
        baseline: [R] one number per run.
        method: [R] of the method that is judged, same runs in the same order.
        reference: [R] of what could be reached.
        probability: of the interval.
        seed: of the bootstrap.

    Raises:
        ValueError: lengths differ, or a probability outside (0, 1).
    """
    three = [np.asarray(values, dtype=np.float64).ravel() for values in (baseline, method, reference)]
    if len({values.size for values in three}) != 1:
        raise ValueError(f"paired runs must come in equal numbers; got {[values.size for values in three]}")
    if not 0.0 < probability < 1.0:
        raise ValueError(f"probability must lie between 0 and 1; got {probability!r}")
    runs = np.stack(three)
    runs = runs[:, np.isfinite(runs).all(axis=0)]
    n = runs.shape[1]
    if n == 0:
        return Gap(math.nan, math.nan, math.nan, 0, (math.nan,) * 3)
    base, own, best = map(float, runs.mean(axis=1))
    closed, means = float(_share(np.array([base, own, best]))), (base, own, best)
    index = np.random.default_rng(seed).integers(n, size=(BOOTSTRAP_DRAWS, n))
    draws = np.stack([values[index].mean(axis=1) for values in runs])  # [3, draws]
    tail = 0.5 * (1.0 - probability)
    if n == 1 or np.mean(draws[0] <= draws[2]) > tail:
        return Gap(closed, -math.inf, math.inf, n, means)
    low, high = np.quantile(_share(draws[:, draws[0] > draws[2]]), [tail, 1.0 - tail])
    return Gap(closed, float(low), float(high), n, means)


def _share(means: Floats) -> Floats:
    """Of [3, ...]: baseline, method, reference; NaN without a gap."""
    gap = means[0] - means[2]
    return np.where(gap != 0.0, (means[0] - means[1]) / np.where(gap != 0.0, gap, 1.0), np.nan)
