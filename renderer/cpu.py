"""The CPU for which kernels are compiled.

A film adds samples of many hosts and must not depend on which hosts those are. Therefore all Intel and AMD hosts count as one
kind: they compile for x86-64-v3, or, if the CPU has it, for AVX-512, which yields the same bits faster (more registers, masks,
byte operations; tests/renderer/test_same_bits.py). ARM hosts compile for their own baseline and are a separate kind, whose films
are never merged with those of Intel and AMD.
"""

from __future__ import annotations

import os
import platform

import llvmlite.binding as llvm

__all__ = ["FEATURES", "HAS_AVX512", "NAME", "TARGET"]

_X86 = ("x86_64", "amd64")
_ARM = ("aarch64", "arm64")
_V3 = ("avx2", "fma", "bmi", "bmi2", "lzcnt", "movbe", "f16c")
_AVX512 = ("avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl", "avx512vbmi", "gfni")


def _target() -> tuple[str, str, str]:
    """Returns (the target's name within a kind, LLVM's name of the CPU, the features to enable beyond that CPU's).

    AVX-512 is used with the features of Intel since Ice Lake and AMD since Zen 4, unless $RAYFARM_AVX512 is false: earlier
    processors lower their clock for it.
    """
    machine = platform.machine().lower()
    if machine not in _X86:
        return ("aarch64" if machine in _ARM else machine), "generic", ""
    has = llvm.get_host_cpu_features()
    if lacks := [name for name in _V3 if not has.get(name)]:
        raise RuntimeError(
            f"This processor lacks {', '.join(lacks)}. Rayfarm's kernels need x86-64-v3: Intel since 2013, AMD since 2017."
        )
    wanted = os.environ.get("RAYFARM_AVX512", "true").lower() not in ("false", "0", "no", "off")
    if wanted and all(has.get(name) for name in _AVX512):
        return "x86-64-v3", "x86-64-v4", "+avx512vbmi,+gfni"
    return "x86-64-v3", "x86-64-v3", ""


TARGET, NAME, FEATURES = _target()
HAS_AVX512 = NAME == "x86-64-v4"
