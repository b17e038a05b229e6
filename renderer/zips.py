"""What Python's zipfile raises for an archive that is damaged, encrypted or packed in a way that it does not know."""

from __future__ import annotations

import lzma
import struct
import zipfile
import zlib

__all__ = ["DAMAGED"]

# Its documentation names the first alone; bytes that were changed at random gave all of them.
DAMAGED = (
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error),
    *(EOFError, IndexError, NotImplementedError, OverflowError, RuntimeError, ValueError),
)
