"""Reads whole rows of a scene's tables without index checks.

Numba's own indexing checks each index for a negative value and loads the table's strides. A path reads about a hundred table
rows, and a sixth of its instructions were spent on those checks and loads.

An index may also be a u32x8. Then each column is a vector of eight lanes: f32x8, or u32x8 for int32.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from renderer.bvh.simd import f32x8
from renderer.wide.operators import INTS, is_wide, u32x8
from renderer.wide.rows import emit_gather

__all__ = ["columns", "row"]

_WORD = ir.IntType(64)


def _index(builder, number):
    return builder.zext(number, _WORD) if number.type.width < _WORD.width else number


def _values(context, builder, sig, table, number, width, first, known=None):
    """Emits LLVM code that loads `width` consecutive values of a table row as a tuple, from column `first` on.

    known: `first` as a Python integer if it is a constant.
    """
    data = context.make_array(sig.args[0])(context, builder, table).data
    if is_wide(sig.args[1]):
        count = sig.return_type.count
        whole = count == 3 and known is not None and known + 4 <= width  # a single load is faster than two
        vectors = emit_gather(builder, data, number, _WORD(width), first, 4 if whole else count)[:count]
        if sig.args[0].dtype != types.float32:
            vectors = [builder.bitcast(vector, INTS) for vector in vectors]
        return context.make_tuple(builder, sig.return_type, vectors)
    start = builder.add(builder.mul(_index(builder, number), _WORD(width)), first)
    values = []
    for k in range(sig.return_type.count):
        value = builder.load(builder.gep(data, [builder.add(start, _WORD(k))]))
        # The scene is constant during rendering, so repeated loads can be merged.
        value.set_metadata("invariant.load", builder.module.add_metadata([]))
        values.append(value)
    return context.make_tuple(builder, sig.return_type, values)


def _number(table, index):
    """Returns the Numba type of an element loaded from the table: a scalar, or eight lanes if `index` is a vector."""
    if not is_wide(index):
        return table.dtype
    return f32x8 if table.dtype == types.float32 else u32x8


@intrinsic(prefer_literal=True)
def row(typingctx, table, number, width):
    """Returns a whole row of one of the scene's C-contiguous tables as a tuple.

    number: the row's index, non-negative and not checked. width: the number of columns, a literal.
    """
    wide = width.literal_value

    def codegen(context, builder, sig, args):
        return _values(context, builder, sig, args[0], args[1], wide, _WORD(0))

    return types.UniTuple(_number(table, number), wide)(table, types.unliteral(number), width), codegen


@intrinsic(prefer_literal=True)
def columns(typingctx, table, number, width, first, count):
    """Returns `count` columns of a table row, from column `first` on, as a tuple; see `row`. width, count: literals."""
    wide = width.literal_value
    numbers = types.UniTuple(_number(table, number), count.literal_value)
    known = first.literal_value if isinstance(first, types.IntegerLiteral) else None

    def codegen(context, builder, sig, args):
        return _values(context, builder, sig, args[0], args[1], wide, _index(builder, args[3]), known)

    return numbers(table, types.unliteral(number), width, types.unliteral(first), count), codegen
