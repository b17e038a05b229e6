"""Tests that compiled subroutines are linked from the cache, and that only whole kernels become machine code."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from renderer.jit import device, entry, never_inline, subroutine


@device
def _merged(x):
    return x * 3.0


@subroutine
def _apart_from_all(values):
    never_inline()
    total = 0.0
    for i in range(len(values)):
        total += _merged(values[i])
    return total


@subroutine
def _between(values):
    never_inline()
    return _apart_from_all(values) + 1.0


@entry
def kernel(values):
    """Writes three times the sum of the values, plus 1."""
    return _between(values)


@pytest.fixture
def cold(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    for function in (_merged, _apart_from_all, _between, kernel):
        function._cache.flush()
        function._reset_overloads()


def test_only_the_kernel_is_compiled_to_machine_code(cold: None) -> None:
    assert kernel(np.arange(4.0)) == 19.0
    libraries = {f.__name__: next(iter(f.overloads.values())).library for f in (_merged, _apart_from_all, _between, kernel)}
    codes = {name: library._compiled_object for name, library in libraries.items()}
    assert b"_apart_from_all" in codes["kernel"]
    assert [name for name, code in codes.items() if code is not None] == ["kernel"]
    assert [name for name, library in libraries.items() if not library.is_inlinable] == ["_apart_from_all", "_between"]


def test_cached_functions_are_linked(cold: None) -> None:
    """In a new process each cached function is loaded from its file once, and linked into newly compiled callers."""
    assert kernel(np.arange(4.0)) == 19.0
    kernel._cache.flush()
    for function in (_apart_from_all, _between, kernel):
        function._reset_overloads()
    assert kernel(np.arange(5.0)) == 31.0


@entry
def caller(values):
    """Writes the kernel's result times 2."""
    return 2.0 * kernel(values)


def test_kernel_bitcode_is_loaded_when_linked(cold: None) -> None:
    assert kernel(np.arange(4.0)) == 19.0
    kernel._reset_overloads()
    assert kernel(np.arange(4.0)) == 19.0
    kept = next(iter(kernel.overloads.values())).library
    assert isinstance(kept._unread, bytes)
    caller._cache.flush()
    caller._reset_overloads()
    assert caller(np.arange(4.0)) == 38.0
    assert kept._unread is None
