"""The films of all jobs: one `Film` object per job, opened on demand and closed after long disuse."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
import weakref
from collections import OrderedDict
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Protocol
from weakref import WeakValueDictionary

from renderer.settings import RenderSettings
from service.errors import FarmError, FilmLost
from service.store.film_check import film_samples, readable_rows
from service.store.film_copy import COPY_SUFFIX, FilmCopy
from service.store.film_faults import film_faults
from service.store.film_snapshots import FilmSnapshots
from service.store.film_version import FilmShape
from service.store.films import Film
from service.store.tile_cache import TileCache

__all__ = ["CopyFrames", "FilmFolder", "FilmStore"]

MAX_OPEN = 64  # films kept in memory after their last use
MAX_FILES = 100  # films with open files, three file descriptors each
QUARANTINE_SUFFIX = ".lost"  # suffix of a film that was set aside
FILES = ("", "-wal", "-shm")  # suffixes of one SQLite database

# take(other, frames, most): copies frames of another job's film; returns the number of samples of each copied frame, over all
# pixels. Skips frames without samples or with sample numbers of `most` or higher. Raises FilmLost or FilmUnavailable; then none
# is copied.
CopyFrames = Callable[[str, Collection[int], int], Mapping[int, int]]

log = logging.getLogger(__name__)


class FilmStore(Protocol):
    """Interface of the storage of films. A film holds the sums of all samples of one job."""

    def open(
        self, job: str, settings: RenderSettings, tile_size: int, pin: bool = False, recorded: int = 0, frame: int = 0
    ) -> Film:
        """Returns the job's film, the same object for all callers. Raises FilmUnavailable or FilmLost.

        pin: whether to keep the film in memory until `unpin`, because it will be rendered. Its file is created with the first
        batch.
        recorded: number of samples that `frame` must have; raises FilmLost if it has fewer.
        """

    def unpin(self, job: str) -> None:
        """Marks a film as no longer rendered: merges its write-ahead log, and allows the film to be closed."""

    def quarantine(self, job: str) -> None:
        """Renames the unreadable film of a job, so that the job starts again with an empty one.

        Raises FilmUnavailable or FilmLost.
        """

    def delete_damaged(self, job: str, settings: RenderSettings, tile_size: int) -> None:
        """Repairs a film: deletes rows that do not match their checksums, so that their samples are rendered again.

        A film that cannot be opened is renamed, and its intact rows are copied to a new one. Raises FilmUnavailable or FilmLost.
        """

    def verify(self, job: str, settings: RenderSettings, tile_size: int) -> Mapping[int, int]:
        """Reads and verifies a whole film. Returns the number of samples of each frame, by key.

        Raises FilmDamaged, FilmLost or FilmUnavailable.
        """

    def copy(self, job: str, settings: RenderSettings, tile_size: int) -> AbstractContextManager[CopyFrames]:
        """Context manager that creates a job's film from frames of other films. It yields the function that copies frames.

        The film exists after the block if frames were copied. Raises FilmUnavailable or FilmLost; then no film is created.
        """

    def size(self, job: str) -> int:
        """Returns the disk space of a job's film in bytes; 0 if it has no film."""

    def delete(self, job: str) -> None:
        """Closes and deletes a film, and its damaged copy if there is one. Raises FilmUnavailable or FilmLost."""

    def sweep(self, keep: set[str]) -> None:
        """Deletes films of jobs not in `keep`, and unfinished copies of an earlier process."""

    def close(self) -> None:
        """Closes all films."""


