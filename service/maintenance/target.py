"""Where a backup goes: a folder, in which the next backup writes only what is new, or one tar file."""

from __future__ import annotations

import io
import os
import shutil
import tarfile
import tempfile
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import Protocol

from service.errors import Invalid
from service.store.atomic_files import PRIVATE, PRIVATE_FOLDER, make_private, move_whole, write_whole

__all__ = ["ARCHIVES", "FolderTarget", "TarTarget", "Target", "target_at"]

ARCHIVES = (".tar", ".tar.gz", ".tgz", ".tar.xz")


class Target(Protocol):
    """Takes files under names with slashes."""

    def manifest(self, name: str) -> bytes | None:
        """The manifest of the backup that is there already."""

    def has(self, name: str, size: int) -> bool:
        """Whether a file is there, and so long."""

    def put(self, name: str, path: Path) -> None:
        """Take a copy of a file."""

    def write(self, name: str, data: bytes) -> None:
        """Take a small file."""

    def prune(self, keep: set[str]) -> None:
        """Remove what an earlier backup had and this has not."""

    def scratch(self) -> AbstractContextManager[Path]:
        """A folder for files that are about to be put."""


class FolderTarget:
    """A folder: the same again takes only what is new."""

    def __init__(self, folder: Path, marker: str) -> None:
        """Raises Invalid for a folder that holds something else; marker: the file by which a backup is known."""
        if folder.is_dir() and any(folder.iterdir()) and not (folder / marker).exists() and not (folder / ".part").exists():
            raise Invalid(f"{folder} holds something else than a backup. Name an empty folder, or a new one.")
        make_private(folder)
        self._folder = folder
        self._part = folder / ".part"
        shutil.rmtree(self._part, ignore_errors=True)
        self._part.mkdir(PRIVATE_FOLDER)

    def manifest(self, name: str) -> bytes | None:
        """See Target. It is taken away until this backup is complete."""
        path = self._folder / name
        if not path.exists():
            return None
        data = path.read_bytes()
        path.replace(self._part / name)
        return data

    def has(self, name: str, size: int) -> bool:
        """See Target."""
        with suppress(FileNotFoundError):
            return (self._folder / name).stat().st_size == size
        return False

    def put(self, name: str, path: Path) -> None:
        """See Target."""
        target, part = self._folder / name, self._part / "copy"
        make_private(target.parent)
        shutil.copyfile(path, part)
        part.chmod(PRIVATE)
        move_whole(part, target)

    def write(self, name: str, data: bytes) -> None:
        """See Target."""
        write_whole(self._folder / name, data)

    def prune(self, keep: set[str]) -> None:
        """See Target."""
        shutil.rmtree(self._part, ignore_errors=True)
        for path in self._folder.rglob("*"):
            if path.is_file() and path.relative_to(self._folder).as_posix() not in keep:
                path.unlink()

    @contextmanager
    def scratch(self) -> Iterator[Path]:
        """See Target."""
        with tempfile.TemporaryDirectory(dir=self._part) as folder:
            yield Path(folder)


class TarTarget:
    """One file, which appears when it is complete."""

    def __init__(self, path: Path) -> None:
        if path.exists():
            raise Invalid(f"{path} is there already. Name another file, or remove it.")
        path.parent.mkdir(parents=True, exist_ok=True)
        self._path = path
        self._part = path.with_name(f".{path.name}.part")
        packing = {".gz": "w:gz", ".tgz": "w:gz", ".xz": "w:xz"}.get(path.suffix, "w")
        handle = os.open(self._part, os.O_RDWR | os.O_CREAT | os.O_TRUNC, PRIVATE)
        self._file = os.fdopen(handle, "wb")
        self._tar = tarfile.open(fileobj=self._file, mode=packing)  # type: ignore[call-overload]  # noqa: SIM115 - closed by prune
        self._has: dict[str, int] = {}

    def manifest(self, name: str) -> bytes | None:
        """See Target."""
        return None

    def has(self, name: str, size: int) -> bool:
        """See Target."""
        return self._has.get(name) == size

    def put(self, name: str, path: Path) -> None:
        """See Target. A name that comes again counts as it came last."""
        self._tar.add(path, name, filter=_private)
        self._has[name] = path.stat().st_size

    def write(self, name: str, data: bytes) -> None:
        """See Target."""
        info = tarfile.TarInfo(name)
        info.size, info.mtime = len(data), int(time.time())
        self._tar.addfile(_private(info), io.BytesIO(data))

    def prune(self, keep: set[str]) -> None:
        """See Target. Nothing was there; the file is closed and gets its name."""
        self._tar.close()
        self._file.close()
        move_whole(self._part, self._path)

    @contextmanager
    def scratch(self) -> Iterator[Path]:
        """See Target."""
        with tempfile.TemporaryDirectory(dir=self._path.parent, prefix=".rayfarm-") as folder:
            yield Path(folder)


def target_at(path: Path, marker: str) -> Target:
    """By its name: a tar file, or a folder. Raises Invalid."""
    if path.name.endswith(ARCHIVES):
        return TarTarget(path)
    if path.suffix in (".zip", ".gz", ".xz", ".zst", ".7z") or path.is_file():
        raise Invalid(f"A backup is a folder, or a file that ends with {', '.join(ARCHIVES)}; {path.name} is neither.")
    return FolderTarget(path, marker)


def _private(info: tarfile.TarInfo) -> tarfile.TarInfo:
    info.mode, info.uid, info.gid, info.uname, info.gname = PRIVATE, 0, 0, "", ""
    return info
