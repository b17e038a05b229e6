"""Limits and errors for untrusted zip archives: the maximum unpacked size, and the exceptions of zipfile for damaged archives."""

from __future__ import annotations

import lzma
import struct
import zipfile
import zlib

__all__ = ["DAMAGED", "is_bomb", "most_unpacked"]

# The documentation names only the first; fuzzing raised all of them.
DAMAGED = (
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error),
    *(EOFError, IndexError, NotImplementedError, OverflowError, RuntimeError, ValueError),
)

_FREE = 16 << 20  # bytes: no limit on the ratio below
_RATIO = 200  # as the service's limit for uploads (max_unzip_ratio)


def most_unpacked(packed: int) -> int:
    """Returns the maximum allowed unpacked size, in bytes, of an archive of this packed size."""
    return max(_FREE, _RATIO * packed)


def is_bomb(unpacked: int, packed: int) -> bool:
    """Returns True if an archive's unpacked size, in bytes, exceeds the maximum for its packed size."""
    return unpacked > most_unpacked(packed)
