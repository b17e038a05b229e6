"""Cache of blobs by hash: mapped from the service's folder if it is on this machine; otherwise downloaded once and stored.

Downloaded blobs are written to a temporary file next to their final name, verified, synced and renamed, so a file in the cache is
complete even after a power failure. The cache evicts the least recently used blob; a file that is still mapped stays readable
until it is unmapped (POSIX).
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

from renderer.cache_folders import make_private, private_folder, reason_to_distrust, trusted
from renderer.sentences import Sentence
from worker.exchange.errors import MachineError, WorkError
from worker.exchange.link import FarmAnswer, Link

__all__ = ["BlobCache", "default_cache_dir"]

PARTIAL_MARK = ".part-"
ORPHAN_AGE_S = 60.0  # younger files may belong to a process that has not locked them yet
DISK_FULL_ERRORS = (errno.ENOSPC, errno.EDQUOT)


def default_cache_dir() -> Path:
    """Returns the default cache folder, next to the cache of kernels (renderer.jit)."""
    return private_folder("blobs")


class BlobCache:
    """The blob cache of this machine. Many processes can use it concurrently.

    max_bytes: limit on the total size of downloaded blobs; the requested blob is stored even if it alone is larger.
    Every method raises MachineError if this machine cannot store files: full disk, folder without write permission.
    """

    def __init__(self, link: Link, farm: FarmAnswer, folder: Path, max_bytes: int = 32 << 30) -> None:
        self.link = link
        self.folder = trusted(folder)
        self.max_bytes = max_bytes
        self.shared = _service_blob_folder(farm)

    def check(self) -> None:
        """Raises MachineError if the cache is not writable. Called before the first task."""
        with self._translated_errors(), tempfile.TemporaryFile(dir=self._created_folder(self.folder)):
            pass

    def path(self, sha256: str, size: int | None = None) -> Path:
        """Returns the path of a blob's file, downloaded if missing. size: if known, a file of another size is downloaded again.

        Raises TemporaryError or RefusedError if it cannot be downloaded.
        """
        if self.shared is not None and (mine := self.shared / sha256[:2] / sha256).is_file():
            return mine
        target = self._target(sha256)
        with self._translated_errors(), self._locked(sha256):
            _remove_untrusted(target)
            if size is not None and target.is_file() and target.stat().st_size != size:
                target.unlink()
            if not target.is_file():
                self._evicting_if_full(target, lambda: self._fetch(sha256, target))
                self._evict(target, self.max_bytes)
            with contextlib.suppress(OSError):  # a read-only cache is usable
                os.utime(target)
        return target

    def add_copy(self, path: Path, sha256: str) -> None:
        """Adds a copy of a file that was created on this machine, so that it need not be downloaded.

        Raises WorkError if its hash is not `sha256`, since the process that created it is not trusted.
        """
        if self.shared is not None:
            return
        target = self._target(sha256)
        with self._translated_errors(), self._locked(sha256):
            if target.is_file() and target.stat().st_size == path.stat().st_size:
                os.utime(target)
                return
            self._evicting_if_full(target, lambda: self._copy_file(path, target))
            self._evict(target, self.max_bytes)

    def discard_damaged(self, sha256: str) -> bool:
        """Deletes a downloaded file if its content does not match its hash any more. Returns whether it was deleted.

        The next `path` downloads it again.
        """
        target = self._target(sha256)
        with self._translated_errors(), self._locked(sha256):
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
            raise ValueError(f"{sha256!r} is not a SHA-256 hash in lower-case hexadecimal")
        return self.folder / sha256[:2] / sha256

    def _fetch(self, sha256: str, target: Path) -> None:
        with self._writing(target) as temporary, temporary.open("wb") as out:
            self.link.fetch(sha256, out)

    def _copy_file(self, path: Path, target: Path) -> None:
        with self._writing(target) as temporary:
            shutil.copyfile(path, temporary)
            with temporary.open("rb") as file:
                if hashlib.file_digest(file, "sha256").hexdigest() != target.name:
                    raise WorkError(
                        Sentence(
                            "cache-part-damaged", "a part of the compiled scene does not match its hash; prepare the scene again"
                        )
                    )

    def _evicting_if_full(self, target: Path, write: Callable[[], None]) -> None:
        """Calls `write`, which creates the file `target`. If the disk is full, evicts all other blobs and calls it again."""
        try:
            write()
        except OSError as error:
            if error.errno not in DISK_FULL_ERRORS:
                raise
            self._evict(target, 0)
            write()

    @contextlib.contextmanager
    def _writing(self, target: Path) -> Iterator[Path]:
        """Context manager that yields a temporary file next to `target`; on exit, syncs it and renames it to `target`.

        The file is locked while it is being written.
        """
        handle, name = tempfile.mkstemp(dir=self._created_folder(target.parent), prefix=PARTIAL_MARK)
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
        """Context manager that holds an exclusive file lock for a blob, so that one process downloads it while others wait.

        The operating system releases locks of killed processes. Blobs whose hashes have the same first two digits share a lock.
        """
        with (self._created_folder(self.folder / "locks") / sha256[:2]).open("wb") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            yield

    @contextlib.contextmanager
    def _translated_errors(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            if error.errno in DISK_FULL_ERRORS:
                raise MachineError(
                    Sentence(
                        "cache-disk-full",
                        "there is no room for a scene in {folder}. Free some space, or set RAYFARM_CACHE to a larger disk.",
                        folder=self.folder,
                    )
                ) from error
            why = error.strerror or str(error)
            raise MachineError(
                Sentence(
                    "cache-folder-unusable",
                    "the cache {folder} cannot be used ({reason}). Make it writable, or set RAYFARM_CACHE to another folder.",
                    folder=self.folder,
                    reason=why,
                )
            ) from error

    def _created_folder(self, folder: Path) -> Path:
        make_private(folder)
        return folder

    def _evict(self, keep: Path, max_bytes: int) -> None:
        """Deletes the least recently used files, but never `keep`, until the total size is at most `max_bytes`.

        Also deletes partial files of killed processes.
        """
        files = []
        for path in self.folder.glob("??/*"):
            with contextlib.suppress(OSError):
                if path.name.startswith(PARTIAL_MARK):
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


def _remove_untrusted(target: Path) -> None:
    """Deletes a downloaded file that other users could have written; makes its folder private if this user owns the folder."""
    with contextlib.suppress(FileNotFoundError):
        folder = target.parent.stat()
        if reason_to_distrust(folder):
            if folder.st_uid == os.geteuid():
                target.parent.chmod(0o700)
            target.unlink()
        elif reason_to_distrust(target.stat()):
            target.unlink()


def _remove_orphan(path: Path) -> None:
    """Deletes a partial file unless its writer still runs, and so holds the file's lock."""
    if time.time() - path.stat().st_mtime < ORPHAN_AGE_S:
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


def _service_blob_folder(farm: FarmAnswer) -> Path | None:
    """Returns the service's blob folder if this process can read it, else None.

    The folder is the service's if the file `instance` in the data folder contains the service's id.
    """
    if not farm.data_dir:
        return None
    try:
        here = (Path(farm.data_dir) / "instance").read_text().strip()
    except (OSError, ValueError):  # on another machine, or an invalid path
        return None
    return Path(farm.data_dir) / "blobs" if here and here == farm.instance else None
