"""A shot in one file: its frames in a zip that is sent while it is made, or as a film."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from renderer.errors import SettingsError
from service.errors import Conflict
from service.store.films import Film
from service.watching.made import Made
from service.watching.movie import write_movie
from service.watching.pictures import PictureWish, memory, shown

__all__ = ["ZipStream", "movie", "movie_memory"]

ENCODER = 96  # bytes a pixel that an encoder looks ahead and keeps, about


class ZipStream:
    """A zip that is given away as it grows. What pictures are is compressed already, so they are stored as they are."""

    def __init__(self) -> None:
        self._out = _Pipe()
        self._zip = zipfile.ZipFile(self._out, "w", zipfile.ZIP_STORED)

    def file(self, name: str, made: Made) -> Iterator[bytes]:
        """The bytes by which the zip grows when a file is added."""
        with self._zip.open(zipfile.ZipInfo(name), "w", force_zip64=made.size >= 1 << 31) as file:
            for piece in made.pieces():
                file.write(piece)
                yield self._out.take()
        yield self._out.take()

    def end(self) -> bytes:
        """The bytes with which it ends."""
        self._zip.close()
        return self._out.take()


class _Pipe(io.RawIOBase):
    """What is written waits until it is taken."""

    def __init__(self) -> None:
        super().__init__()
        self._written = bytearray()

    def writable(self) -> bool:
        """It is."""
        return True

    def write(self, data: object) -> int:
        """All of it."""
        view = memoryview(data)  # type: ignore[arg-type]
        self._written += view
        return view.nbytes

    def take(self) -> bytes:
        """What was written since."""
        taken = bytes(self._written)
        self._written.clear()
        return taken


def movie(film: Film, frames: Sequence[int], wish: PictureWish, fps: float, folder: Path) -> Made:
    """The film of these frames, in the format of the wish's extension. Raises Conflict where it cannot be written."""
    pictures = (shown(film, frame, wish) for frame in frames)
    try:
        return Made.written(lambda path: write_movie(path, pictures, fps), folder, f".{wish.extension}")
    except SettingsError as error:
        raise Conflict(f"{error}.") from None


def movie_memory(film: Film, wish: PictureWish) -> int:
    """About the most bytes that `movie` takes."""
    return memory(film, wish) + ENCODER * film.width * film.height
