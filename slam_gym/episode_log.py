"""What an episode measured: a table for the terminal, a figure for a file."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from rich.markup import escape
from rich.table import Table

from slam_gym.consistency import in95_run
from slam_gym.episode import Episode
from slam_gym.metrics import METRIC

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NAME_WIDTH = 24
COLUMNS = (
    # heading, metric, statistic, format
    ("robot\n[m]", "robot_error", "rms", "{:.3f}"),
    ("heading\n[rad]", "heading_error", "rms", "{:.3f}"),
    ("target\n[m]", "target_error", "rms", "{:.3f}"),
    ("relative\n[m]", "target_error_rel", "rms", "{:.3f}"),
    ("map\n[m]", "landmark_error", "last", "{:.3f}"),
    ("mapped", "landmark_count", "last", "{:.0f}"),
    ("pose\nNEES", "pose_nees", "median", "{:.2f}"),
    ("target\nNEES", "target_nees", "median", "{:.2f}"),
)
CAPTION = (
    "Errors: root mean square over the episode{relative}; map: at the end. NEES: median, an honest filter has 2.4 "
    "(pose){target}; in 95 %: share of steps with the pose's NEES inside its bounds."
)
TARGET_CAPTION = {"relative": "; relative: of the target in the robot's frame", "target": " and 1.4 (target)"}
NO_TARGET_CAPTION = {"relative": "", "target": ""}


class EpisodeLog:
    """Metrics and positions of every estimator at every step of an episode.

    Call `record` after each step.
    """

    def __init__(self, episode: Episode) -> None:
        self.episode = episode
        self.names = episode.names
        self._metrics: list[NDArray[np.void]] = []
        self._tracks: list[dict[str, Any]] = []

    def record(self) -> None:
        """Measure the present."""
        simulation = self.episode.simulation
        row = np.zeros(len(self.names), dtype=METRIC)
        for i, name in enumerate(self.names):
            row[i] = simulation.measure(i)[0]
            self._tracks.append(self._track(i, name))
        self._metrics.append(row)

    @property
    def metrics(self) -> NDArray[np.void]:
        """[steps, estimators] records of `slam_gym.metrics.METRIC`."""
        return np.array(self._metrics, dtype=METRIC).reshape(-1, len(self.names))

    def table(self) -> Table:
        """One row per estimator, for a terminal of 80 columns."""
        episode, metrics = self.episode, self.metrics[self.episode.scenario.burn_in :]
        drive = episode.policy_name.partition(":")[0]
        title = f"{episode.scenario.name}, policy {drive}, seed {episode.seed}, {episode.time:.1f} s"
        has_target = episode.simulation.world.has_target
        caption = CAPTION.format(**(TARGET_CAPTION if has_target else NO_TARGET_CAPTION))
        table = Table(title=title, title_justify="left", title_style="bold", caption=caption, caption_justify="left",
                      box=None, padding=(0, 1), collapse_padding=True, pad_edge=False)  # fmt: skip
        table.add_column("estimator", overflow="fold", max_width=NAME_WIDTH)  # gives way before any number does
        columns = [c for c in COLUMNS if has_target or not c[1].startswith("target")]
        for heading in (*(c[0] for c in columns), "in 95 %"):
            table.add_column(escape(heading), justify="right", no_wrap=True)
        for i, name in enumerate(self.names):
            values = [_statistic(metrics[metric][:, i], kind) for _, metric, kind, _ in columns]
            cells = [_cell(value, column[3]) for value, column in zip(values, columns, strict=True)]
            share = in95_run(metrics["pose_nees"][:, i][None], 3)
            table.add_row(name, *cells, f"{100.0 * share:.0f} %")
        return table

    def figure(self) -> "Figure":
        """Paths with ellipses above, errors over time below, for every estimator."""
        import pandas as pd

        from slam_gym.plots import trajectories

        return trajectories(pd.DataFrame(self._tracks), pd.DataFrame(self._landmarks()), run=0)

    def _track(self, index: int, name: str) -> dict[str, Any]:
        world, belief = self.episode.simulation.world, self.episode.simulation.estimators[index].belief
        known = bool(belief.target_known[0])
        target = world.target[0, :2] if world.has_target else (math.nan, math.nan)
        return {
            "run": 0, "estimator": name, "time": self.episode.time,
            **_columns(("true_x", "true_y"), world.pose[0]),
            **_columns(("x", "y"), belief.pose[0]),
            **_cov("pose_cov", belief.pose_cov[0]),
            **_columns(("target_true_x", "target_true_y"), target),
            **_columns(("target_x", "target_y"), belief.target_position[0] if known else (math.nan, math.nan)),
            **_cov("target_cov", belief.target_position_cov[0] if known else np.full((2, 2), math.nan)),
        }  # fmt: skip

    def _landmarks(self) -> list[dict[str, Any]]:
        """True landmarks, then each estimator's map, at the end."""
        world, rows = self.episode.simulation.world, []
        nowhere = np.full((2, 2), math.nan)
        for name, estimator in zip(self.names, self.episode.simulation.estimators, strict=True):
            for i in range(int(world.landmark_count[0])):
                truth = _columns(("true_x", "true_y"), world.landmarks[0, i])
                radius = float(world.landmark_radius[0, i])
                rows.append({"run": 0, "estimator": name, "radius": radius, **truth, "x": math.nan, "y": math.nan,
                             **_cov("cov", nowhere)})  # fmt: skip
            belief = estimator.belief
            for slot in np.flatnonzero(belief.landmark_mapped[0]):
                mean = _columns(("x", "y"), belief.landmark_mean[0, slot])
                rows.append({"run": 0, "estimator": name, "radius": 0.0, "true_x": math.nan, "true_y": math.nan,
                             **mean, **_cov("cov", belief.landmark_cov[0, slot])})  # fmt: skip
        return rows


def _columns(names: tuple[str, ...], values: Any) -> dict[str, float]:
    return {name: float(value) for name, value in zip(names, values, strict=False)}


def _cov(prefix: str, cov: Any) -> dict[str, float]:
    return {f"{prefix}_xx": float(cov[0, 0]), f"{prefix}_xy": float(cov[0, 1]), f"{prefix}_yy": float(cov[1, 1])}


def _cell(value: float, form: str) -> str:
    """A number in at most 7 characters: the table has room for no more."""
    if math.isnan(value):
        return "-"
    text = form.format(value)
    return text if len(text) <= 7 else f"{value:.1e}"


def _statistic(values: NDArray[np.float64], kind: str) -> float:
    defined = values[~np.isnan(values)]
    if not defined.size:
        return math.nan
    if kind == "last":
        return float(defined[-1])
    return float(np.sqrt(np.mean(defined**2)) if kind == "rms" else np.median(defined))
