"""Destinations of a backup: a folder, to which later backups add only new files, or a tar file."""

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

from renderer.sentences import Sentence
from service.errors import Invalid
from service.store.atomic_files import PRIVATE, PRIVATE_FOLDER, make_private, rename_synced, write_atomically

__all__ = ["ARCHIVES", "FolderTarget", "TarTarget", "Target", "target_at"]

ARCHIVES = (".tar", ".tar.gz", ".tgz", ".tar.xz")


class Target(Protocol):
    """Interface of a backup's destination. File names contain slashes."""

    def manifest(self, name: str) -> bytes | None:
        """Returns the content of a previous backup's manifest; None if there is no previous backup."""

    def has(self, name: str, size: int) -> bool:
        """Returns True if the destination already contains a file with this name and size."""

    def put(self, name: str, path: Path) -> None:
        """Stores a copy of a file."""

    def write(self, name: str, data: bytes) -> None:
        """Stores a small file with this content under a name."""

    def prune(self, keep: set[str]) -> None:
        """Deletes files of the previous backup whose names are not in `keep`."""

    def scratch(self) -> AbstractContextManager[Path]:
        """Context manager that yields a folder for temporary files."""


class FolderTarget:
    """A folder as a backup's destination. Unchanged files of a previous backup are reused."""

    def __init__(self, folder: Path, marker: str) -> None:
        """Opens the folder. Raises Invalid if it has other content. marker: name of the file that identifies a backup."""
        if folder.is_dir() and any(folder.iterdir()) and not (folder / marker).exists() and not (folder / ".part").exists():
            raise Invalid(
                Sentence(
                    "backup-target-occupied",
                    "{folder} contains other files than a backup. Name an empty or a new folder.",
                    folder=folder,
                )
            )
        make_private(folder)
        self._folder = folder
        self._part = folder / ".part"
        shutil.rmtree(self._part, ignore_errors=True)
        self._part.mkdir(PRIVATE_FOLDER)

    def manifest(self, name: str) -> bytes | None:
        """Returns the content of a previous backup's manifest; None if there is no previous backup.

        Deletes the manifest, so that the backup is marked incomplete until the new one is written.
        """
        path = self._folder / name
        if not path.exists():
            return None
        data = path.read_bytes()
        path.replace(self._part / name)
        return data

    def has(self, name: str, size: int) -> bool:
        """Returns True if the folder already contains a file with this name and size."""
        with suppress(FileNotFoundError):
            return (self._folder / name).stat().st_size == size
        return False

    def put(self, name: str, path: Path) -> None:
        """Copies a file to the folder under this name."""
        target, part = self._folder / name, self._part / "copy"
        make_private(target.parent)
        shutil.copyfile(path, part)
        part.chmod(PRIVATE)
        rename_synced(part, target)

    def write(self, name: str, data: bytes) -> None:
        """Writes a small file with this content and name to the folder."""
        write_atomically(self._folder / name, data)

    def prune(self, keep: set[str]) -> None:
        """Deletes the files in the folder whose names are not in `keep`."""
        shutil.rmtree(self._part, ignore_errors=True)
        for path in self._folder.rglob("*"):
            if path.is_file() and path.relative_to(self._folder).as_posix() not in keep:
                path.unlink()

    @contextmanager
    def scratch(self) -> Iterator[Path]:
        """Context manager that yields a folder for temporary files."""
        with tempfile.TemporaryDirectory(dir=self._part) as folder:
            yield Path(folder)


class TarTarget:
    """A tar file as a backup's destination, moved to its final name once it is complete."""

    def __init__(self, path: Path) -> None:
        if path.exists():
            raise Invalid(Sentence("backup-target-exists", "{path} exists already. Name another file, or remove it.", path=path))
        path.parent.mkdir(parents=True, exist_ok=True)
        self._path = path
        self._part = path.with_name(f".{path.name}.part")
        packing = {".gz": "w:gz", ".tgz": "w:gz", ".xz": "w:xz"}.get(path.suffix, "w")
        handle = os.open(self._part, os.O_RDWR | os.O_CREAT | os.O_TRUNC, PRIVATE)
        self._file = os.fdopen(handle, "wb")
        self._tar = tarfile.open(fileobj=self._file, mode=packing)  # type: ignore[call-overload]  # noqa: SIM115 - closed by prune
        self._has: dict[str, int] = {}

    def manifest(self, name: str) -> bytes | None:
        """Returns None, since a tar file never has a previous backup."""
        return None

    def has(self, name: str, size: int) -> bool:
        """Returns True if the tar file already contains a file with this name and size."""
        return self._has.get(name) == size

    def put(self, name: str, path: Path) -> None:
        """Adds a copy of a file to the tar file. If a name is stored twice, the later file is used."""
        self._tar.add(path, name, filter=_with_private_mode)
        self._has[name] = path.stat().st_size

    def write(self, name: str, data: bytes) -> None:
        """Adds a small file with this content and name to the tar file."""
        info = tarfile.TarInfo(name)
        info.size, info.mtime = len(data), int(time.time())
        self._tar.addfile(_with_private_mode(info), io.BytesIO(data))

    def prune(self, keep: set[str]) -> None:
        """Closes the tar file and moves it to its final name. There are no previous files to delete."""
        self._tar.close()
        self._file.close()
        rename_synced(self._part, self._path)

    @contextmanager
    def scratch(self) -> Iterator[Path]:
        """Context manager that yields a folder for temporary files."""
        with tempfile.TemporaryDirectory(dir=self._path.parent, prefix=".rayfarm-") as folder:
            yield Path(folder)


def target_at(path: Path, marker: str) -> Target:
    """Returns the destination for a path: a tar file if the name has its suffix, else a folder. Raises Invalid."""
    if path.name.endswith(ARCHIVES):
        return TarTarget(path)
    if path.suffix in (".zip", ".gz", ".xz", ".zst", ".7z") or path.is_file():
        raise Invalid(
            Sentence(
                "backup-target-invalid",
                "A backup is a folder, or a file that ends with {endings}; {name} is neither.",
                endings=[*ARCHIVES],
                name=path.name,
            )
        )
    return FolderTarget(path, marker)


def _with_private_mode(info: tarfile.TarInfo) -> tarfile.TarInfo:
    info.mode, info.uid, info.gid, info.uname, info.gname = PRIVATE, 0, 0, "", ""
    return info
