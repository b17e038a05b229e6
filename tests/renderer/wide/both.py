"""Evaluates a formula for eight lanes and for each lane alone, side by side."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from renderer.bvh.simd import LANES, mask8
from renderer.jit import template
from renderer.kernel.fetch import row
from renderer.wide.operators import is_wide, lifted
from renderer.wide.rows import load_ints

__all__ = ["both", "in_both", "keep", "ulps"]

F32 = npt.NDArray[np.float32]


@intrinsic
def keep(typingctx, table, index, lanes, values):
    """Each of a tuple's values into its row of a C-contiguous float32 table, from column `index` on; choices as 0 and 1.

    lanes: a u32x8 where the tuple is eight lanes', whose plain numbers then stand for all; else a plain number.
    """

    def codegen(context, builder, sig, args):
        array = context.make_array(sig.args[0])(context, builder, args[0])
        length = builder.extract_value(array.shape, 1)
        for k, kind in enumerate(sig.args[3]):
            value = builder.extract_value(args[3], k)
            if is_wide(sig.args[2]):
                value = lifted(builder, kind, value)
            vector = isinstance(value.type, ir.VectorType)
            number = ir.VectorType(ir.FloatType(), LANES) if vector else ir.FloatType()
            if kind in (mask8, types.boolean):
                value = builder.uitofp(value, number)
            elif str(value.type) != str(number):
                value = builder.sitofp(value, number)
            at = builder.gep(array.data, [builder.add(builder.mul(length, ir.IntType(64)(k)), args[1])])
            builder.store(value, builder.bitcast(at, number.as_pointer())).align = 4
        return context.get_dummy_value()

    return types.void(table, types.intp, lanes, values), codegen


@template
def in_both(formula, width, given, order, eight, one):
    """The formula, of a row's numbers, for eight rows at a time and for each row."""
    for i in range(0, len(given), LANES):
        number = load_ints(order, np.uintp(i))
        keep(eight, i, number, formula(row(given, number, width)))
        for j in range(i, i + LANES):
            keep(one, j, j, formula(row(given, j, width)))


def both(kernel: Callable[..., Any], given: npt.ArrayLike, count: int) -> tuple[F32, F32]:
    """(of eight lanes, of each lane alone), (count, N) each, of an entry around `in_both`.

    given: (N, width), N a multiple of 8.
    """
    rows = np.ascontiguousarray(given, np.float32)
    assert len(rows) % LANES == 0
    eight, one = np.full((2, count, len(rows)), np.float32(-77.0))
    kernel(rows, np.arange(len(rows), dtype=np.int32), eight, one)
    return eight, one


def ulps(a: F32, b: F32, least: float = 0.0) -> F32:
    """How far apart, in units in the last place of the greater, or of `least` where both are smaller; NaN equals NaN."""
    size = np.maximum(np.maximum(abs(a), abs(b)), np.float32(max(least, 2.0**-126)))
    with np.errstate(invalid="ignore"):
        apart = abs(a.astype(np.float64) - b) / np.spacing(np.where(np.isfinite(size), size, np.float32(1)))
    return np.where((a == b) | (np.isnan(a) & np.isnan(b)), 0, np.where(np.isnan(apart), np.inf, apart))
