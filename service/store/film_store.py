"""The films of all jobs: one `Film` per job, opened on demand, and closed when many others have been used since."""

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
from service.store.film_check import film_samples, rows_left
from service.store.film_copy import COPYING, FilmCopy
from service.store.film_faults import film_faults
from service.store.film_snapshots import FilmSnapshots
from service.store.film_version import FilmShape
from service.store.films import Film
from service.store.tile_cache import TileCache

__all__ = ["FilmFolder", "FilmStore", "Take"]

MAX_OPEN = 64  # films that are held for those who ask next
MAX_FILES = 100  # films whose files are open at a time: three descriptors each
LOST = ".lost"  # a film that was set aside
FILES = ("", "-wal", "-shm")  # of one SQLite database

# take(other, frames, most): what the film of another job has of these frames; the samples of each that was taken, all pixels
# together. Left is a frame that has none, or some from number `most` on. Raises FilmLost or FilmWaits; then none of them was.
Take = Callable[[str, Collection[int], int], Mapping[int, int]]

log = logging.getLogger(__name__)


class FilmStore(Protocol):
    """What the service asks of the place where films are."""

    def open(
        self, job: str, settings: RenderSettings, tile_size: int, pin: bool = False, recorded: int = 0, frame: int = 0
    ) -> Film:
        """The job's film: the same object for all who hold it. Raises FilmWaits or FilmLost.

        pin: it is to be rendered: kept until `unpin`. Its file is made with the first batch.
        recorded: the samples that it must have of a frame; FilmLost where it has fewer.
        """

    def unpin(self, job: str) -> None:
        """Nobody renders a film any more: let it rest, and be closed when others need the room."""

    def set_aside(self, job: str) -> None:
        """Put a film that cannot be read any more out of the way, so that its job begins anew. Raises FilmWaits or FilmLost."""

    def heal(self, job: str, settings: RenderSettings, tile_size: int) -> None:
        """Make a film readable again: what is not what was written is removed, and so counts as missing.

        One that cannot be read as a whole is set aside, and what is left of it taken over. Raises FilmWaits or FilmLost.
        """

    def verify(self, job: str, settings: RenderSettings, tile_size: int) -> Mapping[int, int]:
        """The samples of each frame, once all of the film was read. Raises FilmDamaged, FilmLost, FilmWaits."""

    def copy(self, job: str, settings: RenderSettings, tile_size: int) -> AbstractContextManager[Take]:
        """Make a job's film of what is taken of others'; it is there when the context is left, where anything was taken.

        Raises FilmWaits or FilmLost; then nothing was made."""

    def size(self, job: str) -> int:
        """The bytes of disk that a job's film takes; 0 where it has none."""

    def delete(self, job: str) -> None:
        """Close a film and remove it, and what was set aside of it. Raises FilmWaits or FilmLost."""

    def sweep(self, keep: set[str]) -> None:
        """Remove the films of jobs that no longer exist, and copies that a service which was killed had begun."""

    def close(self) -> None:
        """Close all films."""


