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
from typing import Any

import redis

from renderer.settings import RenderSettings
from service.active_job import ActiveJob
from service.dispatch import Dispatcher, QueueError
from service.film_store import FilmStore
from service.merging import batch_of, merge
from service.preparing import Preparing, Progress
from service.records import Records
from service.results import Entry, Results
from service.scheduler import Scheduler
from service.settings import Settings
from service.workers import Workers
from worker.contract import SceneInfo

__all__ = ["Engine"]

BLOCK_MS = 50
PAUSE_AFTER_FAULT_S = 0.5

log = logging.getLogger(__name__)

Tell = Callable[[str, str], None]  # what ("job", "scene", "worker") and which
TellTiles = Callable[[str, int, set[int]], None]  # job, frame, tiles


class Engine:
    """Runs jobs. `tell` and `tell_tiles` are called from its thread."""

    def __init__(self, settings: Settings, records: Records, films: FilmStore, tell: Tell, tell_tiles: TellTiles) -> None:
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
        self.scheduler = Scheduler(settings, self._dispatcher, self.workers, self._start)
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
            self.changed("job", job)
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
        while not self._changes.empty():
            self._apply(*self._changes.get())
        self.workers.look()
        if time.monotonic() - self._looked_around >= 1.0:
            self._looked_around = time.monotonic()
            self._each_second()
        self.preparing.fill()
        self.scheduler.fill()
        entries = self._results.read(BLOCK_MS)
        if entries:
            self._take(entries)
            self._results.delete(entries)

    def _apply(self, what: str, id: str) -> None:
        if what == "scene":
            scene = self.records.scene(id)
            if scene is None:
                self.preparing.forget(id)
            elif scene.status == "preparing":
                self.preparing.want(id, None)
            return
        row = self.records.job(id)
        job = self.scheduler.jobs.get(id)
        if row is None or row.state not in ("queued", "running", "paused"):
            if job is not None:
                self.records.progress(job)
                self._drop(job)
            if row is None:
                self.films.delete(id)
        elif job is None:
            self._take_up(id)
        else:
            if row.state == "paused" != job.state:
                self.scheduler.withdraw(job)
                self.records.progress(job)
            job.state, job.priority = row.state, row.priority
            if row.spp and row.spp != job.plan.spp:
                self.scheduler.withdraw(job)
                job.plan.extend(row.spp)
        self._tell("job", id)

    def _take_up(self, id: str) -> None:
        """Begin or go on with a job, as soon as its scene is ready."""
        row = self.records.job(id)
        scene = self.records.scene(row.scene) if row else None
        if row is None or scene is None or scene.status == "failed":
            self.records.failed(
                id, scene.error or "The scene failed." if scene else "The scene of this job was deleted. Upload it again."
            )
            return
        if scene.status != "ready":
            return
        row = self.records.resolve(id, scene)
        if row is None or row.state == "failed" or row.settings is None or row.tile_size is None:
            return
        film = self.films.open(id, RenderSettings.from_json(row.settings), row.tile_size, pin=True)
        job = ActiveJob(row, film, {kind: ref["sha256"] for kind, ref in scene.compiled.items()})
        self.scheduler.jobs[id] = job
        self.records.progress(job)
        self._end_if_done(job)

    def _start(self, job: ActiveJob, kind: str) -> bool:
        """Whether the job can be rendered by workers of this kind now; if so its kind is fixed."""
        if kind not in job.compiled:
            self.preparing.want(job.scene, kind)
            return False
        if not job.started or job.kind is None or job.state == "queued":
            if not self.records.started(job.id, kind):
                return False
            job.started, job.state = True, "running"
            job.kind = job.kind or kind
            self._tell("job", job.id)
        return True

    def _take(self, entries: list[Entry]) -> None:
        touched: dict[str, set[int]] = {}
        for merged in merge(entries, self.scheduler.jobs):
            self.scheduler.came_back(merged.job, merged.lease, merged.batch, merged.seconds)
            self.counts["merged" if merged.taken else "dropped"] += 1
            if merged.taken:
                merged.job.bad_samples += merged.part.bad_count
                touched.setdefault(merged.job.id, set()).add(merged.batch.tile)
        for id, tiles in touched.items():
            job = self.scheduler.jobs[id]
            job.tick(job.state == "running")
            self._tell_tiles(id, job.frame, tiles)
            self._tell("job", id)
            self._end_if_done(job)
        for entry in entries:
            if entry.result is not None and entry.result.event["type"] != "batch":
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
                self._fail(job, f"A batch failed {len(trouble.workers)} times: {trouble.error}", trouble.reproduce)
            return
        scene, kind = event["scene"], event["kind"]
        if event["type"] == "prepare-started":
            self.preparing.heard(scene, kind, event["worker"], Progress("Reading", 0.0))
        elif event["type"] == "prepare-progress":
            self.preparing.heard(scene, kind, event.get("worker", ""), Progress(str(event["step"]), float(event["fraction"])))
        elif event["type"] == "prepared":
            self._prepared(scene, SceneInfo.from_json(event["info"]))
        elif event["type"] == "prepare-failed":
            self._prepare_failed(scene, kind, str(event["error"]))
        self._tell("scene", scene)

    def _prepared(self, scene: str, info: SceneInfo) -> None:
        self.preparing.forget_kind(scene, info.kind)
        if not self.records.prepared(scene, info):
            return
        for id in self.records.jobs_of(scene):
            if id in self.scheduler.jobs:
                self.scheduler.jobs[id].compiled[info.kind] = info.compiled.sha256
            else:
                self._take_up(id)
                self._tell("job", id)

    def _prepare_failed(self, scene: str, kind: str | None, error: str) -> None:
        """The scene's error ends the jobs that wait for it: all, or those that need it for this kind of worker."""
        if self.records.prepare_failed(scene, error):
            self.preparing.forget(scene)
        elif kind is not None:
            self.preparing.forget_kind(scene, kind)
        row = self.records.scene(scene)
        for id in self.records.jobs_of(scene):
            job = self.scheduler.jobs.get(id)
            if job is None or row is None or row.status == "failed":
                self.records.failed(id, error)
            elif job.kind == kind and kind not in job.compiled:
                self._fail(job, error, None)
            self._tell("job", id)

    def _each_second(self) -> None:
        hopeless = self.scheduler.review()
        self.counts["lost"] = self.scheduler.lost
        for job, sentence in hopeless:
            self._fail(job, sentence, None)
        for scene, kind in self.preparing.review():
            self._prepare_failed(
                scene, kind, "The worker was lost three times while it prepared this scene. It may be too large."
            )
            self._tell("scene", scene)
        for job in list(self.scheduler.jobs.values()):
            job.tick(job.state == "running" and bool(self.scheduler.leases.of(job.id)))
            if job.state == "running":
                self.records.progress(job)
                self._tell("job", job.id)
            self._end_if_done(job)

    def _end_if_done(self, job: ActiveJob) -> None:
        if job.state in ("queued", "running") and job.done:
            job.tick(job.started)
            self.records.progress(job)
            if self.records.finished(job):
                self._drop(job)
                self._tell("job", job.id)

    def _fail(self, job: ActiveJob, error: str, reproduce: str | None) -> None:
        self.records.progress(job)
        self.records.failed(job.id, error, reproduce)
        self._drop(job)
        self._tell("job", job.id)

    def _drop(self, job: ActiveJob) -> None:
        self.scheduler.withdraw(job)
        self.scheduler.jobs.pop(job.id, None)
        job.film.settle()
        self.films.unpin(job.id)
