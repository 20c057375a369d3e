"""Everything of the world that changes, in three flat blocks: the cost of a kernel call grows with its arrays.

A block holds one array after the other, each lane by lane, so that every array is also an ordinary contiguous view.
Kernels find an array by its offset: the robot's x of one lane is `x[k[POSE] + 3 * lane]`, where `x` is the block of
floats and `k` the block of integers, which begins with the offsets.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

(
    # floats
    POSE, START_POSE, TARGET_STATE, TARGET_HEADING, ODOMETRY, STEERING, GOAL, SINCE_SEEN, DELAYED, ERRORS, LANDMARKS,
    RADIUS, RANGES, BEARINGS,
    # integers
    KEY, EPISODE, STEP, COUNT, COLLISIONS, OVERFLOW, RETURNS, LABELS, ORIGIN,
    # flags
    DUE, VISIBLE, DETECTED, TOUCHING,
    # sizes, not offsets: landmarks, returns and remembered commands per lane
    NUM_LANDMARKS, NUM_RETURNS, NUM_COMMANDS,
    # shared by the lanes: a recorded target's path, and its rows
    PATH, NUM_ROWS,
    HEAD,
) = range(33)  # fmt: skip

Floats = NDArray[np.float64]


VECTOR = 8  # returns whose errors are drawn together: a sweep's width is a multiple of it


class Blocks:
    """The blocks and their arrays.

    Args:
        num_lanes: L. landmarks: N. returns: K, most in a sweep. commands: D, remembered for the delay.
        path: [rows, 3] of a recorded target (time_s, x_m, y_m).

    Attributes:
        floats, integers, flags: the blocks.
        views: the arrays by name, each [L, ...].
    """

    def __init__(self, num_lanes: int, landmarks: int, returns: int, commands: int, path: Floats) -> None:
        N, K, D = landmarks, returns, commands
        floats = {
            "pose": (POSE, (3,)), "start_pose": (START_POSE, (3,)), "target": (TARGET_STATE, (4,)),
            "target_heading": (TARGET_HEADING, ()), "odometry": (ODOMETRY, (2,)), "steering": (STEERING, ()),
            "goal": (GOAL, (2,)), "time_since_seen": (SINCE_SEEN, ()), "delayed": (DELAYED, (D, 2)),
            "errors": (ERRORS, (N + 1, 2)), "landmarks": (LANDMARKS, (N, 2)), "landmark_radius": (RADIUS, (N,)),
            "ranges": (RANGES, (K,)), "bearings": (BEARINGS, (K,)),
        }  # fmt: skip
        integers = {
            "key": (KEY, ()), "episode": (EPISODE, ()), "step_count": (STEP, ()), "landmark_count": (COUNT, ()),
            "collisions": (COLLISIONS, ()), "overflow": (OVERFLOW, ()), "count": (RETURNS, ()),
            "labels": (LABELS, (K,)), "origin": (ORIGIN, (K,)),
        }  # fmt: skip
        flags = {
            "due": (DUE, ()), "target_visible": (VISIBLE, ()), "target_detected": (DETECTED, ()),
            "in_collision": (TOUCHING, ()),
        }  # fmt: skip
        offsets = np.zeros(HEAD, dtype=np.int64)
        offsets[[NUM_LANDMARKS, NUM_RETURNS, NUM_COMMANDS, NUM_ROWS]] = N, K, D, len(path)
        self.views: dict[str, NDArray[Any]] = {}
        self.floats: Floats = self._lay_out(floats, num_lanes, path.size, np.float64, offsets)
        self.integers: NDArray[np.int64] = self._lay_out(integers, num_lanes, HEAD, np.int64, offsets)
        self.flags: NDArray[np.bool_] = self._lay_out(flags, num_lanes, 0, np.bool_, offsets)
        self.floats[: path.size] = path.ravel()
        self.integers[:HEAD] = offsets
        self.views["key"] = self.views["key"].view(np.uint64)

    def _lay_out(
        self, arrays: Mapping[str, tuple[int, tuple[int, ...]]], num_lanes: int, first: int, kind: Any, offsets: Any
    ) -> NDArray[Any]:
        """One block, its views and their offsets; the block begins with `first` elements of other use."""
        sizes = [num_lanes * int(np.prod(shape)) for _, shape in arrays.values()]
        block = np.zeros(first + sum(sizes), dtype=kind)
        start = first
        for (name, (where, shape)), size in zip(arrays.items(), sizes, strict=True):
            offsets[where] = start
            self.views[name] = block[start : start + size].reshape(num_lanes, *shape)
            start += size
        return block