class FilmFolder:
    """Films as `<folder>/<job>.sqlite`."""

    def __init__(
        self,
        folder: Path,
        cache_bytes: int,
        snapshots: FilmSnapshots | None = None,
        epoch: int | None = None,
        guard: Callable[[], None] = lambda: None,
    ) -> None:
        """snapshots: of these films, which go with them; None: of those nothing is touched. epoch: service/store/film_file.py.
        guard: raises FarmError where none may be removed."""
        self._epoch = epoch
        self._guard = guard
        self._folder = folder
        self._snapshots = snapshots
        self._cache = TileCache(cache_bytes)
        # Whoever holds a film keeps it in `_films`; the store itself holds on to those that were used latest. So a job never
        # has two films at a time, each of which would remember what the other has changed.
        self._films: WeakValueDictionary[str, Film] = WeakValueDictionary()
        self._latest: OrderedDict[str, Film] = OrderedDict()
        self._pinned: dict[str, Film] = {}
        self._in_use: OrderedDict[int, weakref.ref[Film]] = OrderedDict()  # those with an open file, the latest last
        self._use_lock = threading.Lock()
        self._lock = threading.Lock()
        self._made = time.time()
        folder.mkdir(parents=True, exist_ok=True)

    def open(
        self, job: str, settings: RenderSettings, tile_size: int, pin: bool = False, recorded: int = 0, frame: int = 0
    ) -> Film:
        """See FilmStore."""
        with self._lock:
            film = self._films.get(job)
            if film is None:
                path = self._path(job)
                film = Film(
                    *(path, settings.width, settings.height, tile_size, settings.film_exponent, self._cache, self._epoch),
                    on_use=self._used,
                )
                self._films[job] = film
        film.load()  # takes its time, so without the lock that all films share
        film.check(recorded, frame)
        with self._lock:
            if self._films.get(job) is film:
                self._latest[job] = film
                self._latest.move_to_end(job)
                if pin:
                    self._pinned[job] = film
            while len(self._latest) > MAX_OPEN:
                self._latest.popitem(last=False)
        return film

    def _used(self, film: Film) -> None:
        """A film's file is open: close those that were not used for longest, where there are many. From any thread."""
        with self._use_lock:
            self._in_use[id(film)] = weakref.ref(film)
            self._in_use.move_to_end(id(film))
            for key in list(self._in_use)[: max(len(self._in_use) - MAX_FILES, 0)]:
                other = self._in_use[key]()
                if other is None or other.rest():
                    del self._in_use[key]

    def unpin(self, job: str) -> None:
        """See FilmStore."""
        with self._lock:
            film = self._pinned.pop(job, None)
        if film is not None:
            film.settle()

    def set_aside(self, job: str) -> None:
        """See FilmStore."""
        self._guard()
        with self._lock, film_faults():
            self._close(job)
            path = self._path(job)
            if path.exists():
                self._remove(self._lost(job))
                for suffix in ("-wal", ""):  # the log first, which says nothing without its film
                    with contextlib.suppress(FileNotFoundError):
                        path.with_name(path.name + suffix).replace(path.with_name(path.name + LOST + suffix))
            self._remove(path)
            self._drop_snapshots(job)

    def heal(self, job: str, settings: RenderSettings, tile_size: int) -> None:
        """See FilmStore."""
        try:
            film = self.open(job, settings, tile_size)
            if lost := film.heal():
                log.warning("the film of %s was damaged: %d samples are missing", job, lost)
        except FilmLost as error:
            log.warning("the film of %s is set aside: %s", job, error)
            self.set_aside(job)
            film = self.open(job, settings, tile_size)
            film.take_over(rows_left(self._lost(job), self._shape(settings, tile_size)))

    def verify(self, job: str, settings: RenderSettings, tile_size: int) -> Mapping[int, int]:
        """See FilmStore."""
        return film_samples(self._path(job), self._shape(settings, tile_size))

    @contextlib.contextmanager
    def copy(self, job: str, settings: RenderSettings, tile_size: int) -> Iterator[Take]:
        """See FilmStore."""

        def take(other: str, frames: Collection[int], most: int) -> Mapping[int, int]:
            self.open(other, settings, tile_size)  # which brings one of an older release up to date
            with film_faults():
                return made.take(self._path(other), frames, most)

        with film_faults(), FilmCopy(self._path(job), self._shape(settings, tile_size)) as made:
            yield take

    def size(self, job: str) -> int:
        """See FilmStore."""
        with film_faults():
            return sum(_bytes_of(self._path(job, suffix)) for suffix in FILES)

    def delete(self, job: str) -> None:
        """See FilmStore."""
        self._guard()
        with self._lock, film_faults():
            self._close(job)
            self._remove(self._lost(job))
            self._remove(self._path(job))
            self._drop_snapshots(job)

    def sweep(self, keep: set[str]) -> None:
        """See FilmStore."""
        # What is younger than this process' store may be a copy for a job that is about to be recorded.
        found = [path for path in self._folder.glob("*.sqlite*") if self._is_of_before(path)]
        for path in found:
            if path.name.partition(".sqlite")[2].startswith(COPYING):
                path.unlink(missing_ok=True)
        for job in {path.name.partition(".")[0] for path in found} - keep:
            try:
                self.delete(job)
            except FarmError as error:
                log.warning("the film of the deleted job %s stays: %s", job, error)
        if self._snapshots is not None:
            self._snapshots.sweep(keep)

    def close(self) -> None:
        """See FilmStore."""
        with self._lock:
            for job in list(self._films):
                self._close(job)

    def _is_of_before(self, path: Path) -> bool:
        """Whether a file was last written before this store was made."""
        with contextlib.suppress(FileNotFoundError):
            return path.stat().st_mtime < self._made
        return False

    def _drop_snapshots(self, job: str) -> None:
        if self._snapshots is not None:
            self._snapshots.drop(job)

    def _path(self, job: str, suffix: str = "") -> Path:
        return self._folder / f"{job}.sqlite{suffix}"

    def _lost(self, job: str) -> Path:
        return self._folder / f"{job}.sqlite{LOST}"

    def _shape(self, settings: RenderSettings, tile_size: int) -> FilmShape:
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


def _bytes_of(path: Path) -> int:
    """0 where it is not there, also from one look to the next: a film may be deleted, and is closed, while it is asked about."""
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0
