"""Configures glibc's allocator for large, short-lived arrays."""

from __future__ import annotations

import contextlib
import ctypes
import sys

__all__ = ["trim_heap", "use_one_heap"]

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD, M_ARENA_MAX = -1, -3, -8  # malloc.h
MMAP_THRESHOLD = 32 << 20  # glibc's maximum
TRIM_THRESHOLD = 128 << 20


def use_one_heap() -> None:
    """Makes all threads share one heap, which keeps some free memory for the next allocations.

    Threads that encode pictures or merge results repeatedly allocate and free a tile's sums (10 MB). The system zeroes newly
    allocated pages each time, which took three quarters of a picture's processor time. With one heap per thread, each heap
    would keep free memory.
    """
    _call_libc("mallopt", M_MMAP_THRESHOLD, MMAP_THRESHOLD)
    _call_libc("mallopt", M_TRIM_THRESHOLD, TRIM_THRESHOLD)
    _call_libc("mallopt", M_ARENA_MAX, 1)


def trim_heap() -> None:
    """Returns free heap memory to the operating system."""
    _call_libc("malloc_trim", 0)


def _call_libc(function: str, *arguments: int) -> None:
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):
            getattr(ctypes.CDLL("libc.so.6"), function)(*arguments)
