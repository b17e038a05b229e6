"""Backs up a farm's data while the farm runs; restore.py creates a data folder from the backup.

The order of copying makes the backup consistent. First comes the database, by SQLite's online backup. Then the data that it
refers to: blobs are immutable and named by their hash; films only gain samples, so each, copied in one read transaction, has at
least the samples that the database records. If a blob or film is missing because it was deleted meanwhile, the database is copied
once more. Samples that a film still lacks are rendered again when the restored farm is started (scrub.py).

manifest.json   the files with their sizes and hashes; written last, so a backup without it is incomplete
rayfarm.sqlite  scenes, jobs, frames
films/  blobs/  as in the data folder
snapshots/  logs-of-jobs/  likewise; optional files, in their state at the time of copying
token, owner-token, secrets.json   so that workers and programs remain authorized
webhook-secret                     so that receivers of webhooks still recognise the farm
"""

from __future__ import annotations

import hashlib
import json
import shutil
import sqlite3
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path

from sqlalchemy import select

from renderer import __version__
from renderer.library_messages import library_message
from renderer.sentences import Sentence
from service.errors import FarmError, Invalid, NotFound
from service.locations import sqlite_url
from service.maintenance.target import Target
from service.scheduling.records import Records
from service.store.blobs import CHUNK
from service.store.database import connect
from service.store.models import Frame

__all__ = ["MANIFEST", "Manifest", "Report", "back_up"]

MANIFEST = "manifest.json"
DATABASE = "rayfarm.sqlite"
SECRETS = ("token", "owner-token", "secrets.json", "webhook-secret")
OPTIONAL_FOLDERS = ("snapshots", "logs-of-jobs")
MAX_ROUNDS = 3
PATIENCE_S = 30.0

Progress = Callable[[int, int, str], None]  # bytes copied, total bytes, and the kind of data being copied


@dataclass
class Manifest:
    """List of a backup's files.

    files: size in bytes and SHA-256, by path. stamps: a mark for each film, which is equal at the next backup if the film is
    unchanged.
    """

    version: str = __version__
    made: float = 0.0
    files: dict[str, tuple[int, str]] = field(default_factory=dict)
    stamps: dict[str, list[int]] = field(default_factory=dict)

    @classmethod
    def parse(cls, text: bytes | str) -> Manifest:
        """Parses a manifest file. Raises Invalid if it is malformed."""
        try:
            data = json.loads(text)
            files = {str(path): (int(size), str(sha256)) for path, (size, sha256) in data["files"].items()}
            stamps = {str(path): [int(n) for n in stamp] for path, stamp in data["stamps"].items()}
            return cls(str(data["version"]), float(data["made"]), files, stamps)
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise Invalid(
                Sentence(
                    "backup-manifest-unreadable",
                    "{manifest} of the backup cannot be read ({error}). Use another backup.",
                    manifest=MANIFEST,
                    error=library_message(error),
                )
            ) from None

    def to_json(self) -> bytes:
        """Returns the manifest as JSON."""
        return json.dumps(asdict(self), indent=1).encode()


@dataclass
class Report:
    """Result of a backup. lacking: sentences about data that is missing or damaged in the farm itself."""

    films: int = 0
    blobs: int = 0
    bytes: int = 0
    unchanged: int = 0
    lacking: list[str] = field(default_factory=list)


def back_up(data: Path, target: Target, progress: Progress = lambda done, total, what: None) -> Report:
    """Backs up the farm in a data folder, which may be running. Raises Invalid, NotFound and OSError."""
    if not (data / DATABASE).is_file():
        raise NotFound(
            Sentence(
                "backup-source-without-farm",
                "{data} contains no farm: there is no {database} in it. Name a data folder with --data.",
                data=data,
                database=DATABASE,
            )
        )
    before, manifest = target.manifest(MANIFEST), Manifest(made=time.time())
    known = Manifest.parse(before) if before else Manifest()
    run = _Run(data, target, known, manifest, progress)
    for round in range(MAX_ROUNDS):
        with run.database() as (blobs, films):
            missing = run.copy(blobs, films)
        if not missing or round == MAX_ROUNDS - 1:
            break
    run.report.lacking = missing
    run.copy_optional_files()
    for name in SECRETS:
        if (data / name).is_file():
            run.add_file(name, data / name)
    target.write(MANIFEST, manifest.to_json())
    target.prune(set(manifest.files) | {MANIFEST})
    return run.report


