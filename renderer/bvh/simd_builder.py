"""Eight-lane operations for the BVH builder, besides those of simd.py: in-place maximum of array rows, and swapping of halves."""

from __future__ import annotations

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from renderer.bvh.simd import LANES, f32x8, row_at
from renderer.lane_types import called

__all__ = ["store_maximum", "swapped"]


@intrinsic
def store_maximum(typingctx, array, index, value):
    """Replaces eight float32 of a C-contiguous array, starting at its flat element `index`, by their maximum with an f32x8.

    The index is not checked. LLVM would convert the plain form to one masked store, which takes AMD's processors twenty times as
    long.
    """

    def codegen(context, builder, sig, args):
        pointer = row_at(context, builder, sig.args[0], args[0], args[1], ir.VectorType(ir.FloatType(), LANES))
        old = builder.load(pointer)
        old.align = 4
        greater = builder.select(builder.fcmp_ordered(">", old, args[2]), old, args[2])
        builder.store(called(builder, "arithmetic.fence", greater), pointer).align = 4
        return context.get_dummy_value()

    return types.void(array, types.uintp, f32x8), codegen


@intrinsic
def swapped(typingctx, vector):
    """Returns the f32x8 with its two halves of four lanes swapped."""

    def codegen(context, builder, sig, args):
        order = [*range(LANES // 2, LANES), *range(LANES // 2)]
        return builder.shuffle_vector(
            args[0], ir.Constant(args[0].type, ir.Undefined), ir.Constant(ir.VectorType(ir.IntType(32), LANES), order)
        )

    return f32x8(f32x8), codegen
