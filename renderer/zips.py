"""Archives from strangers: the errors that Python's zipfile raises for damaged ones, and the limit on what they may unpack to."""

from __future__ import annotations

import lzma
import struct
import zipfile
import zlib

__all__ = ["DAMAGED", "is_bomb", "most_unpacked"]

# Its documentation names the first alone; bytes that were changed at random gave all of them.
DAMAGED = (
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error),
    *(EOFError, IndexError, NotImplementedError, OverflowError, RuntimeError, ValueError),
)

_FREE = 16 << 20  # bytes: small files may shrink as well as they like
_RATIO = 200  # as the service has it for uploads (max_unzip_ratio)


def most_unpacked(packed: int) -> int:
    """The most bytes that so many are unpacked to."""
    return max(_FREE, _RATIO * packed)


def is_bomb(unpacked: int, packed: int) -> bool:
    """Whether so many bytes are more than scenes ever unpack to."""
    return unpacked > most_unpacked(packed)
