"""A picture file on its way to its readers: on disk if it is large, since a slow reader would occupy memory for long."""

from __future__ import annotations

import contextlib
import os
import tempfile
import weakref
from collections.abc import Callable, Iterator
from pathlib import Path

__all__ = ["Made"]

SMALL = 1 << 18
PIECE = 1 << 18


class Made:
    """Bytes that any number of readers take in pieces. Their file has no name, and goes with the last who knows of it."""

    def __init__(self, data: bytes, file: int | None = None) -> None:
        """data: what is in memory. file: a descriptor of what is not; it is closed in the end."""
        self.span: tuple[float, float] | None = None  # of a heat map: the values between which it is drawn
        self._data = data
        self._file = file
        self.size = len(data) if file is None else os.fstat(file).st_size
        if file is not None:
            weakref.finalize(self, os.close, file)

    @classmethod
    def of(cls, data: bytes, folder: Path) -> Made:
        """Of bytes; they stay in memory where they are few, or where the disk in `folder` has no room."""
        if len(data) > SMALL:
            with contextlib.suppress(OSError):
                return cls.written(lambda path: path.write_bytes(data), folder, "")
        return cls(data)

    @classmethod
    def written(cls, write: Callable[[Path], object], folder: Path, suffix: str) -> Made:
        """Of what `write` writes to a path that ends so. Raises what it raises."""
        with tempfile.TemporaryDirectory(prefix="picture-", dir=folder) as own:
            path = Path(own) / f"picture{suffix}"
            write(path)
            return cls(b"", os.open(path, os.O_RDONLY | os.O_CLOEXEC))

    def pieces(self) -> Iterator[bytes]:
        """All of it, from the beginning."""
        if self._file is None:
            yield self._data
            return
        at = 0
        while piece := os.pread(self._file, PIECE, at):
            at += len(piece)
            yield piece
