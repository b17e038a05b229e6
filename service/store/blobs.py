"""Files under the SHA-256 of their bytes. A blob is whole or not there: written beside, synced, then renamed."""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

__all__ = ["BlobStore", "BlobWriter", "is_sha256"]

SHA256 = re.compile(r"[0-9a-f]{64}")


def is_sha256(text: str) -> bool:
    """Whether this is a SHA-256 in lower-case hexadecimal, and so safe in a path."""
    return SHA256.fullmatch(text) is not None


class BlobWriter:
    """Bytes on their way in. Nothing is visible before `commit`; `discard` leaves no trace."""

    def __init__(self, store: BlobStore) -> None:
        handle, name = tempfile.mkstemp(dir=store.temporary, prefix="blob-")
        self._store = store
        self._file = os.fdopen(handle, "w+b")
        self._hash = hashlib.sha256()
        self.path = Path(name)
        self.size = 0

    def write(self, data: bytes) -> None:
        """Append bytes."""
        self._file.write(data)
        self._hash.update(data)
        self.size += len(data)

    @property
    def sha256(self) -> str:
        """The hash of what was written so far."""
        return self._hash.hexdigest()

    def rewind(self) -> Path:
        """Flush, and the path to read what was written."""
        self._file.flush()
        return self.path

    def commit(self) -> str:
        """Make the blob visible; returns its hash. A blob that is there already stays as it is."""
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()
        target = self._store.path(self.sha256)
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.exists():
            os.utime(target)
            self.path.unlink(missing_ok=True)
        else:
            self.path.chmod(0o644)
            self.path.replace(target)
            _sync_folder(target.parent)
        return self.sha256

    def discard(self) -> None:
        """Forget what was written."""
        self._file.close()
        self.path.unlink(missing_ok=True)


class BlobStore:
    """The folder of blobs: `<folder>/<first two hex digits>/<sha256>`; `temporary` is on the same file system."""

    def __init__(self, folder: Path, temporary: Path) -> None:
        self.folder = folder
        self.temporary = temporary
        folder.mkdir(parents=True, exist_ok=True)
        temporary.mkdir(parents=True, exist_ok=True)

    def path(self, sha256: str) -> Path:
        """Where the blob of this hash is or would be. Raises ValueError where it is no hash."""
        if not is_sha256(sha256):
            raise ValueError(f"{sha256!r} is no SHA-256 in lower-case hexadecimal")
        return self.folder / sha256[:2] / sha256

    def writer(self) -> BlobWriter:
        """Begin a new blob."""
        return BlobWriter(self)

    def delete(self, sha256: str) -> None:
        """Remove a blob; a worker that has it mapped keeps reading it."""
        self.path(sha256).unlink(missing_ok=True)

    def sweep(self, keep: set[str], older_than_s: float = 86400.0) -> int:
        """Remove unfinished writes, and blobs that are not in `keep`; returns how many blobs went.

        Young blobs stay: the news of what a worker stored may still be on its way.
        """
        for left_over in [*self.temporary.glob("blob-*"), *self.temporary.glob("means-*")]:
            left_over.unlink(missing_ok=True)
        gone = 0
        for path in self._all():
            with contextlib.suppress(OSError):
                if path.name not in keep and path.stat().st_mtime < time.time() - older_than_s:
                    path.unlink()
                    gone += 1
        return gone

    def _all(self) -> Iterator[Path]:
        return (path for path in self.folder.glob("??/*") if is_sha256(path.name))


def _sync_folder(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
