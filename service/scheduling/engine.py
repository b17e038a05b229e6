"""The farm's heart: one thread that takes in the workers' answers and hands out the next work, in turn.

One thread, so that films, plans and leases need no locks between them; the HTTP side only reads, writes the database, and
tells this thread what changed.
"""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

import redis

from service.scheduling.denoising import Denoised, Denoising
from service.scheduling.dispatch import Dispatcher, QueueError
from service.scheduling.lifecycle import Lifecycle, Tell
from service.scheduling.merging import batch_of, merge
from service.scheduling.preparing import Preparing, Progress
from service.scheduling.results import WAKE, Entry, Results
from service.scheduling.scheduler import Scheduler
from service.scheduling.workers import Workers
from service.settings import Settings
from service.store.blobs import BlobStore
from service.store.film_store import FilmStore
from service.store.films import Film
from service.store.records import Records
from worker.contract import SceneInfo

__all__ = ["Engine"]

BLOCK_MS = 200
PAUSE_AFTER_FAULT_S = 0.5

log = logging.getLogger(__name__)

TellTiles = Callable[[str, int, set[int]], None]  # job, frame, tiles


class Engine:
    """Runs jobs. `tell` and `tell_tiles` are called from its thread."""

    def __init__(
        self, settings: Settings, records: Records, films: FilmStore, blobs: BlobStore, tell: Tell, tell_tiles: TellTiles
    ) -> None:
        self.records = records
        self.films = films
        self._tell = tell
        self._tell_tiles = tell_tiles
        self._redis = redis.Redis.from_url(
            settings.redis_url, socket_timeout=5, socket_connect_timeout=2, health_check_interval=30
        )
        self._dispatcher = Dispatcher(settings.redis_url, self._redis)
        self._results = Results(self._redis)
        self.workers = Workers(self._redis, lambda name: tell("worker", name))
        self.preparing = Preparing(self._dispatcher, self.workers, settings.prepare_deadline)
        self.denoising = Denoising(self._dispatcher, self.workers, blobs)
        self.scheduler = Scheduler(settings, self._dispatcher, self.workers, lambda *start: self.lifecycle.may_start(*start))
        self.lifecycle = Lifecycle(records, films, self.scheduler, self.preparing, self.denoising, tell)
        self._changes: queue.SimpleQueue[tuple[str, str]] = queue.SimpleQueue()
        self._purged = False
        self._looked_around = 0.0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="engine", daemon=True)
        self.counts: Counter[str] = Counter()  # batches merged, dropped, failed, lost
        self.fault: str | None = "starting"  # a sentence while the engine cannot work

    def start(self) -> None:
        """Take up what the database says is unfinished, and begin."""
        self.films.sweep(self.records.all_jobs())
        for scene in self.records.preparing_scenes():
            self.preparing.want(scene, None)
        for job in self.records.active_jobs():
            self._changes.put(("job", job))
        self._thread.start()

    def stop(self) -> None:
        """End after the work in hand; what is out comes back in the next life or is handed out again."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(10)
        self._dispatcher.close()
        self._redis.close()

    @property
    def is_alive(self) -> bool:
        """Whether the thread runs."""
        return self._thread.is_alive()

    def changed(self, what: str, id: str) -> None:
        """A job or a scene was made, changed or deleted in the database."""
        self._changes.put((what, id))
        self._results.wake()

    def order(self, worker: str, why: str | None) -> None:
        """Pause a worker, for a reason; or let it go on (None). Raises redis.RedisError."""
        if why is None:
            self.workers.resume(worker)
            self.scheduler.suspicion.forgive(worker)
        else:
            self.workers.pause(worker, why)
        self._results.wake()

    def denoise(self, job: str, frame: int, film: Film) -> Future[Denoised]:
        """The frame as it is now, denoised by a worker. Raises Problem where none can."""
        answer = self.denoising.want(job, frame, film.version(frame), film.width, film.height)
        if not answer.done():
            self._results.wake()
        return answer

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                self._step()
                self.fault = None
            except (redis.RedisError, QueueError) as error:
                if self.fault is None:
                    log.warning("Redis does not answer: %s", error)
                self.fault = f"Redis does not answer ({error}). Start it, or look at RAYFARM_REDIS_URL."
                self._stop.wait(PAUSE_AFTER_FAULT_S)
            except Exception as error:
                log.exception("a fault in the engine")
                self.fault = f"The engine has a fault ({type(error).__name__}: {error}); the log says more."
                self._stop.wait(PAUSE_AFTER_FAULT_S)

    def _step(self) -> None:
        if not self._purged:
            self._dispatcher.purge()
            self._purged = True
        self._apply_changes()
        self.workers.look()
        if time.monotonic() - self._looked_around >= 1.0:
            self._looked_around = time.monotonic()
            self._each_second()
        self.preparing.fill()
        self.denoising.fill()
        self.scheduler.fill()
        entries = self._results.read(BLOCK_MS)
        if entries:
            self._take(entries)
            self._results.delete(entries)

    def _apply_changes(self) -> None:
        while not self._changes.empty():
            what, id = self._changes.get()
            try:
                self.lifecycle.apply(what, id)
            except Exception:
                self._changes.put((what, id))  # what the database accepted is not forgotten because of a fault
                raise

    def _take(self, entries: list[Entry]) -> None:
        touched: dict[str, set[int]] = {}
        arrived, broken = merge(entries, self.scheduler.jobs)
        for id, error in broken.items():
            self.lifecycle.fail(self.scheduler.jobs[id], f"The film of this job cannot be written ({error}). Make a new job.")
        for merged in arrived:
            self.scheduler.came_back(merged.job, merged.lease, merged.batch, merged.seconds, merged.worker)
            self.counts["merged" if merged.taken else "dropped"] += 1
            if merged.taken:
                merged.job.bad_samples += merged.part.bad_count
                touched.setdefault(merged.job.id, set()).add(merged.batch.tile)
        for id, tiles in touched.items():
            job = self.scheduler.jobs[id]
            job.tick(job.state == "running")
            self._tell_tiles(id, job.frame, tiles)
            self._tell("job", id)
            self.lifecycle.end_if_done(job)
        for entry in entries:
            if entry.result is not None and entry.result.event["type"] not in ("batch", WAKE):
                try:
                    self._hear(entry.result.event)
                except (KeyError, TypeError, ValueError) as error:
                    log.warning("an answer of a worker is left out: %r", error)

    def _hear(self, event: dict[str, Any]) -> None:
        if event["type"] == "batch-failed":
            job = self.scheduler.jobs.get(event["job"])
            batch = batch_of(event, job) if job else None
            if job is None or batch is None:
                return
            self.counts["failed"] += 1
            trouble = self.scheduler.failed(job, event["batch"], batch, event["worker"], event["error"], event.get("reproduce"))
            if trouble is not None:
                self.lifecycle.fail(job, f"A batch failed {len(trouble.workers)} times: {trouble.error}", trouble.reproduce)
            return
        if event["type"] == "batch-returned":
            job = self.scheduler.jobs.get(event["job"])
            batch = batch_of(event, job) if job else None
            if job is not None and batch is not None:
                self.scheduler.returned(job, event["batch"], batch, event["worker"], str(event["error"]))
            return
        if event["type"] == "denoised":
            made = Denoised(str(event["sha256"]), str(event["version"]), int(event["samples"]))
            self.denoising.heard(event["work"], made)
            return
        if event["type"] == "denoise-failed":
            self.denoising.heard(event["work"], None, str(event["error"]))
            return
        scene, kind = event["scene"], event["kind"]
        if event["type"] == "prepare-started":
            self.preparing.heard(scene, kind, event["worker"], Progress("Reading", 0.0))
        elif event["type"] == "prepare-progress":
            self.preparing.heard(scene, kind, event.get("worker", ""), Progress(str(event["step"]), float(event["fraction"])))
        elif event["type"] == "prepare-returned":
            self.preparing.returned(scene, kind, str(event["error"]))
        elif event["type"] == "prepared":
            self.lifecycle.prepared(scene, SceneInfo.from_json(event["info"]))
        elif event["type"] == "prepare-failed":
            self.lifecycle.prepare_failed(scene, kind, str(event["error"]))
        self._tell("scene", scene)

    def _each_second(self) -> None:
        self.denoising.review()
        hopeless = self.scheduler.review()
        self.counts["lost"] = self.scheduler.lost
        for job, sentence in hopeless:
            self.lifecycle.fail(job, sentence)
        for scene, kind in self.preparing.review():
            self.lifecycle.prepare_failed(
                scene, kind, "The worker was lost three times while it prepared this scene. It may be too large."
            )
        for job in list(self.scheduler.jobs.values()):
            job.tick(job.state == "running" and bool(self.scheduler.leases.of(job.id)))
            if job.state == "running":
                self.records.progress(job)
                self._tell("job", job.id)
            self.lifecycle.end_if_done(job)
