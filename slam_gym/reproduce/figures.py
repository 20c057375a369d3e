"""Drawings that several experiments share, in this project's look."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from slam_gym.consistency import nees_bounds
from slam_gym.palette import styles
from slam_gym.plots import new_figure

Floats = NDArray[np.float64]

BAND = "#D9EFE6"
POSE_DOF = 3


def nees_panels(time: Floats, panels: Sequence[tuple[str, Mapping[str, Floats]]], runs: int, x_label: str) -> Figure:
    """Mean NEES of the pose against time, a panel each, with the bounds of a mean over `runs`.

    Args:
        time: [T].
        panels: title, and label -> [T].
        runs: R of the bounds.
        x_label: what `time` is.
    """
    figure, axes = new_figure(9.0, 2.5 * len(panels), nrows=len(panels), sharex=True, squeeze=False)
    low, high = nees_bounds(POSE_DOF, runs)
    for axis, (title, lines) in zip(axes[:, 0], panels, strict=True):
        axis.axhspan(low, high, color=BAND, zorder=0, label=f"95 % of an honest filter, mean of {runs} runs")
        for label, (colour, dash) in styles(lines).items():
            axis.plot(time, lines[label], color=colour, linestyle=dash, linewidth=1.1, label=label)
        axis.set_yscale("log")
        axis.set_ylabel("pose NEES")
        axis.set_title(title, fontsize=10, loc="left")
        axis.legend(frameon=False, fontsize=8, ncols=3, loc="upper left")
        bottom, top = axis.get_ylim()
        axis.set_ylim(min(bottom, 0.5 * low), max(top, high) * 4.0)
    axes[-1, 0].set_xlabel(x_label)
    return figure


def with_bars(
    axis: Axes, x: Sequence[float], lines: Mapping[str, tuple[Sequence[float], Sequence[float]]], x_label: str
) -> None:
    """Means with bars against a count, on a logarithmic axis. lines: label -> (means, half lengths of the bars)."""
    for label, (colour, dash) in styles(lines).items():
        means, bars = lines[label]
        axis.errorbar(x, means, yerr=bars, color=colour, linestyle=dash, marker="o", markersize=4, linewidth=1.3,
                      capsize=3, label=label)  # fmt: skip
    axis.set_xscale("log")
    axis.set_xticks(list(x), [f"{value:g}" for value in x])
    axis.minorticks_off()
    axis.set_xlabel(x_label)
    axis.legend(frameon=False, fontsize=9)


def against(
    x: Sequence[float], lines: Mapping[str, Sequence[float]], x_label: str, y_label: str, *, log: str = ""
) -> Figure:
    """Plain lines with markers; log: "x", "y", "xy" or nothing."""
    figure, axis = new_figure(7.0, 4.0)
    for label, (colour, dash) in styles(lines).items():
        axis.plot(x, lines[label], color=colour, linestyle=dash, marker="o", markersize=4, linewidth=1.4, label=label)
    if "x" in log:
        axis.set_xscale("log")
        axis.set_xticks(list(x), [f"{value:g}" for value in x])
        axis.tick_params(axis="x", which="minor", bottom=False, labelbottom=False)
    if "y" in log:
        axis.set_yscale("log")
    axis.set_xlabel(x_label)
    axis.set_ylabel(y_label)
    axis.grid(color="#EEEEEE", linewidth=0.6)
    axis.legend(frameon=False, fontsize=9)
    return figure
