"""Nested numbers and arrays in a torch file that is loaded without running code (`weights_only`)."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch

from slam_gym.results import write_atomic

ARRAY, GENERATOR = "__array__", "__generator__"


def save(file: Path, tree: Any) -> None:
    """Write dictionaries, lists, tensors, arrays (structured ones too), generators and plain values."""
    write_atomic(file, partial(torch.save, encode(tree)))


def load(file: Path) -> Any:
    """What `save` wrote; a file with anything else in it is refused by torch."""
    return decode(torch.load(file, weights_only=True, map_location="cpu"))


def encode(tree: Any) -> Any:
    """The same with arrays as bytes and their type."""
    if isinstance(tree, Mapping):
        return {key: encode(value) for key, value in tree.items()}
    if isinstance(tree, (list, tuple)):
        return type(tree)(encode(value) for value in tree)
    if isinstance(tree, np.random.Generator):
        return {GENERATOR: encode(tree.bit_generator.state)}
    if isinstance(tree, np.ndarray):
        data = torch.frombuffer(bytearray(tree.tobytes()), dtype=torch.uint8) if tree.size else torch.zeros(0)
        return {ARRAY: np.lib.format.dtype_to_descr(tree.dtype), "shape": list(tree.shape), "data": data}
    return tree.item() if isinstance(tree, np.generic) else tree


def decode(tree: Any) -> Any:
    """The inverse of `encode`."""
    if isinstance(tree, dict):
        if ARRAY in tree:
            dtype = np.lib.format.descr_to_dtype(tree[ARRAY])
            return np.frombuffer(tree["data"].numpy().tobytes(), dtype=dtype).reshape(tree["shape"]).copy()
        if GENERATOR in tree:
            generator = np.random.default_rng()
            generator.bit_generator.state = decode(tree[GENERATOR])
            return generator
        return {key: decode(value) for key, value in tree.items()}
    return type(tree)(decode(value) for value in tree) if isinstance(tree, (list, tuple)) else tree
