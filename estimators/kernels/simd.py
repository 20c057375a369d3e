"""The inner loops that the compiler's own vectoriser leaves slow: symmetric changes of P by outer products.

Numba vectorises them too, but checks each row anew whether P and W overlap; written out in vectors of eight they take
about half the time (on processors with AVX-512 less). LLVM splits the vectors where the processor's are narrower.
`add_outer` adds two products in one sweep over P; `subtract_rows` any number of them, a tile of P at a time, so that P
is read and written once: half the time again where P is larger than the first cache. `simd_rows` has the loops over
rows of W that the update itself is made of.
"""

from typing import Any

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped, unused-ignore]
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

WIDTH = 8  # numbers in a vector: P's rows come in blocks of as many
_DOUBLE, INDEX = ir.DoubleType(), ir.IntType(64)


def vector(size):
    """The type of a vector of so many numbers."""
    return ir.VectorType(_DOUBLE, size)


VECTOR = vector(WIDTH)
ALIGN = 8  # bytes: of a double, not of a vector
FUSE = ("contract",)
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
        whole = builder.and_(n_value, INDEX(-2 * WIDTH))
        with cgutils.for_range_slice(builder, INDEX(0), whole, INDEX(2 * WIDTH), INDEX) as (column, _):
            _add_strip(builder, start, side, n_value, column, rows, 2)
        with builder.if_then(builder.icmp_signed("<", whole, n_value)):
            _add_strip(builder, start, side, n_value, whole, rows, 1)
        return context.get_dummy_value()

    return signature, codegen


add_outer: Any = intrinsic(_add_outer)


def _add_strip(builder, start, side, n, column, rows, vectors):
    """All rows of `vectors` vectors of columns, from `column` on: what is across stays in registers."""
    columns = [builder.add(column, INDEX(WIDTH * k)) for k in range(vectors)]
    across = [[load(builder, builder.gep(row, [c])) for c in columns] for row, _ in rows]
    with cgutils.for_range(builder, n, intp=INDEX) as loop:
        line = builder.mul(loop.index, side)
        factors = [
            splat(builder, builder.fmul(sign, builder.load(builder.gep(row, [loop.index])))) for row, sign in rows
        ]
        for k, c in enumerate(columns):
            at = vector_pointer(builder, builder.gep(start, [builder.add(line, c)]))
            value = builder.load(at, align=ALIGN)
            for factor, other in zip(factors, across, strict=True):
                value = builder.fadd(value, builder.fmul(factor, other[k], flags=FUSE), flags=FUSE)
            builder.store(value, at, align=ALIGN)


def vector_pointer(builder, pointer, size=WIDTH):
    """The pointer to a number as one to a vector."""
    return builder.bitcast(pointer, vector(size).as_pointer())


def load(builder, pointer, size=WIDTH):
    """The vector that begins there."""
    return builder.load(vector_pointer(builder, pointer, size), align=ALIGN)


def splat(builder, scalar, size=WIDTH):
    """The same number in every place of a vector."""
    nothing = ir.Constant(vector(size), ir.Undefined)
    one = builder.insert_element(nothing, scalar, ir.IntType(32)(0))
    return builder.shuffle_vector(one, nothing, ir.Constant(ir.VectorType(ir.IntType(32), size), None))


PANEL = 64  # columns worked on together: their part of W stays in the first cache, and P comes by whole cache lines
TILE = 4  # rows of a tile, one vector wide: what four accumulators and a vector of W keep in sixteen registers


