"""The engine: one thread that alternates between processing results and dispatching work.

With a single thread, films, plans and leases need no locks. The HTTP handlers read its latest snapshot, write to the database
and notify it of changes. Errors of one job, scene or worker are contained by the bulkheads (faults/bulkhead.py); `_run` catches
only errors of Redis and bugs in the engine.
"""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from contextlib import suppress
from typing import Protocol

import redis

from protocol.contract import VERSION_SEPARATOR, DenoiseFrame, FrameVectors, GuideScene, ShowEnvironment
from protocol.terms import Terms
from renderer.sentences import Sentence
from service.errors import FarmError, QueueError
from service.events import Events, FrameDenoised, PreparationRequested, RowWritten
from service.scheduling.answers import Answers
from service.scheduling.artifacts.artifact_result import ArtifactResult
from service.scheduling.artifacts.artifacts import ArtifactTasks
from service.scheduling.changes import Changes
from service.scheduling.dispatching.dispatcher import Dispatcher
from service.scheduling.dispatching.pacing import BatchSizing
from service.scheduling.dispatching.scheduler import Scheduler
from service.scheduling.faults.bulkhead import Bulkheads, Step
from service.scheduling.faults.redis_errors import exception_chain, redis_fault
from service.scheduling.faults.repair import is_wrong_type, repair_all
from service.scheduling.fleet.dead_letters import FILE, DeadLetters
from service.scheduling.fleet.workers import Workers
from service.scheduling.forecasts.deadlines import Deadlines
from service.scheduling.forecasts.forecast import Forecaster
from service.scheduling.incoming.results import Results
from service.scheduling.jobs.active_job import ActiveJob
from service.scheduling.jobs.film_snapshots import SnapshotKeeper
from service.scheduling.jobs.job_log import JobLogs
from service.scheduling.lifecycle import Lifecycle
from service.scheduling.records import Records
from service.scheduling.snapshot import JobNumbers, Snapshot, SnapshotHolder
from service.scheduling.trust.trust import Trust
from service.scheduling.waiting import DependencyTracker
from service.settings import Settings
from service.store.blobs import BlobStore
from service.store.film_snapshots import FilmSnapshots
from service.store.film_store import FilmStore
from service.store.films import Film

__all__ = ["Engine"]

BLOCK_MS = 200
PAUSE_AFTER_FAULT_S = 0.5
SERVICE_KEY = "rayfarm:service"  # Unix time of the service's latest write to Redis
SERVICE_KEY_TTL_S = 10
REPAIR_KEYS_EVERY_S = 10.0
TRACE_EVERY_S = 60.0  # interval of tracebacks of the same fault
STUCK_TIMEOUT_S = 60.0  # seconds without a round after which another service may take over

log = logging.getLogger(__name__)


class Viewing(Protocol):
    """A part of the service that sends clients' interactive work to slots."""

    def has_unfinished(self) -> bool:
        """Returns True if such work waits for a slot or is being done. Thread-safe."""