class _Run:
    def __init__(self, data: Path, target: Target, previous: Manifest, manifest: Manifest, progress: Progress) -> None:
        self.data, self.target, self.known, self.manifest, self.progress = data, target, previous, manifest, progress
        self.report = Report()
        self._done = 0

    @contextmanager
    def database(self) -> Iterator[tuple[set[str], set[str]]]:
        """Context manager that copies the database, and adds the copy to the backup on exit.

        Yields the hashes of the blobs, and the ids of the jobs with films, to which the copied database refers.
        """
        with self.target.scratch() as folder:
            copy = folder / DATABASE
            _snapshot(self.data / DATABASE, copy)
            engine, sessions = connect(sqlite_url(copy))  # also migrates the copy to this release's schema
            try:
                blobs = Records(sessions, 0).blobs()
                with sessions() as session:
                    films = set(session.scalars(select(Frame.job).where(Frame.samples > 0).distinct()))
            finally:
                engine.dispose()
            yield blobs, films
            self.add_file(DATABASE, copy)

    def copy(self, blobs: set[str], films: set[str]) -> list[str]:
        """Copies blobs and films to the backup; returns one sentence for each that is missing or damaged."""
        paths = {sha256: self.data / "blobs" / sha256[:2] / sha256 for sha256 in sorted(blobs)}
        sources = {job: self.data / "films" / f"{job}.sqlite" for job in sorted(films)}
        total = sum(_size(path) for path in (*paths.values(), *sources.values()))
        self._done = 0
        missing: list[str] = []
        self.report.films = self.report.blobs = self.report.unchanged = 0
        for sha256, path in paths.items():
            try:
                self._blob(sha256, path)
                self.report.blobs += 1
            except FileNotFoundError:
                missing.append(
                    Sentence(
                        "backup-blob-missing",
                        "the upload or compiled scene {sha256} is missing in the data folder",
                        sha256=sha256[:12],
                    )
                )
            except Invalid as error:
                missing.append(str(error))
            self._report_progress(_size(path), total, "uploads and compiled scenes")
        for job, path in sources.items():
            try:
                self._film(job, path)
                self.report.films += 1
            except (FileNotFoundError, sqlite3.DatabaseError, FarmError) as error:
                missing.append(
                    Sentence(
                        "backup-film-missing",
                        "the film of job {job} is missing in the data folder; a restored farm renders it again",
                        job=job,
                    )
                    if isinstance(error, FileNotFoundError)
                    else Sentence(
                        "backup-film-unreadable",
                        "the film of job {job} cannot be read ({error}); a restored farm renders it again",
                        job=job,
                        error=library_message(error),
                    )
                )
            self._report_progress(_size(path), total, "films")
        return missing

    def copy_optional_files(self) -> None:
        """Copies the optional files (logs and snapshots) as they are now. Skips files that are deleted meanwhile."""
        for folder in OPTIONAL_FOLDERS:
            for path in sorted((self.data / folder).rglob("[!.]*")):
                with suppress(FileNotFoundError), self.target.scratch() as scratch:
                    if path.is_file():
                        shutil.copyfile(path, scratch / "copy")  # a fixed state for both size and hash, since the file may grow
                        self.add_file(path.relative_to(self.data).as_posix(), scratch / "copy")

    def add_file(self, name: str, path: Path) -> None:
        """Adds a file to the backup under this name, and to its manifest."""
        size, sha256 = _hash(path)
        self.target.put(name, path)
        self.manifest.files[name] = (size, sha256)
        self.report.bytes += size

    def _blob(self, sha256: str, path: Path) -> None:
        name = f"blobs/{sha256[:2]}/{sha256}"
        if self.target.has(name, _required_size(path)):
            self.report.unchanged += 1
        else:
            if _hash(path)[1] != sha256:
                raise Invalid(
                    Sentence(
                        "backup-blob-damaged", "the upload or compiled scene {sha256} was damaged by the disk", sha256=sha256[:12]
                    )
                )
            self.target.put(name, path)
            self.report.bytes += path.stat().st_size
        self.manifest.files[name] = (path.stat().st_size, sha256)

    def _film(self, job: str, path: Path) -> None:
        name = f"films/{job}.sqlite"
        stamp = _change_stamp(path)  # taken before the copy, so that later writes change it
        if self.known.stamps.get(name) == stamp and name in self.known.files and self.target.has(name, self.known.files[name][0]):
            self.manifest.files[name] = self.known.files[name]
            self.report.unchanged += 1
        else:
            with self.target.scratch() as folder:
                copy = folder / path.name
                _snapshot(path, copy)
                self.add_file(name, copy)
        self.manifest.stamps[name] = stamp

    def _report_progress(self, size: int, total: int, what: str) -> None:
        self._done += size
        self.progress(self._done, max(total, self._done, 1), what)


def _snapshot(source: Path, copy: Path) -> None:
    """Copies an SQLite database in one read transaction, during which other processes can write (WAL mode)."""
    _required_size(source)
    uri = f"{source.resolve().as_uri()}?mode=rw"
    with closing(sqlite3.connect(uri, uri=True, timeout=PATIENCE_S)) as a, closing(sqlite3.connect(copy)) as b:
        a.backup(b, pages=-1)
        b.execute("PRAGMA journal_mode=DELETE")  # a single file without a WAL


def _required_size(path: Path) -> int:
    return path.stat().st_size


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0


def _change_stamp(path: Path) -> list[int]:
    stamp = [path.stat().st_size, path.stat().st_mtime_ns]
    log = path.with_name(path.name + "-wal")
    return [*stamp, log.stat().st_size, log.stat().st_mtime_ns] if log.exists() else stamp


def _hash(path: Path) -> tuple[int, str]:
    found, size = hashlib.sha256(), 0
    with path.open("rb") as file:
        while chunk := file.read(CHUNK):
            found.update(chunk)
            size += len(chunk)
    return size, found.hexdigest()
