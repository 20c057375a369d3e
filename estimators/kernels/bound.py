"""Call kernels again and again with the same arrays, for a quarter of a microsecond whatever their number.

numba takes every array of a call apart anew, some 0.08 us each, and a structured one costs 0.3 us and more. `bind`
writes the kernel's address, the arrays that stay, word by word as numba passes them, and the numbers into one table; a
small caller hands them on to the kernel. `chain` makes one such call of several. What runs is the machine code that
Python calls too, not a copy: LLVM would optimise that beside other code, and the last bit of a result could differ.
"""

import hashlib
import importlib
from collections.abc import Iterable
from functools import cache, partial
from pathlib import Path
from typing import Any

import numba
import numpy as np
from llvmlite import ir  # type: ignore[import-untyped, unused-ignore]
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from estimators.kernels.jit import inline, jit
from estimators.kernels.simd import aligned_zeros
from estimators.kernels.subroutines import Subroutine


class _Later:
    """The kind of `LATER`, which is one object wherever it is unpickled."""

    def __reduce__(self) -> str:
        return "LATER"

    def __deepcopy__(self, memo: Any) -> "_Later":
        return self


LATER: Any = _Later()
"""Among the arguments of `bind`: the lanes [n], int64 and contiguous, which are given at each call."""
_LANES = types.int64[::1]

_WORD = ir.IntType(64)
_FIELD = 8  # bytes of a table's field
_ARRAY = ("meminfo", "parent", "nitems", "itemsize", "data")  # of numba's, before shape and strides
_NOBODYS = (0, 0)  # what is bound needs no owner: `Bound` keeps it

Part = tuple[Any, tuple[Any, ...]]  # a kernel and its arguments
Call = tuple[Any, Any, tuple[Any, ...]]  # a kernel, the type of its result, those of its arguments: None for the lanes


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
    """The kernel with its arguments, but for `LATER`: the lanes, given at each call. It is compiled at once.

    Args:
        kernel: a `@jit` function at the top level of its module, or a `@subroutine`.
        arguments: contiguous arrays, which are kept alive and must not be replaced; integers, floats, booleans.

    Raises:
        ValueError: an array that is not contiguous.
    """
    return _bind(((kernel, arguments),))


def chain(*calls: Bound) -> Bound:
    """Bound kernels one after the other, as one call; it returns whether all of them ran.

    A kernel that returns False is the last to run. All take the same lanes.
    """
    return _bind(tuple(part for call in calls for part in call.parts))


def _copy(array: Any) -> Any:
    own = aligned_zeros(*array.shape) if array.dtype == np.float64 else np.empty_like(array)
    own[...] = array
    return own


def _bind(parts: tuple[Part, ...]) -> Bound:
    fields: list[int] = []
    calls = []
    for kernel, arguments in parts:
        kinds = tuple(map(_kind, arguments))
        address, result = _compiled(kernel, kinds)
        fields += [address, *(field for argument in arguments for field in _fields(argument))]
        calls.append((kernel, result, kinds))
    table = np.array(fields, dtype=np.int64)
    bound = Bound(_caller(tuple(calls)), int(table.ctypes.data))
    bound.parts, bound.table = parts, table
    return bound


def _compiled(kernel: Any, kinds: tuple[Any, ...]) -> tuple[int, Any]:
    """A kernel's address for arguments of these types, and the type of its result."""
    kernel = kernel.as_kernel if isinstance(kernel, Subroutine) else kernel
    passed = _passed(kinds)
    kernel.compile(passed)
    found = kernel.overloads[passed]
    return found.library.get_pointer_to_function(found.fndesc.llvm_func_name), found.signature.return_type


def _bind_again(named: tuple[tuple[str, str, tuple[Any, ...]], ...]) -> Bound:
    return _bind(tuple((getattr(importlib.import_module(module), name), rest) for module, name, rest in named))


def _kind(argument: Any) -> Any:
    """Numba's type of an argument; None for the lanes, which are in no table."""
    return None if argument is LATER else numba.typeof(argument)


def _passed(kinds: tuple[Any, ...]) -> tuple[Any, ...]:
    """The types that the kernel is called with."""
    return tuple(_LANES if kind is None else kind for kind in kinds)


