"""Tests of the translation from LLVM code to PTX, and of what a graphics card's kernel must not contain."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import llvmlite.binding as llvm
import pytest

from renderer.arrays.scene_features import KERNEL_VARIANTS
from renderer.kernel.backends.cuda.ptx import KERNEL, InexactError, card_module, check_exact, emit_ptx
from renderer.kernel.backends.cuda.target import CAPABILITY, PTX_VERSION
from renderer.kernel.backends.cuda.wavefront import is_in_wavefront, kernels_of
from tests.grids import grid
from tests.renderer.cuda.on_host import card_module as module_of

# Measured by ptxas for a card of this capability: bytes of stack per thread, with the traversal stack, and of spilled registers.
ARCHITECTURE = "sm_75"
STACK, SPILLED = 16384, 4096


def ptx_of(body: str, declared: str = "") -> str:
    """Returns the PTX of a kernel in which each thread stores %y, which the instructions in `body` compute from %a, %b and %c."""
    text = f"""
{declared}
define i32 @work(ptr %ret, ptr %exc, ptr %job, i64 %thread) {{
  %a = load float, ptr %job
  %pb = getelementptr float, ptr %job, i64 1
  %b = load float, ptr %pb
  %pc = getelementptr float, ptr %job, i64 2
  %c = load float, ptr %pc
  %out = getelementptr ptr, ptr %job, i64 2
  %to = load ptr, ptr %out
  {body}
  store float %y, ptr %to
  ret i32 0
}}
"""
    return emit_ptx(card_module(llvm.parse_assembly(text), "work", 24))


def test_ptx_fuses_only_explicit_fma() -> None:
    plain = ptx_of("%x = fmul float %a, %b\n  %y = fadd float %x, %c")
    assert "mul.rn.f32" in plain
    assert "add.rn.f32" in plain
    assert "fma" not in plain
    fused = ptx_of(
        "%y = call float @llvm.fma.f32(float %a, float %b, float %c)", "declare float @llvm.fma.f32(float, float, float)"
    )
    assert fused.count("fma.rn.f32") == 1


def test_quotients_and_roots_are_rounded_correctly() -> None:
    ptx = ptx_of("%x = fdiv float %a, %b\n  %y = call float @sqrtf(float %x)", "declare float @sqrtf(float)")
    assert "div.rn.f32" in ptx
    assert "sqrt.rn.f32" in ptx


@pytest.mark.parametrize("called", ("sinf", "llvm.exp.f32", "llvm.sin.f32"))
def test_inexact_function_is_an_error(called: str) -> None:
    with pytest.raises(InexactError, match=re.escape(called)):
        ptx_of(f"%y = call float @{called}(float %a)", f"declare float @{called}(float)")


def test_a_remainder_is_an_error() -> None:
    with pytest.raises(InexactError, match="remainder"):
        ptx_of("%y = frem float %a, %b")


@pytest.mark.parametrize("operation", ("div.full.f32", "sqrt.approx.f32", "ex2.approx.ftz.f32", "add.f32", "mul.f64", "mad.f32"))
def test_inexact_operation_is_an_error(operation: str) -> None:
    with pytest.raises(InexactError, match=re.escape(operation)):
        check_exact(f"\t{operation} \t%f1, %f2, %f3;\n")


def test_prefetch_is_omitted() -> None:
    declared = "declare void @llvm.prefetch.p0(ptr, i32, i32, i32)"
    assert "prefetch" not in ptx_of(
        "call void @llvm.prefetch.p0(ptr %job, i32 0, i32 3, i32 1)\n  %y = fadd float %a, %b", declared
    )


@grid("variant", KERNEL_VARIANTS, ordinary=["plain"])
def test_variant_ptx_is_accepted_by_the_assembler(variant: str, tmp_path: Path) -> None:
    ptx = emit_ptx(module_of(variant).clone())
    assert f".target sm_{CAPABILITY[0]}{CAPABILITY[1]}" in ptx
    assert f".version {PTX_VERSION[0]}.{PTX_VERSION[1]}" in ptx
    wanted = list(kernels_of(KERNEL_VARIANTS[variant])) if is_in_wavefront(variant) else [KERNEL]
    assert sorted(re.findall(r"\.entry (\w+)\(", ptx)) == sorted(wanted)
    assembler = shutil.which("ptxas")
    if assembler is None or variant == "plain":  # takes ten seconds or more
        return
    path = tmp_path / "kernel.ptx"
    path.write_text(ptx)
    command = [assembler, f"-arch={ARCHITECTURE}", "-v", str(path), "-o", str(tmp_path / "kernel.cubin")]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stderr
    for name in wanted:
        kernel = said[said.index(f"Function properties for {name}\n") :]
        stack, stored = (int(re.findall(rf"(\d+) bytes {what}", kernel)[0]) for what in ("stack frame", "spill stores"))
        assert stack <= STACK
        assert stored <= SPILLED
