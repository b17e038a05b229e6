"""Sums over the lanes of an f32x8, to choose a lane in proportion to what it holds."""

from __future__ import annotations

from llvmlite import ir
from numba.extending import intrinsic

from renderer.bvh.simd import LANES, f32x8

__all__ = ["running_sum", "whole_sum"]

_PLACES = ir.VectorType(ir.IntType(32), LANES)
_ZERO = LANES  # as a place: the first lane of a second vector, of zeros
_BEFORE = (
    [_ZERO, 0, _ZERO, 2, _ZERO, 4, _ZERO, 6],
    [_ZERO, _ZERO, 1, 1, _ZERO, _ZERO, 5, 5],
    [_ZERO, _ZERO, _ZERO, _ZERO, 3, 3, 3, 3],
)
_PARTNER = ([1, 0, 3, 2, 5, 4, 7, 6], [2, 3, 0, 1, 6, 7, 4, 5], [4, 5, 6, 7, 0, 1, 2, 3])


def _added(builder, value, steps):
    """The vector to which at each step its own lanes are added, from the places named."""
    zeros = ir.Constant(value.type, [0.0] * LANES)
    for places in steps:
        value = builder.fadd(value, builder.shuffle_vector(value, zeros, ir.Constant(_PLACES, places)))
    return value


@intrinsic
def running_sum(typingctx, a):
    """f32x8: in each lane the sum of the lanes up to it.

    Of lanes that are not negative, the sums do not fall, and rise only where a lane is above 0, however they are rounded.
    """
    return f32x8(f32x8), lambda context, builder, sig, args: _added(builder, args[0], _BEFORE)


@intrinsic
def whole_sum(typingctx, a):
    """f32x8: in each lane the sum of all lanes; to the bit that which `running_sum` has in the last one."""
    return f32x8(f32x8), lambda context, builder, sig, args: _added(builder, args[0], _PARTNER)
