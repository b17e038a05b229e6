"""Builds and caches the PTX of kernel variants. Needs no GPU; the files are shared between hosts like the CPU's machine code."""

from __future__ import annotations

import contextlib
import os
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba import types

from renderer import jit
from renderer.arrays.scene_features import KERNEL_VARIANTS
from renderer.cache_folders import make_private, read_private
from renderer.cuda.job import wave_type
from renderer.kernel.backends.cuda.ptx import card_module, emit_ptx, joined_modules, linked_module
from renderer.kernel.backends.cuda.wavefront import kernels_of
from renderer.machine_code import SUFFIX, note_file
from renderer.reference import Reference
from renderer.shipped_kernels import copy_shipped_kernels
from renderer.target import KernelDispatcher
from renderer.variant_names import base_variant, has_caustics

__all__ = ["card_module_of", "kernel_name", "path_of", "ptx_of"]

_FOLDER = "ptx"


def kernel_name(variant: str) -> str:
    """Returns the name of a variant's kernel in the cache (renderer/kernel_file.py)."""
    return f"cuda-{variant.replace('-', '_')}"


def ptx_of(variant: str, fetch: Callable[[str], None] | None = None) -> str:
    """Returns the PTX of a variant's kernels from the cache, or builds it in a minute.

    variant: named as in renderer/variant_names.py. fetch: called with the kernel's name before it is built; may fetch the file
    from another host. Raises InexactError if the kernel needs an operation that graphics cards lack or round differently.
    """
    name = kernel_name(variant)
    path = path_of(variant)
    if not jit.is_cached(name):
        copy_shipped_kernels(jit.cache_folder())
    with jit.compiling(name, None if fetch is None else lambda: fetch(name)):
        kept = _read(path)
        if kept is None:
            kept = emit_ptx(card_module_of(variant))
            _write(path, kept)
        note_file(path)
    return kept


def card_module_of(variant: str) -> Any:
    """Compiles the kernels of a variant for graphics cards; returns their optimised LLVM module.

    Raises InexactError as `ptx_of` does.
    """
    kind, kernels = wave_type(variant), kernels_of(KERNEL_VARIANTS[base_variant(variant)], has_caustics(variant))
    context = KernelDispatcher.targetdescr.target_context
    size = context.get_abi_sizeof(context.get_value_type(kind))
    linked = {kernel: linked_module(function, (Reference(kind), types.int64)) for kernel, function in kernels.items()}
    return joined_modules([card_module(module, name, size, kernel) for kernel, (module, name) in linked.items()])


def path_of(variant: str) -> Path:
    """Returns the path of a variant's PTX in the cache."""
    assert base_variant(variant) in KERNEL_VARIANTS
    return jit.cache_folder() / _FOLDER / f"{variant}{SUFFIX}"


def _read(path: Path) -> str | None:
    try:
        found = read_private(path)
    except OSError:
        return None
    try:
        return None if found is None else zlib.decompress(found).decode("ascii")
    except (zlib.error, UnicodeDecodeError):  # a damaged file is built again
        return None


def _write(path: Path, text: str) -> None:
    """Writes the file atomically, compressed to a fifth. If it cannot be written, the next process builds the kernel again."""
    beside = path.with_name(f".part-{os.getpid()}-{path.name}")
    try:
        make_private(path.parent)
        beside.touch(0o600)
        beside.write_bytes(zlib.compress(text.encode("ascii")))
        beside.replace(path)
    except OSError:
        with contextlib.suppress(OSError):
            beside.unlink()
