"""What films looked like on their way, at 1, 2, 4, 8 ... samples a pixel: `<folder>/<job>/<samples>.film`.

A file is one line of JSON, the facts, and behind it the picture as the page reads films (service/watching/film_packet.py), packed
by gzip. It is written whole or not at all, so what is there is all there is to know: no table names it.
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

from service.store.whole import PRIVATE, PRIVATE_FOLDER, move_whole

__all__ = ["FilmSnapshot", "FilmSnapshots"]

SUFFIX = ".film"
MOST_FACTS = 4096  # bytes
PIECE = 1 << 18

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class FilmSnapshot:
    """The film when its every tile had `spp` samples a pixel or was complete with fewer."""

    spp: int
    least: int  # samples a pixel of the tile that had fewest then
    most: int
    samples: int  # of all pixels together
    seconds: float  # of rendering, pauses left out
    noise: float | None  # relative
    created: float  # unix time


class FilmSnapshots:
    """All that is kept. Safe to use from several threads."""

    def __init__(self, folder: Path, max_bytes: int, min_free_bytes: int) -> None:
        """max_bytes: of all jobs together; 0: nothing is kept. min_free_bytes: of disk, below which nothing is."""
        self._folder = folder
        self._max_bytes = max_bytes
        self._min_free = min_free_bytes
        self._lock = threading.Lock()
        self._begun: set[str] = set()  # jobs of which some may come

    @property
    def is_off(self) -> bool:
        """Whether nothing is kept."""
        return self._max_bytes <= 0

    def begin(self, job: str) -> list[int]:
        """A job is rendered: what comes of it is kept, until it is dropped. What there is of it already, as `kept` says."""
        with self._lock:
            self._begun.add(job)
        return self.kept(job)

    def kept(self, job: str) -> list[int]:
        """At how many samples a pixel there is a snapshot of a job, in order."""
        try:
            names = [name.removesuffix(SUFFIX) for name in os.listdir(self._folder / job) if name.endswith(SUFFIX)]  # noqa: PTH208
        except OSError:
            return []
        return sorted(int(name) for name in names if name.isascii() and name.isdigit())

    def facts(self, job: str) -> list[FilmSnapshot]:
        """Of all snapshots of a job, in order."""
        found = (self.find(job, spp) for spp in self.kept(job))
        return [snapshot for snapshot in found if snapshot is not None]

    def find(self, job: str, spp: int) -> FilmSnapshot | None:
        """The facts of one; None where it is not there, or not to be understood."""
        try:
            with self._path(job, spp).open("rb") as file:
                return _facts(file.readline(MOST_FACTS))
        except (OSError, ValueError, TypeError):
            return None

    def packed(self, job: str, spp: int) -> tuple[int, Iterator[bytes]]:
        """The size of one's picture, packed by gzip, and its pieces. Raises FileNotFoundError."""
        file = self._path(job, spp).open("rb")
        file.readline(MOST_FACTS)
        size = os.fstat(file.fileno()).st_size - file.tell()

        def pieces() -> Iterator[bytes]:
            with file:
                while piece := file.read(PIECE):
                    yield piece

        return size, pieces()

    def keep(self, job: str, facts: FilmSnapshot, packed: Iterable[bytes]) -> bool:
        """Write one down; whether there was room. Those of jobs that got theirs longest ago make room for it."""
        head = json.dumps(asdict(facts)).encode() + b"\n"
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
                if job not in self._begun or not self._make_room(size, job):
                    return False
                folder.mkdir(mode=PRIVATE_FOLDER, exist_ok=True)
                move_whole(temporary, self._path(job, facts.spp))
        finally:
            temporary.unlink(missing_ok=True)
        return True

    def drop(self, job: str) -> None:
        """Remove those of a job."""
        with self._lock:
            self._begun.discard(job)
            shutil.rmtree(self._folder / job, ignore_errors=True)

    def sweep(self, keep: set[str]) -> None:
        """Remove those of jobs that no longer exist, and what an earlier life began to write."""
        if not self._folder.is_dir():
            return
        with self._lock, os.scandir(self._folder) as found:
            for entry in found:
                if entry.is_dir() and entry.name not in keep:
                    shutil.rmtree(entry.path, ignore_errors=True)
                elif not entry.is_dir():
                    Path(entry.path).unlink(missing_ok=True)

    def _make_room(self, size: int, job: str) -> bool:
        """Whether so many bytes more may be kept, once older ones were removed."""
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
                log.info("the snapshots of job %s make room for those of others", name)
                held -= bytes
        return held + size <= self._max_bytes

    def _path(self, job: str, spp: int) -> Path:
        return self._folder / job / f"{spp}{SUFFIX}"


def _facts(line: bytes) -> FilmSnapshot:
    data = json.loads(line)
    return FilmSnapshot(**{each.name: data[each.name] for each in fields(FilmSnapshot)})
