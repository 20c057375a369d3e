"""Colours that stay apart for colour-blind eyes, the same in figures, reports and the live view.

Reference: Okabe and Ito, "Color Universal Design", 2008.
"""

from collections.abc import Iterable

BLACK = "#000000"
ORANGE = "#E69F00"
SKY = "#56B4E9"
GREEN = "#009E73"
YELLOW = "#F0E442"
BLUE = "#0072B2"
VERMILION = "#D55E00"
PURPLE = "#CC79A7"
GREY = "#6B6B6B"

TRUTH = BLACK
SERIES = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, GREY, YELLOW)
DASHES = ("-", "--", "-.", ":")


def styles(names: Iterable[str]) -> dict[str, tuple[str, str]]:
    """(colour, dash pattern) of each name, in order; the dashes change where the colours run out."""
    unique = dict.fromkeys(names)
    return {name: (SERIES[i % len(SERIES)], DASHES[i // len(SERIES) % len(DASHES)]) for i, name in enumerate(unique)}


def rgb(colour: str) -> tuple[int, int, int]:
    """The colour "#RRGGBB" as three integers, 0 to 255."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)
