"""Blobs by hash on this machine: mapped from the service's own folder where it is here, else fetched once and kept.

Fetched blobs are written beside their final name, checked, and renamed, so a file in the cache is always whole. The cache
forgets what was not used longest; a file that is still mapped somewhere stays readable until it is unmapped (POSIX).
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

from renderer.places import cache_home
from worker.link import FarmAnswer, Link

__all__ = ["BlobCache", "default_cache_dir"]


def default_cache_dir() -> Path:
    """Beside the kernels' cache (renderer.jit)."""
    return cache_home() / "blobs"


class BlobCache:
    """Gives the path of a blob on this machine. Safe to use from many processes at a time.

    max_bytes: what the fetched blobs may take together; the blob in hand is kept even where it alone is larger.
    """

    def __init__(self, link: Link, farm: FarmAnswer, folder: Path, max_bytes: int = 32 << 30) -> None:
        self.link = link
        self.folder = folder
        self.max_bytes = max_bytes
        self.shared = _shared_blobs(farm)

    def path(self, sha256: str) -> Path:
        """The blob's file, fetched where it is not here yet. Raises LinkError or RefusedError where it cannot be fetched."""
        if self.shared is not None and (mine := self.shared / sha256[:2] / sha256).is_file():
            return mine
        target = self._target(sha256)
        with self._locked(sha256):
            if not target.is_file():
                with self._writing(target) as temporary, temporary.open("wb") as out:
                    self.link.fetch(sha256, out)
                self._evict(keep=target)
            os.utime(target)
        return target

    def adopt(self, path: Path, sha256: str) -> None:
        """Keep a file that was made here and whose hash is known, so that it need not be fetched back."""
        if self.shared is not None:
            return
        target = self._target(sha256)
        with self._locked(sha256), self._writing(target) as temporary:
            temporary.unlink()
            try:
                os.link(path, temporary)
            except OSError:
                temporary.write_bytes(path.read_bytes())
        self._evict(keep=target)

    def _target(self, sha256: str) -> Path:
        if len(sha256) != 64 or not all(c in "0123456789abcdef" for c in sha256):
            raise ValueError(f"{sha256!r} is no SHA-256 in lower-case hexadecimal")
        return self.folder / sha256[:2] / sha256

    @contextlib.contextmanager
    def _writing(self, target: Path) -> Iterator[Path]:
        target.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=".part-")
        os.close(handle)
        temporary = Path(name)
        try:
            yield temporary
            temporary.replace(target)
        finally:
            temporary.unlink(missing_ok=True)

    @contextlib.contextmanager
    def _locked(self, sha256: str) -> Iterator[None]:
        """One process fetches a blob while the others wait for it. A lock of a killed process is released by the kernel."""
        locks = self.folder / "locks"
        locks.mkdir(parents=True, exist_ok=True)
        with (locks / sha256[:2]).open("wb") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            yield

    def _evict(self, keep: Path) -> None:
        files = []
        for path in self.folder.glob("??/*"):
            with contextlib.suppress(OSError):
                status = path.stat()
                files.append((status.st_mtime, status.st_size, path))
        total = sum(size for _, size, _ in files)
        for _, size, path in sorted(files):
            if total <= self.max_bytes:
                return
            if path != keep:
                path.unlink(missing_ok=True)
                total -= size


def _shared_blobs(farm: FarmAnswer) -> Path | None:
    """The service's blob folder, where this process can read it: its `instance` file has the id that the service told."""
    if not farm.data_dir:
        return None
    try:
        here = (Path(farm.data_dir) / "instance").read_text().strip()
    except OSError:
        return None
    return Path(farm.data_dir) / "blobs" if here and here == farm.instance else None
