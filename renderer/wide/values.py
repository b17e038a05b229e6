"""Selections, integers and table look-ups for formulas that accept float32 or f32x8.

An integer is an intp for one path and a u32x8 for eight; a condition is a bool or a mask8.
"""

from __future__ import annotations

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from renderer.bvh.simd import LANES, f32x8, f64x8, mask8
from renderer.jit import device
from renderer.wide.operators import FLOATS, INTS, called, is_wide, lifted, u32x8

__all__ = [
    "any_of",
    "as_floats",
    "as_ints",
    "as_wide",
    "as_wide3",
    "double",
    "lookup",
    "not_",
    "rint",
    "single",
    "to_float",
    "to_int",
    "u32",
    "where",
    "where3",
    "zero_like",
]

_I32 = ir.IntType(32)


@intrinsic
def where(typingctx, mask, a, b):
    """Returns `a` where the mask is set, else `b`. Both are evaluated, without a branch."""
    wide = next((kind for kind in (a, b) if is_wide(kind)), None)
    if wide is None:
        wide = a if not is_wide(mask) else {types.float32: f32x8, types.uint32: u32x8, types.boolean: mask8}[a]

    def codegen(context, builder, sig, args):
        choice, x, y = args
        if is_wide(sig.return_type):
            x, y = lifted(builder, sig.args[1], x), lifted(builder, sig.args[2], y)
        value = builder.select(choice, x, y)
        if not is_wide(sig.args[0]):
            value.set_metadata("unpredictable", builder.module.add_metadata([]))
        return value

    return wide(mask, a, b), codegen


@device
def where3(mask, a, b):
    """Returns `a` where the mask is set, else `b`, for each component of 3-vectors."""
    return where(mask, a[0], b[0]), where(mask, a[1], b[1]), where(mask, a[2], b[2])


@intrinsic
def any_of(typingctx, mask):
    """Returns True if the mask is set in any lane: a bool on which to branch."""

    def codegen(context, builder, sig, args):
        if not is_wide(sig.args[0]):
            return args[0]
        lanes = ir.IntType(LANES)
        return builder.icmp_unsigned("!=", builder.bitcast(args[0], lanes), lanes(0))

    return types.boolean(mask), codegen


@intrinsic
def not_(typingctx, mask):
    """Returns the logical negation of a mask."""
    return mask(mask), lambda context, builder, sig, args: builder.not_(args[0])


@intrinsic
def rint(typingctx, a):
    """Returns the nearest integer, as a float; ties to even."""
    return a(a), lambda context, builder, sig, args: called(builder, "rint", args[0])


@intrinsic
def to_int(typingctx, a):
    """Converts a float to an integer by truncation. Lanes must be within the range of int32."""

    def codegen(context, builder, sig, args):
        return builder.fptosi(args[0], INTS if is_wide(sig.args[0]) else ir.IntType(64))

    return (u32x8 if is_wide(a) else types.intp)(a), codegen


@intrinsic
def to_float(typingctx, a):
    """Converts an integer to a float. Lanes contain int32; scalars may be any integer."""

    def codegen(context, builder, sig, args):
        kind = sig.args[0]
        if is_wide(kind):
            return builder.sitofp(args[0], FLOATS)
        return (builder.sitofp if kind.signed else builder.uitofp)(args[0], ir.FloatType())

    return (f32x8 if is_wide(a) else types.float32)(a), codegen


@intrinsic
def u32(typingctx, a):
    """Converts a scalar integer to uint32; returns a u32x8 unchanged."""

    def codegen(context, builder, sig, args):
        return args[0] if is_wide(sig.args[0]) else context.cast(builder, args[0], sig.args[0], types.uint32)

    return (a if is_wide(a) else types.uint32)(a), codegen


@intrinsic
def zero_like(typingctx, a):
    """Returns 0 in the type of a."""
    return a(a), lambda context, builder, sig, args: ir.Constant(args[0].type, None)


@intrinsic
def as_wide(typingctx, number, like):
    """Broadcasts a float32, uint32 or bool to eight lanes if `like` has eight lanes; else returns it unchanged."""
    wide = is_wide(like)
    result = {types.float32: f32x8, types.uint32: u32x8, types.boolean: mask8}[number] if wide else number

    def codegen(context, builder, sig, args):
        return lifted(builder, sig.args[0], args[0]) if wide else args[0]

    return result(number, like), codegen


@device
def as_wide3(vector, like):
    """Broadcasts each component of a 3-vector to eight lanes if `like` has eight lanes; else returns the vector unchanged."""
    return as_wide(vector[0], like), as_wide(vector[1], like), as_wide(vector[2], like)


@intrinsic
def double(typingctx, a):
    """Converts a float32, or eight of them, to double precision."""
    wide = is_wide(a)

    def codegen(context, builder, sig, args):
        return builder.fpext(args[0], ir.VectorType(ir.DoubleType(), LANES) if wide else ir.DoubleType())

    return (f64x8 if wide else types.float64)(a), codegen


@intrinsic
def single(typingctx, a):
    """Rounds a double, or eight of them, to float32."""
    wide = is_wide(a)

    def codegen(context, builder, sig, args):
        return builder.fptrunc(args[0], FLOATS if wide else ir.FloatType())

    return (f32x8 if wide else types.float32)(a), codegen


@intrinsic
def as_ints(typingctx, a):
    """Reinterprets the bits of a float32 as uint32, or of an f32x8 as u32x8."""

    def codegen(context, builder, sig, args):
        return builder.bitcast(args[0], INTS if is_wide(sig.args[0]) else _I32)

    return (u32x8(f32x8) if is_wide(a) else types.uint32(types.float32)), codegen


@intrinsic
def as_floats(typingctx, a):
    """Reinterprets the bits of a uint32 as float32, or of a u32x8 as f32x8."""

    def codegen(context, builder, sig, args):
        return builder.bitcast(args[0], FLOATS if is_wide(sig.args[0]) else ir.FloatType())

    return (f32x8(u32x8) if is_wide(a) else types.float32(types.uint32)), codegen


@intrinsic
def lookup(typingctx, table, index):
    """Returns elements of a C-contiguous float32 or int32 table at a flat index, which is not checked.

    Returns float32 or int32 for a scalar index. For a u32x8 index returns an f32x8, or integers as the bits of a u32x8.
    """
    wide = is_wide(index)
    element = table.dtype
    result = (f32x8 if element == types.float32 else u32x8) if wide else element

    def codegen(context, builder, sig, args):
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        if not wide:
            return builder.load(builder.gep(data, [args[1]]))
        vector = ir.Constant(ir.VectorType(data.type.pointee, LANES), ir.Undefined)
        for lane in range(LANES):
            at = builder.zext(builder.extract_element(args[1], _I32(lane)), ir.IntType(64))
            vector = builder.insert_element(vector, builder.load(builder.gep(data, [at])), _I32(lane))
        return vector

    return result(table, index), codegen
