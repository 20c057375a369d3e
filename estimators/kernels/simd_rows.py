"""The inner loops of the left-looking update, in the vectors of `simd`: rows of P as they will be, and what joins them.

One after the other they write what the next one reads. A processor hands on a number that has just been stored only to
a load that lies within the store: so all of them, and no loop of the compiler's own choice of width, touch these rows.
Rows are those of the scratch W [.., >= n], contiguous; n is a multiple of `WIDTH`.
"""

from typing import Any

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from estimators.kernels.simd import ALIGN, FUSE, INDEX, VECTOR, WIDTH, load, splat, vector_pointer

STRIPS = (4, 1)  # vectors of columns that `offset_rows` sums up together: a sum waits for its own last product alone
NUMBER, PLACE = types.float64, types.intp


class _Value:
    """A vector (or a number in every place of one) that knows sums and products, for code that reads like formulas."""

    def __init__(self, builder: Any, value: Any) -> None:
        self.builder, self.value = builder, value

    def __mul__(self, other: "_Value") -> "_Value":
        return _Value(self.builder, self.builder.fmul(self.value, other.value, flags=FUSE))

    def __add__(self, other: "_Value") -> "_Value":
        return _Value(self.builder, self.builder.fadd(self.value, other.value, flags=FUSE))

    def __sub__(self, other: "_Value") -> "_Value":
        return _Value(self.builder, self.builder.fsub(self.value, other.value, flags=FUSE))


class _Rows:
    """Rows of a contiguous array of one matrix per lane, or of a single one."""

    def __init__(self, context: Any, builder: Any, kind: Any, array: Any, lane: Any = None) -> None:
        found = context.make_array(kind)(context, builder, array)
        shape = cgutils.unpack_tuple(builder, found.shape)
        self.builder, self.side, self.start = builder, shape[-1], found.data
        if lane is not None:
            size = builder.mul(shape[-1], shape[-2])
            self.start = builder.gep(found.data, [builder.mul(lane, size)])

    def line(self, row: Any, after: int = 0) -> Any:
        """Pointer to the beginning of row `row` + `after`."""
        return self.builder.gep(self.start, [self.builder.mul(self.builder.add(row, INDEX(after)), self.side)])

    def vector(self, line: Any, column: Any) -> _Value:
        return _Value(self.builder, load(self.builder, self.builder.gep(line, [column])))

    def number(self, line: Any, column: Any) -> _Value:
        return _Value(self.builder, splat(self.builder, self.builder.load(self.builder.gep(line, [column]))))

    def put(self, value: _Value, line: Any, column: Any) -> None:
        place = vector_pointer(self.builder, self.builder.gep(line, [column]))
        self.builder.store(value.value, place, align=ALIGN)


def _columns(builder: Any, n: Any) -> Any:
    """A loop over vectors of columns."""
    return cgutils.for_range_slice(builder, INDEX(0), n, INDEX(WIDTH), INDEX)


def _numbers(builder: Any, values: Any) -> list[_Value]:
    return [_Value(builder, splat(builder, value)) for value in values]


def _copy_row(typingctx, P, lane, i, W, row, n):
    """W[row] = P[lane, i]."""
    signature = types.void(P, PLACE, PLACE, W, PLACE, PLACE)

    def codegen(context, builder, sig, args):
        own = _Rows(context, builder, sig.args[0], args[0], args[1])
        scratch = _Rows(context, builder, sig.args[3], args[3])
        _, _, i, _, row, n = args
        source, goal = own.line(i), scratch.line(row)
        with _columns(builder, n) as (column, _):
            scratch.put(own.vector(source, column), goal, column)
        return context.get_dummy_value()

    return signature, codegen


copy_row: Any = intrinsic(_copy_row)


def _offset_rows(typingctx, P, lane, j, W, rows, n):
    """D P less what the rows collected take off, D = point - robot: two rows for the point at row j.

    W[rows + i] = P[lane, j + i] - P[lane, i] - sum_k (W[k, j + i] - W[k, i]) W[k].
    """
    signature = types.void(P, PLACE, PLACE, W, PLACE, PLACE)

    def codegen(context, builder, sig, args):
        own = _Rows(context, builder, sig.args[0], args[0], args[1])
        scratch = _Rows(context, builder, sig.args[3], args[3])
        _, _, j, _, rows, n = args
        done = INDEX(0)
        for vectors in STRIPS:
            size = vectors * WIDTH
            end = builder.sub(n, builder.srem(builder.sub(n, done), INDEX(size)))
            with cgutils.for_range_slice(builder, done, end, INDEX(size), INDEX) as (column, _):
                columns = [builder.add(column, INDEX(WIDTH * i)) for i in range(vectors)]
                _offset_strip(builder, own, j, scratch, rows, columns)
            done = end
        return context.get_dummy_value()

    return signature, codegen


