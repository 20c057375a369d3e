"""Fit a range-bearing sensor against a recorded truth: systematic errors first, then what is left.

A return's errors are taken against the true offset at its stamp less the delay. Mis-read labels are trimmed.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import curve_fit

from estimators.interface import TARGET
from slam_gym.recording import Floats, Ints, Recording, wrap

WRONG_BEARING, WRONG_RANGE = 0.15, 0.3  # [rad], [-]: beyond, a return is of something else
TRIM = 4.0  # robust deviations, in a regression
OUTLIER = 6.0  # robust deviations, beyond which a return is a mis-read label
TURN_WINDOW = 0.1  # [s], half the span over which the true turn rate is taken
LONGEST_LAG, LAG_BINS = 40.0, 20  # [s] of an autocovariance
FEWEST = 50  # returns
ONE_ROBOT = {"range_scale_std": 0.011, "bearing_bias_std": 0.005}  # spreads that a single robot cannot tell


@dataclass(frozen=True, slots=True)
class Returns:
    """Labelled returns beside the truth.

    Attributes:
        robot, label: [Z] index of the recording; a landmark's id or TARGET.
        time: [Z] seconds, as stamped.
        range, bearing: [Z] as logged.
        true_range, true_bearing: [Z] when the image was taken.
        turn_rate: [Z] the robot's true one [rad/s].
    """

    robot: Ints
    label: Ints
    time: Floats
    range: Floats
    bearing: Floats
    true_range: Floats
    true_bearing: Floats
    turn_rate: Floats

    def only(self, which: np.ndarray) -> "Returns":
        """A part of them."""
        return Returns(*(getattr(self, name)[which] for name in Returns.__slots__))


def returns_of(recordings: Sequence[Recording], delay: float) -> Returns:
    """Every return of a surveyed landmark or of the target, with the truth `delay` seconds before its stamp.

    Raises:
        ValueError: too few, or no truth.
    """
    parts = [_one(index, recording, delay) for index, recording in enumerate(recordings)]
    found = Returns(*(np.concatenate([getattr(part, name) for part in parts]) for name in Returns.__slots__))
    good = np.abs(wrap(found.bearing - found.true_bearing)) < WRONG_BEARING
    good &= np.abs(found.range / found.true_range - 1.0) < WRONG_RANGE
    if good.sum() < FEWEST:
        raise ValueError(
            f"a calibration needs at least {FEWEST} returns of surveyed landmarks (or the target) near their true "
            f"places; found {int(good.sum())} of {len(good)}: are labels, clocks and the truth's frame right?"
        )
    return found.only(good)


def _one(index: int, recording: Recording, delay: float) -> Returns:
    if recording.truth is None:
        raise ValueError(f"{recording.name}: a calibration needs the recorded truth (truth.csv), and there is none")
    counts = np.diff(recording.sweep_first)
    stamp = np.repeat(recording.sweep_times, counts)
    pose = recording.truth.at(stamp - delay)
    point = np.full((len(stamp), 2), np.nan)
    for number, place in zip(recording.landmark_ids, recording.landmarks, strict=True):
        point[recording.labels == number] = place
    if recording.target is not None:
        mine = recording.labels == TARGET
        point[mine] = recording.target.at(stamp[mine] - delay)[:, :2]
    offset = point - pose[:, :2]
    after, before = recording.truth.at(stamp - delay + TURN_WINDOW), recording.truth.at(stamp - delay - TURN_WINDOW)
    every = Returns(
        np.full(len(stamp), index), recording.labels, stamp, recording.ranges, recording.bearings,
        np.hypot(offset[:, 0], offset[:, 1]), wrap(np.arctan2(offset[:, 1], offset[:, 0]) - pose[:, 2]),
        wrap(after[:, 2] - before[:, 2]) / (2.0 * TURN_WINDOW),
    )  # fmt: skip
    return every.only(np.isfinite(every.true_range + every.turn_rate) & (every.true_range > 0.0))


def trimmed_fit(design: Floats, values: Floats, rounds: int = 5) -> tuple[Floats, np.ndarray]:
    """Least squares without what lies `TRIM` robust deviations off: coefficients, and which rows were kept."""
    kept = np.ones(len(values), dtype=bool)
    solution: Floats = np.zeros(design.shape[1])
    for _ in range(rounds):
        solution = np.asarray(np.linalg.lstsq(design[kept], values[kept], rcond=None)[0], dtype=np.float64)
        off = np.abs(values - design @ solution)
        kept = off <= TRIM * 1.4826 * np.median(off[kept]) + 1e-12
    return solution, kept


def fit_delay(recordings: Sequence[Recording]) -> tuple[float, float]:
    """Bearing offset [rad] and delay of the stamps [s]: the bearing's error grows by the delay times the turn rate."""
    returns = returns_of(recordings, 0.0)
    error = wrap(returns.bearing - returns.true_bearing)
    design = np.column_stack([np.ones(len(error)), returns.turn_rate])
    (offset, delay), _ = trimmed_fit(design, error)
    return float(offset), max(0.0, float(delay))


