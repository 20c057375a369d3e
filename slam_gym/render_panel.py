"""Beside the map: the panel of numbers, legend and keys, and below it the strip of two small plots over time."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from slam_gym.consistency import nees_bounds
from slam_gym.render_canvas import Canvas, Colour, font, text
from slam_gym.render_frame import Frame, History
from slam_gym.render_legend import AXIS, FAINT, legend
from slam_gym.render_map import BELIEVED_TARGET, INK, ROBOT, Layers
from slam_gym.render_pygame import pygame

Floats = NDArray[np.float64]

PAPER: Colour = (250, 250, 251)
BAND: Colour = (222, 238, 231)
NEES_RANGE = (0.03, 300.0)  # of the logarithmic axis
NEES_TICKS = (0.1, 1.0, 10.0, 100.0)
PLOT_POINTS = 400  # a longer series is thinned out
SHORTEST_TIME = 5.0  # [s] on the time axis

UNDEFINED = "\u2013"  # an en dash

Row = tuple[str, str]


def number(value: float, unit: str, digits: int = 2) -> str:
    """A number with its unit; a dash where it is undefined."""
    if math.isnan(value):
        return UNDEFINED
    if value >= 1e4:
        return f"> 10⁴{unit and ' ' + unit}"
    return f"{value:.{digits}f}{unit and ' ' + unit}"


def rows(frame: Frame) -> list[Row]:
    """Names and values of the panel, top to bottom."""
    found = [
        ("time", f"{frame.time:.1f} s"),
        ("robot error", number(frame.robot_error, "m")),
        ("heading error", number(math.degrees(frame.heading_error), "°", 1).replace(" °", "°")),
        ("pose NEES", number(frame.pose_nees, "", 1)),
        ("landmarks mapped", f"{len(frame.belief_landmarks)} of {len(frame.landmarks)}"),
    ]
    if frame.target is not None:
        found[3:3] = [("target error", number(frame.target_error, "m"))]
        found[5:5] = [("target NEES", number(frame.target_nees, "", 1))]
        found.append(("target", _seen(frame)))
    if frame.collisions:
        found.append(("collisions", str(frame.collisions)))
    return found


def _seen(frame: Frame) -> str:
    if frame.target_seen:
        return "in view"
    if frame.time_since_seen is None or not math.isfinite(frame.time_since_seen):
        return "not seen yet"
    return f"unseen {frame.time_since_seen:.1f} s"


class Panel:
    """The right-hand side: scenario and estimator, numbers, legend, and keys where there are any."""

    def __init__(self, area: pygame.Rect, letter: int) -> None:
        self.area, self.letter = area, letter
        self.line = round(1.4 * letter)
        self.left, self.right = area.left + letter, area.right - letter

    def shapes(self, canvas: Canvas, frame: Frame, layers: Layers) -> None:
        """Background and the legend's symbols."""
        canvas.box(self.area, PAPER)
        canvas.line([self.area.topleft, self.area.bottomleft], AXIS, 1.0)
        y = self._legend_top(frame)
        for draw, _ in legend(frame, layers):
            draw(canvas, self.left + 0.9 * self.letter, y + 0.5 * self.line, 0.42 * self.letter)
            y += self.line

    def words(self, surface: pygame.Surface, frame: Frame, layers: Layers, keys: Sequence[Row], note: str) -> None:
        """Everything written."""
        width = self.right - self.left
        y = self.area.top + round(0.7 * self.letter)
        y += text(surface, frame.scenario, (self.left, y), FAINT, self.letter, max_width=width) + 2
        text(surface, frame.estimator, (self.left, y), INK, round(1.25 * self.letter), bold=True, max_width=width)
        y = self._rows_top()
        for name, value in rows(frame):
            text(surface, name, (self.left, y), FAINT, self.letter)
            text(surface, value, (self.right, y), INK, self.letter, align="right")
            y += self.line
        y = self._legend_top(frame)
        for _, words in legend(frame, layers):
            top = y + 0.5 * (self.line - font(self.letter).get_height())
            room = width - 2.2 * self.letter
            text(surface, words, (self.left + 2.2 * self.letter, top), INK, self.letter, max_width=room)
            y += self.line
        self._keys(surface, keys, note, y)

    def _keys(self, surface: pygame.Surface, keys: Sequence[Row], note: str, used: float) -> None:
        small = max(9, round(0.85 * self.letter))
        step = round(1.3 * small)
        y = self.area.bottom - round(0.7 * self.letter) - step * len(keys)
        if y < used + step:  # no room for all of them: the last ones are left out
            y = round(used + step)
        if note:
            text(surface, note, (self.left, y - 1.5 * step), INK, small, bold=True, max_width=self.right - self.left)
        for key, meaning in keys:
            if y + step > self.area.bottom:
                break
            text(surface, key, (self.left, y), INK, small, bold=True)
            place = (self.left + 5.7 * small, y)
            text(surface, meaning, place, FAINT, small, max_width=self.right - place[0])
            y += step

    def _rows_top(self) -> int:
        return self.area.top + round(3.9 * self.letter)

    def _legend_top(self, frame: Frame) -> int:
        return self._rows_top() + self.line * len(rows(frame)) + self.letter


