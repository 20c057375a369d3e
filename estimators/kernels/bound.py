"""Call a kernel again and again with the same arrays, for a quarter of a microsecond whatever their number.

numba takes every array of a call apart anew, some 0.08 us each, and a structured one costs 0.3 us and more. `bind`
writes the addresses and shapes of the arrays that stay, and the numbers, into one table; a small kernel made for it
reads them back and calls the one that was bound, compiled together with it. Results are the same to the last bit.
"""

import hashlib
import importlib
from functools import cache, partial
from pathlib import Path
from typing import Any

import numba
import numpy as np
from llvmlite import ir  # type: ignore[import-untyped, unused-ignore]
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

from estimators.kernels.jit import jit

LATER: Any = object()
"""Among the arguments of `bind`: one that is given at each call."""

_WORD = ir.IntType(64)
_FIELD = 8  # bytes of a table's field


class Bound(partial[Any]):
    """What `bind` returns. Copies and pickles are bound to the copies of the arrays."""

    kernel: Any
    arguments: tuple[Any, ...]
    table: Any

    def __reduce__(self) -> Any:
        """By the kernel's name: an address means nothing elsewhere."""
        return _bind_again, (self.kernel.__module__, self.kernel.__name__, _mask(self.arguments), self._given())

    def _given(self) -> tuple[Any, ...]:
        return tuple(argument for argument in self.arguments if argument is not LATER)


def bind(kernel: Any, *arguments: Any) -> Bound:
    """The kernel with its arguments, but for those that are `LATER`: given at each call, in order.

    Args:
        kernel: a `@jit` function at the top level of its module.
        arguments: contiguous arrays, which are kept alive and must not be replaced; integers, floats, booleans.

    Raises:
        ValueError: an array that is not contiguous.
    """
    fields: list[int] = []
    kinds = []
    for argument in arguments:
        kind = None if argument is LATER else numba.typeof(argument)
        if isinstance(kind, types.Array):
            if kind.layout != "C":
                raise ValueError("bind needs contiguous arrays; got one that is not: bind a copy, or give it later")
            fields += [argument.ctypes.data, *argument.shape]
        elif kind is not None:
            fields.append(int(np.float64(argument).view(np.int64)) if kind == types.float64 else int(argument))
        kinds.append(kind)
    table = np.array(fields, dtype=np.int64)
    bound = Bound(_caller(kernel, tuple(kinds)), int(table.ctypes.data))
    bound.kernel, bound.arguments, bound.table = kernel, arguments, table
    return bound


def _mask(arguments: tuple[Any, ...]) -> tuple[bool, ...]:
    return tuple(argument is LATER for argument in arguments)


def _bind_again(module: str, name: str, later: tuple[bool, ...], given: tuple[Any, ...]) -> Bound:
    rest = iter(given)
    return bind(getattr(importlib.import_module(module), name), *(LATER if one else next(rest) for one in later))


@cache
def _caller(kernel: Any, kinds: tuple[Any, ...]) -> Any:
    """The small kernel: (address of a table, later arguments) -> what the bound kernel returns.

    Its name tells kinds and this file's version apart, and it counts as part of the bound kernel's file, so that the
    cache on disk holds for it as for any other.
    """
    known: dict[str, Any] = {"__name__": __name__, "kernel": kernel}
    later, passed, at = ["table"], [], 0
    for i, kind in enumerate(kinds):
        if kind is None:
            later.append(f"later_{i}")
            passed.append(f"later_{i}")
            continue
        known[f"read_{i}"] = _reader(kind)
        passed.append(f"read_{i}(table + {at})")
        at += _FIELD * (1 + kind.ndim if isinstance(kind, types.Array) else 1)
    version = hashlib.sha256(f"{kinds} {Path(__file__).read_text()}".encode()).hexdigest()[:16]
    name = f"bound_{kernel.__name__}_{version}"
    source = f"def {name}({', '.join(later)}):\n    return kernel({', '.join(passed)})\n"
    exec(compile(source, kernel.py_func.__code__.co_filename, "exec"), known)
    return jit(known[name])


@cache
def _reader(kind: Any) -> Any:
    """What a kernel calls with a field's address to get the array or number back."""
    return intrinsic(_array_reader(kind) if isinstance(kind, types.Array) else _number_reader(kind))


def _field(builder: Any, address: Any, index: int = 0, kind: Any = _WORD) -> Any:
    pointer = builder.inttoptr(address, kind.as_pointer())
    return builder.load(builder.gep(pointer, [_WORD(index)]))


def _number_reader(kind: Any) -> Any:
    def read(typingctx: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            if kind == types.float64:
                return _field(builder, args[0], kind=ir.DoubleType())
            return context.cast(builder, _field(builder, args[0]), types.int64, kind)

        return kind(types.int64), generate

    return read


def _array_reader(kind: Any) -> Any:
    def read(typingctx: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            array = context.make_array(kind)(context, builder)
            shape = [_field(builder, args[0], 1 + i) for i in range(kind.ndim)]
            itemsize = _WORD(context.get_abi_sizeof(context.get_data_type(kind.dtype)))
            strides = [itemsize]
            for size in reversed(shape[1:]):
                strides.insert(0, builder.mul(strides[0], size))
            data = builder.inttoptr(_field(builder, args[0]), array.data.type)
            populate_array(
                array, data=data, shape=cgutils.pack_array(builder, shape),
                strides=cgutils.pack_array(builder, strides), itemsize=itemsize, meminfo=None,
            )  # fmt: skip
            return array._getvalue()

        return kind(types.int64), generate

    return read
