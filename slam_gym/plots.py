"""Figures of a comparison, drawn from its tables: every function takes frames and returns a matplotlib `Figure`.

No global state (pyplot is never touched), so they work in any process, headless or in a notebook. The frames are those
of `slam_gym.results.Results`, of one scenario and one policy.
"""

import itertools
import math
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Ellipse
from matplotlib.ticker import LogLocator, NullFormatter
from matplotlib.transforms import Bbox
from scipy.stats import chi2

from slam_gym.consistency import nees_bounds
from slam_gym.palette import GREY, TRUTH, VERMILION, styles
from slam_gym.tables import UNBOUNDED

ELLIPSE_PROBABILITY = 0.95
ELLIPSES_PER_TRACK = 12
DOT = 5.0  # pixels about a point that names keep off
USUAL, ROOM_ABOVE = 0.99, 1.5  # the share of a NEES curve that sets its axis, and the room above that
LABELS = {
    "robot_error": "robot position error [m]",
    "target_error": "target position error [m]",
    "target_error_rel": "target error in the robot's frame [m]",
    "heading_error": "robot heading error [rad]",
    "target_heading_error": "target heading error [rad]",
    "landmark_error": "landmark error [m]",
    "pose_nees": "pose NEES",
    "target_nees": "target position NEES",
    "landmark_nees": "landmark NEES",
}
DEGREES = {"pose_nees": 3, "target_nees": 2, "landmark_nees": 2}


def new_figure(width: float, height: float, **kwargs: Any) -> tuple[Figure, Any]:
    """An empty figure [inches] in this project's look, and its axes as `Figure.subplots` gives them."""
    figure = Figure(figsize=(width, height), layout="constrained", dpi=110)
    axes = figure.subplots(**kwargs)
    for axis in np.atleast_1d(axes).ravel():
        axis.spines[["top", "right"]].set_visible(False)
    return figure, axes


def over_time(series: pd.DataFrame, metrics: tuple[str, ...] = ("robot_error", "target_error_rel")) -> Figure:
    """Mean over runs of each metric against time, one line per estimator."""
    figure, axes = new_figure(9.0, 2.6 * len(metrics), nrows=len(metrics), sharex=True, squeeze=False)
    for axis, metric in zip(axes[:, 0], metrics, strict=True):
        _lines(axis, series, metric)
        axis.set_ylabel(LABELS[metric])
        axis.set_ylim(bottom=0.0)
    return _finish_time(figure, axes)


def nees_over_time(series: pd.DataFrame, metrics: tuple[str, ...] = ("pose_nees", "target_nees")) -> Figure:
    """Mean NEES over runs against time, with the 95 % interval of an honest filter's; landmarks' has none."""
    figure, axes = new_figure(9.0, 2.9 * len(metrics), nrows=len(metrics), sharex=True, squeeze=False)
    runs = int(series["runs"].max()) if len(series) else 1
    for axis, metric in zip(axes[:, 0], metrics, strict=True):
        dof = DEGREES[metric]
        low, high = nees_bounds(dof, max(runs, 1))
        if metric != f"{UNBOUNDED}_nees":
            axis.axhspan(low, high, color="#D9EFE6", zorder=0, label=f"95 % for an honest filter, {runs} runs")
        axis.axhline(dof, color=GREY, linewidth=0.8)
        _lines(axis, series, metric)
        axis.set_yscale("log")
        axis.set_ylim(bottom=min(0.3 * dof, low))
        _cut_spikes(axis, series, metric)
        axis.set_ylabel(f"{LABELS[metric]} ({dof} is right)")
    return _finish_time(figure, axes)


def _cut_spikes(axis: Axes, series: pd.DataFrame, metric: str) -> None:
    """End the axis where a few instants alone would set its scale, and say so in the picture.

    Such an instant is the first of a run, whose covariance is nearly zero; a filter that has gone wrong for more than a
    hundredth of the time stays in sight.
    """
    shown = series[np.isfinite(series[metric]) & (series[metric] > 0)]
    if shown.empty:
        return
    top = ROOM_ABOVE * shown.groupby("estimator")[metric].quantile(USUAL).max()
    highest, count = shown[metric].max(), int((shown[metric] > top).sum())
    if highest > ROOM_ABOVE * top:
        axis.set_ylim(top=top)
        note = f"{count} of {len(shown)} points lie above, up to {highest:.0f}"
        axis.set_title(note, loc="right", fontsize=8, color=GREY)


def _lines(axis: Axes, series: pd.DataFrame, metric: str) -> None:
    for name, (colour, dash) in styles(series["estimator"]).items():
        part = series[series["estimator"] == name]
        axis.plot(part["time"], part[metric], color=colour, linestyle=dash, linewidth=1.3, label=name)


