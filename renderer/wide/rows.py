"""Gathers and scatters of table rows, eight at a time: columns of eight arbitrary rows become vectors, and vectors become rows.

Each row is read contiguously, and the eight rows are transposed in registers, at half an instruction per number. AVX2's gathers
take three times as long on current processors.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from renderer.bvh.simd import LANES
from renderer.wide.operators import FLOATS, INTS, u32x8

__all__ = ["emit_gather", "emit_scatter", "gather_words", "load_ints"]

_I32, _I64 = ir.IntType(32), ir.IntType(64)
_FLOAT = ir.FloatType()
_QUARTET = ir.VectorType(_FLOAT, 4)
_PAIR = ir.VectorType(_FLOAT, 2)
_LOW, _HIGH = [0, 8, 1, 9, 4, 12, 5, 13], [2, 10, 3, 11, 6, 14, 7, 15]
_FIRST, _SECOND = [0, 1, 8, 9, 4, 5, 12, 13], [2, 3, 10, 11, 6, 7, 14, 15]
_LOWER, _UPPER = [0, 1, 2, 3, 8, 9, 10, 11], [4, 5, 6, 7, 12, 13, 14, 15]


def _shuffled(builder: Any, a: Any, b: Any, mask: list[int]) -> Any:
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_I32, len(mask)), mask))


def _quarters(builder: Any, rows: list[Any]) -> list[Any]:
    """Transposes four columns of eight table rows to four vectors of eight.

    rows[k]: row k in the lower half, row k + 4 in the upper half.
    """
    a, b = _shuffled(builder, rows[0], rows[1], _LOW), _shuffled(builder, rows[0], rows[1], _HIGH)
    c, d = _shuffled(builder, rows[2], rows[3], _LOW), _shuffled(builder, rows[2], rows[3], _HIGH)
    pairs = ((a, c, _FIRST), (a, c, _SECOND), (b, d, _FIRST), (b, d, _SECOND))
    return [_shuffled(builder, x, y, mask) for x, y, mask in pairs]


def _transposed(builder: Any, rows: list[Any]) -> list[Any]:
    """Returns the columns of an 8x8 matrix given by its rows."""
    lower = [_shuffled(builder, rows[k], rows[k + 4], _LOWER) for k in range(4)]
    upper = [_shuffled(builder, rows[k], rows[k + 4], _UPPER) for k in range(4)]
    return _quarters(builder, lower) + _quarters(builder, upper)


def _pointers(builder: Any, data: Any, index: Any, width: Any, first: Any) -> list[Any]:
    """Returns pointers to column `first` of each of the eight table rows `index`."""
    data = builder.bitcast(data, _FLOAT.as_pointer())
    offsets = []
    for lane in range(LANES):
        row = builder.zext(builder.extract_element(index, _I32(lane)), _I64)
        offsets.append(builder.gep(data, [builder.add(builder.mul(row, width), first)]))
    return offsets


def _piece(builder: Any, pointer: Any, kind: ir.Type) -> Any:
    value = builder.load(builder.bitcast(pointer, kind.as_pointer()))
    value.align = 4
    return value


def _quartet(builder: Any, pointer: Any, count: int) -> Any:
    """Emits code that loads `count` (2 to 4) float32 as a vector of four, and reads no memory after them."""
    if count == 4:
        return _piece(builder, pointer, _QUARTET)
    undefined = ir.Constant(_PAIR, ir.Undefined)
    pair = _piece(builder, pointer, _PAIR)
    four = _shuffled(builder, pair, undefined, [0, 1, 2, 2])
    if count == 3:
        third = builder.load(builder.gep(pointer, [_I64(2)]))
        four = builder.insert_element(four, third, _I32(2))
    return four


def emit_gather(builder: Any, data: Any, index: Any, width: Any, first: Any, count: int) -> list[Any]:
    """Emits code that loads columns of eight table rows; returns `count` vectors of eight, from column `first` on.

    index: the rows' numbers, u32x8. data: pointer to the table, of 32-bit numbers. width: the table's number of columns.
    """
    if count == 1:
        undefined = ir.Constant(FLOATS, ir.Undefined)
        vector = undefined
        for lane, pointer in enumerate(_pointers(builder, data, index, width, first)):
            vector = builder.insert_element(vector, builder.load(pointer), _I32(lane))
        return [vector]
    if count in (2, 3, 4):
        four = [_quartet(builder, pointer, count) for pointer in _pointers(builder, data, index, width, first)]
        return _quarters(builder, [_shuffled(builder, four[k], four[k + 4], list(range(8))) for k in range(4)])[:count]
    if count < LANES:
        rest = emit_gather(builder, data, index, width, builder.add(first, _I64(4)), count - 4)
        return emit_gather(builder, data, index, width, first, 4) + rest
    eight = _transposed(builder, [_piece(builder, p, FLOATS) for p in _pointers(builder, data, index, width, first)])
    if count == LANES:
        return eight
    return eight + emit_gather(builder, data, index, width, builder.add(first, _I64(LANES)), count - LANES)


def emit_scatter(builder: Any, data: Any, index: Any, width: Any, first: Any, columns: list[Any]) -> None:
    """Emits code that stores eight vectors of eight into the columns from `first` on of eight table rows; see `emit_gather`."""
    rows = _transposed(builder, columns)
    for pointer, row in zip(_pointers(builder, data, index, width, first), rows, strict=True):
        builder.store(row, builder.bitcast(pointer, FLOATS.as_pointer())).align = 4


@intrinsic
def load_ints(typingctx, array, index):
    """Loads eight integers of a C-contiguous array of 32-bit integers, starting at its flat element `index`: u32x8. Unchecked."""

    def codegen(context, builder, sig, args):
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        return _piece(builder, builder.gep(data, [args[1]]), INTS)

    return u32x8(array, types.uintp), codegen


@intrinsic
def gather_words(typingctx, table, index):
    """Gathers the rows `index` (u32x8) of a C-contiguous (N, 4) uint8 table as words, first byte lowest: u32x8. Unchecked."""

    def codegen(context, builder, sig, args):
        data = builder.bitcast(context.make_array(sig.args[0])(context, builder, args[0]).data, _I32.as_pointer())
        vector = ir.Constant(INTS, ir.Undefined)
        for lane, pointer in enumerate(_pointers(builder, data, args[1], _I64(1), _I64(0))):
            word = builder.load(builder.bitcast(pointer, _I32.as_pointer()))
            word.align = 1
            vector = builder.insert_element(vector, word, _I32(lane))
        return vector

    return u32x8(table, u32x8), codegen
