"""The legend: small copies of the map's symbols, with what they mean."""

import math
from collections.abc import Callable

import numpy as np

from slam_gym.render_canvas import Canvas, Colour
from slam_gym.render_frame import Frame
from slam_gym.render_map import (
    BELIEVED_LANDMARK,
    BELIEVED_TARGET,
    CLOUD,
    CLUTTER,
    HEADING_POINTS,
    INK,
    PARTICLE,
    PILLAR,
    RAY,
    ROBOT,
    SEEN,
    TRUTH,
    Layers,
)
from slam_gym.render_pygame import pygame

FAINT: Colour = (110, 115, 121)
AXIS: Colour = (205, 208, 212)
PAPER: Colour = (250, 250, 251)  # behind panel and strip

Symbol = Callable[[Canvas, float, float, float], None]


def legend(frame: Frame, layers: Layers) -> list[tuple[Symbol, str]]:
    """What the map's symbols mean; only those that may be on it, so that no row comes and goes."""
    found: list[tuple[Symbol, str]] = []
    if layers.truth:
        found.append((_arrow(INK, filled=True), "robot"))
        if frame.target is not None:
            found.append((_target_symbol, "target"))
        pillars = bool((frame.landmark_radius > 0.0).any())
        found.append((_disc(PILLAR if pillars else TRUTH, pillars), "landmark"))
    if layers.belief:
        found.append((_arrow(ROBOT, filled=False), "robot, believed"))
        if frame.target is not None:
            found.append((_cross(BELIEVED_TARGET, turned=True), "target, believed"))
        found.append((_cross(BELIEVED_LANDMARK, turned=False), "landmark, believed"))
    if layers.belief and layers.ellipses:
        found.append((_ellipse, "95 % ellipse"))
    if layers.belief and layers.particles and frame.particles is not None:
        found.append((_dots, "particles"))
    if layers.belief and layers.cloud and frame.keeps_cloud:
        found.append((_cloud_dots, "target may be here"))
    if layers.view:
        found.append((_patch, "sensor's view"))
    if layers.scan:
        found.append((_ray, "return of this sweep"))
        if frame.false_alarms:
            found.append((_cross(CLUTTER, turned=True), "false alarm"))
    return found


def _arrow(colour: Colour, filled: bool) -> Symbol:
    def draw(canvas: Canvas, x: float, y: float, size: float) -> None:
        outline = np.array([x - 0.2 * size, y]) + 1.15 * size * HEADING_POINTS
        if filled:
            canvas.polygon(outline, colour)
        else:
            canvas.line(outline, colour, 1.5, closed=True)

    return draw


def _target_symbol(canvas: Canvas, x: float, y: float, size: float) -> None:
    canvas.line([(x, y), (x + 1.9 * size, y)], INK, 2.0)
    canvas.disc((x, y), 0.9 * size, INK)


def _disc(colour: Colour, outlined: bool) -> Symbol:
    def draw(canvas: Canvas, x: float, y: float, size: float) -> None:
        canvas.disc((x, y), size if outlined else 3.0 * canvas.line_scale, colour)
        if outlined:
            canvas.disc((x, y), size, TRUTH, 1.0)

    return draw


def _cross(colour: Colour, turned: bool) -> Symbol:
    def draw(canvas: Canvas, x: float, y: float, size: float) -> None:
        canvas.cross((x, y), size, colour, 2.0, turned)

    return draw


def _ellipse(canvas: Canvas, x: float, y: float, size: float) -> None:
    angle = np.linspace(0.0, 2.0 * math.pi, 30)
    canvas.line(np.column_stack([x + 1.7 * size * np.cos(angle), y + size * np.sin(angle)]), FAINT, 1.5)


def _dots(canvas: Canvas, x: float, y: float, size: float) -> None:
    for dx, dy in ((-1.0, 0.3), (-0.2, -0.6), (0.4, 0.5), (1.1, -0.2)):
        canvas.disc((x + dx * size, y + dy * size), 1.6 * canvas.line_scale, PARTICLE)


def _cloud_dots(canvas: Canvas, x: float, y: float, size: float) -> None:
    for dx, dy in ((-1.1, -0.2), (-0.4, 0.5), (0.2, -0.6), (1.0, 0.3)):
        canvas.disc((x + dx * size, y + dy * size), 1.6 * canvas.line_scale, CLOUD)


def _patch(canvas: Canvas, x: float, y: float, size: float) -> None:
    area = pygame.Rect(round(x - 1.7 * size), round(y - size), round(3.4 * size), round(2.0 * size))
    canvas.box(area, SEEN)
    canvas.box(area, AXIS, 1.0)


def _ray(canvas: Canvas, x: float, y: float, size: float) -> None:
    canvas.line([(x - 1.7 * size, y), (x + 1.7 * size, y)], RAY, 1.5)
