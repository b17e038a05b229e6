"""Memory that was needed for a moment goes back to the system."""

from __future__ import annotations

import contextlib
import ctypes
import sys

__all__ = ["give_back_large_blocks"]

M_MMAP_THRESHOLD = -3
LARGE = 4 << 20


def give_back_large_blocks() -> None:
    """Have glibc return blocks as large as a tile's sums as soon as they are free.

    It does so at first, but raises its threshold to 32 MiB as it sees them come and go; then pieces of them stay in every
    thread's heap for good: gigabytes, after many pictures of large frames (measured). Elsewhere there is nothing to do.
    """
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):
            ctypes.CDLL("libc.so.6").mallopt(M_MMAP_THRESHOLD, LARGE)
