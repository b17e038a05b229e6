"""Keys: distances whose last bits tell the lane, in an f32x8, so that the nearest is the least of eight integers."""

from __future__ import annotations

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from renderer.bvh.simd import LANES, f32x8, mask8
from renderer.jit import device

__all__ = ["beyond", "exceeding", "key_limit", "least", "masked", "nearest", "nearest_of", "ranked"]

_I32 = ir.IntType(32)
_FLOAT = ir.FloatType()
_KEYS = ir.VectorType(_I32, LANES)
_LANE = LANES - 1  # the bits of a key that tell its lane
_DONE = 2**31 - 1


@intrinsic
def ranked(typingctx, mask, distance):
    """f32x8 of keys, one a lane: the bits of a distance not below 0, its last three the lane's number.

    As signed integers, they are in the distances' order. `NO_KEY` in lanes that the mask leaves out.
    """

    def codegen(context, builder, sig, args):
        distances = builder.and_(builder.bitcast(args[1], _KEYS), ir.Constant(_KEYS, [-LANES] * LANES))
        keys = builder.or_(distances, ir.Constant(_KEYS, list(range(LANES))))
        return builder.bitcast(builder.select(args[0], keys, ir.Constant(_KEYS, [_DONE] * LANES)), args[1].type)

    return f32x8(mask8, f32x8), codegen


def _least(builder, values):
    function = ir.FunctionType(_I32, [_KEYS])
    return builder.call(
        cgutils.get_or_insert_function(builder.module, function, f"llvm.vector.reduce.smin.v{LANES}i32"), [values]
    )


def _all(builder, value):
    """An integer in all lanes."""
    nothing = ir.Constant(_KEYS, ir.Undefined)
    return builder.shuffle_vector(
        builder.insert_element(nothing, value, ir.Constant(_I32, 0)), nothing, ir.Constant(_KEYS, [0] * LANES)
    )


@intrinsic
def least(typingctx, keys):
    """The least of the keys, an int32."""
    return types.int32(keys), lambda context, builder, sig, args: _least(builder, builder.bitcast(args[0], _KEYS))


@intrinsic
def beyond(typingctx, keys, key):
    """The keys without those up to `key`."""

    def codegen(context, builder, sig, args):
        values = builder.bitcast(args[0], _KEYS)
        further = builder.icmp_signed(">", values, _all(builder, args[1]))
        kept = builder.select(further, values, ir.Constant(_KEYS, [_DONE] * LANES))
        return builder.bitcast(kept, args[0].type)

    return f32x8(f32x8, types.int32), codegen


@intrinsic
def exceeding(typingctx, numbers, number):
    """Where one of the int32 whose bits an f32x8 keeps is greater than an int32."""

    def codegen(context, builder, sig, args):
        return builder.icmp_signed(">", builder.bitcast(args[0], _KEYS), _all(builder, args[1]))

    return mask8(f32x8, types.int32), codegen


@intrinsic
def key_limit(typingctx, distance):
    """The greatest key of a distance not below 0, a float32: keys above it are farther."""

    def codegen(context, builder, sig, args):
        return builder.or_(builder.bitcast(args[0], _I32), _I32(_LANE))

    return types.int32(types.float32), codegen


@intrinsic
def masked(typingctx, mask, distance):
    """The f32x8 of distances, and what is beyond all of them, NaN, in the lanes that the mask leaves out."""

    def codegen(context, builder, sig, args):
        none = ir.Constant(_KEYS, [_DONE] * LANES)
        return builder.bitcast(builder.select(args[0], builder.bitcast(args[1], _KEYS), none), args[1].type)

    return f32x8(mask8, f32x8), codegen


@intrinsic
def nearest_of(typingctx, distances):
    """(distance, lane): the least of what `masked` gives of positive distances; the first lane of equal ones."""

    def codegen(context, builder, sig, args):
        values = builder.bitcast(args[0], _KEYS)
        value = _least(builder, values)
        found = builder.icmp_signed("==", values, _all(builder, value))
        lane = builder.cttz(builder.zext(builder.bitcast(found, ir.IntType(LANES)), _I32), ir.Constant(ir.IntType(1), 1))
        return context.make_tuple(builder, sig.return_type, [builder.bitcast(value, _FLOAT), lane])

    return types.Tuple((types.float32, types.uint32))(distances), codegen


@device
def nearest(mask, distance):
    """(distance, lane): the least of the f32x8 of positive distances in the mask's lanes; the first lane of equal ones."""
    return nearest_of(masked(mask, distance))
