"""Named tuples in memory: the fields of a tuple declare its layout, from which the functions to read and write it are generated.

A field's annotation is its kind. A tuple occupies the columns of a table row that its kinds need, in order. A tuple read from one
row contains plain numbers; one read from eight rows (u32x8) contains vectors of eight lanes.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple, get_type_hints

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from renderer.lane_types import f32x8, is_wide, mask8, u32x8
from renderer.wide.operators import FLOATS, INTS
from renderer.wide.rows import emit_gather, emit_scatter

__all__ = ["Flag", "Float", "Four", "Int", "Layout", "Pair", "Vector", "accessors", "columns_of", "is_integer", "width_of"]

_GROUP = 8  # columns that are read and written together
_I1, _I32, _I64 = ir.IntType(1), ir.IntType(32), ir.IntType(64)
_FLOAT = ir.FloatType()


class _Kind(NamedTuple):
    """The kind of a named tuple's field: how many columns the field occupies, and their type."""

    columns: int
    number: Any
    lanes: Any


_FLOATS = [_Kind(count, types.float32, f32x8) for count in range(5)]
_INT = _Kind(1, types.uint32, u32x8)
_FLAG = _Kind(0, types.boolean, mask8)  # successive flags share a column, a bit each
Float = Annotated[Any, _FLOATS[1]]
Pair = Annotated[Any, _FLOATS[2]]
Vector = Annotated[Any, _FLOATS[3]]
Four = Annotated[Any, _FLOATS[4]]
Int = Annotated[Any, _INT]  # 32 bits
Flag = Annotated[Any, _FLAG]


class _Place(NamedTuple):
    """The columns that a field occupies, relative to the first column of its tuple.

    bit: a flag's bit in its column; None for other kinds.
    """

    kind: _Kind
    column: int
    bit: int | None


def _places(declared: type) -> dict[str, _Place]:
    """Returns field name -> position for a named tuple."""
    places: dict[str, _Place] = {}
    column, bit = 0, 0
    for name, hint in get_type_hints(declared, include_extras=True).items():
        kind = next(each for each in hint.__metadata__ if isinstance(each, _Kind))
        if kind is _FLAG:
            places[name] = _Place(kind, column, bit)
            bit += 1
            continue
        column += bit > 0
        bit = 0
        places[name] = _Place(kind, column, None)
        column += kind.columns
    return places