def fit_range(returns: Returns) -> tuple[dict[str, float], Floats]:
    """The range factor's numbers, and the relative errors [Z] that they leave."""
    b, target = returns.bearing, (returns.label == TARGET).astype(np.float64)
    columns = [np.ones_like(b), b**2, b**4, 1.0 / returns.range]
    names = ["range_offset", "range_bearing2", "range_bearing4", "range_inverse"]
    if 0 < target.sum() < len(target):
        columns, names = [*columns, target], [*names, "target_offset"]
    design, error = np.column_stack(columns), returns.range / returns.true_range - 1.0
    solution, _ = trimmed_fit(design, error)
    left = returns.range / (1.0 + design @ solution) / returns.true_range - 1.0
    return dict(zip(names, map(float, solution), strict=True)), left


def likely(errors: Floats) -> np.ndarray:
    """Which errors are no outliers."""
    off = np.abs(errors - np.median(errors))
    return np.asarray(off <= OUTLIER * 1.4826 * np.median(off) + 1e-12)


def without_means(values: Floats, robot: Ints) -> tuple[Floats, Floats]:
    """Values less each robot's mean, and those means."""
    kinds = np.unique(robot)
    means = np.array([values[robot == kind].mean() for kind in kinds])
    return values - means[np.searchsorted(kinds, robot)], means


def autocovariance(values: Floats, groups: Ints, times: Floats) -> tuple[Floats, Floats]:
    """Mean product of two errors of one group by their lag: lags [n] (bin centres, seconds) and covariances [n]."""
    edges = np.linspace(0.0, LONGEST_LAG, LAG_BINS + 1)
    total, number = np.zeros(LAG_BINS), np.zeros(LAG_BINS)
    for group in np.unique(groups):
        mine = np.flatnonzero(groups == group)
        when, x = times[mine], values[mine]
        for step in range(1, len(mine)):
            lag = when[step:] - when[:-step]
            if lag.min() > LONGEST_LAG:
                break
            bins = np.digitize(lag, edges) - 1
            near = bins < LAG_BINS
            total += np.bincount(bins[near], (x[step:] * x[:-step])[near], LAG_BINS)
            number += np.bincount(bins[near], minlength=LAG_BINS)
    some = number > 0
    return (0.5 * (edges[1:] + edges[:-1]))[some], total[some] / number[some]


def fit_decay(lags: Floats, covariances: Floats, variance: float) -> tuple[float, float]:
    """Variance and time constant [s] of the part that decays exponentially; (0, 0) where nothing persists."""
    if len(lags) < 3 or covariances[0] <= 0.02 * variance:
        return 0.0, 0.0
    start = (float(covariances[0]), 10.0)
    bounds = ([0.0, 0.5], [variance, 120.0])
    (part, time), _ = curve_fit(
        lambda lag, part, time: part * np.exp(-lag / time), lags, covariances, start, bounds=bounds
    )
    return float(part), float(time)


def fit_noise(returns: Returns, range_left: Floats, bearing_left: Floats) -> dict[str, float]:
    """Spreads of what is left: of robots, and of one label's errors with the times over which they persist."""
    series = returns.robot * (returns.label.max() + 3) + returns.label + 2  # one number per robot and label
    relative, scales = without_means(range_left, returns.robot)
    angle, biases = without_means(bearing_left, returns.robot)
    _, range_time = fit_decay(*autocovariance(relative, series, returns.time), float(relative.var()))
    # R_b = sb^2 (1 + g) / (1 - g), g = exp(-D / tau) sab^2 / (sab^2 + sb^2): sb is of one return, sab sets g.
    persisting, bearing_time = fit_decay(*autocovariance(angle, series, returns.time), float(angle.var()))
    total, share = float(angle.std()), min(persisting / float(angle.var()), 0.9)
    many = len(scales) > 1
    return {
        "range_std": float(relative.std()),
        "range_time": range_time,
        "bearing_std": total,
        "bearing_correlated_std": total * float(np.sqrt(share / (1.0 - share))),
        "bearing_time": bearing_time,
        "range_scale_std": float(scales.std(ddof=1)) if many else ONE_ROBOT["range_scale_std"],
        "bearing_bias_std": float(biases.std(ddof=1)) if many else ONE_ROBOT["bearing_bias_std"],
    }
