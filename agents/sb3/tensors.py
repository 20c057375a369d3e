"""Tensors in a file that cannot run code: the safetensors format, read and written with NumPy alone.

A file is the length of a JSON header (8 bytes, little-endian), the header (name -> dtype, shape, place), then the raw
numbers. `safetensors.torch.load_file` reads it too. Pickles, which torch and Stable-Baselines3 write by default, can
run anything when they are loaded; they are recognised and refused.
"""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Tensors = dict[str, NDArray[Any]]

DTYPES = {"F32": "<f4", "F64": "<f8", "I32": "<i4", "I64": "<i8", "U8": "|u1", "BOOL": "|b1"}
CODES = {np.dtype(numpy): code for code, numpy in DTYPES.items()}
HEADER_LIMIT = 10_000_000  # [bytes]
ALIGNMENT = 8  # [bytes] of the numbers' start

REFUSED = (
    "{file!r} is {what}, which can run any code when it is loaded, so it is not read as a policy. A policy is a folder "
    "with policy.json and weights.safetensors. If you trust the file, load it yourself, for example with "
    "stable_baselines3.PPO.load, and write such a folder with agents.sb3.policy_file.export_policy"
)


def to_bytes(tensors: Mapping[str, NDArray[Any]]) -> bytes:
    """The file's contents; the same tensors give the same bytes.

    Raises:
        ValueError: a tensor of a type that the format does not have here.
    """
    header: dict[str, Any] = {}
    parts, at = [], 0
    for name in sorted(tensors):
        array = np.ascontiguousarray(tensors[name]).reshape(np.shape(tensors[name]))
        code = CODES.get(array.dtype)
        if code is None:
            raise ValueError(f"tensor {name!r} is of type {array.dtype}; a policy file holds {', '.join(DTYPES)}")
        data = array.tobytes()
        header[name] = {"dtype": code, "shape": list(array.shape), "data_offsets": [at, at + len(data)]}
        parts.append(data)
        at += len(data)
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % ALIGNMENT)
    return b"".join([len(text).to_bytes(8, "little"), text, *parts])


def read_tensors(file: Path) -> Tensors:
    """The tensors by name.

    Raises:
        ValueError: a pickle or a zip, refused; or a damaged file.
        OSError: no such file.
    """
    content = Path(file).read_bytes()
    refuse_pickle(Path(file), content)
    size = int.from_bytes(content[:8], "little")
    try:
        if not 2 <= size <= min(HEADER_LIMIT, len(content) - 8):
            raise ValueError("the header's length is impossible")
        header = json.loads(content[8 : 8 + size])
        header.pop("__metadata__", None)
        body = memoryview(content)[8 + size :]
        return {name: _tensor(body, **entry) for name, entry in header.items()}
    except (ValueError, TypeError, AttributeError, KeyError) as error:
        raise ValueError(f"{str(file)!r} is no safetensors file, or a damaged one: {error}") from error


def _tensor(body: memoryview, dtype: str, shape: list[int], data_offsets: list[int]) -> NDArray[Any]:
    kind, (start, end) = np.dtype(DTYPES[dtype]), data_offsets
    if not all(isinstance(n, int) and n >= 0 for n in (start, end, *shape)):
        raise ValueError("a size that is no whole number")
    if end > len(body) or end - start != math.prod(shape) * kind.itemsize:
        raise ValueError(f"a tensor of {shape} {dtype} cannot stand at bytes {start} to {end}")
    return np.frombuffer(body[start:end], dtype=kind).reshape(shape).copy()


def refuse_pickle(file: Path, content: bytes) -> None:
    """Raises ValueError with an explanation where the first bytes are those of a zip or a pickle."""
    what = None
    if content[:2] == b"PK":
        what = "a zip archive as Stable-Baselines3 or torch.save writes it"
    elif content[:1] == b"\x80" and content[1:2] in (b"\x02", b"\x03", b"\x04", b"\x05"):
        what = "a Python pickle"
    if what is not None:
        raise ValueError(REFUSED.format(file=str(file), what=what))
