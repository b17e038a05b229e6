"""Files under the SHA-256 of their bytes. A blob is whole or not there."""

from __future__ import annotations

import contextlib
import os
import re
import time
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Protocol

from service.errors import NotFound
from service.store.staging import BlobWriter, Staging
from service.store.whole import PRIVATE_FOLDER, move_whole

__all__ = ["CHUNK", "OLD_S", "BlobFolder", "BlobStore", "ServedBlob", "is_sha256", "no_blob"]

SHA256 = re.compile(r"[0-9a-f]{64}")
CHUNK = 1 << 20
OLD_S = 86400.0
AT_A_TIME = 8  # blobs that are deleted


def is_sha256(text: str) -> bool:
    """Whether this is a SHA-256 in lower-case hexadecimal, and so safe in a path."""
    return SHA256.fullmatch(text) is not None


@dataclass(frozen=True)
class ServedBlob:
    """A blob on its way out."""

    size: int
    chunks: Iterator[bytes]


class BlobStore(Protocol):
    """Where blobs are. A hash that is none raises ValueError; a store that does not answer, Unavailable."""

    is_local: bool  # a worker on this machine finds the blobs in the data folder, and maps them from there

    def writer(self) -> BlobWriter:
        """Begin a new blob."""

    def put(self, writer: BlobWriter) -> None:
        """Make what was written a blob. One that is there already stays as it is."""

    def open(self, sha256: str) -> BinaryIO:
        """Read a blob. Raises NotFound."""

    def serve(self, sha256: str) -> ServedBlob:
        """A blob in pieces, to be sent on. Raises NotFound."""

    def exists(self, sha256: str) -> bool:
        """Whether the blob is there."""

    def size(self, sha256: str) -> int | None:
        """How many bytes a blob has; None where it is not there."""

    def delete(self, hashes: Collection[str], guard: Callable[[], None] = lambda: None) -> None:
        """Remove those blobs that are there. guard: asked again and again whether that may be; raises FarmError."""

    def sweep(self, keep: set[str], older_than_s: float = OLD_S) -> set[str]:
        """Remove unfinished writes, and old blobs that are not in `keep`; returns the young ones.

        These stay: the news of what a worker stored may still be on its way.
        """


class BlobFolder:
    """Blobs as `<folder>/<first two hex digits>/<sha256>`; `temporary` is on the same file system.

    A worker that has a blob mapped keeps reading it after it was deleted.
    """

    is_local = True

    def __init__(self, folder: Path, temporary: Path) -> None:
        self._folder = folder
        self._staging = Staging(temporary)
        folder.mkdir(parents=True, exist_ok=True)

    def writer(self) -> BlobWriter:
        """See BlobStore."""
        return self._staging.writer(self.put)

    def put(self, writer: BlobWriter) -> None:
        """See BlobStore. One that a power cut left shorter than it was is replaced."""
        target = self._path(writer.sha256)
        target.parent.mkdir(PRIVATE_FOLDER, parents=True, exist_ok=True)
        with contextlib.suppress(FileNotFoundError):
            if target.stat().st_size == writer.size:
                os.utime(target)
                return
        move_whole(writer.path, target)

    def open(self, sha256: str) -> BinaryIO:
        """See BlobStore."""
        try:
            return self._path(sha256).open("rb")
        except FileNotFoundError:
            raise no_blob() from None

    def serve(self, sha256: str) -> ServedBlob:
        """See BlobStore."""
        file = self.open(sha256)
        return ServedBlob(os.fstat(file.fileno()).st_size, _chunks(file))

    def exists(self, sha256: str) -> bool:
        """See BlobStore."""
        return self._path(sha256).is_file()

    def size(self, sha256: str) -> int | None:
        """See BlobStore."""
        try:
            return self._path(sha256).stat().st_size
        except FileNotFoundError:
            return None

    def delete(self, hashes: Collection[str], guard: Callable[[], None] = lambda: None) -> None:
        """See BlobStore. Several at a time: a disk that discards at once is waited for, one time for all that wait."""

        def remove(path: Path) -> None:
            guard()
            path.unlink(missing_ok=True)

        paths = [self._path(sha256) for sha256 in hashes]
        if len(paths) <= 1:
            for path in paths:
                remove(path)
            return
        with ThreadPoolExecutor(AT_A_TIME, "blobs") as threads:
            list(threads.map(remove, paths))

    def sweep(self, keep: set[str], older_than_s: float = OLD_S) -> set[str]:
        """See BlobStore."""
        self._staging.sweep()
        young = set()
        for path in self._folder.glob("??/*"):
            with contextlib.suppress(OSError):
                if not is_sha256(path.name) or path.name in keep:
                    continue
                if path.stat().st_mtime < time.time() - older_than_s:
                    path.unlink()
                else:
                    young.add(path.name)
        return young

    def _path(self, sha256: str) -> Path:
        if not is_sha256(sha256):
            raise ValueError(f"{sha256!r} is no SHA-256 in lower-case hexadecimal")
        return self._folder / sha256[:2] / sha256


def no_blob() -> NotFound:
    """There is no such blob."""
    return NotFound("There is no blob of this hash; its scene may have been deleted.")


def _chunks(file: BinaryIO) -> Iterator[bytes]:
    with file:
        while chunk := file.read(CHUNK):
            yield chunk