def width_of(declared: type) -> int:
    """Returns the number of columns that a named tuple occupies, rounded up to a multiple of eight."""
    last = list(_places(declared).values())[-1]
    used = last.column + max(last.kind.columns, 1)
    return -(-used // _GROUP) * _GROUP


def columns_of(declared: type, field: str) -> range:
    """Returns the columns of a field of a named tuple, relative to the tuple's first column."""
    place = _places(declared)[field]
    return range(place.column, place.column + place.kind.columns)


def is_integer(declared: type, field: str) -> bool:
    """Returns True if a field of a named tuple is an `Int`."""
    return _places(declared)[field].kind is _INT


class Layout:
    """The assignment of a table row's columns to named tuples, which follow one another.

    Named tuples that are listed together, as a tuple of classes, begin at the same column: a row holds one of them at a time.
    """

    def __init__(self, *groups: type | tuple[type, ...]) -> None:
        self.first: dict[type, int] = {}
        self.width = 0
        for group in groups:
            shared = group if isinstance(group, tuple) else (group,)
            for declared in shared:
                self.first[declared] = self.width
            self.width += max(width_of(declared) for declared in shared)

    def column(self, declared: type, field: str) -> np.uintp:
        """Returns the index, in a table row, of the first column of the field `field` of the named tuple class `declared`."""
        return np.uintp(self.first[declared] + _places(declared)[field].column)


def _type_of(declared: Any, wide: bool) -> Any:
    """Returns the Numba type of the named tuple class `declared`: its fields are scalars or, if `wide`, eight-lane vectors."""
    fields = []
    for place in _places(declared).values():
        number = place.kind.lanes if wide else place.kind.number
        fields.append(types.UniTuple(number, place.kind.columns) if place.kind.columns > 1 else number)
    return types.BaseTuple.from_types(fields, declared)


def _decoded(builder: Any, place: _Place, columns: list[Any], wide: bool) -> list[Any]:
    """Emits code that converts the columns of a field, which are floats, to the field's numbers."""
    word = columns[place.column]
    if place.bit is not None:
        bits = builder.bitcast(word, INTS if wide else _I32)
        bit = 1 << place.bit
        mask = ir.Constant(INTS, [bit] * _GROUP) if wide else _I32(bit)
        return [builder.icmp_unsigned("!=", builder.and_(bits, mask), ir.Constant(bits.type, None))]
    if place.kind is _INT:
        return [builder.bitcast(word, INTS if wide else _I32)]
    return columns[place.column : place.column + place.kind.columns]


def _columns_of(context: Any, builder: Any, declared: Any, kind: Any, value: Any, wide: bool) -> list[Any]:
    """Emits code that converts a named tuple to its columns as floats, zeros in unused ones."""
    number, whole = (FLOATS, INTS) if wide else (_FLOAT, _I32)
    columns = [ir.Constant(number, None) for _ in range(width_of(declared))]
    flags: dict[int, Any] = {}
    for k, place in enumerate(_places(declared).values()):
        part, own = builder.extract_value(value, k), kind.types[k]
        if place.bit is not None:
            bit = ir.Constant(INTS, [1 << place.bit] * _GROUP) if wide else _I32(1 << place.bit)
            chosen = builder.select(_bool(builder, part), bit, ir.Constant(whole, None))
            flags[place.column] = builder.or_(flags[place.column], chosen) if place.column in flags else chosen
        elif place.kind is _INT:
            word = part if wide else context.cast(builder, part, own, types.uint32)
            columns[place.column] = builder.bitcast(word, number)
        elif place.kind.columns == 1:
            columns[place.column] = part if wide else context.cast(builder, part, own, types.float32)
        else:
            for i in range(place.kind.columns):
                columns[place.column + i] = builder.extract_value(part, i)
    for column, bits in flags.items():
        columns[column] = builder.bitcast(bits, number)
    return columns


def _bool(builder: Any, value: Any) -> Any:
    """Emits code that converts a bool, which Numba stores as a byte in tuples, to one bit."""
    return builder.trunc(value, _I1) if isinstance(value.type, ir.IntType) and value.type.width > 1 else value


def _addresses(
    context: Any, builder: Any, kind: Any, table: Any, row: Any, width: int, columns: range, row_major: bool
) -> list[Any]:
    """Emits code that computes the addresses of these columns of one row. kind: the table's type; row_major: see `accessors`."""
    array = context.make_array(kind)(context, builder, table)
    data = builder.bitcast(array.data, _FLOAT.as_pointer())
    row = builder.zext(row, _I64) if row.type.width < _I64.width else row
    if kind.ndim == 1 or row_major:
        first = builder.gep(data, [builder.add(builder.mul(row, _I64(width)), _I64(columns.start))])
        return [builder.gep(first, [_I64(k)]) for k in range(len(columns))]
    rows = builder.extract_value(array.shape, 1)
    return [builder.gep(data, [builder.add(builder.mul(rows, _I64(column)), row)]) for column in columns]


def accessors(layout: Layout, row_major: bool = False) -> tuple[Any, Any]:
    """Returns (gather, scatter) for table rows with this layout, to be called in kernels.

    gather(table, rows, Tuple) returns the named tuple of one row or of eight rows (u32x8) of a C-contiguous float32 table.
    scatter(table, rows, value) writes a tuple; if several lanes have the same row, the last lane is written last. Indices are not
    checked. A table of one dimension has its rows one after the other. One of two, (columns, rows), has its columns one after the
    other, so that the threads of a graphics card, a row each, read adjacent numbers; only single rows of it can be accessed.
    row_major: rows are one after the other in a table of two dimensions, too, counted from its first number on.
    """

    @intrinsic
    def gather(typingctx: Any, table: Any, rows: Any, declared: Any) -> Any:
        wide, named = is_wide(rows), declared.instance_class
        result, first, count = _type_of(named, wide), layout.first[named], width_of(named)

        def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            if wide:
                data = context.make_array(sig.args[0])(context, builder, args[0]).data
                columns = emit_gather(builder, data, args[1], _I64(layout.width), _I64(first), count)
            else:
                every = range(first, first + count)
                places = _addresses(context, builder, sig.args[0], args[0], args[1], layout.width, every, row_major)
                columns = [builder.load(each) for each in places]
            parts = []
            for place, kind in zip(_places(named).values(), result.types, strict=True):
                numbers = _decoded(builder, place, columns, wide)
                parts.append(context.make_tuple(builder, kind, numbers) if place.kind.columns > 1 else numbers[0])
            return context.make_tuple(builder, result, parts)

        return result(table, rows, declared), codegen

    @intrinsic
    def scatter(typingctx: Any, table: Any, rows: Any, value: Any) -> Any:
        wide, named = is_wide(rows), value.instance_class
        first = layout.first[named]

        def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            columns = _columns_of(context, builder, named, sig.args[2], args[2], wide)
            if wide:
                data = context.make_array(sig.args[0])(context, builder, args[0]).data
                for group in range(0, len(columns), _GROUP):
                    emit_scatter(builder, data, args[1], _I64(layout.width), _I64(first + group), columns[group : group + _GROUP])
            else:
                every = range(first, first + len(columns))
                places = _addresses(context, builder, sig.args[0], args[0], args[1], layout.width, every, row_major)
                for number, place in zip(columns, places, strict=True):
                    builder.store(number, place)
            return context.get_dummy_value()

        return types.void(table, rows, value), codegen

    return gather, scatter