def _finish_time(figure: Figure, axes: Any) -> Figure:
    axes[-1, 0].set_xlabel("time [s]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=min(4, len(labels)), frameon=False)
    return figure


def error_distributions(runs: pd.DataFrame, metrics: tuple[str, ...] = ("robot_error", "target_error_rel")) -> Figure:
    """Each run's mean error as a dot, the middle half as a box, per estimator."""
    names = list(dict.fromkeys(runs["estimator"]))
    figure, axes = new_figure(9.0, 0.9 + 0.36 * len(names), ncols=len(metrics), sharey=True, squeeze=False)
    look = styles(names)
    jitter = np.random.default_rng(0)
    for axis, metric in zip(axes[0], metrics, strict=True):
        for row, name in enumerate(names):
            values = runs.loc[runs["estimator"] == name, f"{metric}_mean"].to_numpy(dtype=float)
            values = values[np.isfinite(values)]
            if not values.size:
                continue
            offset = jitter.uniform(-0.22, 0.22, values.size)
            axis.scatter(values, row + offset, s=7, color=look[name][0], alpha=0.45, linewidths=0)
            low, middle, high = np.percentile(values, (25, 50, 75))
            axis.plot([low, high], [row, row], color=TRUTH, linewidth=1.2)
            axis.plot([middle], [row], marker="|", markersize=11, color=TRUTH)
        _positive_axis(axis, runs[f"{metric}_mean"])
        axis.set_xlabel(LABELS[metric])
    axes[0, 0].set_yticks(range(len(names)), names)
    axes[0, 0].invert_yaxis()
    return figure


def _positive_axis(axis: Axes, values: pd.Series) -> None:
    """Logarithmic where the values span more than a factor of 30."""
    finite = values[np.isfinite(values) & (values > 0)]
    if len(finite) and finite.max() > 30.0 * finite.min():
        axis.set_xscale("log")
    else:
        axis.set_xlim(left=0.0)


def cost_against_accuracy(summary: pd.DataFrame) -> Figure:
    """Time per step against error; the ring's size grows with the pose's overconfidence."""
    figure, axis = new_figure(6.4, 4.2)
    look = styles(summary["estimator"])
    points: dict[str, tuple[float, float]] = {}
    for row in summary.to_dict("records"):
        cost, error = row["predict_us"] + row["update_us"], row["robot_error_rmse"]
        if not (cost > 0 and math.isfinite(error) and error > 0):
            continue
        colour = look[row["estimator"]][0]
        excess = max(1.0, row["pose_nees_mean"] / 3.0) if math.isfinite(row["pose_nees_mean"]) else 100.0
        axis.scatter([cost], [error], s=40.0 * min(excess, 30.0), facecolors="none", edgecolors=colour)
        axis.scatter([cost], [error], s=22, color=colour)
        points[row["estimator"]] = (cost, error)
    axis.set_xscale("log")
    costs = [cost for cost, _ in points.values()] or [1.0]
    narrow = max(costs) < 30.0 * min(costs)
    axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 1.5, 2.0, 3.0, 5.0, 7.0) if narrow else (1.0,)))
    axis.xaxis.set_major_formatter("{x:g}")
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.margins(x=0.22, y=0.15)
    axis.set_xlabel("filter time per step, predict + update [us]")
    axis.set_ylabel("robot position RMSE [m]")
    axis.set_title("ring area = pose NEES / 3 (only the dot: honest)", fontsize=9, color=GREY)
    figure.draw_without_rendering()  # limits and places are final
    _name_points(axis, points)
    return figure


def _name_points(axis: Axes, points: dict[str, tuple[float, float]]) -> None:
    """A name beside each point, at the first place where it covers no name or dot; once all else has its place."""
    dots = [axis.transData.transform(at) for at in points.values()]
    taken = [Bbox([dot - DOT, dot + DOT]) for dot in dots]
    for name, at in sorted(points.items(), key=lambda item: item[1]):
        for y, (x, side) in itertools.product((5, -13, 17, -25), ((7, "left"), (-7, "right"))):
            label = axis.annotate(name, at, xytext=(x, y), textcoords="offset points", ha=side, fontsize=9)
            extent = label.get_window_extent()
            if not extent.count_overlaps(taken):
                break
            label.remove()
        else:
            label = axis.annotate(name, at, xytext=(7, 5), textcoords="offset points", fontsize=9)
        taken.append(label.get_window_extent())


