"""Arrays of zeros on the stack of a graphics card's thread."""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

__all__ = ["local_zeros"]


@intrinsic(prefer_literal=True)
def local_zeros(typingctx: Any, dtype: Any, shape: Any) -> Any:
    """Returns an array of zeros on the thread's stack, valid until the calling function returns. shape: a literal."""
    lengths = [each.literal_value for each in shape]
    array = types.Array(dtype.dtype, len(lengths), "C")

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        word = context.get_value_type(array.dtype)
        size = context.get_abi_sizeof(word)
        kind = ir.ArrayType(word, int(np.prod(lengths)))
        memory = cgutils.alloca_once(builder, kind)
        builder.store(ir.Constant(kind, None), memory)
        strides = [size * int(np.prod(lengths[k + 1 :])) for k in range(len(lengths))]
        view = context.make_array(array)(context, builder)
        populate_array(
            view,
            data=builder.bitcast(memory, word.as_pointer()),
            shape=[context.get_constant(types.intp, each) for each in lengths],
            strides=[context.get_constant(types.intp, each) for each in strides],
            itemsize=context.get_constant(types.intp, size),
            meminfo=None,
        )
        return view._getvalue()

    return array(dtype, shape), codegen
