"""Staging of uploads: bytes are hashed while they are written to a local temporary file."""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import BinaryIO

__all__ = ["BlobWriter", "Staging", "commit_all"]

PREFIX = "blob-"
AT_A_TIME = 8  # blobs put into the store in parallel


class BlobWriter:
    """A blob that is being written to the temporary file `path`. `commit` stores it; `discard` deletes it."""

    def __init__(self, folder: Path, put: Callable[[BlobWriter], None]) -> None:
        handle, name = tempfile.mkstemp(dir=folder, prefix=PREFIX)
        self._put = put
        self._file: BinaryIO = os.fdopen(handle, "wb")
        self._hash = hashlib.sha256()
        self.path = Path(name)
        self.size = 0

    def write(self, data: bytes) -> None:
        """Appends bytes to the blob."""
        self._file.write(data)
        self._hash.update(data)
        self.size += len(data)

    def close_file(self) -> None:
        """Closes the file after the last write, so that an upload of thousands of files does not keep all of them open."""
        self._file.close()

    @property
    def sha256(self) -> str:
        """The SHA-256 of the bytes written so far."""
        return self._hash.hexdigest()

    def rewind(self) -> BinaryIO:
        """Opens the written bytes for reading from the beginning."""
        self._file.close()
        self._file = self.path.open("rb")
        return self._file

    def commit(self) -> str:
        """Moves the blob into the store, and returns its hash."""
        self._file.close()
        self._put(self)
        self.discard()
        return self.sha256

    def discard(self) -> None:
        """Deletes the temporary file."""
        with contextlib.suppress(OSError):  # closing flushes, which fails on a full disk
            self._file.close()
        self.path.unlink(missing_ok=True)


def commit_all(writers: Iterable[BlobWriter]) -> list[str]:
    """Commits blobs in parallel threads, so that the waits for the disk overlap.

    Returns their hashes in the same order. Raises the errors of `commit`.
    """
    with ThreadPoolExecutor(AT_A_TIME, "blobs") as threads:
        return list(threads.map(BlobWriter.commit, writers))


class Staging:
    """The folder of temporary files for uploads."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    def writer(self, put: Callable[[BlobWriter], None]) -> BlobWriter:
        """Returns a writer for a new blob. put: called with the writer by its `commit`."""
        return BlobWriter(self._folder, put)

    def sweep(self) -> None:
        """Deletes files that an earlier process left unfinished."""
        for left_over in [*self._folder.glob(f"{PREFIX}*"), *self._folder.glob("means-*")]:
            left_over.unlink(missing_ok=True)
