"""Below the map: small plots over time, of consistency, error and reward."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from slam_gym.consistency import nees_bounds
from slam_gym.render_canvas import Canvas, Colour, text
from slam_gym.render_frame import History
from slam_gym.render_legend import AXIS, FAINT, PAPER
from slam_gym.render_map import BELIEVED_TARGET, INK, ROBOT
from slam_gym.render_pygame import pygame

Floats = NDArray[np.float64]

BAND: Colour = (222, 238, 231)
NEES_RANGE = (0.03, 300.0)  # of the logarithmic axis
NEES_TICKS = (0.1, 1.0, 10.0, 100.0)
REWARD_RANGE = (-3.0, 1.0)  # from a target lost far away to one in view, with the default weights
PLOT_POINTS = 400  # a longer series is thinned out
SHORTEST_TIME = 5.0  # [s] on the time axis


@dataclass(frozen=True)
class Curve:
    """One plot. title; colour; ticks and heights: shares 0 (bottom) to 1 (top) of the values of a history."""

    title: str
    colour: Colour
    heights: Callable[[History], Floats]  # [T]
    ticks: Callable[[History], Sequence[tuple[float, str]]]  # (share of the height, words)
    band: tuple[float, float] | None = None  # shares between which a good value lies


class Strip:
    """Plots over time: pose NEES with its 95 % bounds, the target's error, the reward.

    Without a target: pose NEES and the robot's error.
    """

    def __init__(self, area: pygame.Rect, letter: int) -> None:
        self.area, self.letter = area, letter

    def shapes(self, canvas: Canvas, history: History, has_target: bool) -> None:
        """Axes, bounds and curves."""
        canvas.box(self.area, PAPER)
        canvas.line([self.area.topleft, self.area.topright], AXIS, 1.0)
        x = history.column("time") / _span(history)
        for curve, plot in self._plots(has_target):
            if curve.band is not None:
                low, high = (plot.bottom - share * plot.height for share in curve.band)
                canvas.box(pygame.Rect(plot.left, round(high), plot.width, round(low - high)), BAND)
            canvas.line([plot.topleft, plot.bottomleft, plot.bottomright], AXIS, 1.0)
            for share, _ in curve.ticks(history):
                y = plot.bottom - share * plot.height
                canvas.line([(plot.left, y), (plot.left + 3, y)], AXIS, 1.0)
            _draw(canvas, plot, x, plot.bottom - plot.height * curve.heights(history), curve.colour)
        if has_target:
            plot = self._plots(has_target)[1][1]
            seen = np.where(history.column("seen") > 0.0, plot.bottom + 3.0, math.nan)
            _draw(canvas, plot, x, seen, INK, thin=False)

    def words(self, surface: pygame.Surface, history: History, has_target: bool) -> None:
        """Titles and ticks."""
        small = max(9, round(0.8 * self.letter))
        for curve, plot in self._plots(has_target):
            place = (plot.left, self.area.top + 0.45 * self.letter)
            text(surface, curve.title, place, FAINT, small, max_width=plot.width)
            for share, align in ((0.0, "left"), (1.0, "right")):
                words = f"{share * _span(history):.0f}{' s' if share else ''}"
                text(surface, words, (plot.left + share * plot.width, plot.bottom + 5), FAINT, small, align=align)
            for share, words in curve.ticks(history):
                y = plot.bottom - share * plot.height - 0.6 * small
                text(surface, words, (plot.left - 4, y), FAINT, small, align="right")

    def _plots(self, has_target: bool) -> list[tuple[Curve, pygame.Rect]]:
        """The curves with their places, side by side."""
        curves = (NEES, TARGET_ERROR, REWARD) if has_target else (NEES, ROBOT_ERROR)
        head, foot, left = round(1.9 * self.letter), round(1.5 * self.letter), round(2.6 * self.letter)
        share = self.area.width // len(curves)
        size = (share - left - self.letter, self.area.height - head - foot)
        corners = [(self.area.left + i * share + left, self.area.top + head) for i in range(len(curves))]
        return [(curve, pygame.Rect(corner, size)) for curve, corner in zip(curves, corners, strict=True)]


def _span(history: History) -> float:
    return max(SHORTEST_TIME, float(history.column("time")[-1]) if len(history) else 0.0)


def _nees_share(value: Floats | float) -> Floats:
    low, high = (math.log10(v) for v in NEES_RANGE)
    return (np.log10(np.clip(value, *NEES_RANGE)) - low) / (high - low)


def _error_curve(title: str, column: str, colour: Colour) -> Curve:
    def top(history: History) -> float:
        """1, 2 or 5 times a power of ten above all finite errors so far."""
        errors = history.column(column)
        largest = errors[np.isfinite(errors)].max(initial=0.1)
        power = 10.0 ** math.floor(math.log10(largest))
        return float(next(power * m for m in (1.0, 2.0, 5.0, 10.0) if power * m >= largest))

    def heights(history: History) -> Floats:
        return np.minimum(history.column(column) / top(history), 1.0)

    return Curve(title, colour, heights, lambda history: [(0.0, "0"), (1.0, f"{top(history):g}")])


def _reward_heights(history: History) -> Floats:
    low, high = REWARD_RANGE
    return (np.clip(history.column("reward"), low, high) - low) / (high - low)


_LOW, _HIGH = nees_bounds(3)
NEES = Curve(
    "pose NEES, 95 % bounds",
    ROBOT,
    lambda history: _nees_share(history.column("pose_nees")),
    lambda history: [(float(_nees_share(tick)), f"{tick:g}") for tick in NEES_TICKS],
    (float(_nees_share(_LOW)), float(_nees_share(_HIGH))),
)
TARGET_ERROR = _error_curve("target error [m], bar: seen", "target_error", BELIEVED_TARGET)
ROBOT_ERROR = _error_curve("robot error [m]", "robot_error", ROBOT)
REWARD = Curve("reward", INK, _reward_heights, lambda history: [(0.0, "\u22123"), (0.75, "0"), (1.0, "1")])


def _draw(canvas: Canvas, plot: pygame.Rect, x: Floats, y: Floats, colour: Colour, thin: bool = True) -> None:
    every = max(1, -(-len(x) // PLOT_POINTS)) if thin else 1
    canvas.line(np.column_stack([plot.left + plot.width * x, y])[::every], colour, 1.5)
