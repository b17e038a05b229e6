"""Memory needed for a moment: where it comes from, and how it is returned to the system. glibc only."""

from __future__ import annotations

import contextlib
import ctypes
import sys

__all__ = ["give_back", "keep_one_heap"]

M_TRIM_THRESHOLD, M_MMAP_THRESHOLD, M_ARENA_MAX = -1, -3, -8  # malloc.h
LARGE = 32 << 20  # the most that glibc takes
KEPT = 128 << 20


def keep_one_heap() -> None:
    """Have all threads take memory from one heap, and keep a little of what is free for the next who asks.

    Pictures and merges take and free a tile's sums (10 MB) again and again. From the system, each of its pages would be new and
    cleared every time, which took three quarters of a picture's processor time; from a heap of each thread's own,
    pieces would stay behind in all of them.
    """
    _call("mallopt", M_MMAP_THRESHOLD, LARGE)
    _call("mallopt", M_TRIM_THRESHOLD, KEPT)
    _call("mallopt", M_ARENA_MAX, 1)


def give_back() -> None:
    """Return to the system what is free."""
    _call("malloc_trim", 0)


def _call(function: str, *arguments: int) -> None:
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):
            getattr(ctypes.CDLL("libc.so.6"), function)(*arguments)
