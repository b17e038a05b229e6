"""Body of a picture response. Large bodies are stored on disk, since they stay until a slow client has read them."""

from __future__ import annotations

import contextlib
import os
import tempfile
import weakref
from collections.abc import Callable, Iterator
from pathlib import Path

__all__ = ["PictureBody"]

MAX_IN_MEMORY = 1 << 18
PIECE = 1 << 18


class PictureBody:
    """Bytes of a picture, which any number of clients can read in chunks.

    Large ones are in an unlinked file, freed with the last reference to this object.
    """

    def __init__(self, data: bytes, file: int | None = None) -> None:
        """Stores the bytes, or an open file if it is given.

        file: descriptor, closed when this object is freed.
        """
        self.span: tuple[float, float] | None = None  # range of a heat map
        self._data = data
        self._file = file
        self.size = len(data) if file is None else os.fstat(file).st_size
        if file is not None:
            weakref.finalize(self, os.close, file)

    @classmethod
    def from_bytes(cls, data: bytes, folder: Path) -> PictureBody:
        """Returns a body with these bytes: in a temporary file in `folder`, or in memory if they are few or the disk is full."""
        if len(data) > MAX_IN_MEMORY:
            with contextlib.suppress(OSError):
                return cls.from_writer(lambda path: path.write_bytes(data), folder, "")
        return cls(data)

    @classmethod
    def from_writer(cls, write: Callable[[Path], object], folder: Path, suffix: str) -> PictureBody:
        """Returns a body with the file that `write` writes to a path with this suffix in `folder`. Raises what `write` raises."""
        with tempfile.TemporaryDirectory(prefix="picture-", dir=folder) as own:
            path = Path(own) / f"picture{suffix}"
            write(path)
            return cls(b"", os.open(path, os.O_RDONLY | os.O_CLOEXEC))

    def pieces(self) -> Iterator[bytes]:
        """Yields the content in chunks, from the beginning."""
        if self._file is None:
            yield self._data
            return
        at = 0
        while piece := os.pread(self._file, PIECE, at):
            at += len(piece)
            yield piece
