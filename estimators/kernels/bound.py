"""Call kernels again and again with the same arrays, for a quarter of a microsecond whatever their number.

numba takes every array of a call apart anew, some 0.08 us each, and a structured one costs 0.3 us and more. `bind`
writes the addresses and shapes of the arrays that stay, and the numbers, into one table; a small kernel made for it
reads them back and calls the one that was bound, compiled together with it. `chain` makes one such call of several.
Results are the same to the last bit.
"""

import hashlib
import importlib
from collections.abc import Iterable, Iterator
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

from estimators.kernels.jit import inline, jit, source_stamp
from estimators.kernels.simd import aligned_zeros


class _Later:
    """The kind of `LATER`, which is one object wherever it is unpickled."""

    def __reduce__(self) -> str:
        return "LATER"

    def __deepcopy__(self, memo: Any) -> "_Later":
        return self


LATER: Any = _Later()
"""Among the arguments of `bind`: one that is given at each call."""

_WORD = ir.IntType(64)
_FIELD = 8  # bytes of a table's field

Part = tuple[Any, tuple[Any, ...]]  # a kernel and its arguments


class Bound(partial[Any]):
    """What `bind` and `chain` return. Copies and pickles are bound to the copies of the arrays."""

    parts: tuple[Part, ...]
    table: Any

    def apart(self, scratch: Iterable[Any]) -> "Bound":
        """The same with scratch of its own in the place of these arrays: for another thread. Nothing is compiled."""
        own = {id(array): _copy(array) for array in scratch}
        parts = ((kernel, tuple(own.get(id(one), one) for one in arguments)) for kernel, arguments in self.parts)
        return _bind(tuple(parts))

    def __reduce__(self) -> Any:
        """By the kernels' names: an address means nothing elsewhere."""
        named = tuple((kernel.__module__, kernel.__name__, arguments) for kernel, arguments in self.parts)
        return _bind_again, (named,)


def bind(kernel: Any, *arguments: Any) -> Bound:
    """The kernel with its arguments, but for those that are `LATER`: given at each call, in order.

    Args:
        kernel: a `@jit` function at the top level of its module.
        arguments: contiguous arrays, which are kept alive and must not be replaced; integers, floats, booleans.

    Raises:
        ValueError: an array that is not contiguous.
    """
    return _bind(((kernel, arguments),))


def chain(*calls: Bound) -> Bound:
    """Bound kernels one after the other, as one call; it returns whether all of them ran.

    A kernel that returns False is the last to run. What is given later, every kernel takes from the beginning: the
    first of its own `LATER` arguments is the chain's first.
    """
    return _bind(tuple(part for call in calls for part in call.parts))


def _copy(array: Any) -> Any:
    own = aligned_zeros(*array.shape) if array.dtype == np.float64 else np.empty_like(array)
    own[...] = array
    return own


def _bind(parts: tuple[Part, ...]) -> Bound:
    fields = [field for _, arguments in parts for argument in arguments for field in _fields(argument)]
    table = np.array(fields, dtype=np.int64)
    kinds = tuple((kernel, tuple(map(_kind, arguments))) for kernel, arguments in parts)
    bound = Bound(_caller(kinds), int(table.ctypes.data))
    bound.parts, bound.table = parts, table
    return bound


def _bind_again(named: tuple[tuple[str, str, tuple[Any, ...]], ...]) -> Bound:
    return _bind(tuple((getattr(importlib.import_module(module), name), rest) for module, name, rest in named))


def _kind(argument: Any) -> Any:
    """Numba's type of an argument; None for one that is given later."""
    return None if argument is LATER else numba.typeof(argument)


def _fields(argument: Any) -> list[int]:
    """An argument's entries in the table: address and shape of an array, or the number."""
    if argument is LATER:
        return []
    if isinstance(argument, np.ndarray):
        if not argument.flags.c_contiguous:
            raise ValueError("bind needs contiguous arrays; got one that is not: bind a copy, or give it later")
        return [argument.ctypes.data, *argument.shape]
    return [int(np.float64(argument).view(np.int64)) if isinstance(argument, float) else int(argument)]


@cache
def _caller(parts: tuple[Part, ...]) -> Any:
    """The small kernel: (address of a table, later arguments) -> what the bound kernel, or the chain, returns.

    Its name tells kinds, this file's version and those of all kernels apart, and it counts as part of the first
    kernel's file, so that the cache on disk holds for it as for any other.
    """
    known: dict[str, Any] = {"__name__": __name__, "went_well": _went_well}
    calls = list(_calls(parts, known))
    most = max(sum(kind is None for kind in kinds) for _, kinds in parts)
    body = [f"return {calls[0]}"] if len(calls) == 1 else _in_turn(calls)
    stamps = [source_stamp(Path(kernel.py_func.__code__.co_filename)) for kernel, _ in parts]
    kinds = [(kernel.__name__, kinds) for kernel, kinds in parts]
    version = hashlib.sha256(f"{kinds} {stamps} {Path(__file__).read_text()}".encode()).hexdigest()[:16]
    name = f"bound_{parts[0][0].__name__}_{version}"
    arguments = ", ".join(["table", *(f"later_{i}" for i in range(most))])
    source = f"def {name}({arguments}):\n" + "".join(f"    {line}\n" for line in body)
    exec(compile(source, parts[0][0].py_func.__code__.co_filename, "exec"), known)
    return jit(known[name])


def _calls(parts: tuple[Part, ...], known: dict[str, Any]) -> Iterator[str]:
    """The source of each kernel's call; what it names is added to `known`."""
    at = 0
    for p, (kernel, kinds) in enumerate(parts):
        known[f"kernel_{p}"] = kernel
        passed, later = [], 0
        for i, kind in enumerate(kinds):
            if kind is None:
                passed.append(f"later_{later}")
                later += 1
                continue
            known[f"read_{p}_{i}"] = _reader(kind)
            passed.append(f"read_{p}_{i}(table + {at})")
            at += _FIELD * (1 + kind.ndim if isinstance(kind, types.Array) else 1)
        yield f"kernel_{p}({', '.join(passed)})"


def _in_turn(calls: list[str]) -> list[str]:
    lines = []
    for call in calls:
        lines += [f"if not went_well({call}):", "    return False"]
    return [*lines, "return True"]


@inline
def _went_well(result):
    """Whether a chain goes on after a kernel's result; one that returns nothing always does well."""
    return True if result is None else result


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
