"""Creates a data folder from a backup.

All files are checked against the manifest's hashes before the folder is moved to its final name.
"""

from __future__ import annotations

import hashlib
import re
import shutil
import sqlite3
import tarfile
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, cast

from renderer.library_messages import library_message
from renderer.sentences import Sentence
from service.errors import Conflict, Invalid, NotFound
from service.maintenance.backup import MANIFEST, Manifest, Progress
from service.maintenance.target import ARCHIVES
from service.store.atomic_files import PRIVATE, make_private
from service.store.blobs import CHUNK

__all__ = ["restore"]

# Files that a backup may contain; other names are rejected, since they could write outside the folder.
NAMES = re.compile(
    r"rayfarm\.sqlite|(owner-)?token|webhook-secret|secrets\.json|manifest\.json"
    r"|films/[\w-]{1,80}\.sqlite|blobs/[0-9a-f]{2}/[0-9a-f]{64}"
    r"|snapshots/[\w-]{1,80}/\d{1,12}\.film|logs-of-jobs/[\w-]{1,80}(\.[a-z]{1,8}){0,2}"
)


OpenFile = Callable[[], BinaryIO]


def restore(source: Path, data: Path, progress: Progress = lambda done, total, what: None) -> Manifest:
    """Restores a backup into a data folder, which must be new or empty. Raises NotFound, Conflict, Invalid and OSError.

    After an error, no files remain.
    """
    if data.exists() and (not data.is_dir() or any(data.iterdir())):
        raise Conflict(
            Sentence(
                "restore-target-not-empty",
                "{folder} is not empty. Name a new folder with --data: a backup is not restored over an existing farm.",
                folder=data,
            )
        )
    part = data.with_name(f".{data.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    make_private(part)
    try:
        with _opened_backup(source) as (total, files):
            hashes, text = _copy(files, part, total, progress)
        if text is None:
            raise Invalid(
                Sentence(
                    "backup-incomplete",
                    "{source} is incomplete: it has no {manifest}. Back up again.",
                    source=source,
                    manifest=MANIFEST,
                )
            )
        manifest = Manifest.parse(text)
        for name, (_, sha256) in manifest.files.items():
            if name not in hashes:
                raise Invalid(
                    Sentence(
                        "backup-file-missing",
                        "{source} is damaged: {name} is missing. Use another backup.",
                        source=source,
                        name=name,
                    )
                )
            if hashes[name] != sha256:
                raise Invalid(
                    Sentence(
                        "backup-file-damaged",
                        "{source} is damaged: {name} differs from what was backed up. Use another backup.",
                        source=source,
                        name=name,
                    )
                )
        for name in hashes.keys() - manifest.files.keys():
            (part / name).unlink()
        _delete_sessions(part / "rayfarm.sqlite")
        with suppress(FileNotFoundError):
            data.rmdir()
        part.rename(data)
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return manifest


def _delete_sessions(database: Path) -> None:
    """Deletes all sessions and login links, since they may have been revoked after the backup. Users have to log in again."""
    if not database.exists():
        return
    with closing(sqlite3.connect(database)) as connection, suppress(sqlite3.DatabaseError):  # from a release without logins
        connection.execute("DELETE FROM keys WHERE kind IN ('session', 'link')")
        connection.commit()


def _copy(
    files: Iterator[tuple[str, int, OpenFile]], folder: Path, total: int, progress: Progress
) -> tuple[dict[str, str], bytes | None]:
    """Copies files into a folder. Returns their SHA-256 hashes by name, and the content of the manifest (None if absent)."""
    hashes: dict[str, str] = {}
    manifest: bytes | None = None
    done = 0
    for name, size, opened in files:
        if not NAMES.fullmatch(name):
            raise Invalid(
                Sentence(
                    "backup-file-unexpected",
                    "The backup contains {name}, which does not belong in a backup. Use another backup.",
                    name=repr(name[:100]),
                )
            )
        if name == MANIFEST:
            with opened() as file:
                manifest = file.read()
        else:
            hashes[name] = _write(opened, folder / name)
        done += size
        progress(done, max(total, done, 1), name.partition("/")[0])
    return hashes, manifest


def _write(opened: OpenFile, path: Path) -> str:
    make_private(path.parent)
    found = hashlib.sha256()
    with opened() as source, path.open("wb") as file:
        path.chmod(PRIVATE)
        while chunk := source.read(CHUNK):
            found.update(chunk)
            file.write(chunk)
    return found.hexdigest()


@contextmanager
def _opened_backup(source: Path) -> Iterator[tuple[int, Iterator[tuple[str, int, OpenFile]]]]:
    """Context manager that opens a backup: a folder or a tar file.

    Yields its size in bytes, and an iterator of its files: name, size, and a function that opens the file.
    """
    if source.is_dir():
        paths = [path for path in sorted(source.rglob("*")) if path.is_file() and ".part" not in path.parts]
        files = ((path.relative_to(source).as_posix(), path.stat().st_size, lambda path=path: path.open("rb")) for path in paths)
        yield sum(path.stat().st_size for path in paths), files
        return
    if not source.is_file():
        raise NotFound(Sentence("backup-not-found", "There is no backup {source}. Check the path.", source=source))
    if not source.name.endswith(ARCHIVES):
        raise Invalid(
            Sentence(
                "backup-path-invalid",
                "{source} is not a backup: a backup is a folder, or a file that ends with {endings}.",
                source=source,
                endings=[*ARCHIVES],
            )
        )
    try:
        with tarfile.open(source) as tar:
            yield source.stat().st_size, _members(tar)
    except (tarfile.TarError, EOFError) as error:
        raise Invalid(
            Sentence(
                "backup-damaged",
                "{source} is damaged or cut off ({error}). Use another backup.",
                source=source,
                error=library_message(error),
            )
        ) from error


def _members(tar: tarfile.TarFile) -> Iterator[tuple[str, int, OpenFile]]:
    for member in tar:
        if not member.isfile():
            raise Invalid(
                Sentence(
                    "backup-entry-not-file",
                    "The backup contains {name}, which is not a file. Use another backup.",
                    name=repr(member.name[:100]),
                )
            )

        def opened(member: tarfile.TarInfo = member) -> BinaryIO:
            file = tar.extractfile(member)
            assert file is not None
            return cast(BinaryIO, file)

        yield member.name, member.size, opened