class Engine:
    """The scheduling engine: a thread that processes results and dispatches work. It also publishes the engine's events."""

    def __init__(
        self,
        settings: Settings,
        connection: redis.Redis,
        dispatcher: Dispatcher,
        records: Records,
        films: FilmStore,
        snapshots: FilmSnapshots,
        blobs: BlobStore,
        snapshot_holder: SnapshotHolder,
        events: Events,
        guard: Callable[[], None],
        viewing: Sequence[Viewing],
    ) -> None:
        """Creates the engine without starting its thread.

        connection, dispatcher: closed by `stop`. snapshots: store for the snapshots of films. snapshot_holder: publishes the
        engine's state to other threads. guard: raises FarmError if this service may not act as the farm's owner. viewing: what
        else sends work to slots, which become free for it between batches.
        """
        self._guard = guard
        self._viewing = viewing
        self.films = films
        self._records = records
        self._redis = connection
        self._dispatcher = dispatcher
        self._results = Results(self._redis, guard)
        self._snapshot_holder = snapshot_holder
        self._changes = Changes()
        self._bulkheads = Bulkheads()
        change = self._snapshot_holder.record_change
        self._dead_letters = DeadLetters(settings.data / FILE)
        self._workers = Workers(self._redis, lambda name: change("worker", name), self._dead_letters)
        self._artifact_tasks = ArtifactTasks(settings, self._dispatcher, self._workers, blobs, events)
        self.logs = JobLogs(settings.data / "logs-of-jobs")
        self._pace = BatchSizing(settings.batch_seconds, settings.batch_seconds_most, settings.results_bytes, self._has_viewers)
        self._scheduler = Scheduler(settings, self._dispatcher, self._workers, self._bulkheads, self._pace)
        self._outcomes = self._scheduler.outcomes
        self.trust = Trust(self._scheduler, self._workers, self._dispatcher, settings.batch_deadline, events)
        self._waiting = DependencyTracker(records, self._bulkheads, self._changes)
        self._lifecycle = Lifecycle(
            *(records, films, self._scheduler, self._artifact_tasks, self.logs, self._bulkheads, self._changes, self._waiting),
            record_change=change,
            events=events,
        )
        self._deadlines = Deadlines(records, self._run_with_database, change)
        self._forecaster = Forecaster(self._scheduler.job_queue, self._scheduler.shares)
        self._keeper = SnapshotKeeper(snapshots, settings.data / "tmp", self._scheduler.jobs.__contains__)
        self._answers = Answers(
            *(
                self._results,
                self._bulkheads,
                self._scheduler,
                self._lifecycle,
                self._artifact_tasks,
                self.trust,
                self._pace,
                self.logs,
            ),
            dead_letters=self._dead_letters,
            record_change=change,
            events=events,
            on_plan_update=self._keeper.store_if_due,
        )
        self._asked: queue.SimpleQueue[tuple[str, str]] = queue.SimpleQueue()  # (scene, kind of workers)
        self._terms: dict[str, Terms] = {}  # terms of workers, by name
        self._has_begun = False
        self._looked_around = 0.0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="engine", daemon=True)
        self._fault: str | None = self._snapshot_holder.latest.fault
        self._refused: str | None = None  # why Redis accepts no writes, or a periodic task fails
        self._step_fault: str | None = None
        self._traced = 0.0
        self._repaired = 0.0
        events.subscribe(RowWritten, self._row_written)
        events.subscribe(PreparationRequested, self._preparation_requested)
        events.subscribe(FrameDenoised, self._frame_denoised, in_background=True)

    def start(self) -> None:
        """Starts the thread, which first loads the unfinished jobs and scenes from the database."""
        self._thread.start()

    def stop(self) -> None:
        """Stops the thread after its current step. Outstanding work is answered after the next start, or dispatched again."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(10)
        self._artifact_tasks.close()
        self._keeper.close()
        self._dispatcher.close()
        self._redis.close()

    @property
    def is_alive(self) -> bool:
        """Returns True if the thread is running."""
        return self._thread.is_alive()

    def makes_progress(self) -> bool:
        """Returns True if the loop has completed an iteration recently, or if the engine is still starting.

        The start may take long after a previous run.
        """
        return self.is_alive and (not self._has_begun or time.monotonic() - self.snapshot.made < STUCK_TIMEOUT_S)

    @property
    def snapshot(self) -> Snapshot:
        """The latest snapshot of the engine's state."""
        return self._snapshot_holder.latest

    def record_change(self, item_kind: str, id: str) -> None:
        """Notifies the engine that an item was created, modified or deleted in the database, and wakes its thread.

        item_kind: "job", "scene", "worker" or "terms".
        """
        self._changes.add(item_kind, id)
        self._results.end_read()

    def _row_written(self, event: RowWritten) -> None:
        self.record_change(event.kind, event.id)

    def _preparation_requested(self, event: PreparationRequested) -> None:
        self._asked.put((event.scene, event.worker_kind))
        self._results.end_read()

    def _frame_denoised(self, event: FrameDenoised) -> None:
        scene = self._records.store_denoising(event.job, event.seconds, event.pixels)
        if scene is not None:
            self.record_change("scene", scene)
            self.record_change("job", event.job)  # its elapsed time

    def set_paused(self, worker: str, reason: str | None) -> None:
        """Pauses a worker. reason: shown to users; None: resumes the worker. Raises redis.RedisError."""
        if reason is None:
            self._workers.resume(worker)
        else:
            self._workers.pause(worker, reason)
        self.record_change("worker", worker)

    def worker_log(self, worker: str) -> list[str] | None:
        """Returns the last lines of a worker's log, or None if the worker does not send them in time.

        Blocks for up to several seconds. Raises redis.RedisError.
        """
        return self._workers.log(worker)

    def denoise(
        self,
        job: str,
        frame: int,
        film: Film,
        frames: tuple[tuple[int, str], ...] = (),
        guide: GuideScene | None = None,
    ) -> Future[ArtifactResult]:
        """Requests that a worker denoise a frame, with the samples that its film has now. Raises Unavailable if no worker can.

        frames, guide: as in DenoiseFrame.
        """
        request = DenoiseFrame("", job, frame, film.width, film.height, frames, guide=guide)
        version = VERSION_SEPARATOR.join(film.version(each) for each, _ in frames or ((frame, ""),))
        answer = self._artifact_tasks.denoising.request(request, version)
        self._artifact_tasks.previews.supersede(job, frame, answer)
        return self._with_wake_up(answer)

    def _has_viewers(self) -> bool:
        return any(each.has_unfinished() for each in self._viewing)

    def denoise_preview(self, job: str, frame: int, film: Film, *, is_final: bool) -> Future[ArtifactResult]:
        """Returns the latest preview of a frame (previews.py), or requests one if it is due.

        is_final: whether the job has ended. While the frame itself is being denoised, returns the future of that picture.
        Raises Unavailable if no worker can denoise.
        """
        if (better := self._artifact_tasks.denoising.answer_of(job, frame)) is not None:
            return better
        request = DenoiseFrame("", job, frame, film.width, film.height, is_preview=True)
        return self._with_wake_up(self._artifact_tasks.previews.latest(request, film.samples(frame), is_final=is_final))

    def preview_rest_s(self, job: str, frame: int, film: Film) -> float:
        """Returns the seconds until a frame's preview may be renewed.

        0: it may be now, or its samples have not grown enough.
        """
        return self._artifact_tasks.previews.rest_s(job, frame, film.samples(frame), film.width * film.height)

    def denoise_lights(self, job: str, frame: int, film: Film, lights: tuple[str, ...]) -> Future[ArtifactResult]:
        """Requests that a worker denoise the light of these groups of a frame. Raises Unavailable if no worker can."""
        request = DenoiseFrame("", job, frame, film.width, film.height, is_preview=True, lights=lights)
        return self._with_wake_up(self._artifact_tasks.denoised_lights.request(request, film.version(frame)))

    def denoised_lights(self, job: str, frame: int, film: Film) -> ArtifactResult | None:
        """Returns the denoised light groups of a frame with all samples of its film if they are stored already."""
        return self._artifact_tasks.denoised_lights.made_of(job, frame, film.version(frame))

    def existing_preview(self, job: str, frame: int, film: Film) -> ArtifactResult | None:
        """Returns the preview or denoised picture with the most samples of a frame's film; None if none is stored.

        It may lack samples of the film. Blocks while the blob store answers.
        """
        made = sorted(self._denoised_of(job, frame, film.samples(frame)), key=lambda each: each.samples, reverse=True)
        return next((each for each in made if self._artifact_tasks.denoising.is_stored(each)), None)

    def denoised(self, job: str, frame: int, film: Film) -> ArtifactResult | None:
        """Returns the denoised frame with all samples of its film if it is stored already."""
        return self._artifact_tasks.denoising.made_of(job, frame, film.version(frame))

    def has_denoised(self, job: str, frame: int, samples: int) -> bool:
        """Returns True if a preview or denoised picture of a frame was made. samples: of the frame. Thread-safe, and quick."""
        return bool(self._denoised_of(job, frame, samples))

    def denoising_s(self, job: str, frame: int, samples: int) -> float:
        """Returns the seconds that a frame's denoised picture took from its request, or has taken so far; 0 without a picture.

        samples: of the frame; a picture of fewer does not count. Thread-safe, and quick.
        """
        denoising = self._artifact_tasks.denoising
        made = denoising.last_of(job, frame)
        return made.waited_s if made is not None and made.samples == samples else denoising.waiting_s(job, frame)

    def _denoised_of(self, job: str, frame: int, samples: int) -> list[ArtifactResult]:
        """Returns the preview and the denoised picture of a frame, as far as they were made of its film, which has `samples`.

        One of more samples was made of samples that were lost or rendered wrongly.
        """
        tasks = self._artifact_tasks
        made = (each.last_of(job, frame) for each in (tasks.previews, tasks.denoising))
        return [each for each in made if each is not None and each.samples <= samples]

    def release_preview(self, job: str, frame: int) -> None:
        """Releases the preview of a frame that is denoised."""
        self._artifact_tasks.previews.release(job, frame)

    def denoised_blobs(self) -> set[str]:
        """Returns the hashes of the stored denoised frames, to which the database does not refer. Called before `start`."""
        return self._artifact_tasks.denoising.blobs_of(self._records.all_jobs())

    def vectors(self, request: FrameVectors) -> Future[ArtifactResult]:
        """Requests that a worker compute a frame's motion vectors. Raises Unavailable if no worker can."""
        return self._with_wake_up(self._artifact_tasks.vectors.request(request))

    def show_environment(self, request: ShowEnvironment) -> Future[ArtifactResult]:
        """Requests that a worker make the thumbnail of an environment image.

        The future raises Invalid if the image cannot be used. Raises Unavailable if no worker can make thumbnails.
        """
        return self._with_wake_up(self._artifact_tasks.environments.request(request))

    def _with_wake_up(self, answer: Future[ArtifactResult]) -> Future[ArtifactResult]:
        if not answer.done():
            self._results.end_read()
        return answer

    def _run(self) -> None:
        while not self._stop.is_set():
            self._fault = self._run_catching_faults(self._step) or self._step_fault or self._refused
            if self._run_catching_faults(self._publish) or self._fault:
                self._stop.wait(PAUSE_AFTER_FAULT_S)

    def _run_catching_faults(self, action: Callable[[], None]) -> str | None:
        """Runs an action. Returns None, or a sentence if the action raised any error."""
        try:
            action()
        except (redis.RedisError, QueueError) as error:
            fault = " ".join(redis_fault(error))
            if self._fault is None:
                log.warning("%s", fault)
            if any(is_wrong_type(each) for each in exception_chain(error)):
                self._repair()
            return fault
        except FarmError as error:  # the database, during start-up
            if self._fault != str(error):
                log.warning("%s", error)
            return str(error)
        except Exception as error:
            return self._log_unexpected(error)
        return None

    def _run_catching_errors(self, part: Callable[[], None]) -> str | None:
        """Runs one part of a step. Returns None, or a sentence if it raised an unexpected error.

        Raises redis.RedisError, QueueError and FarmError.
        """
        try:
            part()
        except (redis.RedisError, QueueError, FarmError):
            raise
        except Exception as error:
            return self._log_unexpected(error)
        return None

    def _log_unexpected(self, error: Exception) -> str:
        sentence = Sentence(
            "engine-error", "The scheduler failed ({name}: {error}); see the log.", name=type(error).__name__, error=error
        )
        if self._fault != sentence or time.monotonic() - self._traced >= TRACE_EVERY_S:  # it may recur at every step
            self._traced = time.monotonic()
            log.error("unexpected error in the engine", exc_info=error)
        return sentence

    def _step(self) -> None:
        self._guard()
        if not self._has_begun:
            self._clean_up_previous_run()
        self._lifecycle.begin_round()
        self._apply_changes()
        self._workers.refresh()
        if time.monotonic() - self._looked_around >= 1.0:
            self._looked_around = time.monotonic()
            with self._pace.measuring():
                self._run_periodic_tasks()
        self._bulkheads.end_failed_jobs(self._lifecycle.fail)
        self.trust.apply_distrust(self._lifecycle.reload)
        self._step_fault = self._run_catching_errors(self._dispatch_work)
        self._answers.read_answers(1 if self._lifecycle.is_loading else BLOCK_MS)

    def _dispatch_work(self) -> None:
        while not self._asked.empty():
            self._artifact_tasks.preparing.request(*self._asked.get())
        self._artifact_tasks.preparing.dispatch_work()
        if shots := self._active_shots():
            for job in self._artifact_tasks.moments.dispatch_work(
                shots, self._lifecycle.automatic_view, self._scheduler.frames_with_batches()
            ):
                self._lifecycle.record(job)
        self._artifact_tasks.path_guides.request_guides(self._scheduler.jobs, self._scheduler.job_queue.kind_for)
        self._artifact_tasks.fill_artifacts()
        with self._pace.measuring():
            self._answers.count_unread()
            self._scheduler.dispatch_work(self._lifecycle.can_start, self._artifact_tasks.wait_for_slots)

    def _clean_up_previous_run(self) -> None:
        """Deletes queued messages of a previous run, and films and logs of deleted jobs. Queues unfinished jobs and scenes."""
        self._dispatcher.purge()
        self.trust.begin()
        self.films.sweep(jobs := self._records.all_jobs())
        self.logs.sweep(jobs)
        self._changes.add("terms", "")
        for scene in self._records.preparing_scenes():
            self._changes.add("scene", scene)
        self._changes.add_low_priority("job", self._records.active_jobs())
        self._has_begun = True

    def _apply_changes(self) -> None:
        changes = self._changes.pending()
        self._lifecycle.set_order(id for item_kind, id in changes if item_kind == "job")
        for item_kind, id in changes:
            if item_kind == "worker":
                self._workers.refresh(now=True)
                if id not in self._workers.roster.orders:
                    self._outcomes.suspicion.clear_failures(id)
                    self._scheduler.distrusted.discard(id)
            elif item_kind == "terms":
                if not self._bulkheads.run(item_kind, Step.CHANGE, self._renew_terms, needs_database=True):
                    continue
            elif not self._lifecycle.may_apply(item_kind, id):
                continue
            elif id in self._bulkheads.verdicts:
                continue  # ended first; changes made meanwhile, even a deletion, are applied afterwards
            elif not self._lifecycle.apply(item_kind, id) and id not in self._bulkheads.verdicts:
                continue
            self._changes.close((item_kind, id))
            if item_kind == "job" and (job := self._scheduler.jobs.get(id)) is not None:
                self._keeper.store_if_due(job)  # the previous picture of a continued job becomes a snapshot

    def _run_with_database(self, id: str, action: Callable[[], object]) -> bool:
        return self._bulkheads.run(id, Step.RECORD, action, needs_database=True)

    def _renew_terms(self) -> None:
        """Reloads the administrators' settings for shares and workers from the database."""
        self._scheduler.shares.terms = self._records.shares()
        for job in self._scheduler.jobs.values():
            job.share = self._scheduler.shares.name_of(job.user, job.project)
        self._terms = self._records.worker_terms()

    def _run_periodic_tasks(self) -> None:
        """Runs the tasks that are due once a second. An unexpected error in one task does not prevent the others."""
        self._refused = self._run_catching_faults(self._write_heartbeat)
        faults = [
            self._run_catching_errors(part)
            for part in (
                *(
                    self.logs.flush,
                    self._maintain_keys,
                    self._answers.reread_if_incomplete,
                    self._artifact_tasks.review_artifacts,
                ),
                *(
                    lambda: self._outcomes.review_leases(self._results),
                    self.trust.advance_checks,
                    self._waiting.settle_ended,
                ),
                *(self._review_preparing, self._ask_workers, self._review_deadlines, self._review_jobs),
            )
        ]
        self._refused = self._refused or next(filter(None, faults), None)

    def _review_preparing(self) -> None:
        for scene, kind in self._artifact_tasks.preparing.end_lost_leases(self._results):
            self._lifecycle.fail_lost_scene(scene, kind)
        for scene, kind, sentence in self._artifact_tasks.preparing.impossible_requests():
            self._lifecycle.fail_impossible_scene(scene, kind, sentence)
        for job, frame in self._artifact_tasks.moments.end_lost_leases(self._scheduler.jobs, self._results):
            self._lifecycle.fail_lost_frame(job, frame)
        for job, sentence in self._artifact_tasks.moments.impossible_jobs(self._scheduler.jobs):
            self._bulkheads.give_verdict(job.id, sentence)

    def _ask_workers(self) -> None:
        needs = [job.needs for job in self._scheduler.jobs.values() if job.needs is not None]
        self._workers.send_terms(self._terms, [*needs, *self._scheduler.sites.site_requirements()])

    def _review_deadlines(self) -> None:
        self._deadlines.update(list(self._scheduler.jobs.values()), self._forecaster.forecast, time.time())

    def _review_jobs(self) -> None:
        for job in list(self._scheduler.jobs.values()):
            job.advance_clock(job.state == "running" and self._scheduler.leases.has_any(job.id))
            if job.state == "running" or job.is_done:
                self._lifecycle.record(job)
                self._snapshot_holder.record_change("job", job.id)

    def _repair(self) -> None:
        """Deletes Redis keys of the wrong type. Ignores errors of Redis."""
        self._repaired = time.monotonic()
        with suppress(redis.RedisError):
            self._results.repair()
            repair_all(self._redis)

    def _maintain_keys(self) -> None:
        """Writes the dead-letter list to its file and, every `REPAIR_KEYS_EVERY_S` seconds, deletes Redis keys of the wrong type.

        Workers can write to Redis, and a key of the wrong type may block other workers.
        """
        self._dead_letters.flush()
        if time.monotonic() - self._repaired >= REPAIR_KEYS_EVERY_S:
            self._repair()

    def _write_heartbeat(self) -> None:
        """Writes the service's heartbeat key. This detects early that Redis is full or read-only. Raises redis.RedisError."""
        self._redis.set(SERVICE_KEY, time.time(), ex=SERVICE_KEY_TTL_S)

    def _active_shots(self) -> list[tuple[ActiveJob, str | None]]:
        """Returns the active shots, by priority and age, each with the worker kind that renders it."""
        jobs = [job for job in self._scheduler.jobs.values() if job.shot is not None and job.state in ("queued", "running")]
        jobs = [job for job in jobs if job.id not in self._bulkheads.verdicts and not job.is_done]
        return [
            (job, self._scheduler.job_queue.kind_for(job)) for job in sorted(jobs, key=lambda job: (-job.priority, job.created))
        ]

    def _publish(self) -> None:
        self._snapshot_holder.publish(self._scheduler.jobs, self._make_snapshot)

    def _make_snapshot(self, numbers: Mapping[str, JobNumbers]) -> Snapshot:
        return Snapshot(
            fault=self._fault or self._bulkheads.database_fault,
            roster=self._workers.roster,
            jobs=numbers,
            ahead=self._scheduler.job_queue.jobs_ahead(),
            waits={**self.trust.required_actions(), **self._bulkheads.waiting_reasons()},
            preparing=dict(self._artifact_tasks.preparing.progress),
            counts={
                **self._answers.counts,
                **self.trust.counts,
                "lost": self._outcomes.lost,
                "doubled": self._outcomes.doubled,
                "put_aside": self._dead_letters.count,
            },
            batches_out=len(self._scheduler.leases),
            has_requests=self._artifact_tasks.has_requests,
            results_unread=self._pace.unread_results,
            batch_cost_s=self._pace.batch_cost_s,
            failures=dict(self._outcomes.suspicion.failures),
        )
