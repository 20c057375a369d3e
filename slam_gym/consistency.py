"""Whether estimators know how wrong they are: NEES, NIS, their chi-square bounds, shares inside, divergence.

Two shares are kept apart: `in95_run` puts each run and step against chi2(d), `in95_mean` puts the mean over a batch of
R runs against chi2(R d)/R. Undefined values are NaN and left out; infinite ones (a broken filter) are counted.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

DIVERGED_TAIL = 1e-6  # probability that a consistent pose NEES exceeds the divergence threshold
DIVERGED_SHARE = 0.1  # the last part of a run that has to lie above it


def nees(error: ArrayLike, covariance: ArrayLike, angles: tuple[int, ...] = ()) -> Floats:
    """Normalised (estimation or innovation) error squared, e' P^-1 e, without regularisation.

    Args:
        error: [..., n].
        covariance: [..., n, n].
        angles: which components are angles, wrapped first.

    Returns:
        [...], infinite where the covariance is singular.
    """
    e = np.array(error, dtype=np.float64)
    for i in angles:
        e[..., i] = (e[..., i] + np.pi) % (2.0 * np.pi) - np.pi
    cov = np.asarray(covariance, dtype=np.float64)
    try:
        return np.einsum("...i,...i->...", e, np.linalg.solve(cov, e[..., None])[..., 0])
    except np.linalg.LinAlgError:
        shape = np.broadcast_shapes(e.shape[:-1], cov.shape[:-2])
        e, cov = np.broadcast_to(e, (*shape, *e.shape[-1:])), np.broadcast_to(cov, (*shape, *cov.shape[-2:]))
        return np.array([_nees_or_inf(e[i], cov[i]) for i in np.ndindex(shape)]).reshape(shape)


def _nees_or_inf(error: Floats, covariance: Floats) -> float:
    try:
        return float(error @ np.linalg.solve(covariance, error))
    except np.linalg.LinAlgError:
        return math.inf


def nis(innovation: ArrayLike, covariance: ArrayLike, angles: tuple[int, ...] = (1,)) -> Floats:
    """Normalised innovation squared, y' S^-1 y: innovation [..., n], by default (range, bearing); S [..., n, n]."""
    return nees(innovation, covariance, angles)


def nees_bounds(dof: int, runs: int = 1, probability: float = 0.95) -> tuple[float, float]:
    """Two-sided interval that holds the mean of `runs` consistent NEES of `dof` with that probability.

    chi2(runs x dof)/runs; Eq. (44), Tian et al. 2010: [2.32, 3.75] for 45 runs of a pose.

    Raises:
        ValueError: dof or runs below 1, or a probability outside (0, 1).
    """
    if dof < 1 or runs < 1 or not 0.0 < probability < 1.0:
        raise ValueError(
            f"nees_bounds needs dof >= 1, runs >= 1, 0 < probability < 1; got {dof}, {runs}, {probability}"
        )
    from scipy.stats import chi2  # takes a second, which an environment need not wait for

    tail = 0.5 * (1.0 - probability)
    low, high = np.asarray(chi2.ppf((tail, 1.0 - tail), runs * dof)) / runs
    return float(low), float(high)


def anees(nees_of_runs: ArrayLike) -> float:
    """Average NEES over all runs and steps where it is defined ([R, T], NaN: undefined); `dof` when consistent."""
    values = np.asarray(nees_of_runs, dtype=np.float64)
    defined = values[~np.isnan(values)]
    return float(defined.mean()) if defined.size else math.nan


def in95_run(nees_of_runs: ArrayLike, dof: int, probability: float = 0.95) -> float:
    """Share of runs and steps whose NEES lies inside the bounds of ONE run. nees_of_runs [R, T], NaN: undefined."""
    values = np.asarray(nees_of_runs, dtype=np.float64)
    low, high = nees_bounds(dof, 1, probability)
    defined = ~np.isnan(values)
    return float(((values >= low) & (values <= high)).sum() / defined.sum()) if defined.any() else math.nan


def in95_mean(nees_of_runs: ArrayLike, dof: int, *, batch: int = 45, probability: float = 0.95) -> tuple[float, int]:
    """Share of steps at which the MEAN over a batch of R runs lies inside chi2(R dof)/R; Eq. (44), Tian et al. 2010.

    The runs are split, in order, into as many batches of at least `batch` as there are (one if fewer), and the
    shares are pooled: a single batch proves little, NEES being strongly correlated in time.

    Args:
        nees_of_runs: [R, T], NaN: undefined; a step's bounds follow the number of runs that define it.
        dof: degrees of freedom.
        batch: runs in a batch, as in the paper.
        probability: of the interval.

    Returns:
        The share (NaN: nothing defined) and R, the runs in the smallest batch: print it.
    """
    values = np.atleast_2d(np.asarray(nees_of_runs, dtype=np.float64))
    batches = np.array_split(values, max(1, values.shape[0] // max(1, batch)))
    inside = total = 0
    for part in batches:
        count = (~np.isnan(part)).sum(axis=0)
        step = count > 0
        mean = np.nansum(part[:, step], axis=0) / count[step]
        sizes, index = np.unique(count[step], return_inverse=True)
        bounds = np.array([nees_bounds(dof, int(size), probability) for size in sizes]).reshape(-1, 2)[index]
        inside += int(((mean >= bounds[:, 0]) & (mean <= bounds[:, 1])).sum())
        total += int(step.sum())
    return (inside / total if total else math.nan), min(len(part) for part in batches)


def diverged(pose_nees: ArrayLike, robot_error: ArrayLike, *, error_limit: float = math.inf) -> NDArray[np.bool_]:
    """Which runs have diverged.

    A run has when an estimate of it is not finite (its NEES not even defined as a number), when its pose NEES stays
    above the chi2(3) quantile of 1 - 1e-6 (30.7) for the whole last tenth of the run, or when the robot's error ends
    above `error_limit` [m].

    Args:
        pose_nees: [R, T], NaN where undefined.
        robot_error: [R, T] metres, NaN only where the estimate is.
        error_limit: [m], for instance the arena's diagonal.

    Returns:
        [R] booleans.
    """
    values, errors = np.atleast_2d(pose_nees), np.atleast_2d(robot_error)
    if errors.shape[1] == 0:
        return np.zeros(errors.shape[0], dtype=np.bool_)
    last = values[:, -max(1, math.ceil(DIVERGED_SHARE * values.shape[1])) :]
    from scipy.stats import chi2

    limit = chi2.isf(DIVERGED_TAIL, 3)
    broken = ~np.isfinite(errors).all(axis=1)
    return np.asarray(broken | (last > limit).all(axis=1) | (errors[:, -1] > error_limit), dtype=np.bool_)
