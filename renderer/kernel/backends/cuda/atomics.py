"""Additions to integers in memory that threads of a graphics card share."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

__all__ = ["RESERVE", "RESERVE_CODE", "add_atomically", "reserve"]

RESERVE = "rayfarm_reserve"  # the function that `reserve` calls
# Its LLVM code for a card: of the threads of a warp that arrive together, those with the same element find each other, the lowest
# adds their number, and each takes the result plus its rank. Their order in the list has no meaning.
RESERVE_CODE = f"""
declare i32 @llvm.nvvm.activemask()
declare i32 @llvm.nvvm.match.any.sync.i32(i32, i32)
declare i32 @llvm.nvvm.shfl.sync.idx.i32(i32, i32, i32, i32)
declare i32 @llvm.nvvm.read.ptx.sreg.lanemask.lt()
declare i32 @llvm.ctpop.i32(i32)
declare i32 @llvm.cttz.i32(i32, i1)
define i64 @{RESERVE}(ptr %counters, i64 %index) alwaysinline convergent {{
  %key = trunc i64 %index to i32
  %active = call i32 @llvm.nvvm.activemask()
  %peers = call i32 @llvm.nvvm.match.any.sync.i32(i32 %active, i32 %key)
  %below = call i32 @llvm.nvvm.read.ptx.sreg.lanemask.lt()
  %lower = and i32 %peers, %below
  %is_first = icmp eq i32 %lower, 0
  br i1 %is_first, label %add, label %share
add:
  %count = call i32 @llvm.ctpop.i32(i32 %peers)
  %wide = zext i32 %count to i64
  %counter = getelementptr i64, ptr %counters, i64 %index
  %before = atomicrmw add ptr %counter, i64 %wide syncscope("device") monotonic
  %added = trunc i64 %before to i32
  br label %share
share:
  %own = phi i32 [ 0, %0 ], [ %added, %add ]
  %first = call i32 @llvm.cttz.i32(i32 %peers, i1 true)
  %base = call i32 @llvm.nvvm.shfl.sync.idx.i32(i32 %peers, i32 %own, i32 %first, i32 31)
  %rank = call i32 @llvm.ctpop.i32(i32 %lower)
  %place = add i32 %base, %rank
  %result = zext i32 %place to i64
  ret i64 %result
}}
"""


@intrinsic
def add_atomically(typingctx: Any, array: Any, index: Any, value: Any) -> Any:
    """Adds an integer to the flat element `index` of an array, atomically with other threads; returns the element before.

    The index is not checked.
    """

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        return builder.atomic_rmw("add", builder.gep(data, [args[1]]), args[2], "monotonic")

    return array.dtype(array, types.uintp, array.dtype), codegen


@intrinsic
def reserve(typingctx: Any, counters: Any, index: Any) -> Any:
    """Adds 1 to element `index` of an int64 array, atomically with other threads; returns a value from before, below 2**32.

    No two threads get the same value. Threads of a warp that call this together make one addition for each element, as one for
    each thread would have to wait for the others. The index is not checked. Only code for graphics cards can call this.
    """

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        kind = ir.FunctionType(ir.IntType(64), [data.type, ir.IntType(64)])
        function = builder.module.globals.get(RESERVE) or ir.Function(builder.module, kind, RESERVE)
        function.attributes.add("convergent")
        return builder.call(function, [data, args[1]])

    return types.int64(counters, types.uintp), codegen