offset_rows: Any = intrinsic(_offset_rows)


def _offset_strip(builder, own, j, scratch, rows, columns):
    """`offset_rows` for some vectors of columns."""
    sums = [[cgutils.alloca_once(builder, VECTOR) for _ in columns] for _ in range(2)]
    for i in range(2):
        point, robot = own.line(j, i), own.line(INDEX(i))
        for one, column in zip(sums[i], columns, strict=True):
            builder.store((own.vector(point, column) - own.vector(robot, column)).value, one)
    with cgutils.for_range(builder, rows, intp=INDEX) as loop:
        line = scratch.line(loop.index)
        across = [scratch.vector(line, column) for column in columns]
        for i in range(2):
            factor = scratch.number(line, builder.add(j, INDEX(i))) - scratch.number(line, INDEX(i))
            for one, other in zip(sums[i], across, strict=True):
                builder.store((_Value(builder, builder.load(one)) - factor * other).value, one)
    for i in range(2):
        for one, column in zip(sums[i], columns, strict=True):
            scratch.put(_Value(builder, builder.load(one)), scratch.line(rows, i), column)


def _measured_rows(typingctx, W, rows, turn, n, a00, a01, a10, a11, c0, c1):
    """H P, H = [-A, c, A], in the place of D P (`rows`, rows + 1); the heading's row of P is row `turn`."""
    signature = types.void(W, PLACE, PLACE, PLACE, *[NUMBER] * 6)

    def codegen(context, builder, sig, args):
        scratch = _Rows(context, builder, sig.args[0], args[0])
        _, rows, turn, n, *factors = args
        a00, a01, a10, a11, c0, c1 = _numbers(builder, factors)
        pair, heading = [scratch.line(rows, i) for i in range(2)], scratch.line(turn)
        with _columns(builder, n) as (column, _):
            dx, dy, phi = (scratch.vector(line, column) for line in (*pair, heading))
            scratch.put(a00 * dx + a01 * dy + c0 * phi, pair[0], column)
            scratch.put(a10 * dx + a11 * dy + c1 * phi, pair[1], column)
        return context.get_dummy_value()

    return signature, codegen


measured_rows: Any = intrinsic(_measured_rows)


def _whitened_rows(typingctx, x, x_lane, W, rows, turn, n, t0, t1, l10, e0, e1):
    """The two rows h of H P become w0 = t0 h0 and w1 = t1 (h1 - l10 w0), and what they change follows.

    x[x_lane] += e0 w0 + e1 w1; the heading's row `turn` loses w0[2] w0 + w1[2] w1.
    """
    signature = types.void(x, PLACE, W, PLACE, PLACE, PLACE, *[NUMBER] * 5)

    def codegen(context, builder, sig, args):
        mean, scratch = _Rows(context, builder, sig.args[0], args[0]), _Rows(context, builder, sig.args[2], args[2])
        _, x_lane, _, rows, turn, n, *factors = args
        t0, t1, l10, e0, e1 = _numbers(builder, factors)
        own, pair, heading = mean.line(x_lane), [scratch.line(rows, i) for i in range(2)], scratch.line(turn)
        u = scratch.number(pair[0], INDEX(2)) * t0
        v = (scratch.number(pair[1], INDEX(2)) - l10 * u) * t1
        with _columns(builder, n) as (column, _):
            w0 = scratch.vector(pair[0], column) * t0
            w1 = (scratch.vector(pair[1], column) - l10 * w0) * t1
            scratch.put(w0, pair[0], column)
            scratch.put(w1, pair[1], column)
            mean.put(mean.vector(own, column) + e0 * w0 + e1 * w1, own, column)
            scratch.put(scratch.vector(heading, column) - u * w0 - v * w1, heading, column)
        return context.get_dummy_value()

    return signature, codegen


whitened_rows: Any = intrinsic(_whitened_rows)