def _fields(argument: Any) -> list[int]:
    """An argument's entries in the table: of an array all words that numba passes, in their order, or the number."""
    if argument is LATER:
        return []
    if isinstance(argument, np.ndarray):
        if not argument.flags.c_contiguous:
            raise ValueError("bind needs contiguous arrays; got one that is not: bind a copy")
        return [*_NOBODYS, argument.size, argument.itemsize, argument.ctypes.data, *argument.shape, *argument.strides]
    return [int(np.float64(argument).view(np.int64)) if isinstance(argument, float) else int(argument)]


@cache
def _caller(calls: tuple[Call, ...]) -> Any:
    """The small kernel: (address of a table, lanes) -> the result of the call, or the chain.

    Its name tells all kinds and this file's version apart, and it counts as part of the first kernel's file, so that
    the cache on disk holds for it as for any other.
    """
    known: dict[str, Any] = {"__name__": __name__, "went_well": _went_well}
    written, at = [], 0
    for p, (_, result, kinds) in enumerate(calls):
        known[f"call_{p}"] = intrinsic(_call(result, kinds))
        written.append(f"call_{p}(table + {at}, lanes)")
        at += _FIELD * (1 + sum(map(_size, kinds)))
    body = [f"return {written[0]}"] if len(written) == 1 else _in_turn(written)
    first = calls[0][0]
    told = [(kernel.__name__, *rest) for kernel, *rest in calls]
    version = hashlib.sha256(f"{told} {Path(__file__).read_text()}".encode()).hexdigest()[:16]
    name = f"bound_{first.__name__}_{version}"
    source = f"def {name}(table, lanes):\n" + "".join(f"    {line}\n" for line in body)
    exec(compile(source, first.py_func.__code__.co_filename, "exec"), known)
    return jit(known[name])


def _in_turn(calls: list[str]) -> list[str]:
    lines = []
    for call in calls:
        lines += [f"if not went_well({call}):", "    return False"]
    return [*lines, "return True"]


@inline
def _went_well(result):
    """Whether a chain goes on after a kernel's result; one that returns nothing always does well."""
    return True if result is None else result


def _call(result: Any, kinds: tuple[Any, ...]) -> Any:
    """The intrinsic that calls the kernel whose address and arguments a table holds."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        table, lanes = args
        passed, at = [], _FIELD
        for kind in kinds:
            passed.append(lanes if kind is None else _read(context, builder, kind, builder.add(table, _WORD(at))))
            at += _FIELD * _size(kind)
        convention, types_passed = context.call_conv, _passed(kinds)
        kernel_type = convention.get_function_type(result, types_passed)
        kernel = builder.inttoptr(_field(builder, table), kernel_type.as_pointer())
        status, value = convention.call_function(builder, kernel, result, types_passed, passed)
        with cgutils.if_unlikely(builder, status.is_error):
            convention.return_status_propagate(builder, status)
        return value

    return lambda typingctx, table, lanes: (result(types.int64, _LANES), generate)


def _size(kind: Any) -> int:
    """Fields that an argument takes in the table."""
    if kind is None:
        return 0
    return len(_ARRAY) + 2 * kind.ndim if isinstance(kind, types.Array) else 1


def _field(builder: Any, address: Any, index: int = 0, kind: Any = _WORD) -> Any:
    pointer = builder.inttoptr(address, kind.as_pointer())
    return builder.load(builder.gep(pointer, [_WORD(index)]))


def _read(context: Any, builder: Any, kind: Any, address: Any) -> Any:
    """An argument back from its fields."""
    if isinstance(kind, types.Array):
        return _read_array(context, builder, kind, address)
    if kind == types.float64:
        return _field(builder, address, kind=ir.DoubleType())
    return context.cast(builder, _field(builder, address), types.int64, kind)


def _read_array(context: Any, builder: Any, kind: Any, address: Any) -> Any:
    array = context.make_array(kind)(context, builder)
    n, axes = len(_ARRAY), range(kind.ndim)
    for i, name in enumerate(_ARRAY):
        word = _field(builder, address, i)
        wanted = getattr(array, name).type
        setattr(array, name, builder.inttoptr(word, wanted) if isinstance(wanted, ir.PointerType) else word)
    array.shape = cgutils.pack_array(builder, [_field(builder, address, n + i) for i in axes])
    array.strides = cgutils.pack_array(builder, [_field(builder, address, n + kind.ndim + i) for i in axes])
    return array._getvalue()
