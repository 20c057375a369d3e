"""Landmarks without ids: which true one each estimated one stands for, and how good the map is as a set."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

LANDMARK_GATE = 2.0  # [m], farther pairs are never matched under unknown association; GOSPA's cut-off c


def match_landmarks(found: ArrayLike, truth: ArrayLike, gate: float = LANDMARK_GATE) -> Ints:
    """The true landmark of each estimated one: least total distance cut off at the gate, one to one.

    Args:
        found: [n, 2] estimated positions.
        truth: [m, 2] true ones.
        gate: [m], farther pairs stay unmatched.

    Returns:
        [n] index into `truth`, -1 where unmatched.
    """
    distance = _distances(found, truth)
    match = np.full(distance.shape[0], -1, dtype=np.int64)
    if distance.size:
        rows, columns = _least_total(np.minimum(distance, gate))
        near = distance[rows, columns] < gate
        match[rows[near]] = columns[near]
    return match


def gospa(found: ArrayLike, truth: ArrayLike, cutoff: float = LANDMARK_GATE, order: float = 2.0) -> float:
    """Generalised optimal sub-pattern assignment distance with alpha = 2 [m].

    The `order`-th root of the matched pairs' distances to that power plus cutoff^order / 2 for each missed and each
    false one. Eq. (1) with Proposition 1, Rahmathullah, Garcia-Fernandez and Svensson 2017.
    """
    distance = _distances(found, truth)
    n, m = distance.shape
    each = cutoff**order
    matched, localisation = 0, 0.0
    if distance.size:
        cost = np.minimum(distance, cutoff) ** order
        rows, columns = _least_total(cost)
        near = cost[rows, columns] < each
        matched, localisation = int(near.sum()), float(cost[rows, columns][near].sum())
    return float((localisation + 0.5 * each * (n + m - 2 * matched)) ** (1.0 / order))


def _distances(found: ArrayLike, truth: ArrayLike) -> Floats:
    a, b = np.asarray(found, dtype=np.float64).reshape(-1, 2), np.asarray(truth, dtype=np.float64).reshape(-1, 2)
    distance = np.hypot(a[:, None, 0] - b[None, :, 0], a[:, None, 1] - b[None, :, 1])
    return np.where(np.isfinite(distance), distance, np.inf)  # an estimate that is not finite matches nothing


def _least_total(cost: Floats) -> tuple[Ints, Ints]:
    """Rows and columns of the one-to-one assignment with the least total cost."""
    from scipy.optimize import linear_sum_assignment  # takes half a second, which labelled landmarks need not wait for

    rows, columns = linear_sum_assignment(cost)
    return rows, columns