def _subtract_rows(typingctx, P, lane, n, W, minus, plus):
    """P[lane, :n, :n] -= sum W[k] W[k]' over the first `minus` rows, += over the next `plus`; n a multiple of `WIDTH`.

    Works on the lower triangle and mirrors it, so a symmetric P stays symmetric to the last bit.

    Args:
        P: [L, n_max, n_max], W: [>= minus + plus, >= n], both contiguous.
    """
    signature = types.void(P, types.intp, types.intp, W, types.intp, types.intp)

    def codegen(context, builder, sig, args):
        p_array = context.make_array(sig.args[0])(context, builder, args[0])
        w_array = context.make_array(sig.args[3])(context, builder, args[3])
        _, lane_value, n_value, _, minus_value, plus_value = args
        side, width = builder.extract_value(p_array.shape, 2), builder.extract_value(w_array.shape, 1)
        start = builder.gep(p_array.data, [builder.mul(lane_value, builder.mul(side, side))])
        ends = [(INDEX(0), minus_value, True), (minus_value, builder.add(minus_value, plus_value), False)]
        tile = _Tile(builder, start, side, w_array.data, width, ends)
        with cgutils.for_range_slice(builder, INDEX(0), n_value, INDEX(PANEL), INDEX) as (panel, _):
            right = builder.add(panel, INDEX(PANEL))
            with cgutils.for_range_slice(builder, panel, n_value, INDEX(TILE), INDEX) as (row, _):
                diagonal = builder.and_(row, INDEX(-WIDTH))
                within = builder.icmp_signed("<", diagonal, right)
                end = builder.select(within, diagonal, right)
                with cgutils.for_range_slice(builder, panel, end, INDEX(WIDTH), INDEX) as (column, _):
                    tile.subtract(row, column, WIDTH, mirrored=WIDTH)
                with builder.if_then(within):
                    upper = builder.icmp_signed("==", row, diagonal)
                    with builder.if_else(upper) as (then, otherwise):
                        with then:
                            tile.subtract(row, diagonal, TILE, mirrored=0)
                        with otherwise:
                            tile.subtract(row, diagonal, WIDTH, mirrored=TILE)
        return context.get_dummy_value()

    return signature, codegen


subtract_rows: Any = intrinsic(_subtract_rows)


class _Tile:
    """`TILE` rows of P, some columns wide, that lose and gain products of the rows of W: kept in registers meanwhile.

    ends: (first, end, whether they are taken off) of the runs of rows of W.
    """

    def __init__(self, builder: Any, start: Any, side: Any, rows: Any, width: Any, ends: Any) -> None:
        self.builder, self.start, self.side, self.rows, self.width, self.ends = builder, start, side, rows, width, ends
        self.kept = {size: [cgutils.alloca_once(builder, vector(size)) for _ in range(TILE)] for size in (TILE, WIDTH)}

    def subtract(self, row: Any, column: Any, size: int, mirrored: int) -> None:
        """The tile at (row, column), `size` columns wide, the first `mirrored` of which are written to P's rows too."""
        builder, kept = self.builder, self.kept[size]
        places = [vector_pointer(builder, self._place(row, i, column), size) for i in range(TILE)]
        for one, place in zip(kept, places, strict=True):
            builder.store(builder.load(place, align=ALIGN), one)
        for first, end, negative in self.ends:
            self._add_products(kept, row, column, size, first, end, negative)
        values = [builder.load(one) for one in kept]
        for value, place in zip(values, places, strict=True):
            builder.store(value, place, align=ALIGN)
        self._store_transposed(values, row, column, mirrored)

    def _place(self, row: Any, after: int, column: Any) -> Any:
        builder = self.builder
        line = builder.mul(builder.add(row, INDEX(after)), self.side)
        return builder.gep(self.start, [builder.add(line, column)])

    def _add_products(self, kept: Any, row: Any, column: Any, size: int, first: Any, end: Any, negative: bool) -> None:
        """kept[i] -= or += W[k, row + i] W[k, column ...] over the rows k of W from `first` to `end`."""
        builder = self.builder
        with cgutils.for_range_slice(builder, first, end, INDEX(1), INDEX) as (k, _):
            line = builder.gep(self.rows, [builder.mul(k, self.width)])
            across = load(builder, builder.gep(line, [column]), size)
            if negative:
                across = builder.fneg(across)
            for i, one in enumerate(kept):
                factor = splat(builder, builder.load(builder.gep(line, [builder.add(row, INDEX(i))])), size)
                product = builder.fmul(factor, across, flags=FUSE)
                builder.store(builder.fadd(builder.load(one), product, flags=FUSE), one)

    def _store_transposed(self, values: Any, row: Any, column: Any, count: int) -> None:
        """The tile's mirror image: column q of the tile becomes `TILE` numbers of P's row column + q."""
        builder, places = self.builder, ir.IntType(32)
        for q in range(count):
            line: Any = ir.Constant(vector(TILE), ir.Undefined)
            for i, value in enumerate(values):
                line = builder.insert_element(line, builder.extract_element(value, places(q)), places(i))
            builder.store(line, vector_pointer(builder, self._place(column, q, row), TILE), align=ALIGN)
