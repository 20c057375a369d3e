"""A picture of a calibration: the sensor's errors as logged and corrected."""

from pathlib import Path

import numpy as np

from slam_gym.calibrate import Fit
from slam_gym.recording import Floats

BINS = 24
LOGGED, CORRECTED = "tab:orange", "tab:blue"


def draw(fit: Fit, path: str | Path) -> Path:
    """Errors of range against bearing and range, of bearing against the turn rate, and their distributions."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 7.0), layout="constrained")
    axes = figure.subplots(2, 2)
    returns = fit.returns
    panels = (
        (axes[0, 0], returns.bearing, "bearing [rad]", fit.range_before, fit.range_after, "relative range error"),
        (axes[0, 1], returns.range, "range [m]", fit.range_before, fit.range_after, "relative range error"),
        (axes[1, 0], returns.turn_rate, "turn rate [rad/s]", fit.bearing_before, fit.bearing_after,
         "bearing error [rad]"),
    )  # fmt: skip
    for axis, x, x_label, before, after, y_label in panels:
        for values, colour, name in ((before, LOGGED, "as logged"), (after, CORRECTED, "corrected")):
            centres, means, spreads = binned(x, values)
            axis.plot(centres, means, color=colour, label=name)
            axis.fill_between(centres, means - spreads, means + spreads, color=colour, alpha=0.2, linewidth=0.0)
        axis.axhline(0.0, color="black", linewidth=0.5)
        axis.set(xlabel=x_label, ylabel=y_label)
    axes[0, 0].legend(title="mean and deviation")
    edges = np.linspace(-0.12, 0.12, 61)
    axes[1, 1].hist(fit.range_before, edges, color=LOGGED, alpha=0.6, label="as logged")
    axes[1, 1].hist(fit.range_after, edges, color=CORRECTED, alpha=0.6, label="corrected")
    axes[1, 1].set(xlabel="relative range error", ylabel="returns")
    axes[1, 1].legend()
    file = Path(path)
    figure.savefig(file, dpi=110)
    return file


def binned(x: Floats, values: Floats) -> tuple[Floats, Floats, Floats]:
    """Centres, means and deviations of the values in bins of equal numbers of x."""
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, BINS + 1)))
    which = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, max(len(edges) - 2, 0))
    groups = [np.flatnonzero(which == k) for k in range(max(len(edges) - 1, 1))]
    groups = [group for group in groups if len(group)]
    return (
        np.array([x[group].mean() for group in groups]),
        np.array([values[group].mean() for group in groups]),
        np.array([values[group].std() for group in groups]),
    )
