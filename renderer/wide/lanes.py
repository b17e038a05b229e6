"""Calls of scalar functions lane by lane, for code that is not worth vectorising."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from renderer.bvh.simd import LANES, f32x8, mask8
from renderer.wide.operators import is_wide, u32x8

__all__ = ["each_lane"]

_I1, _I8, _I32 = ir.IntType(1), ir.IntType(8), ir.IntType(32)
_NUMBERS: dict[types.Type, types.Type] = {f32x8: types.float32, u32x8: types.uint32, mask8: types.boolean}


@intrinsic
def each_lane(typingctx, function, wanted, arguments):
    """Calls function(*arguments) for each lane in the mask `wanted`, with that lane's values. Other lanes get 0 and False.

    Each number in the function's result (a number or nested tuples of numbers) becomes a value of eight lanes, integers as u32x8.
    For a single path `wanted` is a bool, and the function's result is returned unchanged.
    """
    wide = is_wide(wanted)
    plain = tuple(_mapped(kind, _scalar_type) if wide else kind for kind in arguments)
    call = function.get_call_type(typingctx, plain, {})
    result = _mapped(call.return_type, _lanes_type) if wide else call.return_type

    def codegen(context, builder, sig, args):
        target = context.get_function(function, call)
        context.add_linking_libs(getattr(target, "libs", ()))

        def called(values: list[Any]) -> Any:
            kinds = zip(plain, call.args, strict=True)
            return target(builder, [context.cast(builder, v, *pair) for v, pair in zip(values, kinds, strict=True)])

        values = [builder.extract_value(args[2], k) for k in range(len(plain))]
        if not wide:
            kept = cgutils.alloca_once_value(builder, ir.Constant(context.get_value_type(result), None))
            with builder.if_then(args[1]):
                builder.store(called(values), kept)
            return builder.load(kept)

        numbers = [_flatten(builder, *pair) for pair in zip(arguments, values, strict=True)]
        kept = [_memory(builder, kind) for kind in _number_types(result)]

        def at(lane: Any) -> None:
            given = []
            for kind, leaves in zip(plain, numbers, strict=True):
                own = (_extracted(builder, leaf, lane) for leaf in leaves)
                given.append(_tuple(context, builder, kind, own))
            for number, place in zip(_flatten(builder, call.return_type, called(given)), kept, strict=True):
                _store_lane(builder, number, place, lane)

        _each_bit(builder, args[1], at)
        vectors = (_load_lanes(builder, kind, place) for kind, place in zip(_number_types(result), kept, strict=True))
        return _tuple(context, builder, result, vectors)

    return result(function, wanted, arguments), codegen


def _is_tuple(kind: Any) -> bool:
    return isinstance(kind, types.Tuple | types.UniTuple)


def _scalar_type(kind: types.Type) -> types.Type:
    return _NUMBERS.get(kind, kind)


def _lanes_type(kind: types.Type) -> types.Type:
    if isinstance(kind, types.Integer):
        return u32x8
    return next(lanes for lanes, plain in _NUMBERS.items() if plain == kind)


def _mapped(kind: Any, change: Any) -> Any:
    """Returns the Numba type `kind` with `change` applied to each number type, including those nested in tuples."""
    return types.BaseTuple.from_types([_mapped(part, change) for part in kind]) if _is_tuple(kind) else change(kind)


def _number_types(kind: Any) -> list[types.Type]:
    return [leaf for part in kind for leaf in _number_types(part)] if _is_tuple(kind) else [kind]


def _flatten(builder: Any, kind: Any, value: Any) -> list[Any]:
    """Returns the numbers in a value's nested tuples, in order."""
    if not _is_tuple(kind):
        return [value]
    return [leaf for k, part in enumerate(kind) for leaf in _flatten(builder, part, builder.extract_value(value, k))]


def _tuple(context: Any, builder: Any, kind: Any, leaves: Iterator[Any]) -> Any:
    """Returns nested tuples of type `kind` that contain these numbers: the inverse of `_flatten`."""
    if not _is_tuple(kind):
        return next(leaves)
    return context.make_tuple(builder, kind, [_tuple(context, builder, part, leaves) for part in kind])


def _each_bit(builder: Any, mask: Any, at: Any) -> None:
    """Emits a loop that runs the code emitted by at(lane) for each lane set in the mask."""
    bits = builder.zext(builder.bitcast(mask, _I8), _I32)
    left = cgutils.alloca_once_value(builder, bits)
    test, body, end = (builder.append_basic_block(f"lanes.{name}") for name in ("test", "body", "end"))
    builder.branch(test)
    builder.position_at_end(test)
    now = builder.load(left)
    builder.cbranch(builder.icmp_unsigned("!=", now, _I32(0)), body, end)
    builder.position_at_end(body)
    at(builder.cttz(now, _I1(1)))
    builder.store(builder.and_(now, builder.sub(now, _I32(1))), left)
    builder.branch(test)
    builder.position_at_end(end)


def _extracted(builder: Any, leaf: Any, lane: Any) -> Any:
    """Returns one lane's value of `leaf`: an element of a vector, or `leaf` itself if it is a scalar, which all lanes share."""
    return builder.extract_element(leaf, lane) if isinstance(leaf.type, ir.VectorType) else leaf


def _element(kind: Any) -> ir.Type:
    return _I8 if kind == mask8 else kind.element


def _memory(builder: Any, kind: types.Type) -> Any:
    """Allocates eight zeroed numbers on the stack.

    If they were in registers, each lane's result would have to be blended with all others.
    """
    return cgutils.alloca_once_value(builder, ir.Constant(ir.VectorType(_element(kind), LANES), None))


def _store_lane(builder: Any, number: Any, place: Any, lane: Any) -> None:
    element = place.type.pointee.element
    if isinstance(element, ir.IntType):
        number = builder.trunc(number, element) if number.type.width > element.width else builder.zext(number, element)
    builder.store(number, builder.gep(builder.bitcast(place, element.as_pointer()), [lane]))


def _load_lanes(builder: Any, kind: types.Type, place: Any) -> Any:
    value = builder.load(place)
    return builder.trunc(value, ir.VectorType(_I1, LANES)) if kind == mask8 else value
