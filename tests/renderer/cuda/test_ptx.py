"""Tests of the translation from LLVM code to PTX, and of what a graphics card's kernel must not contain."""

from __future__ import annotations

import importlib
import re
import sys
from pathlib import Path

import llvmlite.binding as llvm
import pytest

from renderer import variant_names
from renderer.arrays.scene_features import KERNEL_VARIANTS
from renderer.kernel.backends.cuda.ptx import InexactError, card_module, check_exact, emit_ptx
from renderer.kernel.backends.cuda.target import CAPABILITY, PTX_VERSION
from renderer.kernel.backends.cuda.wavefront import kernels_of
from renderer.variant_names import base_variant, example_of, has_caustics, kernel_names, suffixes_of, variant_suffix
from tests.grids import grid
from tests.renderer.cuda.budget import architectures, assembled, find_assembler, over_budget
from tests.renderer.cuda.on_host import card_module as module_of

# The most that settings can add to a variant: sets of suffixes that no other contains.
SUFFIXES = {frozenset(suffixes_of(name)) for name in kernel_names()}
MOST = [suffixes for suffixes in SUFFIXES if not any(suffixes < other for other in SUFFIXES)]
FIRST_OF_FULL, *_, LARGEST = (name for name in KERNEL_VARIANTS if name != "plain")
# Kernels that are built: of each variant without and with the most, and of the smallest and the largest all others, too.
BUILT = [
    name
    for name in kernel_names()
    if base_variant(name) in (FIRST_OF_FULL, LARGEST) or not suffixes_of(name) or suffixes_of(name) in MOST
]
# Kernels that are assembled, which takes ten times as long: of each variant, and of some with what settings add.
ASSEMBLED = [
    *KERNEL_VARIANTS,
    *(name for name in kernel_names() if base_variant(name) in (FIRST_OF_FULL, LARGEST) and suffixes_of(name) in MOST),
    *("full-spectral", "media-spectral", "linked-spectral", "visibility-spectral", "moving-catchers-spectral"),
    *("full-guided", "full-paths-groups", "aimed-caustics", "media-caustics", "moving-caustics"),
]
OF_WARP = "activemask.b32", "match.any.sync.b32", "shfl.sync.idx.b32"


def _kernels(variant: str) -> list[str]:
    """Returns the names of the kernels of a variant, sorted."""
    return sorted(kernels_of(KERNEL_VARIANTS[base_variant(variant)], has_caustics(variant)))


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
    return emit_ptx(card_module(llvm.parse_assembly(text), "work", 24, "render"))


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


def test_built_kernels_have_all_variants_and_all_that_settings_add() -> None:
    assert {base_variant(name) for name in BUILT} == set(KERNEL_VARIANTS)
    assert {frozenset(suffixes_of(name)) for name in BUILT} == SUFFIXES
    assert set().union(*SUFFIXES) == set(variant_names._IN_ORDER), "a setting is missing in variant_names._VALUES"
    assert all(f"full{variant_suffix(example_of(name)[1])}" in BUILT for name in kernel_names())
    for name in kernel_names():
        assert any(suffixes_of(name) <= suffixes_of(each) for each in BUILT if base_variant(each) == base_variant(name)), name


@grid("variant", BUILT, ordinary=["plain"])
def test_variant_ptx_has_all_kernels(variant: str) -> None:
    ptx = emit_ptx(module_of(variant).clone())
    assert f".target sm_{CAPABILITY[0]}{CAPABILITY[1]}" in ptx
    assert f".version {PTX_VERSION[0]}.{PTX_VERSION[1]}" in ptx
    assert sorted(re.findall(r"\.entry (\w+)\(", ptx)) == _kernels(variant)
    assert all(instruction in ptx for instruction in OF_WARP)


def test_assembler_of_the_wheel_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(sys, "path", [str(tmp_path)])
    assert find_assembler() is None
    program = tmp_path / "nvidia" / "cu13" / "bin" / "ptxas"
    program.parent.mkdir(parents=True)
    program.touch()
    importlib.invalidate_caches()
    assert find_assembler() == str(program)


@pytest.mark.long  # takes a minute for each variant
@pytest.mark.parametrize("variant", ASSEMBLED)
def test_registers_and_spills_stay_within_their_budget(variant: str, tmp_path: Path) -> None:
    assembler = find_assembler() or pytest.skip("There is no ptxas (pip install nvidia-cuda-nvcc).")
    path = tmp_path / "kernel.ptx"
    path.write_text(emit_ptx(module_of(variant).clone()))
    for architecture in architectures(assembler):
        found = assembled(assembler, path, architecture)
        assert sorted(found) == _kernels(variant)
        assert not over_budget(variant, found), architecture
