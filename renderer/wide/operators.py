"""Python's operators for eight-lane values, so that a formula is written once for float32 and f32x8.

f32x8, mask8 and the BVH's operations are in renderer/bvh/simd.py. This module adds operators between scalars and vectors,
comparisons, roots, and u32x8. Scalar operands are broadcast to all lanes.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.core.imputils import lower_builtin
from numba.core.typing import signature
from numba.core.typing.templates import ConcreteTemplate, infer_global

from renderer.bvh.simd import LANES, Lanes, f32x8, f64x8, mask8
from renderer.lane_types import called, is_wide, lifted, u32x8

__all__ = ["FLOATS", "INTS", "called", "is_wide", "lifted", "u32x8"]

_I32 = ir.IntType(32)
FLOATS = ir.VectorType(ir.FloatType(), LANES)
INTS = ir.VectorType(_I32, LANES)


def _binary(
    symbol: Any, lower: Callable[[Any, Any, Any], Any], result: Lanes, wide: Lanes, plain: Any, known: bool = False
) -> None:
    """Defines operator `symbol` between a vector and a scalar, in either order, and between two vectors.

    known: True if it is already defined between two vectors.
    """
    pairs = [(wide, plain), (plain, wide)] + ([] if known else [(wide, wide)])

    class Template(ConcreteTemplate):
        key = symbol
        cases = [signature(result, *pair) for pair in pairs]  # noqa: RUF012

    infer_global(symbol)(Template)
    for pair in pairs:
        lower_builtin(symbol, *pair)(
            lambda context, builder, sig, args: lower(
                builder, lifted(builder, sig.args[0], args[0]), lifted(builder, sig.args[1], args[1])
            )
        )


def _unary(symbol: Any, lower: Callable[[Any, Any], Any], wide: Lanes) -> None:
    class Template(ConcreteTemplate):
        key = symbol
        cases = [signature(wide, wide)]  # noqa: RUF012

    infer_global(symbol)(Template)
    lower_builtin(symbol, wide)(lambda context, builder, sig, args: lower(builder, *args))


def _compared(sign: str) -> Callable[[Any, Any, Any], Any]:
    return lambda builder, a, b: builder.fcmp_ordered(sign, a, b)


def _min_or_max(sign: str) -> Callable[[Any, Any, Any], Any]:
    """Returns the code generator of min (sign "<") or max (">") of two operands a and b: b only if strictly beyond a, else a.

    Numba's scalar min and max follow the same rule, which decides the result for NaN and signed zeros.
    """
    return lambda builder, a, b: builder.select(builder.fcmp_ordered(sign, b, a), b, a)


_binary(operator.add, lambda builder, a, b: builder.fadd(a, b), f32x8, f32x8, types.float32, known=True)
_binary(operator.sub, lambda builder, a, b: builder.fsub(a, b), f32x8, f32x8, types.float32, known=True)
_binary(operator.mul, lambda builder, a, b: builder.fmul(a, b), f32x8, f32x8, types.float32, known=True)
_binary(operator.truediv, lambda builder, a, b: builder.fdiv(a, b), f32x8, f32x8, types.float32, known=True)
for _symbol, _sign in ((operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">="), (operator.eq, "==")):
    _binary(_symbol, _compared(_sign), mask8, f32x8, types.float32)
_binary(operator.ne, lambda builder, a, b: builder.fcmp_unordered("!=", a, b), mask8, f32x8, types.float32)
_binary(max, _min_or_max(">"), f32x8, f32x8, types.float32)
_binary(min, _min_or_max("<"), f32x8, f32x8, types.float32)
_binary(math.copysign, lambda builder, a, b: called(builder, "copysign", a, b), f32x8, f32x8, types.float32)
_unary(operator.neg, lambda builder, a: builder.fneg(a), f32x8)
_unary(abs, lambda builder, a: called(builder, "fabs", a), f32x8)
_unary(math.sqrt, lambda builder, a: called(builder, "sqrt", a), f32x8)
_unary(math.sqrt, lambda builder, a: called(builder, "sqrt", a), f64x8)

_binary(operator.and_, lambda builder, a, b: builder.and_(a, b), mask8, mask8, types.boolean, known=True)
_binary(operator.or_, lambda builder, a, b: builder.or_(a, b), mask8, mask8, types.boolean, known=True)

_binary(operator.add, lambda builder, a, b: builder.add(a, b), u32x8, u32x8, types.uint32)
_binary(operator.sub, lambda builder, a, b: builder.sub(a, b), u32x8, u32x8, types.uint32)
_binary(operator.mul, lambda builder, a, b: builder.mul(a, b), u32x8, u32x8, types.uint32)
_binary(operator.xor, lambda builder, a, b: builder.xor(a, b), u32x8, u32x8, types.uint32)
_binary(operator.and_, lambda builder, a, b: builder.and_(a, b), u32x8, u32x8, types.uint32)
_binary(operator.or_, lambda builder, a, b: builder.or_(a, b), u32x8, u32x8, types.uint32)
_binary(operator.rshift, lambda builder, a, b: builder.lshr(a, b), u32x8, u32x8, types.uint32)
_binary(operator.lshift, lambda builder, a, b: builder.shl(a, b), u32x8, u32x8, types.uint32)
_binary(operator.eq, lambda builder, a, b: builder.icmp_unsigned("==", a, b), mask8, u32x8, types.uint32)
_binary(operator.ne, lambda builder, a, b: builder.icmp_unsigned("!=", a, b), mask8, u32x8, types.uint32)
_binary(operator.lt, lambda builder, a, b: builder.icmp_unsigned("<", a, b), mask8, u32x8, types.uint32)
_binary(operator.ge, lambda builder, a, b: builder.icmp_unsigned(">=", a, b), mask8, u32x8, types.uint32)
