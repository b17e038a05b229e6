"""Finds the peers: Mitsuba in this environment with the system's LLVM, the others in environments of their own."""

from __future__ import annotations

import os
import re
from functools import cache
from pathlib import Path
from typing import Any

import farm

__all__ = ["MissingPeerError", "find_llvm", "mitsuba_with_llvm", "python_with_bpy", "python_with_embree", "python_with_luxcore"]

LEAST_LLVM = 16


class MissingPeerError(Exception):
    """Raised if a peer is not available; the message has the reason and a remedy."""


def find_llvm() -> Path | None:
    """Returns the system's newest LLVM library that Mitsuba supports, or None."""
    found = {
        int(number.group(1)): path
        for folder in ("usr/lib", "usr/lib/*", "opt/homebrew/opt/llvm/lib")
        for path in Path("/").glob(f"{folder}/libLLVM*")
        if (number := re.fullmatch(r"libLLVM(?:-|\.so\.|\.)(\d+)[\d.]*(?:\.so|\.dylib)?[\d.]*", path.name))
    }
    return found[max(found)] if found and max(found) >= LEAST_LLVM else None


@cache
def mitsuba_with_llvm() -> Any:
    """Returns the module `mitsuba` with its LLVM variant selected."""
    if "DRJIT_LIBLLVM_PATH" not in os.environ:
        library = find_llvm()
        if library is None and farm.may_install() and farm.apt_install("libllvm19"):
            library = find_llvm()
        if library is None:
            raise MissingPeerError(f"Mitsuba needs LLVM {LEAST_LLVM} or newer. On Debian: apt install libllvm19")
        os.environ["DRJIT_LIBLLVM_PATH"] = str(library)
    try:
        import mitsuba
    except ImportError:
        raise MissingPeerError("Mitsuba is not installed; `python3 farm.py bench peers` does it") from None
    mitsuba.set_variant("llvm_ad_rgb")
    return mitsuba


def python_with_bpy() -> Path:
    """Returns a Python with Blender: $RAYFARM_BPY_PYTHON, or that of .venv-cycles, which is created if missing."""
    return _made("RAYFARM_BPY_PYTHON", farm.install_blender)


def python_with_embree() -> Path:
    """Returns a Python with Embree: $RAYFARM_EMBREE_PYTHON, or that of .venv-embree, which is created if missing."""
    return _made("RAYFARM_EMBREE_PYTHON", farm.install_embree)


def python_with_luxcore() -> Path:
    """Returns a Python with LuxCore: $RAYFARM_LUXCORE_PYTHON, or that of .venv-luxcore, which is created if missing."""
    return _made("RAYFARM_LUXCORE_PYTHON", farm.install_luxcore)


def _made(variable: str, make: Any) -> Path:
    named = os.environ.get(variable)
    if named:
        return Path(named)
    try:
        return Path(make())
    except (SystemExit, OSError) as error:
        raise MissingPeerError("its environment cannot be made; see above") from error