class FilmFolder:
    """Films as files `<folder>/<job>.sqlite`."""

    def __init__(
        self,
        folder: Path,
        cache_bytes: int,
        snapshots: FilmSnapshots | None = None,
        epoch: int | None = None,
        guard: Callable[[], None] = lambda: None,
    ) -> None:
        """Creates the folder if needed. cache_bytes: size of the cache of tiles, shared by all films.

        snapshots: snapshots to delete together with the films, or None. epoch: number of this service's ownership of the farm,
        as in FilmFile. guard: called before deletions; raises FarmError if deleting is not allowed.
        """
        self._epoch = epoch
        self._guard = guard
        self._folder = folder
        self._snapshots = snapshots
        self._cache = TileCache(cache_bytes)
        # Callers keep a film alive in `_films`; the store itself keeps those used latest. A job thus never has two Film objects,
        # each with an outdated index after the other's changes.
        self._films: WeakValueDictionary[str, Film] = WeakValueDictionary()
        self._latest: OrderedDict[str, Film] = OrderedDict()
        self._pinned: dict[str, Film] = {}
        self._in_use: OrderedDict[int, weakref.ref[Film]] = OrderedDict()  # films with an open file, least recently used first
        self._use_lock = threading.Lock()
        self._lock = threading.Lock()
        self._made = time.time()
        folder.mkdir(parents=True, exist_ok=True)

    def open(
        self, job: str, settings: RenderSettings, tile_size: int, pin: bool = False, recorded: int = 0, frame: int = 0
    ) -> Film:
        """Returns the job's film, the same object for all callers. Raises FilmUnavailable or FilmLost.

        pin: whether to keep the film in memory until `unpin`. recorded: number of samples that `frame` must have.
        """
        with self._lock:
            film = self._films.get(job)
            if film is None:
                path = self._path(job)
                film = Film(
                    *(path, settings.width, settings.height, tile_size, settings.film_exponent, self._cache, self._epoch),
                    on_use=self._record_use,
                    groups=settings.light_planes,
                    ranks=settings.cryptomatte,
                    is_transparent=settings.is_transparent,
                    deep=settings.deep,
                )
                self._films[job] = film
        film.open_file()  # slow, so outside the lock that all films share
        film.check_samples(recorded, frame)
        with self._lock:
            if self._films.get(job) is film:
                self._latest[job] = film
                self._latest.move_to_end(job)
                if pin:
                    self._pinned[job] = film
            while len(self._latest) > MAX_OPEN:
                self._latest.popitem(last=False)
        return film

    def _record_use(self, film: Film) -> None:
        """Records the use of a film with an open file, and closes the least recently used files beyond MAX_FILES.

        Thread-safe.
        """
        with self._use_lock:
            self._in_use[id(film)] = weakref.ref(film)
            self._in_use.move_to_end(id(film))
            for key in list(self._in_use)[: max(len(self._in_use) - MAX_FILES, 0)]:
                other = self._in_use[key]()
                if other is None or other.close_file():
                    del self._in_use[key]

    def unpin(self, job: str) -> None:
        """Merges the write-ahead log of a film that is no longer rendered, and allows the film to be closed."""
        with self._lock:
            film = self._pinned.pop(job, None)
        if film is not None:
            film.checkpoint()

    def quarantine(self, job: str) -> None:
        """Renames the unreadable film of a job, so that the job starts again with an empty one."""
        self._guard()
        with self._lock, film_faults():
            self._close(job)
            path = self._path(job)
            if path.exists():
                self._remove(self._quarantine_path(job))
                for suffix in ("-wal", ""):  # the log first: it is useless without its film
                    with contextlib.suppress(FileNotFoundError):
                        path.with_name(path.name + suffix).replace(path.with_name(path.name + QUARANTINE_SUFFIX + suffix))
            self._remove(path)
            self._drop_snapshots(job)

    def delete_damaged(self, job: str, settings: RenderSettings, tile_size: int) -> None:
        """Deletes the rows of a film that do not match their checksums, so that their samples are rendered again.

        A film that cannot be opened is renamed, and its intact rows are copied to a new one.
        """
        try:
            film = self.open(job, settings, tile_size)
            if lost := film.delete_damaged():
                log.warning("the film of %s was damaged: %d samples are missing", job, lost)
        except FilmLost as error:
            log.warning("the film of job %s is renamed: %s", job, error)
            self.quarantine(job)
            film = self.open(job, settings, tile_size)
            film.add_recovered(readable_rows(self._quarantine_path(job), self._film_shape(settings, tile_size)))

    def verify(self, job: str, settings: RenderSettings, tile_size: int) -> Mapping[int, int]:
        """Reads and verifies a whole film. Returns the number of samples of each frame, by key."""
        return film_samples(self._path(job), self._film_shape(settings, tile_size))

    @contextlib.contextmanager
    def copy(self, job: str, settings: RenderSettings, tile_size: int) -> Iterator[CopyFrames]:
        """Context manager that creates a job's film from frames of other films. It yields the function that copies frames."""

        def copy_frames(other: str, frames: Collection[int], max_samples: int) -> Mapping[int, int]:
            self.open(other, settings, tile_size)  # migrates a film of an older release
            with film_faults():
                return made.copy_frames(self._path(other), frames, max_samples)

        with film_faults(), FilmCopy(self._path(job), self._film_shape(settings, tile_size)) as made:
            yield copy_frames

    def size(self, job: str) -> int:
        """Returns the disk space of a job's film in bytes; 0 if it has no film."""
        with film_faults():
            return sum(_file_size(self._path(job, suffix)) for suffix in FILES)

    def delete(self, job: str) -> None:
        """Closes and deletes a film, its damaged copy, and its snapshots."""
        self._guard()
        with self._lock, film_faults():
            self._close(job)
            self._remove(self._quarantine_path(job))
            self._remove(self._path(job))
            self._drop_snapshots(job)

    def sweep(self, keep: set[str]) -> None:
        """Deletes films of jobs that are not in `keep`, and unfinished copies of an earlier process."""
        # A file newer than this store may be a copy for a job that is not recorded yet.
        found = [path for path in self._folder.glob("*.sqlite*") if self._is_older_than_store(path)]
        for path in found:
            if path.name.partition(".sqlite")[2].startswith(COPY_SUFFIX):
                path.unlink(missing_ok=True)
        for job in {path.name.partition(".")[0] for path in found} - keep:
            try:
                self.delete(job)
            except FarmError as error:
                log.warning("the film of the deleted job %s cannot be deleted: %s", job, error)
        if self._snapshots is not None:
            self._snapshots.sweep(keep)

    def close(self) -> None:
        """Closes all films."""
        with self._lock:
            for job in list(self._films):
                self._close(job)

    def _is_older_than_store(self, path: Path) -> bool:
        """Returns True if a file was last written before this store was created."""
        with contextlib.suppress(FileNotFoundError):
            return path.stat().st_mtime < self._made
        return False

    def _drop_snapshots(self, job: str) -> None:
        if self._snapshots is not None:
            self._snapshots.drop(job)

    def _path(self, job: str, suffix: str = "") -> Path:
        return self._folder / f"{job}.sqlite{suffix}"

    def _quarantine_path(self, job: str) -> Path:
        return self._folder / f"{job}.sqlite{QUARANTINE_SUFFIX}"

    def _film_shape(self, settings: RenderSettings, tile_size: int) -> FilmShape:
        return FilmShape(settings.width, settings.height, tile_size, settings.film_exponent)

    def _close(self, job: str) -> None:
        film = self._films.pop(job, None)
        self._latest.pop(job, None)
        self._pinned.pop(job, None)
        if film is not None:
            film.close()

    def _remove(self, path: Path) -> None:
        for suffix in FILES:
            path.with_name(path.name + suffix).unlink(missing_ok=True)


def _file_size(path: Path) -> int:
    """Returns a file's size in bytes; 0 if it does not exist, since a film may be deleted concurrently."""
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0
