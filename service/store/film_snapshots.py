"""Stored intermediate pictures of films, at 1, 2, 4, 8 ... samples per pixel: `<folder>/<job>/<samples>.film`.

A file is one line of JSON with metadata, followed by the gzip-compressed film packet that the page reads
(service/watching/film_packet.py). Files are written atomically, and no database table lists them.
"""

from __future__ import annotations

import json
import logging
import os
import secrets
import shutil
import threading
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from service.store.atomic_files import PRIVATE, PRIVATE_FOLDER, rename_synced

__all__ = ["FilmSnapshot", "FilmSnapshots"]

SUFFIX = ".film"
MAX_FACTS_BYTES = 4096  # bytes
PIECE = 1 << 18

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class FilmSnapshot:
    """Metadata of a stored picture of a film.

    The picture was taken when every tile had `spp` samples per pixel, or was complete with fewer.
    """

    spp: int
    least: int  # spp of the tile with the fewest samples
    most: int
    samples: int  # over all pixels
    seconds: float  # rendering time, without pauses
    noise: float | None  # relative
    created: float  # Unix time


class FilmSnapshots:
    """The intermediate pictures (snapshots) of all jobs' films, as files on disk. Thread-safe."""

    def __init__(self, folder: Path, max_bytes: int, min_free_bytes: int) -> None:
        """Stores the limits. folder: folder of the files.

        max_bytes: total size of all snapshots; 0 disables snapshots. min_free_bytes: no snapshot is written if the disk has
        less free space.
        """
        self._folder = folder
        self._max_bytes = max_bytes
        self._min_free = min_free_bytes
        self._lock = threading.Lock()
        self._begun: set[str] = set()  # jobs whose snapshots are accepted

    @property
    def is_disabled(self) -> bool:
        """Returns True if snapshots are disabled."""
        return self._max_bytes <= 0

    def accept(self, job: str) -> list[int]:
        """Permits snapshots of a job until `drop` is called. Returns the samples per pixel of existing ones, ascending."""
        with self._lock:
            self._begun.add(job)
        return self.stored_spp(job)

    def stored_spp(self, job: str) -> list[int]:
        """Returns the samples per pixel of each stored snapshot of a job, ascending."""
        try:
            names = [name.removesuffix(SUFFIX) for name in os.listdir(self._folder / job) if name.endswith(SUFFIX)]  # noqa: PTH208
        except OSError:
            return []
        return sorted(int(name) for name in names if name.isascii() and name.isdigit())

    def all_metadata(self, job: str) -> list[FilmSnapshot]:
        """Returns the metadata of all readable snapshots of a job, ascending by samples."""
        found = (self.find(job, spp) for spp in self.stored_spp(job))
        return [snapshot for snapshot in found if snapshot is not None]

    def find(self, job: str, spp: int) -> FilmSnapshot | None:
        """Returns the metadata of the snapshot at `spp` samples per pixel; None if it is missing or invalid."""
        try:
            with self._path(job, spp).open("rb") as file:
                return _parse_facts(file.readline(MAX_FACTS_BYTES))
        except (OSError, ValueError, TypeError):
            return None

    def packed(self, job: str, spp: int) -> tuple[int, Iterator[bytes]]:
        """Returns the size in bytes of a snapshot's compressed film packet, and its chunks. Raises FileNotFoundError."""
        file = self._path(job, spp).open("rb")
        file.readline(MAX_FACTS_BYTES)
        size = os.fstat(file.fileno()).st_size - file.tell()

        def pieces() -> Iterator[bytes]:
            with file:
                while piece := file.read(PIECE):
                    yield piece

        return size, pieces()

    def write(self, job: str, metadata: FilmSnapshot, packed: Iterable[bytes]) -> bool:
        """Writes a snapshot, whose compressed film packet is given in chunks (`packed`). Returns whether it was stored.

        If space is short, snapshots of other jobs are deleted first, beginning with the jobs whose latest snapshot is oldest.
        """
        head = json.dumps(asdict(metadata)).encode() + b"\n"
        folder = self._folder / job
        temporary = self._folder / f".{secrets.token_hex(8)}"
        self._folder.mkdir(mode=PRIVATE_FOLDER, exist_ok=True)
        try:
            with os.fdopen(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, PRIVATE), "wb") as file:
                file.write(head)
                for piece in packed:
                    file.write(piece)
                size = file.tell()
            with self._lock:
                if job not in self._begun or not self._delete_to_fit(size, job):
                    return False
                folder.mkdir(mode=PRIVATE_FOLDER, exist_ok=True)
                rename_synced(temporary, self._path(job, metadata.spp))
        finally:
            temporary.unlink(missing_ok=True)
        return True

    def drop(self, job: str) -> None:
        """Deletes all snapshots of a job, and rejects later ones."""
        with self._lock:
            self._begun.discard(job)
            shutil.rmtree(self._folder / job, ignore_errors=True)

    def sweep(self, keep: set[str]) -> None:
        """Deletes the snapshots of jobs not in `keep`, and unfinished files of an earlier process."""
        if not self._folder.is_dir():
            return
        with self._lock, os.scandir(self._folder) as found:
            for entry in found:
                if entry.is_dir() and entry.name not in keep:
                    shutil.rmtree(entry.path, ignore_errors=True)
                elif not entry.is_dir():
                    Path(entry.path).unlink(missing_ok=True)

    def _delete_to_fit(self, size: int, job: str) -> bool:
        """Deletes snapshots of other jobs until `size` more bytes fit into the limits. Returns whether they do."""
        if size > self._max_bytes or shutil.disk_usage(self._folder).free < self._min_free:
            return False
        jobs = []
        for folder in self._folder.iterdir():
            if folder.is_dir():
                jobs.append((folder.stat().st_mtime, folder.name, sum(file.stat().st_size for file in folder.iterdir())))
        held = sum(bytes for _, _, bytes in jobs)
        for _, name, bytes in sorted(jobs):
            if held + size <= self._max_bytes:
                return True
            if name != job:
                shutil.rmtree(self._folder / name, ignore_errors=True)
                log.info("the snapshots of job %s were deleted to make room for others", name)
                held -= bytes
        return held + size <= self._max_bytes

    def _path(self, job: str, spp: int) -> Path:
        return self._folder / job / f"{spp}{SUFFIX}"


def _parse_facts(line: bytes) -> FilmSnapshot:
    data = json.loads(line)
    return FilmSnapshot(**{each.name: data[each.name] for each in fields(FilmSnapshot)})
