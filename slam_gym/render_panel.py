"""Beside the map: the panel of numbers, legend and keys."""

import math
from collections.abc import Sequence

from slam_gym.render_canvas import Canvas, font, text
from slam_gym.render_frame import Frame
from slam_gym.render_legend import AXIS, FAINT, PAPER, legend
from slam_gym.render_map import INK, Layers
from slam_gym.render_pygame import pygame

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
    found.append(("collisions", str(frame.collisions)))  # also when there are none: no row comes and goes
    return found


def _seen(frame: Frame) -> str:
    if frame.target_seen:
        return "in view"
    since = frame.time_since_seen
    if since is None or since > frame.time - 1e-9:  # counted from the start until the first return
        return "not seen yet"
    return f"unseen {since:.1f} s"


class Panel:
    """The right-hand side: scenario and estimator, numbers, legend, and keys where there are any."""

    def __init__(self, area: pygame.Rect, letter: int) -> None:
        self.area, self.letter = area, letter
        self.line = round(1.3 * letter)
        self.left, self.right = area.left + letter, area.right - letter
        self._paper = pygame.Surface(area.size, 0, 32)  # what stays from one picture to the next
        self._drawn: tuple[object, ...] = ()  # what the paper shows

    def shapes(self, canvas: Canvas, surface: pygame.Surface, frame: Frame, layers: Layers) -> None:
        """Background and the legend's symbols, onto the picture."""
        pillars = bool((frame.landmark_radius > 0.0).any())
        shown = (self._legend_top(frame), pillars, *(words for _, words in legend(frame, layers)))
        if shown != self._drawn:
            self._shapes(canvas, frame, layers)
            canvas.onto(surface, self.area)
            self._paper.blit(surface, (0, 0), self.area)
            self._drawn = shown
        surface.blit(self._paper, self.area)

    def _shapes(self, canvas: Canvas, frame: Frame, layers: Layers) -> None:
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
        text(surface, frame.estimator, (self.left, y), INK, self._title_size(frame), bold=True, max_width=width)
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
            room, top = self.right - self.left, y - 1.5 * step
            text(surface, note, (self.left, top), INK, small, bold=True, max_width=room, cut="middle")
        for key, meaning in keys:
            if y + step > self.area.bottom:
                break
            text(surface, key, (self.left, y), INK, small, bold=True)
            place = (self.left + 5.7 * small, y)
            text(surface, meaning, place, FAINT, small, max_width=self.right - place[0])
            y += step

    def _title_size(self, frame: Frame) -> int:
        """[px] large, but for an estimator whose options would have no room so."""
        large = round(1.25 * self.letter)
        return large if font(large, bold=True).size(frame.estimator)[0] <= self.right - self.left else self.letter

    def _rows_top(self) -> int:
        return self.area.top + round(3.9 * self.letter)

    def _legend_top(self, frame: Frame) -> int:
        return self._rows_top() + self.line * len(rows(frame)) + self.letter
