"""Streaming extraction of zip entries in chunks of at most one megabyte.

zipfile limits the chunk size for deflate only. With bzip2 or LZMA it returns all that a few kilobytes of input expand to, which
can be gigabytes in a zip bomb.
"""

from __future__ import annotations

import bz2
import copy
import lzma
import zipfile
import zlib
from collections.abc import Iterator

__all__ = ["CHUNK", "entry_chunks"]

CHUNK = 1 << 20
LZMA_MEMORY = 256 << 20
UNKNOWN_SIZE = b"\xff" * 8


def entry_chunks(file: zipfile.ZipFile, entry: zipfile.ZipInfo) -> Iterator[bytes]:
    """Yields the extracted bytes of an entry in chunks. Raises errors of zipfile, bz2 and lzma if the entry is damaged."""
    if entry.compress_type not in (zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):
        with file.open(entry) as source:
            while piece := source.read(CHUNK):
                yield piece
        return
    crc = 0
    for piece in _decompress(_compressed_chunks(file, entry), entry.compress_type):
        crc = zlib.crc32(piece, crc)
        yield piece
    if crc != entry.CRC:
        raise zipfile.BadZipFile(f"Bad CRC-32 for file {entry.filename!r}")


def _compressed_chunks(file: zipfile.ZipFile, entry: zipfile.ZipInfo) -> Iterator[bytes]:
    """Yields the still compressed bytes of an entry, by reading it as if it were stored uncompressed."""
    as_stored = copy.copy(entry)
    as_stored.compress_type = zipfile.ZIP_STORED
    as_stored.file_size = entry.compress_size
    del as_stored.CRC  # the CRC is that of the extracted bytes
    with file.open(as_stored) as source:
        if entry.compress_type == zipfile.ZIP_LZMA:
            # Skips the version; yields the properties as the header of a .lzma file without its size (APPNOTE 5.8.8), then an
            # unknown size.
            yield source.read(int.from_bytes(source.read(4)[2:], "little")) + UNKNOWN_SIZE
        while piece := source.read(CHUNK):
            yield piece


def _decompress(packed: Iterator[bytes], method: int) -> Iterator[bytes]:
    decompressor: bz2.BZ2Decompressor | lzma.LZMADecompressor = bz2.BZ2Decompressor()
    if method == zipfile.ZIP_LZMA:
        decompressor = lzma.LZMADecompressor(lzma.FORMAT_ALONE, memlimit=LZMA_MEMORY)
    for piece in packed:
        while not decompressor.eof:
            out = decompressor.decompress(piece, CHUNK)
            if out:
                yield out
            if decompressor.needs_input:
                break
            piece = b""
