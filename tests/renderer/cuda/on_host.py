"""Runs the LLVM module for graphics cards, as optimised, on the CPU.

This tests all of code generation for graphics cards except instruction selection.
"""

from __future__ import annotations

import ctypes
import functools
import re
import shutil
import subprocess
from collections.abc import Callable, Iterable
from pathlib import Path

import llvmlite.binding as llvm
import pytest

from renderer.cuda.artefacts import card_module_of, ptx_of
from renderer.kernel.backends.cuda.atomics import RESERVE_CODE

__all__ = ["card_module", "fake_driver", "launcher", "shared_object", "shared_objects", "warp"]

_REGISTERS = {"tid": "load i32, ptr @thread", "ctaid": "add i32 0, 0", "ntid": "add i32 1, 0"}
# Runs all threads of a launch in sequence, each as if it were alone in the first block.
_THREAD = "@thread = internal global i32 0\n"
_LAUNCH = """
define void @launch_{kernel}(ptr %job, i64 %count) {{
entry:
  br label %loop
loop:
  %i = phi i64 [0, %entry], [%next, %loop]
  %thread = trunc i64 %i to i32
  store i32 %thread, ptr @thread
  call void @{kernel}(ptr %job, i64 %count)
  %next = add i64 %i, 1
  %more = icmp ult i64 %next, %count
  br i1 %more, label %loop, label %end
end:
  ret void
}}
"""
# The instructions of a warp, and the functions that take their place. In a launch each thread is a warp of its own, whose only
# lane gets these results; fake_warp.c has 32 lanes.
_OF_WARP = {
    "activemask": "warp_activemask",
    "match.any.sync.i32": "warp_match",
    "shfl.sync.idx.i32": "warp_shfl",
    "read.ptx.sreg.lanemask.lt": "warp_lanemask_lt",
}
_LONE_LANE = """
define internal i32 @warp_activemask() { ret i32 1 }
define internal i32 @warp_match(i32 %mask, i32 %value) { ret i32 %mask }
define internal i32 @warp_shfl(i32 %mask, i32 %value, i32 %lane, i32 %clamp) { ret i32 %value }
define internal i32 @warp_lanemask_lt() { ret i32 0 }
"""
_UNFUSED = """
define internal float @unfused(float %a, float %b, float %c) {
  %product = fmul float %a, %b
  %sum = fadd float %product, %c
  ret float %sum
}
"""
_ENTRY = re.compile(r"^define .*ptx_kernel .*@(\w+)\(", re.MULTILINE)
_REMOVED = (
    r'^target (?:triple|datalayout) = ".*"$',
    r"^declare .*@llvm\.nvvm\..*$",
    r"\bptx_kernel ",
    r"byval\(\[\d+ x i8\]\) ",
    r'"nvvm\.\w+"(?:="\d+")?',
)


@functools.cache
def card_module(variant: str) -> llvm.ModuleRef:
    """Returns the optimised LLVM module of a kernel variant; each is built once for all tests."""
    return card_module_of(variant)


@functools.cache
def launcher(variant: str, kernel: str) -> Callable[[int, int], None]:
    """Returns a function that runs a kernel of a variant: launch(address of the job struct, number of threads)."""
    return ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64)(_engine(variant).get_function_address(f"launch_{kernel}"))


@functools.cache
def _engine(variant: str) -> llvm.ExecutionEngine:
    """Returns an engine with the machine code of a variant's kernels."""
    code = _machine_code(variant)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _machine())
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    return engine


def fake_driver(folder: Path) -> Path:
    """Compiles fake_cuda.c to a library in the folder and returns its path; skips the test if there is no C compiler."""
    library = folder / "libcuda.so.1"
    _linked([str(Path(__file__).with_name("fake_cuda.c")), "-ldl"], library)
    return library


def shared_object(variant: str, folder: Path, unfused: str = "") -> Path:
    """Writes a variant's kernels as the shared object that fake_cuda.c loads, and returns its path.

    unfused: name of a kernel that rounds the products of its fused operations, as a driver that does not keep to its PTX would.
    Skips the test if there is no C compiler.
    """
    code = folder / f"{variant}.o"
    code.write_bytes(_machine_code(variant, unfused))
    library = folder / f"{variant}.so"
    _linked([str(code)], library)
    return library


def shared_objects(variants: Iterable[str], folder: Path, unfused: str = "") -> Path:
    """Adds the kernels of variants to a folder as fake_cuda.c finds them, by the length of their PTX; returns the folder."""
    folder.mkdir(exist_ok=True)
    for variant in variants:
        shared_object(variant, folder, unfused).rename(folder / f"{len(ptx_of(variant))}.so")
    return folder


def warp(folder: Path) -> Callable[[int, int, int, int], None]:
    """Returns reserve_in_warp of fake_warp.c: reserve(mask of active lanes, addresses of the counters, lists and places).

    Skips the test if there is no C compiler.
    """
    code = folder / "reserve.o"
    code.write_bytes(_object(_with_warp_functions(RESERVE_CODE)))
    library = folder / "warp.so"
    _linked(["-pthread", str(Path(__file__).with_name("fake_warp.c")), str(code)], library)
    function = ctypes.CDLL(str(library)).reserve_in_warp
    function.argtypes = [ctypes.c_uint32, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p]
    return function


def _linked(arguments: list[str], library: Path) -> None:
    compiler = shutil.which("cc") or pytest.skip("There is no C compiler.")
    subprocess.run([compiler, "-shared", "-fPIC", "-o", str(library), *arguments], check=True)


@functools.cache
def _machine_code(variant: str, unfused: str = "") -> bytes:
    """Returns the object file of a variant's kernels for this CPU, each with a function launch_NAME; made once for all tests.

    unfused: as for `shared_object`.
    """
    text = str(card_module(variant))
    if unfused:
        whole = re.search(rf"^define [^\n]*ptx_kernel [^\n]*@{unfused}\(.*?^}}", text, re.MULTILINE | re.DOTALL)
        assert whole is not None
        text = text.replace(whole[0], whole[0].replace("@llvm.fma.f32(", "@unfused(")) + _UNFUSED
    for pattern in _REMOVED:
        text = re.sub(pattern, "", text, flags=re.MULTILINE)
    text = re.sub(r"call (?:range\([^)]*\) )?i32 @llvm\.nvvm\.read\.ptx\.sreg\.(\w+)\.x\(\)", r"call i32 @register_\1()", text)
    for register, value in _REGISTERS.items():
        text += f"define internal i32 @register_{register}() {{\n  %value = {value}\n  ret i32 %value\n}}\n"
    text = _with_warp_functions(text) + _LONE_LANE
    text += _THREAD + "".join(_LAUNCH.format(kernel=kernel) for kernel in _ENTRY.findall(str(card_module(variant))))
    return _object(text)


def _object(text: str) -> bytes:
    """Returns the object file of LLVM code for this CPU."""
    module, machine = llvm.parse_assembly(text), _machine()
    module.triple = llvm.get_default_triple()
    module.data_layout = str(machine.target_data)
    return bytes(machine.emit_object(module))


def _with_warp_functions(text: str) -> str:
    for instruction, function in _OF_WARP.items():
        text = text.replace(f"@llvm.nvvm.{instruction}(", f"@{function}(")
    return text


def _machine() -> llvm.TargetMachine:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    features = ",".join(f"{'+' if has else '-'}{name}" for name, has in llvm.get_host_cpu_features().items())
    target = llvm.Target.from_default_triple()
    return target.create_target_machine(cpu=llvm.get_host_cpu_name(), features=features, opt=1, jit=True, reloc="pic")
