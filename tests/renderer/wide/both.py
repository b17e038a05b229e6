"""Evaluates a formula both for eight lanes at once and for each lane alone, so that tests can compare the results."""

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

__all__ = ["assert_same_bits", "both", "in_both", "keep"]

F32 = npt.NDArray[np.float32]


@intrinsic
def keep(typingctx, table, index, lanes, values):
    """Stores a tuple's values, each in its row of a C-contiguous float32 table, from column `index` on; masks as 0 and 1.

    lanes: a u32x8 if the tuple holds values for eight lanes, scalars then being broadcast to all lanes; otherwise a scalar.
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
    """Evaluates a formula on each row of `given`: eight rows at a time, with results in `eight`, and row by row, in `one`.

    width: numbers per row. order: the numbers of the rows, of which eight consecutive ones are evaluated together.
    """
    for i in range(0, len(given), LANES):
        number = load_ints(order, np.uintp(i))
        keep(eight, i, number, formula(row(given, number, width)))
        for j in range(i, i + LANES):
            keep(one, j, j, formula(row(given, j, width)))


def both(kernel: Callable[..., Any], given: npt.ArrayLike, count: int) -> tuple[F32, F32]:
    """Returns the results for eight lanes and for each lane alone, (count, N) each, of an entry that wraps `in_both`.

    given: (N, width), N a multiple of 8.
    """
    rows = np.ascontiguousarray(given, np.float32)
    assert len(rows) % LANES == 0
    eight, one = np.full((2, count, len(rows)), np.float32(-77.0))
    kernel(rows, np.arange(len(rows), dtype=np.int32), eight, one)
    return eight, one


def assert_same_bits(a: F32, b: F32) -> None:
    """Asserts that all values have the same bits, including the signs of zeros; NaN equals NaN."""
    differ = (a.view(np.uint32) != b.view(np.uint32)) & ~(np.isnan(a) & np.isnan(b))
    rows, lanes = np.nonzero(differ)
    some = [(int(row), int(lane), a[row, lane], b[row, lane]) for row, lane in list(zip(rows, lanes, strict=True))[:5]]
    assert not differ.any(), f"{differ.sum()} values of rows {sorted(set(rows.tolist()))} differ, such as {some}"
