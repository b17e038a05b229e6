"""The films of all jobs: opened when asked for, closed when many others were used since, deleted with their job."""

from __future__ import annotations

import contextlib
import threading
from collections import OrderedDict
from pathlib import Path

from renderer.settings import RenderSettings
from service.store.films import Film, TileCache

__all__ = ["FilmStore"]

MAX_OPEN = 64


class FilmStore:
    """`<folder>/<job>.sqlite` for every job that has begun."""

    def __init__(self, folder: Path, cache_bytes: int) -> None:
        self.folder = folder
        self.cache = TileCache(cache_bytes)
        self._films: OrderedDict[str, Film] = OrderedDict()
        self._pinned: set[str] = set()
        self._lock = threading.Lock()
        folder.mkdir(parents=True, exist_ok=True)

    def open(self, job: str, settings: RenderSettings, tile_size: int, pin: bool = False) -> Film:
        """The job's film, made where it does not exist yet. Pinned films stay open until `unpin`."""
        with self._lock:
            film = self._films.get(job)
            if film is None:
                path = self.folder / f"{job}.sqlite"
                film = Film(path, settings.width, settings.height, tile_size, settings.film_exponent, self.cache)
                self._films[job] = film
            self._films.move_to_end(job)
            if pin:
                self._pinned.add(job)
            for other in [name for name in self._films if name not in self._pinned and name != job]:
                if len(self._films) <= MAX_OPEN:
                    break
                del self._films[other]  # closed when its last reader lets go of it
            return film

    def unpin(self, job: str) -> None:
        """Nobody renders a film any more: let it rest in its one file, and be closed when others need the room."""
        with self._lock:
            self._pinned.discard(job)
            film = self._films.get(job)
        if film is not None:
            film.settle()

    def delete(self, job: str) -> None:
        """Close a film and remove its files."""
        with self._lock:
            film = self._films.pop(job, None)
            self._pinned.discard(job)
            if film is not None:
                film.close()
        for suffix in ("", "-wal", "-shm"):
            (self.folder / f"{job}.sqlite{suffix}").unlink(missing_ok=True)

    def sweep(self, keep: set[str]) -> None:
        """Remove the films of jobs that no longer exist."""
        for path in self.folder.glob("*.sqlite"):
            if path.stem not in keep:
                self.delete(path.stem)

    def close(self) -> None:
        """Close all films."""
        with self._lock:
            for film in self._films.values():
                with contextlib.suppress(Exception):
                    film.close()
            self._films.clear()
