"""Blob storage: files addressed by the SHA-256 of their content. A blob is complete or absent."""

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

from renderer.sentences import Sentence
from service.errors import NotFound
from service.store.atomic_files import PRIVATE_FOLDER, rename_synced
from service.store.staging import BlobWriter, Staging

__all__ = ["CHUNK", "MIN_AGE_S", "BlobFolder", "BlobStore", "ServedBlob", "blob_not_found", "is_sha256"]

SHA256 = re.compile(r"[0-9a-f]{64}")
CHUNK = 1 << 20
MIN_AGE_S = 86400.0
DELETING_THREADS = 8  # threads that delete blobs in parallel


def is_sha256(text: str) -> bool:
    """Returns True if `text` is a SHA-256 in lower-case hexadecimal, which is safe as part of a path."""
    return SHA256.fullmatch(text) is not None


@dataclass(frozen=True)
class ServedBlob:
    """A blob for a response: its size in bytes and its content in chunks."""

    size: int
    chunks: Iterator[bytes]


class BlobStore(Protocol):
    """Interface of the blob storage.

    Methods raise ValueError for a malformed hash, and Unavailable if the storage does not respond.
    """

    is_local: bool  # whether workers on this machine can map the blobs from the data folder

    def writer(self) -> BlobWriter:
        """Returns a writer for a new blob."""

    def put(self, writer: BlobWriter) -> None:
        """Stores the bytes of a writer as a blob. An existing blob is not changed."""

    def open(self, sha256: str) -> BinaryIO:
        """Opens a blob for reading. Raises NotFound."""

    def serve(self, sha256: str) -> ServedBlob:
        """Returns a blob's size and content in chunks, for a response. Raises NotFound."""

    def exists(self, sha256: str) -> bool:
        """Returns True if the blob exists."""

    def size(self, sha256: str) -> int | None:
        """Returns the size of a blob in bytes, or None if it does not exist."""

    def delete(self, hashes: Collection[str], guard: Callable[[], None] = lambda: None) -> None:
        """Deletes the blobs with these hashes. Missing blobs are ignored.

        guard: called before each deletion; raises FarmError if deleting is no longer allowed.
        """

    def sweep(self, keep: set[str], older_than_s: float = MIN_AGE_S) -> set[str]:
        """Deletes remains of interrupted writes, and blobs older than `older_than_s` seconds that are not in `keep`.

        Returns the hashes of younger blobs that are not in `keep`. These are not deleted, since the worker's message that
        refers to them may still be in transit.
        """


class BlobFolder:
    """Blobs as files `<folder>/<first two hex digits>/<sha256>`. `temporary` is a folder on the same file system.

    A worker that has mapped a blob into memory can still read it after its deletion.
    """

    is_local = True

    def __init__(self, folder: Path, temporary: Path) -> None:
        self._folder = folder
        self._staging = Staging(temporary)
        folder.mkdir(parents=True, exist_ok=True)

    def writer(self) -> BlobWriter:
        """Returns a writer for a new blob, which is written to a temporary file."""
        return self._staging.writer(self.put)

    def put(self, writer: BlobWriter) -> None:
        """Moves the written file to the blob's path, unless the blob exists.

        An existing file of another size, which a power failure can leave, is replaced.
        """
        target = self._path(writer.sha256)
        target.parent.mkdir(PRIVATE_FOLDER, parents=True, exist_ok=True)
        with contextlib.suppress(FileNotFoundError):
            if target.stat().st_size == writer.size:
                os.utime(target)
                return
        rename_synced(writer.path, target)

    def open(self, sha256: str) -> BinaryIO:
        """Opens a blob for reading. Raises NotFound."""
        try:
            return self._path(sha256).open("rb")
        except FileNotFoundError:
            raise blob_not_found() from None

    def serve(self, sha256: str) -> ServedBlob:
        """Returns a blob's size and content in chunks, for a response. Raises NotFound."""
        file = self.open(sha256)
        return ServedBlob(os.fstat(file.fileno()).st_size, _chunks(file))

    def exists(self, sha256: str) -> bool:
        """Returns True if the blob exists."""
        return self._path(sha256).is_file()

    def size(self, sha256: str) -> int | None:
        """Returns the size of a blob in bytes, or None if it does not exist."""
        try:
            return self._path(sha256).stat().st_size
        except FileNotFoundError:
            return None

    def delete(self, hashes: Collection[str], guard: Callable[[], None] = lambda: None) -> None:
        """Deletes the blobs with these hashes. Missing blobs are ignored.

        Up to DELETING_THREADS files are deleted in parallel, so that the waits of disks with synchronous discard overlap.
        guard: called before each deletion; raises FarmError if deleting is not allowed.
        """

        def remove(path: Path) -> None:
            guard()
            path.unlink(missing_ok=True)

        paths = [self._path(sha256) for sha256 in hashes]
        if len(paths) <= 1:
            for path in paths:
                remove(path)
            return
        with ThreadPoolExecutor(DELETING_THREADS, "blobs") as threads:
            list(threads.map(remove, paths))

    def sweep(self, keep: set[str], older_than_s: float = MIN_AGE_S) -> set[str]:
        """Deletes remains of interrupted writes, and blobs older than `older_than_s` seconds that are not in `keep`.

        Returns the hashes of younger blobs that are not in `keep`.
        """
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
            raise ValueError(f"{sha256!r} is not a SHA-256 hash in lower-case hexadecimal")
        return self._folder / sha256[:2] / sha256


def blob_not_found() -> NotFound:
    """Returns the error for a blob that does not exist."""
    return NotFound(Sentence("blob-not-found", "There is no blob with this hash; its scene may have been deleted."))


def _chunks(file: BinaryIO) -> Iterator[bytes]:
    with file:
        while chunk := file.read(CHUNK):
            yield chunk
