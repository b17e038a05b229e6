"""Sort keys of hits: distances whose last bits are replaced by the lane, so that the nearest is the minimum of eight integers."""

from __future__ import annotations

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from renderer.bvh.simd import LANES, f32x8, mask8
from renderer.jit import device

__all__ = ["greater_ints", "hit_keys", "key_limit", "keys_beyond", "masked", "minimum_key", "nearest", "nearest_of"]

_I32 = ir.IntType(32)
_FLOAT = ir.FloatType()
_KEYS = ir.VectorType(_I32, LANES)
_LANE = LANES - 1  # the bits of a key that hold its lane
_DONE = 2**31 - 1


@intrinsic
def hit_keys(typingctx, mask, distance):
    """Returns sort keys, an f32x8: the bits of non-negative distances with the lane number in the last three bits.

    As signed integers, the keys sort by distance. Lanes that the mask excludes get the greatest int32.
    """

    def codegen(context, builder, sig, args):
        distances = builder.and_(builder.bitcast(args[1], _KEYS), ir.Constant(_KEYS, [-LANES] * LANES))
        keys = builder.or_(distances, ir.Constant(_KEYS, list(range(LANES))))
        return builder.bitcast(builder.select(args[0], keys, ir.Constant(_KEYS, [_DONE] * LANES)), args[1].type)

    return f32x8(mask8, f32x8), codegen


def _minimum_of_lanes(builder, values):
    function = ir.FunctionType(_I32, [_KEYS])
    return builder.call(
        cgutils.get_or_insert_function(builder.module, function, f"llvm.vector.reduce.smin.v{LANES}i32"), [values]
    )


def _broadcast(builder, value):
    """Returns an integer broadcast to all lanes."""
    nothing = ir.Constant(_KEYS, ir.Undefined)
    return builder.shuffle_vector(
        builder.insert_element(nothing, value, ir.Constant(_I32, 0)), nothing, ir.Constant(_KEYS, [0] * LANES)
    )


@intrinsic
def minimum_key(typingctx, keys):
    """Returns the minimum, an int32, of sort keys from `hit_keys`."""
    return types.int32(keys), lambda context, builder, sig, args: _minimum_of_lanes(builder, builder.bitcast(args[0], _KEYS))


@intrinsic
def keys_beyond(typingctx, keys, key):
    """Returns the sort keys with those not greater than `key` replaced by the greatest int32."""

    def codegen(context, builder, sig, args):
        values = builder.bitcast(args[0], _KEYS)
        further = builder.icmp_signed(">", values, _broadcast(builder, args[1]))
        kept = builder.select(further, values, ir.Constant(_KEYS, [_DONE] * LANES))
        return builder.bitcast(kept, args[0].type)

    return f32x8(f32x8, types.int32), codegen


@intrinsic
def greater_ints(typingctx, numbers, number):
    """Returns a mask of the lanes whose int32 (stored as bits in an f32x8) is greater than `number`."""

    def codegen(context, builder, sig, args):
        return builder.icmp_signed(">", builder.bitcast(args[0], _KEYS), _broadcast(builder, args[1]))

    return mask8(f32x8, types.int32), codegen


@intrinsic
def key_limit(typingctx, distance):
    """Returns the greatest key of a non-negative distance, a float32. Any greater key belongs to a larger distance."""

    def codegen(context, builder, sig, args):
        return builder.or_(builder.bitcast(args[0], _I32), _I32(_LANE))

    return types.int32(types.float32), codegen


@intrinsic
def masked(typingctx, mask, distance):
    """Returns the distances, f32x8, with a NaN that sorts above all of them in lanes that the mask excludes."""

    def codegen(context, builder, sig, args):
        none = ir.Constant(_KEYS, [_DONE] * LANES)
        return builder.bitcast(builder.select(args[0], builder.bitcast(args[1], _KEYS), none), args[1].type)

    return f32x8(mask8, f32x8), codegen


@intrinsic
def nearest_of(typingctx, distances):
    """Returns (minimum of positive distances from `masked`, the first lane with that distance)."""

    def codegen(context, builder, sig, args):
        values = builder.bitcast(args[0], _KEYS)
        value = _minimum_of_lanes(builder, values)
        found = builder.icmp_signed("==", values, _broadcast(builder, value))
        lane = builder.cttz(builder.zext(builder.bitcast(found, ir.IntType(LANES)), _I32), ir.Constant(ir.IntType(1), 1))
        return context.make_tuple(builder, sig.return_type, [builder.bitcast(value, _FLOAT), lane])

    return types.Tuple((types.float32, types.uint32))(distances), codegen


@device
def nearest(mask, distance):
    """Returns (minimum of the positive distances in the mask's lanes, the first lane with that distance)."""
    return nearest_of(masked(mask, distance))
