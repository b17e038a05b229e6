"""Downloads of a shot (all frames of an animation) as one file: a streamed zip of the frames, or a movie."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from renderer.errors import SettingsError
from renderer.sentences import with_full_stop
from service.errors import Conflict
from service.store.films import Film
from service.watching.movie import write_movie
from service.watching.picture_response import PictureBody
from service.watching.pictures import PictureRequest, display_picture, picture_memory

__all__ = ["ZipStream", "movie", "movie_memory"]

ENCODER_BYTES_PER_PIXEL = 96  # approximate bytes per pixel of an encoder's lookahead


class ZipStream:
    """A zip archive generated as a stream. Entries are stored uncompressed, since picture files are compressed already."""

    def __init__(self) -> None:
        self._out = _Pipe()
        self._zip = zipfile.ZipFile(self._out, "w", zipfile.ZIP_STORED)

    def file(self, name: str, picture: PictureBody) -> Iterator[bytes]:
        """Adds a file and yields the bytes to append to the stream."""
        with self._zip.open(zipfile.ZipInfo(name), "w", force_zip64=picture.size >= 1 << 31) as file:
            for piece in picture.pieces():
                file.write(piece)
                yield self._out.take_written()
        yield self._out.take_written()

    def final_bytes(self) -> bytes:
        """Returns the final bytes of the zip archive."""
        self._zip.close()
        return self._out.take_written()


class _Pipe(io.RawIOBase):
    """Writable file object that buffers bytes until `take_written` returns them."""

    def __init__(self) -> None:
        super().__init__()
        self._written = bytearray()

    def writable(self) -> bool:
        """Returns True, as zipfile requires."""
        return True

    def write(self, data: object) -> int:
        """Buffers all bytes and returns their number."""
        view = memoryview(data)  # type: ignore[arg-type]
        self._written += view
        return view.nbytes

    def take_written(self) -> bytes:
        """Returns the bytes written since the last call, and empties the buffer."""
        taken = bytes(self._written)
        self._written.clear()
        return taken


def movie(film: Film, frames: Sequence[int], request: PictureRequest, fps: float, folder: Path) -> PictureBody:
    """Returns a movie of the frames with these keys, in the format `request.extension`. Raises Conflict if that fails.

    folder: for temporary files.
    """
    pictures = (display_picture(film, frame, request) for frame in frames)
    try:
        return PictureBody.from_writer(lambda path: write_movie(path, pictures, fps), folder, f".{request.extension}")
    except SettingsError as error:
        raise Conflict(with_full_stop(error)) from None


def movie_memory(film: Film, request: PictureRequest) -> int:
    """Returns the estimated peak memory of `movie` for this film, in bytes."""
    return picture_memory(film, request) + ENCODER_BYTES_PER_PIXEL * film.width * film.height
