"""Where things land on the picture and how they are drawn: camera, smooth shapes, text.

Shapes are drawn on a surface of twice the size and scaled down, which smooths every kind of edge alike; text is drawn
afterwards at its own size.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from slam_gym.render_pygame import pygame
from slam_gym.render_smooth import halve

Floats = NDArray[np.float64]
Colour = tuple[int, int, int]

OVERSAMPLING = 2  # what `halve` undoes
ELLIPSE_SCALE = math.sqrt(-2.0 * math.log(1.0 - 0.95))  # standard deviations of the plane's 95 % ellipse
_ANGLES = np.linspace(0.0, 2.0 * math.pi, 48, endpoint=False)
_CIRCLE = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)])  # [48, 2]
LARGEST_COORDINATE = 1e4  # [px], beyond which pygame's drawing is slow or overflows


def ellipse_points(mean: ArrayLike, cov: ArrayLike, scale: float = ELLIPSE_SCALE) -> Floats:
    """Outlines [..., 48, 2] of the ellipses (q - mean)' cov^-1 (q - mean) = scale^2; by default each holds 95 %.

    mean [..., 2], cov [..., 2, 2].
    """
    values, vectors = np.linalg.eigh(np.asarray(cov, dtype=np.float64))
    axes = vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]  # columns: half axes of one standard deviation
    return np.asarray(mean)[..., None, :] + scale * (_CIRCLE @ np.swapaxes(axes, -1, -2))


@dataclass(frozen=True)
class Camera:
    """From metres to pixels of an area: a point of the world in the middle, pixels per metre, y upwards."""

    area: pygame.Rect
    centre: tuple[float, float]  # [m]
    scale: float  # [px/m]

    @classmethod
    def fit(cls, area: pygame.Rect, low: ArrayLike, high: ArrayLike, margin: float = 0.04) -> "Camera":
        """The camera that shows the box from `low` to `high` [m] with a margin on each side (share of the area)."""
        corner, other = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
        size = np.maximum(other - corner, 1e-3)
        scale = (1.0 - 2.0 * margin) * min(area.width / size[0], area.height / size[1])
        middle = 0.5 * (corner + other)
        return cls(area, (float(middle[0]), float(middle[1])), float(scale))

    def pixels(self, points: ArrayLike) -> Floats:
        """[..., 2] metres to pixels of the whole picture."""
        q = np.asarray(points, dtype=np.float64) - self.centre
        q *= (self.scale, -self.scale)
        q += self.area.center
        return np.clip(q, -LARGEST_COORDINATE, LARGEST_COORDINATE, out=q)


class Canvas:
    """Smooth shapes in pixel coordinates of the final picture, clipped to an area.

    Args:
        size: [px] of the picture.
        line_scale: every line is so many times as wide as asked for; symbols of a fixed size go with it.
    """

    def __init__(self, size: tuple[int, int], line_scale: float = 1.0) -> None:
        self.size = size
        self._large = pygame.Surface((size[0] * OVERSAMPLING, size[1] * OVERSAMPLING), 0, 32)
        self.line_scale, self._thickness = line_scale, OVERSAMPLING * line_scale
        self._touched = self._to_wipe = self._large.get_rect()  # boxes around what was drawn: now, the last time

    def clip(self, area: pygame.Rect | None) -> None:
        """Draw only inside this area from now on."""
        self._large.set_clip(None if area is None else _enlarged(area))

    def ground(self, area: pygame.Rect, colour: Colour, covered: Iterable[pygame.Rect] = ()) -> None:
        """Begin an area anew, plain but for what is drawn from now on: only what was drawn the last time is wiped.

        covered: boxes that are going to be filled anyway, each inside of the area: they are not wiped.
        """
        pieces = [self._to_wipe.clip(_enlarged(area))]
        for box in covered:
            pieces = [piece for old in pieces for piece in _around(old, _enlarged(box))]
        for piece in pieces:
            self._large.fill(colour, piece)
        self._touched = pygame.Rect(0, 0, 0, 0)

    def ground_onto(self, surface: pygame.Surface, area: pygame.Rect, colour: Colour) -> None:
        """Bring such an area onto the picture: where nothing was drawn there is nothing to scale down."""
        self._to_wipe = box = self._touched.clip(_enlarged(area))
        left, top = box.left // OVERSAMPLING, box.top // OVERSAMPLING
        right, bottom = -(-box.right // OVERSAMPLING), -(-box.bottom // OVERSAMPLING)
        drawn = pygame.Rect(left, top, right - left, bottom - top)
        for piece in _around(area, drawn):
            surface.fill(colour, piece)
        self.onto(surface, drawn)

    def onto(self, surface: pygame.Surface, area: pygame.Rect) -> None:
        """Scale an area down onto the same area of a surface of the final size."""
        area = area.clip(surface.get_rect())  # the kernel checks no bounds
        large, small = pygame.surfarray.pixels2d(self._large), pygame.surfarray.pixels2d(surface)  # [W, H], locked
        halve(large.T, small.T, area.left, area.top, area.right, area.bottom)

    def line(self, points: ArrayLike, colour: Colour, width: float = 1.5, closed: bool = False) -> None:
        """A polyline [n, 2]; a row with NaN interrupts it."""
        q = np.asarray(points, dtype=np.float64) * OVERSAMPLING
        for part in _finite_parts(q):
            if len(part) > 1:
                self._touch(pygame.draw.lines(self._large, colour, closed, part.tolist(), self._width(width)))

    def dashes(self, points: ArrayLike, colour: Colour, width: float = 1.5, length: float = 5.0) -> None:
        """A dashed polyline [n, 2]; dashes and gaps of `length` pixels along it."""
        q = np.asarray(points, dtype=np.float64)
        q = q[np.isfinite(q).all(axis=1)]
        if len(q) < 2:
            return
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(q, axis=0).T))])
        for start in np.arange(0.0, along[-1], 2.0 * length):
            inside = along[(along > start) & (along < start + length)]
            at = np.concatenate([[start], inside, [min(start + length, along[-1])]])
            self.line(np.column_stack([np.interp(at, along, q[:, 0]), np.interp(at, along, q[:, 1])]), colour, width)

    def polygon(self, points: ArrayLike, colour: Colour) -> None:
        """A filled polygon [n, 2]."""
        self._touch(pygame.draw.polygon(self._large, colour, (np.asarray(points) * OVERSAMPLING).tolist()))

    def discs(self, centres: ArrayLike, radii: ArrayLike, colour: Colour) -> None:
        """Discs [n, 2], each of its own radius [n]."""
        places = (np.asarray(centres, dtype=np.float64) * OVERSAMPLING).tolist()
        sizes = np.maximum(1.0, np.asarray(radii, dtype=np.float64) * OVERSAMPLING).tolist()
        for place, size in zip(places, sizes, strict=True):
            self._touch(pygame.draw.circle(self._large, colour, place, size))

    def disc(self, centre: ArrayLike, radius: float, colour: Colour, width: float = 0.0) -> None:
        """A disc, or a circle of that line width."""
        x, y = (np.asarray(centre, dtype=np.float64) * OVERSAMPLING).tolist()
        size = max(1.0, radius * OVERSAMPLING)
        self._touch(pygame.draw.circle(self._large, colour, (x, y), size, self._width(width) if width else 0))

    def box(self, area: pygame.Rect, colour: Colour, width: float = 0.0, rounding: int = 0) -> None:
        """A rectangle, filled or of that line width."""
        large = _enlarged(area)
        thickness = self._width(width) if width else 0
        self._touch(pygame.draw.rect(self._large, colour, large, thickness, border_radius=rounding * OVERSAMPLING))

    def cross(self, centre: ArrayLike, size: float, colour: Colour, width: float = 1.5, turned: bool = False) -> None:
        """A plus of that half size, or a cross when turned."""
        a, b = (np.array([1.0, 1.0]), np.array([1.0, -1.0])) if turned else (np.array([1.0, 0.0]), np.array([0.0, 1.0]))
        middle = np.asarray(centre, dtype=np.float64)
        for arm in (a, b):
            self.line([middle - size * arm, middle + size * arm], colour, width)

    def _touch(self, box: pygame.Rect) -> None:
        if box.width and box.height:
            self._touched = self._touched.union(box) if self._touched.width else box

    def _width(self, width: float) -> int:
        return max(1, round(width * self._thickness))


def _enlarged(area: pygame.Rect) -> pygame.Rect:
    return pygame.Rect([OVERSAMPLING * v for v in area])


def _around(area: pygame.Rect, hole: pygame.Rect) -> list[pygame.Rect]:
    """What is left of an area without a hole, as at most four boxes: above, below, left and right of it."""
    hole = hole.clip(area)
    if not hole.width or not hole.height:
        return [area]
    boxes = (
        (area.left, area.top, area.width, hole.top - area.top),
        (area.left, hole.bottom, area.width, area.bottom - hole.bottom),
        (area.left, hole.top, hole.left - area.left, hole.height),
        (hole.right, hole.top, area.right - hole.right, hole.height),
    )
    return [pygame.Rect(box) for box in boxes if box[2] > 0 and box[3] > 0]


def _finite_parts(points: Floats) -> list[Floats]:
    """The runs of rows [n, 2] between those that are not finite."""
    finite = np.isfinite(points)
    if finite.all():
        return [points]
    whole = finite.all(axis=1)
    parts = np.split(points, np.flatnonzero(~whole))
    return [part[np.isfinite(part).all(axis=1)] for part in parts]


@cache
def _font_file(bold: bool) -> str | None:
    """DejaVu Sans as it comes with matplotlib, found without importing it; None: pygame's own font."""
    spec = find_spec("matplotlib")
    if spec is None or spec.origin is None:
        return None
    file = Path(spec.origin).parent / "mpl-data/fonts/ttf" / f"DejaVuSans{'-Bold' if bold else ''}.ttf"
    return str(file) if file.is_file() else None


