"""A picture drawn twice as large, brought down to its size: the mean of every four pixels."""

import numpy as np

from estimators.kernels.jit import jit

_HALVES = np.uint32(0x7F7F7F7F)  # what a byte shifted right by one may keep: nothing of its neighbour
_ONE = np.uint32(1)


@jit
def halve(large, small, left, top, right, bottom):
    """Means of 2 x 2 pixels of four bytes each, byte by byte, rounded down, in a part of the picture.

    Two integers have the mean (a & b) + (a ^ b) / 2, which for all bytes of a pixel at once is far faster than pygame's
    scaling of any size to any other. Pixel by pixel the compiler makes vector instructions of it; with two pixels in a
    word of 64 bits it takes twice the time.

    Args:
        large: [2 H, 2 W] uint32.
        small: [H, W] uint32, written.
        left: first column of `small` to write.
        top: first row.
        right: column behind the last one.
        bottom: row behind the last one.
    """
    for y in range(top, bottom):
        upper, lower, row = large[2 * y], large[2 * y + 1], small[y]
        for x in range(left, right):
            a, b = upper[2 * x], lower[2 * x]
            c, d = upper[2 * x + 1], lower[2 * x + 1]
            one = (a & b) + (((a ^ b) >> _ONE) & _HALVES)
            other = (c & d) + (((c ^ d) >> _ONE) & _HALVES)
            row[x] = (one & other) + (((one ^ other) >> _ONE) & _HALVES)
