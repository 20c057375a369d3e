"""Pictures of a running simulation with pygame: in a window, or as arrays for videos, the very same pixels.

renderer = Renderer("rgb_array", size=(800, 600))
picture = renderer.draw(Frame.from_simulation(simulation))  # [600, 800, 3] uint8
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from slam_gym.render_canvas import Camera, Canvas, text
from slam_gym.render_frame import Frame, History
from slam_gym.render_legend import AXIS, FAINT
from slam_gym.render_map import BACKGROUND, INK, Layers, bounds, draw_map, floor_box, grid_step
from slam_gym.render_panel import Panel
from slam_gym.render_pygame import pygame, show_directly
from slam_gym.render_strip import Strip

__all__ = ["Frame", "History", "Layers", "Renderer"]

MODES = ("rgb_array", "human")
SMALLEST = (160, 120)  # [px]
PANEL_FROM, STRIP_FROM = 520, 360  # [px] width and height from which the panel and the strip are shown
SMALL_LETTER = 13  # [px] in a picture of 800 x 600; letters and lines grow with it
FOLLOWED = 1.15  # half the width of the followed view, in sensor ranges


class Renderer:
    """Draws frames of one lane and keeps their history for trails and plots.

    Args:
        mode: "rgb_array": `draw` returns the picture; "human": it shows it in a window.
        size: [px] width and height; a window can be resized by its user.
        title: of the window.
        fps: highest number of pictures per second in a window; 0: no limit.

    Attributes:
        layers: what is drawn.
        follow: what to keep in the middle instead of showing the whole arena: "robot" or "target"; None: neither.
        split: truth on the left, belief on the right, instead of one over the other.
        keys: rows (key, meaning) listed in the panel.
        note: one bold line above them.

    Raises:
        ValueError: an unknown mode or a picture too small to draw in.
    """

    def __init__(
        self,
        mode: Literal["rgb_array", "human"] = "rgb_array",
        size: tuple[int, int] = (800, 600),
        *,
        title: str = "slam-gym",
        fps: float = 0.0,
    ) -> None:
        if mode not in MODES:
            raise ValueError(f"render mode must be one of {', '.join(map(repr, MODES))}; got {mode!r}")
        if size[0] < SMALLEST[0] or size[1] < SMALLEST[1]:
            raise ValueError(f"a picture needs at least {SMALLEST[0]} x {SMALLEST[1]} pixels; got {size}")
        self.mode, self.fps = mode, fps
        self.layers = Layers()
        self.follow: Literal["robot", "target"] | None = None
        self.split = False
        self.keys: Sequence[tuple[str, str]] = ()
        self.note = ""
        self.history = History()
        self.window: pygame.Surface | None = None
        self._clock: pygame.time.Clock | None = None
        if mode == "human":
            pygame.display.init()
            show_directly()
            pygame.display.set_caption(title)
            self.window = pygame.display.set_mode((int(size[0]), int(size[1])), pygame.RESIZABLE)
            self._clock = pygame.time.Clock()
        self._lay_out((int(size[0]), int(size[1])))

    def _lay_out(self, size: tuple[int, int]) -> None:
        """Divide the picture: the panel on the right, the strip at the bottom, the map in the rest."""
        self.size = width, height = size
        letter = round(SMALL_LETTER * min(2.0, max(0.75, min(width / 800, height / 600))))
        panel = round(min(0.4 * width, 17.0 * letter)) if width >= PANEL_FROM else 0
        strip = round(8.5 * letter) if height >= STRIP_FROM else 0
        self._map = pygame.Rect(0, 0, width - panel, height - strip)
        self._panel = Panel(pygame.Rect(width - panel, 0, panel, height), letter) if panel else None
        self._strip = Strip(pygame.Rect(0, height - strip, width - panel, strip), letter) if strip else None
        self._letter = letter
        self._canvas = Canvas(size, max(1.0, letter / SMALL_LETTER))
        self.surface = pygame.Surface(size, 0, 32)  # the latest picture
        if self.window is not None and self.window.get_size() == size:
            if self.window.get_masks() == self.surface.get_masks():
                self.surface = self.window  # pixels as ours: drawing there saves a copy

    def draw(self, frame: Frame, history: History | None = None) -> NDArray[np.uint8] | None:
        """Record the frame, draw it, and show or return it.

        Args:
            frame: what to show.
            history: trails and plots to show instead of this renderer's own (then nothing is recorded).

        Returns:
            [height, width, 3] uint8 in mode "rgb_array", None in mode "human".
        """
        if history is None:
            history = self.history
            history.record(frame)
        self._match_window()
        self._paint(frame, history)
        if self.mode == "human":
            self._show()
            return None
        return self.pixels()

    def pixels(self) -> NDArray[np.uint8]:
        """[height, width, 3] a copy of the latest picture."""
        width, height = self.size
        return np.frombuffer(pygame.image.tobytes(self.surface, "RGB"), np.uint8).reshape(height, width, 3).copy()

    def close(self) -> None:
        """Close the window, if there is one."""
        if self.window is not None:
            self.surface = self.surface.copy()  # the last picture outlives the window
            self.window = None
            pygame.display.quit()

    def _match_window(self) -> None:
        """Take the window's size before drawing: whenever events are fetched, it may have got another one."""
        if self.window is None:
            return
        pygame.event.pump()
        width, height = self.window.get_size()
        size = (max(width, SMALLEST[0]), max(height, SMALLEST[1]))
        if size != self.size or self.surface.get_size() != size:
            self._lay_out(size)

    def _paint(self, frame: Frame, history: History) -> None:
        has_target = frame.target is not None
        views = [(area, self._camera(area, frame, history, layers), layers) for area, layers, _ in self._views()]
        floors = [floor_box(camera, frame).clip(area) for area, camera, _ in views]
        self._canvas.ground(self._map, BACKGROUND, floors)
        for area, camera, layers in views:
            draw_map(self._canvas, area, camera, frame, history, layers)
        self._canvas.ground_onto(self.surface, self._map, BACKGROUND)
        if self._strip:
            self._strip.shapes(self._canvas, history, has_target)
            self._canvas.onto(self.surface, self._strip.area)
        shown = replace(self.layers, truth=True, belief=True) if self.split else self.layers
        if self._panel:
            self._panel.shapes(self._canvas, self.surface, frame, shown)
        small = max(9, round(0.85 * self._letter))
        self._scale_bar(views[-1][1], small)
        if self.split:  # followed, both floors may reach the middle
            self.surface.fill(AXIS, (self._map.left + self._map.width // 2 - 1, self._map.top, 2, self._map.height))
        for area, _, title in self._views():
            text(self.surface, title, (area.left + self._letter, area.top + 4), INK, self._letter, bold=True)
        if not (shown.truth or shown.belief):
            place = (self._map.centerx, self._map.top + self._map.height // 4)
            text(self.surface, "truth and belief are hidden", place, FAINT, self._letter, align="centre")
        if self._panel:
            self._panel.words(self.surface, frame, shown, self.keys, self.note)
        if self._strip:
            self._strip.words(self.surface, history, has_target)

    def _views(self) -> list[tuple[pygame.Rect, Layers, str]]:
        """The maps side by side: place, what is drawn, title."""
        if not self.split:
            return [(self._map, self.layers, "")]
        width = self._map.width // 2
        halves = [pygame.Rect(self._map.left + i * width, self._map.top, width, self._map.height) for i in (0, 1)]
        truth = replace(self.layers, truth=True, belief=False)
        return [(halves[0], truth, "truth"), (halves[1], replace(self.layers, truth=False, belief=True), "belief")]

    def _camera(self, area: pygame.Rect, frame: Frame, history: History, layers: Layers) -> Camera:
        middle = self._followed(frame, layers)
        if middle is None:
            bar = round(2.2 * self._letter)  # its scale stands below what is shown
            inside = pygame.Rect(area.left, area.top, area.width, area.height - bar)
            return Camera.fit(inside, *bounds(frame, history), margin=0.02)
        reach = FOLLOWED * min(frame.max_range, max(frame.arena))
        return Camera.fit(area, middle - reach, middle + reach, margin=0.0)

    def _followed(self, frame: Frame, layers: Layers) -> NDArray[np.float64] | None:
        """The point [2] to keep in the middle; None: the whole arena is shown."""
        if self.follow == "target":
            place = frame.target if layers.truth else frame.belief_target
            return None if place is None else place[:2]
        if self.follow == "robot":
            return (frame.pose if layers.truth else frame.belief_pose)[:2]
        return None

    def _scale_bar(self, camera: Camera, small: int) -> None:
        """A bar as long as the grid's step; small: [px] height of its letters."""
        length = grid_step(camera)
        left, thickness = self._letter, round(2.0 * max(1.0, self._letter / SMALL_LETTER))
        y = round(self._map.bottom - 0.7 * self._letter - 0.5 * thickness)
        self.surface.fill(INK, (left, y, round(length * camera.scale), thickness))
        text(self.surface, f"{length:g} m", (left, self._map.bottom - 2.3 * small), INK, small)

    def _show(self) -> None:
        assert self.window is not None and self._clock is not None
        if self.surface is not self.window:
            self.window.blit(self.surface, (0, 0))
        pygame.display.flip()
        if self.fps:
            self._clock.tick(self.fps)