def trajectories(tracks: pd.DataFrame, landmarks: pd.DataFrame, *, run: int | None = None) -> Figure:
    """One run: truth and belief of robot and target, landmarks, with 95 % ellipses; one panel per estimator."""
    if run is None and len(tracks):
        run = int(tracks["run"].min())
    tracks, landmarks = tracks[tracks["run"] == run], landmarks[landmarks["run"] == run]
    names = list(dict.fromkeys(tracks["estimator"]))
    columns = min(3, max(1, len(names)))
    rows = math.ceil(max(1, len(names)) / columns)
    figure, axes = new_figure(
        3.5 * columns, 3.6 * rows + 0.4, nrows=rows, ncols=columns, sharex=True, sharey=True, squeeze=False
    )
    for axis in axes.ravel()[len(names) :]:
        axis.set_axis_off()
    for axis, name in zip(axes.ravel(), names, strict=False):
        _panel(axis, tracks[tracks["estimator"] == name], landmarks[landmarks["estimator"] == name])
        axis.set_title(name, fontsize=10)
    for axis in axes.ravel()[max(0, len(names) - columns) : len(names)]:  # with nothing below
        axis.set_xlabel("x [m]")
        axis.tick_params(labelbottom=True)
    for axis in axes[:, 0]:
        axis.set_ylabel("y [m]")
    if names:
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=min(4, 2 * columns), frameon=False, fontsize=9)
    return figure


def _panel(axis: Axes, track: pd.DataFrame, landmarks: pd.DataFrame) -> None:
    robot, target = styles(["robot", "target"])["robot"][0], VERMILION
    for row in landmarks.to_dict("records"):
        if row["radius"] > 0:
            axis.add_patch(Circle((row["true_x"], row["true_y"]), row["radius"], color="#DDDDDD", zorder=0))
    axis.plot(landmarks["true_x"], landmarks["true_y"], "+", color=GREY, markersize=5)
    for row in landmarks[np.isfinite(landmarks["x"])].to_dict("records"):
        add_ellipse(axis, row["x"], row["y"], row["cov_xx"], row["cov_xy"], row["cov_yy"], GREY)
    axis.plot(track["true_x"], track["true_y"], color=TRUTH, linewidth=1.0, label="robot, true")
    axis.plot(track["x"], track["y"], color=robot, linewidth=1.2, linestyle="--", label="robot, believed")
    if track["target_true_x"].notna().any():
        axis.plot(track["target_true_x"], track["target_true_y"], color="#888888", linewidth=1.0, label="target, true")
        axis.plot(track["target_x"], track["target_y"], color=target, linewidth=1.0, linestyle="--",
                  label="target, believed")  # fmt: skip
    chosen = track.iloc[np.unique(np.linspace(0, len(track) - 1, ELLIPSES_PER_TRACK).astype(int))]
    for row in chosen.to_dict("records"):
        add_ellipse(axis, row["x"], row["y"], row["pose_cov_xx"], row["pose_cov_xy"], row["pose_cov_yy"], robot)
        add_ellipse(axis, row["target_x"], row["target_y"], row["target_cov_xx"], row["target_cov_xy"],
                    row["target_cov_yy"], target)  # fmt: skip
    _true_limits(axis, track, landmarks)


def _true_limits(axis: Axes, track: pd.DataFrame, landmarks: pd.DataFrame) -> None:
    """Equal axes that follow the truth: a filter that runs away must not shrink the picture; without it, the belief."""
    x = np.concatenate([track["true_x"], track["target_true_x"], landmarks["true_x"]])
    y = np.concatenate([track["true_y"], track["target_true_y"], landmarks["true_y"]])
    x, y = x[np.isfinite(x)], y[np.isfinite(y)]
    if not x.size:
        x, y = np.concatenate([track["x"], landmarks["x"]]), np.concatenate([track["y"], landmarks["y"]])
        x, y = x[np.isfinite(x)], y[np.isfinite(y)]
    if not x.size:
        return
    half = 0.55 * max(np.ptp(x), np.ptp(y), 1.0)
    axis.set_xlim(0.5 * (x.min() + x.max()) - half, 0.5 * (x.min() + x.max()) + half)
    axis.set_ylim(0.5 * (y.min() + y.max()) - half, 0.5 * (y.min() + y.max()) + half)
    axis.set_aspect("equal")


def add_ellipse(axis: Axes, x: float, y: float, xx: float, xy: float, yy: float, colour: str) -> None:
    """The 95 % ellipse of a 2-D Gaussian (mean [m], covariance [m^2]); nothing where a number is not finite."""
    if not np.isfinite([x, y, xx, xy, yy]).all():
        return
    values, vectors = np.linalg.eigh([[xx, xy], [xy, yy]])
    size = 2.0 * np.sqrt(np.maximum(values, 0.0) * chi2.ppf(ELLIPSE_PROBABILITY, 2))
    angle = math.degrees(math.atan2(vectors[1, 1], vectors[0, 1]))
    axis.add_patch(Ellipse((x, y), size[1], size[0], angle=angle, fill=False, edgecolor=colour, linewidth=0.8))
