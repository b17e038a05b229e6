"""The eight-lane types f32x8, f64x8 and mask8 for kernels, and their operations.

LLVM does not convert a plain loop over eight lanes to min, max and fused multiply-adds, so the instructions are emitted here as
LLVM IR. The operators + - * / apply to vectors of one type; comparisons return a mask8, which & and | combine. The compiler
preserves their order, and fuses a * b + c as described in renderer/fused_multiply_add.py; `product` is not fused.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.imputils import lower_builtin
from numba.core.typing import signature
from numba.core.typing.templates import ConcreteTemplate, infer_global
from numba.extending import intrinsic

from renderer.lane_types import LANES, Lanes, called, f32x8, f64x8, mask8

__all__ = [
    "LANES",
    "Lanes",
    "address",
    "bits",
    "extract",
    "f32x8",
    "f64x8",
    "fetch",
    "flip",
    "fma",
    "less",
    "less_equal",
    "load",
    "load_from",
    "load_int",
    "lowest_bit",
    "mask8",
    "maximum",
    "minimum",
    "product",
    "row_at",
    "select",
    "splat",
    "splat_like",
    "sqrt",
    "store",
    "store_int",
    "to_double",
    "to_single",
]

_I32 = ir.IntType(32)
_FLOAT = ir.FloatType()
_DOUBLE = ir.DoubleType()


def _operator(symbol: Any, lower: Callable[[Any, Any, Any], Any], *kinds: Lanes) -> None:
    """Defines the operator `symbol` between two vectors of the same type, for each vector type. lower: emits the instruction."""

    class Template(ConcreteTemplate):
        key = symbol
        cases = [signature(kind, kind, kind) for kind in kinds]  # noqa: RUF012

    infer_global(symbol)(Template)
    for kind in kinds:
        lower_builtin(symbol, kind, kind)(lambda context, builder, sig, args: lower(builder, *args))


_operator(operator.add, lambda builder, a, b: builder.fadd(a, b), f32x8, f64x8)
_operator(operator.sub, lambda builder, a, b: builder.fsub(a, b), f32x8, f64x8)
_operator(operator.mul, lambda builder, a, b: builder.fmul(a, b), f32x8, f64x8)
_operator(operator.truediv, lambda builder, a, b: builder.fdiv(a, b), f32x8, f64x8)
_operator(operator.and_, lambda builder, a, b: builder.and_(a, b), mask8)
_operator(operator.or_, lambda builder, a, b: builder.or_(a, b), mask8)


def row_at(context: Any, builder: Any, array_type: Any, array: Any, index: Any, element: ir.Type) -> Any:
    """Returns a pointer to the array's element at a flat index, as a pointer to type `element`."""
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), element.as_pointer())


@intrinsic
def address(typingctx, array, index):
    """Returns the address of a float32 array's flat element `index`, for `load_from`. Unchecked."""

    def codegen(context, builder, sig, args):
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        return builder.ptrtoint(builder.gep(data, [args[1]]), args[1].type)

    return types.uintp(array, types.uintp), codegen


@intrinsic
def fetch(typingctx, address):
    """Prefetches the cache line at an address."""

    def codegen(context, builder, sig, args):
        byte = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [byte, _I32, _I32, _I32])
        function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0i8")
        builder.call(function, [builder.inttoptr(args[0], byte), _I32(0), _I32(3), _I32(1)])
        return context.get_dummy_value()

    return types.void(types.uintp), codegen


@intrinsic
def load_from(typingctx, address, offset):
    """Loads eight float32, starting `offset` float32 after the address."""

    def codegen(context, builder, sig, args):
        first = builder.gep(builder.inttoptr(args[0], _FLOAT.as_pointer()), [args[1]])
        value = builder.load(builder.bitcast(first, ir.VectorType(_FLOAT, LANES).as_pointer()))
        value.align = 4
        return value

    return f32x8(types.uintp, types.uintp), codegen


@intrinsic
def load(typingctx, array, index):
    """Loads eight float32 of a C-contiguous array, starting at its flat element `index`. Unchecked."""

    def codegen(context, builder, sig, args):
        pointer = row_at(context, builder, sig.args[0], *args, ir.VectorType(_FLOAT, LANES))
        value = builder.load(pointer)
        value.align = 4
        return value

    return f32x8(array, types.uintp), codegen


@intrinsic
def store(typingctx, array, index, value):
    """Stores eight float32 into a C-contiguous array, starting at its flat element `index`. Unchecked."""

    def codegen(context, builder, sig, args):
        pointer = row_at(context, builder, sig.args[0], args[0], args[1], ir.VectorType(_FLOAT, LANES))
        builder.store(args[2], pointer).align = 4
        return context.get_dummy_value()

    return types.void(array, types.uintp, f32x8), codegen


@intrinsic
def load_int(typingctx, array, index):
    """Loads an int32 stored as bits in a float32 array, at its flat element `index`. Unchecked."""

    def codegen(context, builder, sig, args):
        return builder.load(row_at(context, builder, sig.args[0], *args, _I32))

    return types.int32(array, types.uintp), codegen


@intrinsic
def store_int(typingctx, array, index, value):
    """Stores an int32 as bits in a float32 array, at its flat element `index`. Unchecked."""

    def codegen(context, builder, sig, args):
        builder.store(args[2], row_at(context, builder, sig.args[0], args[0], args[1], _I32))
        return context.get_dummy_value()

    return types.void(array, types.uintp, types.int32), codegen


