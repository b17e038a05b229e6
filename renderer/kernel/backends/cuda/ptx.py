"""Translates a kernel's LLVM IR to PTX, the assembly language of NVIDIA's driver, without a graphics card, a driver or a toolkit.

Numba's front end compiles the kernel as for the CPU, and the NVPTX back end of llvmlite's LLVM translates the result. No sums are
fused with products here (renderer/fused_multiply_add.py does that before), and divisions and roots are correctly
rounded, so a thread computes the same bits as a path on the CPU.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Sequence
from typing import Any

import llvmlite.binding as llvm

from renderer.kernel.backends.cuda.atomics import RESERVE, RESERVE_CODE
from renderer.kernel.backends.cuda.target import CAPABILITY, PTX_VERSION

__all__ = ["THREADS", "InexactError", "card_module", "check_exact", "emit_ptx", "joined_modules", "linked_module"]

THREADS = 128  # per block, at most
_TRIPLE = "nvptx64-nvidia-cuda"
# LLVM intrinsics that PTX computes with the CPU's bits: integers, memory, and floating-point operations rounded once.
_INTRINSICS = re.compile(
    r"llvm\.(fma|fabs|sqrt|rint|copysign|minnum|maxnum|floor|ceil|trunc"
    r"|bitreverse|bswap|ctpop|cttz|ctlz|fshl|fshr|abs|umin|umax|smin|smax|usub\.sat|uadd\.sat|vector\.reduce\.\w+"
    r"|is\.fpclass|masked\.load|masked\.store|scmp|ucmp|umul\.with\.overflow|smul\.with\.overflow"
    r"|memset|memcpy|memmove|lifetime\.start|lifetime\.end|nvvm\.read\.ptx\.sreg\.\w+|nvvm\.internal\.addrspace\.wrap)\.[\w.]+"
    r"|llvm\.assume"  # which generates no code
    r"|llvm\.nvvm\.(?:activemask|match\.any\.sync\.i32|shfl\.sync\.idx\.i32)"
)
_PREFETCH = re.compile(r"^.*@llvm\.prefetch\b.*\n", re.MULTILINE)
# Roots of the C library, which LLVM expects to be correctly rounded.
_ROOTS = """
define float @sqrtf(float %x) alwaysinline {
  %y = call float @llvm.sqrt.f32(float %x)
  ret float %y
}
define double @sqrt(double %x) alwaysinline {
  %y = call double @llvm.sqrt.f64(double %x)
  ret double %y
}
declare float @llvm.sqrt.f32(float)
declare double @llvm.sqrt.f64(double)
"""
# The job is one parameter by value, in the card's constant memory.
_ENTRY = """
declare i32 @{name}(ptr, ptr, ptr, i64)
declare i32 @llvm.nvvm.read.ptx.sreg.tid.x()
declare i32 @llvm.nvvm.read.ptx.sreg.ctaid.x()
declare i32 @llvm.nvvm.read.ptx.sreg.ntid.x()
define ptx_kernel void @{kernel}(ptr byval([{size} x i8]) align 16 "nvvm.grid_constant" %job, i64 %count) #0 {{
  %thread = call i32 @llvm.nvvm.read.ptx.sreg.tid.x()
  %block = call i32 @llvm.nvvm.read.ptx.sreg.ctaid.x()
  %size = call i32 @llvm.nvvm.read.ptx.sreg.ntid.x()
  %thread64 = zext i32 %thread to i64
  %block64 = zext i32 %block to i64
  %size64 = zext i32 %size to i64
  %before = mul i64 %block64, %size64
  %number = add i64 %before, %thread64
  %is_wanted = icmp ult i64 %number, %count
  br i1 %is_wanted, label %work, label %end
work:
  %result = alloca ptr
  %error = alloca ptr
  %status = call i32 @{name}(ptr %result, ptr %error, ptr %job, i64 %number)
  br label %end
