"""Uploaded bytes on their way in: a temporary file on this machine, hashed as it is written."""

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
AT_A_TIME = 8  # blobs that are put into the store


class BlobWriter:
    """Nothing is visible before `commit`; `discard` leaves no trace. `path` is for the store that takes the file."""

    def __init__(self, folder: Path, put: Callable[[BlobWriter], None]) -> None:
        handle, name = tempfile.mkstemp(dir=folder, prefix=PREFIX)
        self._put = put
        self._file: BinaryIO = os.fdopen(handle, "wb")
        self._hash = hashlib.sha256()
        self.path = Path(name)
        self.size = 0

    def write(self, data: bytes) -> None:
        """Append bytes."""
        self._file.write(data)
        self._hash.update(data)
        self.size += len(data)

    def end(self) -> None:
        """All of it is written. An upload has thousands of files, and they are not held open until the last one has come."""
        self._file.close()

    @property
    def sha256(self) -> str:
        """The hash of what was written so far."""
        return self._hash.hexdigest()

    def rewind(self) -> BinaryIO:
        """What was written, to be read from its beginning."""
        self._file.close()
        self._file = self.path.open("rb")
        return self._file

    def commit(self) -> str:
        """Put it into the store; returns its hash."""
        self._file.close()
        self._put(self)
        self.discard()
        return self.sha256

    def discard(self) -> None:
        """Forget what was written."""
        with contextlib.suppress(OSError):  # a full disk has no room for the last of it
            self._file.close()
        self.path.unlink(missing_ok=True)


def commit_all(writers: Iterable[BlobWriter]) -> list[str]:
    """Put them into the store, several at a time: most of the time goes into waiting for the disk, once for all that wait.

    Returns their hashes in the same order. Raises what `commit` raises.
    """
    with ThreadPoolExecutor(AT_A_TIME, "blobs") as threads:
        return list(threads.map(BlobWriter.commit, writers))


class Staging:
    """The folder of temporary files."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    def writer(self, put: Callable[[BlobWriter], None]) -> BlobWriter:
        """Begin a blob; `put` takes it when it is complete."""
        return BlobWriter(self._folder, put)

    def sweep(self) -> None:
        """Remove what an earlier life of the service did not finish."""
        for left_over in [*self._folder.glob(f"{PREFIX}*"), *self._folder.glob("means-*")]:
            left_over.unlink(missing_ok=True)
