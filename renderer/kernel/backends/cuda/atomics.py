"""Additions to integers in memory that threads of a graphics card share."""

from __future__ import annotations

from typing import Any

from numba import types
from numba.extending import intrinsic

__all__ = ["add_atomically"]


@intrinsic
def add_atomically(typingctx: Any, array: Any, index: Any, value: Any) -> Any:
    """Adds an integer to the flat element `index` of an array, atomically with other threads; returns the element before.

    The index is not checked.
    """

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        return builder.atomic_rmw("add", builder.gep(data, [args[1]]), args[2], "monotonic")

    return array.dtype(array, types.uintp, array.dtype), codegen
