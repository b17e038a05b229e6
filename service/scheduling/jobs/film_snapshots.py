"""Stores snapshots of a still image at 1, 2, 4, 8 ... samples per pixel.

A snapshot is due when every tile has that many samples or is complete. The engine's thread only opens a consistent view of the
film (store/film_moment.py); another thread reads and compresses it. If that thread is too slow, snapshots are skipped. Stored
snapshots are always complete.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from weakref import WeakKeyDictionary

from service.errors import FarmError
from service.scheduling.jobs.active_frame import FIRST_ESTIMATE_SAMPLES, ActiveFrame
from service.scheduling.jobs.active_job import ActiveJob
from service.store.film_moment import FilmSnapshotView
from service.store.film_snapshots import FilmSnapshot, FilmSnapshots
from service.store.films import Film
from service.watching.film_packet import film_packet

__all__ = ["SnapshotKeeper"]

AT_A_TIME = 2  # pending film views; the film's log grows while one is open

log = logging.getLogger(__name__)


class _Progress:
    """Tracks how many tiles of a frame have the samples of its next snapshot."""

    def __init__(self, due: int) -> None:
        self.due = due
        self._reached = 0  # all tiles before this index are done

    def is_reached(self, frame: ActiveFrame) -> bool:
        """Returns True if every tile has enough samples. A tile that was found to have them is not checked again."""
        tiles = len(frame.plan.tiles)
        while self._reached < tiles and not frame.plan.tile_lacks(self._reached, self.due):
            self._reached += 1
        return self._reached == tiles

    def track_next(self, due: int) -> None:
        """Starts tracking the snapshot at `due` samples per pixel."""
        self.due, self._reached = due, 0


class SnapshotKeeper:
    """Creates snapshots. The engine's thread calls `store_if_due`; a separate thread writes the files."""

    def __init__(self, snapshots: FilmSnapshots, folder: Path, is_rendered: Callable[[str], bool]) -> None:
        """Starts the thread. snapshots: store of the snapshots. folder: for temporary files.

        is_rendered: returns whether the job with an id is active.
        """
        self._kept = snapshots
        self._folder = folder
        self._is_rendered = is_rendered
        self._progress: WeakKeyDictionary[ActiveJob, _Progress] = WeakKeyDictionary()
        self._room = threading.Semaphore(AT_A_TIME)
        self._writer = ThreadPoolExecutor(1, "snapshots")

    def store_if_due(self, job: ActiveJob) -> None:
        """Creates a snapshot if one is due. Does nothing for shots and finished pictures."""
        if job.shot is not None or self._kept.is_disabled:
            return
        (frame,) = job.frames.values()
        if not frame.is_begun:
            return
        progress = self._progress.get(job)
        if progress is None:
            known = self._kept.accept(job.id)
            progress = self._progress[job] = _Progress(2 * known[-1] if known else 1)
        if frame.plan.is_done or not progress.is_reached(frame) or not self._room.acquire(blocking=False):
            return
        spp = progress.due
        while frame.plan.every_tile_has(2 * spp):
            spp *= 2
        progress.track_next(2 * spp)
        try:
            moment = job.film.snapshot()
        except FarmError as error:
            self._room.release()
            log.info("job %s: no snapshot at %d samples: %s", job.id, spp, error)
            return
        noise = job.current_noise if spp >= FIRST_ESTIMATE_SAMPLES else None  # before that, some tiles have no noise estimate
        metadata = FilmSnapshot(spp, 0, 0, 0, round(job.active_s, 3), noise, round(time.time(), 2))
        self._writer.submit(self._write, job.id, frame.key, metadata, moment, job.film)

    def close(self) -> None:
        """Stops the thread after the snapshot that it is writing. Discards pending snapshots."""
        self._writer.shutdown(cancel_futures=True)

    def _write(self, job: str, frame: int, metadata: FilmSnapshot, moment: FilmSnapshotView, film: Film) -> None:
        try:
            with moment:
                tiles = [(moment.coverage(frame, i).total, tile.w * tile.h) for i, tile in enumerate(moment.tiles)]
                counts = [count for count, _ in tiles]
                samples = sum(count * area for count, area in tiles)
                metadata = replace(metadata, least=min(counts), most=max(counts), samples=samples)
                packet = film_packet(moment, frame, self._folder, gzip=True)
            if not self._kept.write(job, metadata, packet.pieces()):
                log.info("job %s: no disk space for its snapshot at %d samples", job, metadata.spp)
            if not self._is_rendered(job):
                film.checkpoint()  # the film's log could not be merged while the view was open
        except (FarmError, OSError) as error:
            log.warning("job %s: no snapshot at %d samples: %s", job, metadata.spp, error)
        finally:
            self._room.release()
