"""The film's fixed-point format, and the half buffer for noise estimation, for kernels; see renderer/film.py."""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from renderer.bvh.simd import LANES, f32x8, row_at
from renderer.film import SAMPLE_MAX
from renderer.jit import device
from renderer.wide.operators import lifted

__all__ = ["add_fixed8", "fixed", "in_half", "sample_contribution"]

_MAX_SAMPLE = np.float32(SAMPLE_MAX)
_MANTISSA_TOP = np.int32(22)
_DOUBLES = ir.VectorType(ir.DoubleType(), LANES)
_WORDS = ir.VectorType(ir.IntType(64), LANES)
_ROUNDER = 1.5 * 2.0**52  # added to a double below 2**51, rounds it to an integer


@device
def fixed(value, scale):
    """Converts a value to the film's fixed point, clamped. Scaling by a power of two is exact; the conversion rounds once."""
    return np.int64(np.rint(min(max(value, -_MAX_SAMPLE), _MAX_SAMPLE) * scale))


@device
def in_half(sample):
    """Returns True if a sample number belongs to the half buffer: if its second highest bit is 0, as in renderer/film.py.

    That bit is the top bit of the mantissa of the number as float32.
    """
    second = np.int32(np.float32(sample).view(np.int32) >> _MANTISSA_TOP) & 1
    return second == 0 and sample != 1


@intrinsic
def sample_contribution(typingctx, light, one, halved):
    """Returns a sample's contribution to its pixel, f32x8: three channels of light and `one`, twice.

    The second copy, for the half buffer, is 0 unless `halved` is True.
    """

    def codegen(context, builder, sig, args):
        ones = lifted(builder, types.float32, args[1])
        order = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0, 1, 2, LANES, 0, 1, 2, LANES])
        both = builder.shuffle_vector(args[0], ones, order)
        order = ir.Constant(order.type, [0, 1, 2, 3, *[LANES] * (LANES - 4)])
        whole = builder.shuffle_vector(both, ir.Constant(both.type, None), order)
        return builder.select(args[2], both, whole)

    return f32x8(f32x8, types.float32, types.boolean), codegen


@intrinsic
def _add_rounded(typingctx, sums, index, values, scale):
    """Adds rint(value * scale) of eight values to eight int64 from a flat index on. |value * scale| must be below 2**51."""

    def codegen(context, builder, sig, args):
        pointer = row_at(context, builder, sig.args[0], args[0], args[1], _WORDS)
        doubles = builder.fpext(args[2], _DOUBLES)
        factor = lifted(builder, types.float64, builder.fpext(args[3], ir.DoubleType()))
        magic = ir.Constant(_DOUBLES, [_ROUNDER] * LANES)
        # The constant's bits are subtracted as integers, since AVX2 has no conversion to int64.
        rounded = builder.bitcast(builder.fadd(builder.fmul(doubles, factor), magic), _WORDS)
        whole = builder.sub(rounded, builder.bitcast(magic, _WORDS))
        before = builder.load(pointer)
        before.align = 8
        builder.store(builder.add(before, whole), pointer).align = 8
        return context.get_dummy_value()

    return types.void(sums, types.uintp, f32x8, types.float32), codegen


@device
def add_fixed8(sums, index, values, scale):
    """Adds eight values (f32x8) in the film's fixed point to eight int64 of an array, from the flat index `index` on."""
    _add_rounded(sums, index, min(max(values, -_MAX_SAMPLE), _MAX_SAMPLE), scale)