end:
  ret void
}}
attributes #0 = {{ "nvvm.maxntid"="{threads}" }}
"""
_REMAINDER = re.compile(r" = (?:\w+ )*frem ")  # which the back end approximates
_INEXACT = re.compile(r"\b\w+(?:\.\w+)*\.(?:approx|ftz|full)\b[\w.]*|\b(?:add|sub|mul)\.f(?:32|64)\b|\bmad\.f\w+")


class InexactError(Exception):
    """Raised if a kernel contains an operation whose result on a GPU differs from the CPU's, or whose code is missing."""


def linked_module(dispatcher: Any, signature: tuple[Any, ...]) -> tuple[llvm.ModuleRef, str]:
    """Compiles a subroutine (renderer/jit.py) to an LLVM module that also contains all functions that it calls.

    Returns (module, the subroutine's name in it).
    """
    dispatcher.compile(signature)
    library = dispatcher.overloads[signature].library
    module = llvm.parse_bitcode(library._final_module.as_bitcode())
    for beneath in reversed(list(library.beneath.values())):
        module.link_in(llvm.parse_bitcode(beneath if isinstance(beneath, bytes) else beneath.as_bitcode()), preserve=True)
    return module, library.own_name


@functools.cache
def _machine() -> llvm.TargetMachine:
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    target = llvm.Target.from_triple(_TRIPLE)
    processor, version = (f"{major}{minor}" for major, minor in (CAPABILITY, PTX_VERSION))
    return target.create_target_machine(cpu=f"sm_{processor}", features=f"+ptx{version}", opt=3)


def _retargeted(text: str) -> llvm.ModuleRef:
    module = llvm.parse_assembly(text)
    module.triple = _TRIPLE
    module.data_layout = str(_machine().target_data)
    return module


def card_module(module: llvm.ModuleRef, name: str, size: int, kernel: str) -> llvm.ModuleRef:
    """Returns the optimised LLVM module of a GPU kernel, whose entry is kernel(job, number of threads).

    module, name: from `linked_module`, for a subroutine that takes a reference to a job and a thread's number. size: of a job in
    bytes. kernel: the entry's name. Raises InexactError if the module contains an operation that a graphics card lacks.
    """
    card = _retargeted(_PREFETCH.sub("", str(module)))
    declared = {each.name for each in card.functions if each.is_declaration}
    if declared & {"sqrt", "sqrtf"}:
        card.link_in(_retargeted(_ROOTS))
    if RESERVE in declared:
        card.link_in(_retargeted(RESERVE_CODE))
    card.link_in(_retargeted(_ENTRY.format(name=name, kernel=kernel, size=size, threads=THREADS)))
    for each in (*card.functions, *card.global_variables):
        if not each.is_declaration and each.name != kernel:
            each.linkage = "internal"
    card.get_function(name).add_function_attribute("alwaysinline")  # the job's fields are read where the kernel's parameter lies
    passes = llvm.create_pass_builder(_machine(), llvm.create_pipeline_tuning_options(speed_level=3))
    passes.getModulePassManager().run(card, passes)
    found = [each.name for each in card.functions if each.is_declaration and not _INTRINSICS.fullmatch(each.name)]
    if _REMAINDER.search(str(card)):
        found.append("the remainder of floating-point numbers")
    if found:
        raise InexactError(f"the kernel needs {', '.join(found)}, which a card does not have or rounds differently")
    return card


def joined_modules(cards: Sequence[llvm.ModuleRef]) -> llvm.ModuleRef:
    """Links the modules of several GPU kernels from `card_module`, which share nothing; returns the first, which has them all."""
    first, *others = cards
    for each in others:
        first.link_in(each)
    return first


def emit_ptx(card: llvm.ModuleRef) -> str:
    """Returns the PTX of a GPU module from `card_module`. Raises InexactError if it contains an inexact operation."""
    ptx = _machine().emit_assembly(card)
    check_exact(ptx)
    return str(ptx)


def check_exact(ptx: str) -> None:
    """Raises InexactError if a floating-point operation in PTX is approximate, or may be fused with another by the driver."""
    if found := sorted(set(_INEXACT.findall(ptx))):
        raise InexactError(f"the PTX contains {', '.join(found)}, which round differently from the CPU")
