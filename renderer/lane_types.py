"""The types of eight lanes in a vector register, and functions to broadcast values and to call LLVM intrinsics on them.

renderer/bvh/simd.py and renderer/wide/operators.py define their operations.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.datamodel import models, register_default

__all__ = ["LANES", "Lanes", "called", "f32x8", "f64x8", "is_wide", "lifted", "mask8", "u32x8"]

LANES = 8
_I32 = ir.IntType(32)
_INDICES = ir.VectorType(_I32, LANES)
_SUFFIX = {str(ir.FloatType()): "f32", str(ir.DoubleType()): "f64", str(_I32): "i32"}


class Lanes(types.Type):
    """The Numba type of a vector register with eight values (lanes) of one type."""

    def __init__(self, name: str, element: ir.Type) -> None:
        self.element = element
        super().__init__(name)


f32x8 = Lanes("f32x8", ir.FloatType())
f64x8 = Lanes("f64x8", ir.DoubleType())
u32x8 = Lanes("u32x8", _I32)
mask8 = Lanes("mask8", ir.IntType(1))


@register_default(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, fe_type: Lanes) -> None:
        super().__init__(manager, fe_type, ir.VectorType(fe_type.element, LANES))


def is_wide(kind: types.Type) -> bool:
    """Returns True if a Numba type is a type of eight lanes."""
    return isinstance(kind, Lanes)


def lifted(builder: Any, kind: types.Type, value: Any) -> Any:
    """Broadcasts an LLVM value to all lanes if it is a scalar, else returns it unchanged. kind: the value's Numba type."""
    if is_wide(kind):
        return value
    vector = ir.VectorType(value.type, LANES)
    first = builder.insert_element(ir.Constant(vector, ir.Undefined), value, _I32(0))
    return builder.shuffle_vector(first, ir.Constant(vector, ir.Undefined), ir.Constant(_INDICES, [0] * LANES))


def called(builder: Any, name: str, *arguments: Any) -> Any:
    """Emits a call of the LLVM intrinsic `name` on scalars or vectors of one type; returns its result."""
    kind = arguments[0].type
    wide = isinstance(kind, ir.VectorType)
    suffix = _SUFFIX[str(kind.element if wide else kind)]
    full = f"llvm.{name}.v{LANES}{suffix}" if wide else f"llvm.{name}.{suffix}"
    function = cgutils.get_or_insert_function(builder.module, ir.FunctionType(kind, [kind] * len(arguments)), full)
    return builder.call(function, arguments)