_fonts: dict[tuple[int, bool], pygame.font.Font] = {}


def font(size: int, bold: bool = False) -> pygame.font.Font:
    """The font of that height in pixels."""
    if not pygame.font.get_init():
        pygame.font.init()
        _fonts.clear()  # fonts do not survive a `pygame.quit` elsewhere
    if (size, bold) not in _fonts:
        _fonts[size, bold] = pygame.font.Font(_font_file(bold), size)
    return _fonts[size, bold]


def text(
    surface: pygame.Surface, words: str, position: Sequence[float], colour: Colour, size: int, *,
    bold: bool = False, align: str = "left", max_width: float = math.inf, cut: str = "end",
) -> int:  # fmt: skip
    """Write one line with its top at `position`, cut with an ellipsis where too wide; returns its height [px].

    align: which part of the line `position` names: "left", "right" or "centre".
    cut: where the ellipsis stands: at the "end", or in the "middle" where the end says as much as the beginning.
    """
    image = _written(words, colour, size, bold, max_width, cut)
    shift = {"left": 0.0, "right": 1.0, "centre": 0.5}[align] * image.get_width()
    surface.blit(image, (round(position[0] - shift), round(position[1])))
    return image.get_height()


@lru_cache(maxsize=512)
def _written(words: str, colour: Colour, size: int, bold: bool, max_width: float, cut: str) -> pygame.Surface:
    """The picture of a line: nearly all that is written was there in the picture before."""
    letters = font(size, bold)
    return letters.render(shortened(words, letters, max_width, cut), True, colour)


def shortened(words: str, letters: pygame.font.Font, max_width: float, cut: str = "end") -> str:
    """The words, with an ellipsis for what has no room."""
    if letters.size(words)[0] <= max_width:
        return words
    for kept in range(len(words) - 1, 0, -1):
        tail = kept // 2 if cut == "middle" else 0
        shorter = f"{words[: kept - tail]}…{words[len(words) - tail :]}"
        if letters.size(shorter)[0] <= max_width:
            return shorter
    return "…"