class Strip:
    """Two plots over time: pose NEES with its 95 % bounds on a logarithmic axis, and the target's error.

    Without a target the second shows the robot's error.
    """

    def __init__(self, area: pygame.Rect, letter: int) -> None:
        self.area, self.letter = area, letter
        head, foot, left = round(1.9 * letter), round(1.5 * letter), round(2.6 * letter)
        half = area.width // 2
        size = (half - left - letter, area.height - head - foot)
        self.plots = [pygame.Rect((area.left + i * half + left, area.top + head), size) for i in (0, 1)]

    def shapes(self, canvas: Canvas, history: History, has_target: bool) -> None:
        """Axes, bounds and curves."""
        canvas.box(self.area, PAPER)
        canvas.line([self.area.topleft, self.area.topright], AXIS, 1.0)
        low, high = nees_bounds(3)
        first, second = self.plots
        top, bottom = (_nees_height(v, first) for v in (high, low))
        canvas.box(pygame.Rect(first.left, round(top), first.width, round(bottom - top)), BAND)
        for plot in self.plots:
            canvas.line([plot.topleft, plot.bottomleft, plot.bottomright], AXIS, 1.0)
        for tick in NEES_TICKS:
            y = _nees_height(tick, first)
            canvas.line([(first.left, y), (first.left + 3, y)], AXIS, 1.0)
        if len(history) == 0:
            return
        x = history.column("time") / self._span(history)
        nees = np.clip(history.column("pose_nees"), *NEES_RANGE)
        _curve(canvas, first, x, np.array([_nees_height(v, first) for v in nees]), ROBOT)
        error = self._errors(history, has_target) / self._error_top(history, has_target)
        colour = BELIEVED_TARGET if has_target else ROBOT
        _curve(canvas, second, x, second.bottom - second.height * np.minimum(error, 1.0), colour)
        if has_target:
            self._seen(canvas, history, x)

    def _seen(self, canvas: Canvas, history: History, x: Floats) -> None:
        """A bar below the second plot wherever the target was seen."""
        plot = self.plots[1]
        seen = np.where(history.column("seen") > 0.0, plot.bottom + 3.0, math.nan)
        _curve(canvas, plot, x, seen, INK, thin=False)

    def words(self, surface: pygame.Surface, history: History, has_target: bool) -> None:
        """Titles and ticks."""
        small = max(9, round(0.8 * self.letter))
        first, second = self.plots
        titles = ["pose NEES, 95 % bounds", "target error [m], bar: seen" if has_target else "robot error [m]"]
        for plot, title in zip(self.plots, titles, strict=True):
            place = (plot.left, self.area.top + 0.45 * self.letter)
            text(surface, title, place, FAINT, small, max_width=plot.width)
            for share, align in ((0.0, "left"), (1.0, "right")):
                words = f"{share * self._span(history):.0f}{' s' if share else ''}"
                text(surface, words, (plot.left + share * plot.width, plot.bottom + 5), FAINT, small, align=align)
        for tick in NEES_TICKS:
            y = _nees_height(tick, first) - 0.6 * small
            text(surface, f"{tick:g}", (first.left - 4, y), FAINT, small, align="right")
        top = self._error_top(history, has_target)
        for share in (0.0, 1.0):
            y = second.bottom - share * second.height - 0.6 * small
            text(surface, f"{share * top:g}", (second.left - 4, y), FAINT, small, align="right")

    @staticmethod
    def _span(history: History) -> float:
        return max(SHORTEST_TIME, float(history.column("time")[-1]) if len(history) else 0.0)

    @staticmethod
    def _errors(history: History, has_target: bool) -> Floats:
        return history.column("target_error" if has_target else "robot_error")

    @classmethod
    def _error_top(cls, history: History, has_target: bool) -> float:
        """The top of the error axis: 1, 2 or 5 times a power of ten above all finite errors so far."""
        errors = cls._errors(history, has_target)
        largest = errors[np.isfinite(errors)].max(initial=0.1)
        power = 10.0 ** math.floor(math.log10(largest))
        return float(next(power * m for m in (1.0, 2.0, 5.0, 10.0) if power * m >= largest))


def _nees_height(value: float, plot: pygame.Rect) -> float:
    low, high = (math.log10(v) for v in NEES_RANGE)
    if math.isnan(value):
        return math.nan
    return plot.bottom - plot.height * (math.log10(value) - low) / (high - low)


def _curve(canvas: Canvas, plot: pygame.Rect, x: Floats, y: Floats, colour: Colour, thin: bool = True) -> None:
    every = -(-len(x) // PLOT_POINTS) if thin else 1
    points = np.column_stack([plot.left + plot.width * x, y])[::every]
    canvas.line(points, colour, 1.5)
