"""Sums over the lanes of an f32x8, for choosing a lane with probability proportional to its value."""

from __future__ import annotations

from llvmlite import ir
from numba.extending import intrinsic

from renderer.bvh.simd import LANES, f32x8

__all__ = ["running_sum", "whole_sum"]

_PLACES = ir.VectorType(ir.IntType(32), LANES)
_ZERO = LANES  # as a shuffle index: the first lane of a second vector, of zeros
_BEFORE = (
    [_ZERO, 0, _ZERO, 2, _ZERO, 4, _ZERO, 6],
    [_ZERO, _ZERO, 1, 1, _ZERO, _ZERO, 5, 5],
    [_ZERO, _ZERO, _ZERO, _ZERO, 3, 3, 3, 3],
)
_PARTNER = ([1, 0, 3, 2, 5, 4, 7, 6], [2, 3, 0, 1, 6, 7, 4, 5], [4, 5, 6, 7, 0, 1, 2, 3])


def _add_permuted(builder, value, steps):
    """Emits code that adds to a vector, once for each of `steps`, a permutation of the sum so far.

    A step lists, for each lane, the lane to add.
    """
    zeros = ir.Constant(value.type, [0.0] * LANES)
    for places in steps:
        value = builder.fadd(value, builder.shuffle_vector(value, zeros, ir.Constant(_PLACES, places)))
    return value


@intrinsic
def running_sum(typingctx, a):
    """Returns the prefix sums of the lanes, an f32x8; lane i is the sum of lanes 0 ... i.

    For non-negative lanes the rounded sums never decrease, and increase only at lanes above 0.
    """
    return f32x8(f32x8), lambda context, builder, sig, args: _add_permuted(builder, args[0], _BEFORE)


@intrinsic
def whole_sum(typingctx, a):
    """Returns an f32x8 with the sum of all lanes in every lane; its bits are those of the last lane of `running_sum`."""
    return f32x8(f32x8), lambda context, builder, sig, args: _add_permuted(builder, args[0], _PARTNER)
