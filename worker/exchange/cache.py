"""Blobs by hash on this machine: mapped from the service's own folder if that is here, otherwise fetched once and kept.

Fetched blobs are written beside their final name, checked, synced and renamed, so a file in the cache is complete even after a
power cut. The cache evicts the least recently used; a file that is still mapped somewhere stays readable until it is unmapped
(POSIX).
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import hashlib
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from renderer.places import distrust, make_private, private_folder, trusted
from worker.exchange.errors import MachineError, WorkError
from worker.exchange.link import FarmAnswer, Link

__all__ = ["BlobCache", "default_cache_dir"]

PART = ".part-"
ORPHAN_S = 60.0  # younger ones may belong to a process that has not locked its file yet
FULL = (errno.ENOSPC, errno.EDQUOT)


def default_cache_dir() -> Path:
    """Beside the kernels' cache (renderer.jit)."""
    return private_folder("blobs")


class BlobCache:
    """Gives the path of a blob on this machine. Safe to use from many processes at a time.

    max_bytes: what the fetched blobs may take together; the blob in hand is kept even where it alone is larger.
    Every method raises MachineError where this machine cannot keep files: a full disk, a folder that cannot be written.
    """

    def __init__(self, link: Link, farm: FarmAnswer, folder: Path, max_bytes: int = 32 << 30) -> None:
        self.link = link
        self.folder = trusted(folder)
        self.max_bytes = max_bytes
        self.shared = _shared_blobs(farm)

    def check(self) -> None:
        """Whether the cache can be written; to be asked before the first work comes."""
        with self._explained(), tempfile.TemporaryFile(dir=self._made(self.folder)):
            pass

    def path(self, sha256: str, size: int | None = None) -> Path:
        """The blob's file, fetched where it is not here yet. size: its size where it is known; a file of another is damaged.

        Raises Trouble or RefusedError where it cannot be fetched.
        """
        if self.shared is not None and (mine := self.shared / sha256[:2] / sha256).is_file():
            return mine
        target = self._target(sha256)
        with self._explained(), self._locked(sha256):
            _drop_distrusted(target)
            if size is not None and target.is_file() and target.stat().st_size != size:
                target.unlink()
            if not target.is_file():
                self._with_room(target, lambda: self._fetch(sha256, target))
                self._evict(target, self.max_bytes)
            with contextlib.suppress(OSError):  # a cache that may only be read serves as well
                os.utime(target)
        return target

    def adopt(self, path: Path, sha256: str) -> None:
        """Keep a copy of a file that was made here, so that it need not be fetched back. Raises WorkError if its hash is another:
        a reader of untrusted files made it.
        """
        if self.shared is not None:
            return
        target = self._target(sha256)
        with self._explained(), self._locked(sha256):
            if target.is_file() and target.stat().st_size == path.stat().st_size:
                os.utime(target)
                return
            self._with_room(target, lambda: self._copy(path, target))
            self._evict(target, self.max_bytes)

    def discard_damaged(self, sha256: str) -> bool:
        """Remove a fetched file whose bytes have changed on this disk; whether it was so. The next `path` fetches it anew."""
        target = self._target(sha256)
        with self._explained(), self._locked(sha256):
            try:
                with target.open("rb") as file:
                    is_whole = hashlib.file_digest(file, "sha256").hexdigest() == sha256
            except FileNotFoundError:
                return False
            if not is_whole:
                target.unlink(missing_ok=True)
            return not is_whole

    def _target(self, sha256: str) -> Path:
        if len(sha256) != 64 or not all(c in "0123456789abcdef" for c in sha256):
            raise ValueError(f"{sha256!r} is no SHA-256 in lower-case hexadecimal")
        return self.folder / sha256[:2] / sha256

    def _fetch(self, sha256: str, target: Path) -> None:
        with self._writing(target) as temporary, temporary.open("wb") as out:
            self.link.fetch(sha256, out)

    def _copy(self, path: Path, target: Path) -> None:
        with self._writing(target) as temporary:
            shutil.copyfile(path, temporary)
            with temporary.open("rb") as file:
                if hashlib.file_digest(file, "sha256").hexdigest() != target.name:
                    raise WorkError("a part of the compiled scene is not what its name says; prepare the scene again")

    def _with_room(self, target: Path, write: Callable[[], None]) -> None:
        """Write a file; where the disk is full, give up all other blobs for it."""
        try:
            write()
        except OSError as error:
            if error.errno not in FULL:
                raise
            self._evict(target, 0)
            write()

    @contextlib.contextmanager
    def _writing(self, target: Path) -> Iterator[Path]:
        """A file beside `target` that becomes it at the end, synced. It is locked: other slots see that somebody writes it."""
        handle, name = tempfile.mkstemp(dir=self._made(target.parent), prefix=PART)
        temporary = Path(name)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX)
            yield temporary
            os.fsync(handle)
            temporary.replace(target)
            _sync_folder(target.parent)
        finally:
            temporary.unlink(missing_ok=True)
            os.close(handle)

    @contextlib.contextmanager
    def _locked(self, sha256: str) -> Iterator[None]:
        """One process fetches a blob while the others wait for it. A lock of a killed process is released by the kernel."""
        with (self._made(self.folder / "locks") / sha256[:2]).open("wb") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            yield

    @contextlib.contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            if error.errno in FULL:
                raise MachineError(
                    f"there is no room for a scene in {self.folder}. Free some, or set RAYFARM_CACHE to a larger disk."
                ) from error
            why = error.strerror or str(error)
            raise MachineError(
                f"the cache {self.folder} cannot be used ({why}). Let this user write there, "
                "or set RAYFARM_CACHE to another folder."
            ) from error

    def _made(self, folder: Path) -> Path:
        make_private(folder)
        return folder

    def _evict(self, keep: Path, max_bytes: int) -> None:
        """Remove what was used longest ago until the rest fits, and what killed processes have left half-written."""
        files = []
        for path in self.folder.glob("??/*"):
            with contextlib.suppress(OSError):
                if path.name.startswith(PART):
                    _remove_orphan(path)
                    continue
                status = path.stat()
                files.append((status.st_mtime, status.st_size, path))
        total = sum(size for _, size, _ in files)
        for _, size, path in sorted(files):
            if total <= max_bytes:
                return
            if path != keep:
                path.unlink(missing_ok=True)
                total -= size


def _drop_distrusted(target: Path) -> None:
    """Removes a fetched file that other users may have written, and their access to its folder where it is ours."""
    with contextlib.suppress(FileNotFoundError):
        folder = target.parent.stat()
        if distrust(folder):
            if folder.st_uid == os.geteuid():
                target.parent.chmod(0o700)
            target.unlink()
        elif distrust(target.stat()):
            target.unlink()


def _remove_orphan(path: Path) -> None:
    """Remove a half-written file that nobody writes any more: whoever does holds its lock."""
    if time.time() - path.stat().st_mtime < ORPHAN_S:
        return
    with path.open("rb") as file, contextlib.suppress(BlockingIOError):
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        path.unlink(missing_ok=True)


def _sync_folder(folder: Path) -> None:
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _shared_blobs(farm: FarmAnswer) -> Path | None:
    """The service's blob folder, where this process can read it: its `instance` file has the id that the service told."""
    if not farm.data_dir:
        return None
    try:
        here = (Path(farm.data_dir) / "instance").read_text().strip()
    except (OSError, ValueError):  # not here, or named as no file can be
        return None
    return Path(farm.data_dir) / "blobs" if here and here == farm.instance else None
