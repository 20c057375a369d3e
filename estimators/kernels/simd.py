"""The one inner loop that the compiler's own vectoriser leaves slow: a symmetric rank-2 change of P.

Numba vectorises it too, but checks each row anew whether P and W overlap; written out in vectors of eight it takes
about half the time (on processors with AVX-512 less). LLVM splits the vectors where the processor's are narrower.
"""

from typing import Any

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped, unused-ignore]
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

WIDTH = 8  # numbers in a vector: P's rows come in blocks of as many
_DOUBLE, _INDEX = ir.DoubleType(), ir.IntType(64)
_VECTOR = ir.VectorType(_DOUBLE, WIDTH)
_ALIGN = 8  # bytes: of a double, not of a vector
_FUSE = ("contract",)
CACHE_LINE = 64  # bytes


def aligned_zeros(*shape):
    """Zeros that begin at a cache line, so that no vector of a whole block straddles two."""
    size = int(np.prod(shape))
    raw = np.zeros(size + CACHE_LINE // 8)
    start = -raw.ctypes.data % CACHE_LINE // 8
    return raw[start : start + size].reshape(shape)


def _add_outer(typingctx, P, lane, n, W, sign_0, sign_1):
    """P[lane, :n, :n] += sign_0 W[0] W[0]' + sign_1 W[1] W[1]'; n a multiple of `WIDTH`, signs +1.0 or -1.0.

    Every element sums the same products in the same order, so a symmetric P stays symmetric to the last bit.

    Args:
        P: [L, n_max, n_max], W: [>= 2, >= n], both contiguous.
    """
    signature = types.void(P, types.intp, types.intp, W, types.float64, types.float64)

    def codegen(context, builder, sig, args):
        p_array = context.make_array(sig.args[0])(context, builder, args[0])
        w_array = context.make_array(sig.args[3])(context, builder, args[3])
        _, lane_value, n_value, _, *signs = args
        side = builder.extract_value(p_array.shape, 2)
        start = builder.gep(p_array.data, [builder.mul(lane_value, builder.mul(side, side))])
        second = builder.gep(w_array.data, [builder.extract_value(w_array.shape, 1)])
        rows = list(zip((w_array.data, second), signs, strict=True))
        whole = builder.and_(n_value, _INDEX(-2 * WIDTH))
        with cgutils.for_range_slice(builder, _INDEX(0), whole, _INDEX(2 * WIDTH), _INDEX) as (column, _):
            _add_strip(builder, start, side, n_value, column, rows, 2)
        with builder.if_then(builder.icmp_signed("<", whole, n_value)):
            _add_strip(builder, start, side, n_value, whole, rows, 1)
        return context.get_dummy_value()

    return signature, codegen


add_outer: Any = intrinsic(_add_outer)


def _add_strip(builder, start, side, n, column, rows, vectors):
    """All rows of `vectors` vectors of columns, from `column` on: what is across stays in registers."""
    columns = [builder.add(column, _INDEX(WIDTH * k)) for k in range(vectors)]
    across = [[_load(builder, builder.gep(row, [c])) for c in columns] for row, _ in rows]
    with cgutils.for_range(builder, n, intp=_INDEX) as loop:
        line = builder.mul(loop.index, side)
        factors = [
            _splat(builder, builder.fmul(sign, builder.load(builder.gep(row, [loop.index])))) for row, sign in rows
        ]
        for k, c in enumerate(columns):
            at = _vector_pointer(builder, builder.gep(start, [builder.add(line, c)]))
            value = builder.load(at, align=_ALIGN)
            for factor, other in zip(factors, across, strict=True):
                value = builder.fadd(value, builder.fmul(factor, other[k], flags=_FUSE), flags=_FUSE)
            builder.store(value, at, align=_ALIGN)


def _vector_pointer(builder, pointer):
    return builder.bitcast(pointer, _VECTOR.as_pointer())


def _load(builder, pointer):
    return builder.load(_vector_pointer(builder, pointer), align=_ALIGN)


def _splat(builder, scalar):
    """The same number in every place of a vector."""
    one = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), scalar, ir.IntType(32)(0))
    places = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), None)
    return builder.shuffle_vector(one, ir.Constant(_VECTOR, ir.Undefined), places)