@intrinsic
def splat(typingctx, value):
    """Broadcasts a float32 to all lanes."""

    def codegen(context, builder, sig, args):
        vector = ir.VectorType(_FLOAT, LANES)
        first = builder.insert_element(ir.Constant(vector, ir.Undefined), args[0], ir.Constant(_I32, 0))
        zeros = ir.Constant(ir.VectorType(_I32, LANES), [0] * LANES)
        return builder.shuffle_vector(first, ir.Constant(vector, ir.Undefined), zeros)

    return f32x8(types.float32), codegen


@intrinsic
def splat_like(typingctx, like, value):
    """Returns a float32 broadcast to all lanes if `like` has lanes, else the float32 itself."""
    is_wide = isinstance(like, Lanes)

    def codegen(context, builder, sig, args):
        if not is_wide:
            return args[1]
        vector = ir.VectorType(_FLOAT, LANES)
        first = builder.insert_element(ir.Constant(vector, ir.Undefined), args[1], ir.Constant(_I32, 0))
        zeros = ir.Constant(ir.VectorType(_I32, LANES), [0] * LANES)
        return builder.shuffle_vector(first, ir.Constant(vector, ir.Undefined), zeros)

    return (f32x8 if is_wide else types.float32)(like, types.float32), codegen


@intrinsic
def fma(typingctx, a, b, c):
    """Returns a * b + c, rounded once (fused multiply-add)."""
    return a(a, b, c), lambda context, builder, sig, args: called(builder, "fma", *args)


@intrinsic
def product(typingctx, a, b):
    """Returns a * b, always rounded: as an operand of a sum, a plain product would be fused (renderer/fused_multiply_add.py)."""
    return a(a, b), lambda context, builder, sig, args: builder.fmul(*args)


@intrinsic
def sqrt(typingctx, a):
    """Returns the square root of each lane, correctly rounded; NaN for negative numbers."""
    return a(a), lambda context, builder, sig, args: called(builder, "sqrt", *args)


@intrinsic
def minimum(typingctx, a, b):
    """Returns the lane-wise minimum of a and b; the lane of `b` if either is NaN (one vminps)."""

    def codegen(context, builder, sig, args):
        return builder.select(builder.fcmp_ordered("<", *args), *args)

    return a(a, b), codegen


@intrinsic
def maximum(typingctx, a, b):
    """Returns the lane-wise maximum of a and b; the lane of `b` if either is NaN (one vmaxps)."""

    def codegen(context, builder, sig, args):
        return builder.select(builder.fcmp_ordered(">", *args), *args)

    return a(a, b), codegen


def _mask_of(kind: Any) -> Any:
    """Returns the Numba type of a comparison's result: mask8 for vectors, boolean for scalars of type `kind`."""
    return mask8 if isinstance(kind, Lanes) else types.boolean


@intrinsic
def less(typingctx, a, b):
    """Returns the mask of lanes in which a < b, or for scalars a boolean; False for NaN."""
    return _mask_of(a)(a, b), lambda context, builder, sig, args: builder.fcmp_ordered("<", *args)


@intrinsic
def less_equal(typingctx, a, b):
    """Returns the mask of lanes in which a <= b, or for scalars a boolean; False for NaN."""
    return _mask_of(a)(a, b), lambda context, builder, sig, args: builder.fcmp_ordered("<=", *args)


@intrinsic
def flip(typingctx, a, b):
    """Returns a, f32x8 or float32, with the sign flipped where b is negative (or -0)."""
    is_wide = isinstance(a, Lanes)
    integers = ir.VectorType(_I32, LANES) if is_wide else _I32
    sign = ir.Constant(integers, [-(2**31)] * LANES if is_wide else -(2**31))

    def codegen(context, builder, sig, args):
        signs = builder.and_(builder.bitcast(args[1], integers), sign)
        return builder.bitcast(builder.xor(builder.bitcast(args[0], integers), signs), args[0].type)

    return a(a, a), codegen


@intrinsic
def select(typingctx, mask, a, b):
    """Returns `a` in lanes where the mask is set, else `b`. For scalars too, as a selection without a branch."""

    def codegen(context, builder, sig, args):
        value = builder.select(*args)
        value.set_metadata("unpredictable", builder.module.add_metadata([]))
        return value

    return a(mask, a, b), codegen


@intrinsic
def bits(typingctx, mask):
    """Returns the mask as an integer: bit i is lane i."""

    def codegen(context, builder, sig, args):
        return builder.zext(builder.bitcast(args[0], ir.IntType(LANES)), _I32)

    return types.uint32(mask), codegen


@intrinsic
def lowest_bit(typingctx, number):
    """Returns the index of the lowest set bit of a non-zero integer."""

    def codegen(context, builder, sig, args):
        return builder.cttz(args[0], ir.Constant(ir.IntType(1), 1))

    return types.uint32(types.uint32), codegen


@intrinsic
def extract(typingctx, vector, lane):
    """Returns the value of one lane of a vector."""
    element = types.float32 if vector.element == _FLOAT else types.float64
    return element(vector, types.uint32), lambda context, builder, sig, args: builder.extract_element(*args)


@intrinsic
def to_double(typingctx, a):
    """Converts an f32x8 to f64x8."""

    def codegen(context, builder, sig, args):
        return builder.fpext(args[0], ir.VectorType(_DOUBLE, LANES))

    return f64x8(f32x8), codegen


@intrinsic
def to_single(typingctx, a):
    """Rounds an f64x8 to f32x8."""

    def codegen(context, builder, sig, args):
        return builder.fptrunc(args[0], ir.VectorType(_FLOAT, LANES))

    return f32x8(f64x8), codegen
