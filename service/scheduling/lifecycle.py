"""The life cycle of a job in the scheduler: loaded from the database, started, changed, finished or failed.

Used only by the engine's thread. The database takes precedence: a user's concurrent change is never overwritten.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import asdict
from itertools import islice
from typing import Any

from protocol.contract import BlobRef, SceneInfo
from renderer.errors import SettingsError
from renderer.frames import frame_number, frame_text
from renderer.sentences import Sentence, with_full_stop
from service.errors import FarmError
from service.events import BlobsReleased, Events, FilmSuspected, ItemKind
from service.intake.frame_view import requested_view
from service.intake.resolve import frame_settings, refuse_warnings
from service.scheduling.artifacts.artifacts import ArtifactTasks
from service.scheduling.changes import Changes
from service.scheduling.dispatching.scheduler import Scheduler
from service.scheduling.faults.bulkhead import Bulkheads, Step, Verdict
from service.scheduling.fleet.needs import Needs
from service.scheduling.incoming.messages import FrameFailed, FramePrepared
from service.scheduling.jobs.active_frame import ActiveFrame
from service.scheduling.jobs.active_job import ActiveJob
from service.scheduling.jobs.job_log import JobLogs
from service.scheduling.jobs.measurements import measured
from service.scheduling.jobs.reproduce import reproduce
from service.scheduling.jobs.traces import record_job_span
from service.scheduling.loading import Loading
from service.scheduling.records import PendingJob, Records
from service.scheduling.waiting import DependencyTracker
from service.shot import Shot
from service.store.film_faults import FILM
from service.store.film_store import FilmStore
from service.store.models import ACTIVE_STATES, Job, Scene, blobs_of

__all__ = ["Lifecycle"]


READ_AT_ONCE = 16  # further jobs read together with the one being loaded


class Lifecycle:
    """Loads, starts and ends jobs, and requests the preparation of their scenes."""

    def __init__(
        self,
        records: Records,
        films: FilmStore,
        scheduler: Scheduler,
        artifact_tasks: ArtifactTasks,
        logs: JobLogs,
        bulkheads: Bulkheads,
        changes: Changes,
        waiting: DependencyTracker,
        record_change: Callable[[ItemKind, str], None],
        events: Events,
    ) -> None:
        """Stores the parameters. record_change: records the change of a job or scene, to be published with the next snapshot."""
        self._records = records
        self._films = films
        self._scheduler = scheduler
        self._artifact_tasks = artifact_tasks
        self._logs = logs
        self._bulkheads = bulkheads
        self._changes = changes
        self._loading = Loading(records, films, scheduler, waiting, logs, self._handle_loaded)
        self._record_change = record_change
        self._events = events
        self._expected: Iterator[str] = iter(())  # jobs whose changes are applied next
        self._pending: dict[str, PendingJob] = {}  # read in this round and not loaded yet
        self._autos: dict[str, dict[str, Any]] = {}  # by job of a shot: the view that frames its scene at the start time

    def apply(self, item_kind: str, id: str) -> bool:
        """Applies the current database row of a job or scene. Returns False if that has to wait or has failed.

        item_kind: "job" or "scene".
        """
        is_done: list[bool] = []
        step = self._apply_job if item_kind == "job" else self._apply_scene
        return self._bulkheads.run(id, Step.CHANGE, lambda: is_done.append(step(id)), needs_database=True) and all(is_done)

    def begin_round(self) -> None:
        """Starts an iteration of the engine's loop, with a new time limit for loading jobs."""
        self._loading.begin_round()
        self.set_order(())

    def set_order(self, jobs: Iterable[str]) -> None:
        """Sets the jobs whose changes are applied next, in order, so that rows of jobs to load are read together."""
        self._expected = (id for id in jobs if id not in self._scheduler.jobs)
        self._pending.clear()

    @property
    def is_loading(self) -> bool:
        """True while jobs remain to be loaded in later iterations of the engine's loop."""
        return self._loading.is_under_way or self._changes.has_low_priority

    def may_apply(self, item_kind: str, id: str) -> bool:
        """Returns True if a change can be applied in this iteration of the engine's loop.

        Loading a job requires that the iteration has time left. item_kind: "job" or "scene".
        """
        return item_kind != "job" or id in self._scheduler.jobs or self._loading.has_time

    def is_awaited(self, id: str) -> bool:
        """Returns True if a job is not loaded yet, but will be once its film and the database can be read."""
        return id not in self._scheduler.jobs and self._changes.is_pending(("job", id))

    def _apply_job(self, id: str) -> bool:
        job = self._scheduler.jobs.get(id)
        pending = self._read_pending(id) if job is None else None
        row = self._records.job(id) if pending is None else pending.row
        if row is None or row.state not in ACTIVE_STATES:
            self._loading.discard(id)
            if job is not None:
                job.history.log.add_line(row.state if row is not None else "deleted")
                record_job_span(job, row.state if row is not None else "deleted")
                self._close_job(job)
            self._unpin_film(id)
            self._bulkheads.remove_id(id)
            if row is None:
                self._logs.delete(id)
                self._artifact_tasks.discard_job(id)
                self._films.delete(id)
            elif job is not None:
                self._records.store_progress(job)
                self._release_frames(job)
        elif not (
            self._apply_user_changes(job, row) if job is not None else pending is not None and self._load_or_adjust(pending)
        ):
            return False
        self._record_change("job", id)
        return True

    def _read_pending(self, id: str) -> PendingJob | None:
        """Returns the data of a job that is not in the scheduler; None if the job has no database row."""
        if id not in self._pending:
            ids = [id, *islice(self._expected, READ_AT_ONCE)]
            try:
                self._pending = self._records.pending(ids)
            except Exception:
                if len(ids) == 1:
                    raise
                self._pending = self._records.pending([id])  # another job's row may be at fault
        return self._pending.pop(id, None)

    def _load_or_adjust(self, pending: PendingJob) -> bool:
        if not self._loading.continue_loading(pending):
            return False
        job = self._scheduler.jobs.get(pending.row.id)
        return job is None or self._apply_user_changes(job, pending.row)  # changes made while it was being loaded

    def _apply_user_changes(self, job: ActiveJob, row: Job) -> bool:
        """Applies a user's changes to an active job, from its database row. Returns False if some have to wait."""
        shot = Shot.parse(row.shot)
        if shot is not None and job.shot is not None and shot.revision != job.shot.revision:
            self._records.store_progress(job)
            self._close_job(job)
            pending = self._records.pending([row.id]).get(row.id)
            return pending is not None and self._load_or_adjust(pending)
        job.agenda.first_key = shot.first if shot else None
        if row.state == "paused" != job.state:
            self._scheduler.outcomes.withdraw(job)
            self._records.store_progress(job)
        if row.state != job.state and "paused" in (row.state, job.state):
            job.history.add_event("paused" if row.state == "paused" else "resumed")
        job.state, job.priority, job.max_slots = row.state, row.priority, row.max_slots
        if (needs := Needs.from_json(row.needs)) != job.needs:
            self._scheduler.outcomes.withdraw(job)
            job.needs = needs
        if row.deadline != job.deadline:
            job.deadline, job.expected, job.urgency = row.deadline, None, math.inf
        if job.focus != row.focus:
            job.focus_on(row.focus)
        if shot is None and row.spp and job.differs_from_goal(row.spp, row.noise, row.seconds):
            self._scheduler.outcomes.withdraw(job)
            job.set_goal(row.spp, row.noise, row.seconds)
        return True

    def _handle_loaded(self, job: ActiveJob, scene: Scene) -> None:
        if job.shot is not None:
            self._autos[job.id] = (scene.info or {})["cameras"][-1]["view"]
        if (
            job.started
            or job.shot is not None
            or job.film.has_file
            or not all(f.has_recorded_samples for f in job.frames.values())
        ):
            self.record(job)  # otherwise its row is up to date

    def reload(self, job: ActiveJob) -> None:
        """Reloads a job after a worker was distrusted, so that the worker's samples are removed and rendered again."""
        self._bulkheads.run(job.id, Step.RECORD, lambda: self._records.store_progress(job), needs_database=True)
        self._close_job(job)
        self._changes.add("job", job.id)

    def can_start(self, job: ActiveJob, kind: str) -> bool:
        """Starts a job on workers of this kind if they can render it now. Returns whether they can.

        If the scene is not compiled for this kind, requests that.
        """
        if kind not in job.compiled:
            self._artifact_tasks.preparing.request(job.scene, kind)
            return False
        if job.shot is not None and not job.started and job.agenda.next_frame(kind) is None:
            return False  # its first frame is still being prepared
        if not job.started or job.kind is None or job.state == "queued":
            if not self._records.mark_started(job.id, kind):
                return False
            job.started, job.state = True, "running"
            job.history.add_event("begun", kind)
            job.kind = job.kind or kind
            self._record_change("job", job.id)
        return True

    def record(self, job: ActiveJob) -> None:
        """Stores a job's progress, and finishes the job if it has reached its goal."""
        self._bulkheads.run(job.id, Step.RECORD, lambda: self._record_progress(job), needs_database=True)

    def _record_progress(self, job: ActiveJob) -> None:
        if job.agenda.new_goals:
            self.begin_next_round(job)
        is_over = job.is_done and job.state in ("queued", "running")
        if is_over:
            job.advance_clock(job.started)
            job.finish_frames()
        if job.has_first_wave and not any(kind == "picture" for _, kind, _ in job.history.events):
            job.history.add_event("picture")
        job.history.record_departures(self._scheduler.connected_workers())
        if job.shot is None:
            next(iter(job.frames.values())).update_noise()
        job.history.add_point(job.active_s, job.samples, job.current_noise, is_over)
        gone = job.release_compiled()
        self._records.store_progress(job)
        if gone:
            self._events.publish(BlobsReleased(gone))
        if is_over and self._records.mark_finished(job, measured(job, self._scheduler.job_queue.slots_for(job))):
            job.history.log.add_line(f"finished: {job.samples:,} samples in {job.active_s:.2f} s")
            record_job_span(job, "finished")
            self._record_change("scene", job.scene)
            self._close_job(job)
            self._release_frames(job)
            self._bulkheads.remove_id(job.id)
        self._record_change("job", job.id)

    def begin_next_round(self, job: ActiveJob) -> None:
        """Stores the sample goals that the order `noisiest-first` has computed for a shot's frames, and applies them."""
        self._records.store_goals(job)
        job.agenda.begin_round()

    def automatic_view(self, job: ActiveJob) -> dict[str, Any]:
        """Returns the automatic view of a job's scene: a camera that frames the scene at the job's start time."""
        return self._autos[job.id]

    def handle_frame_answer(self, message: FramePrepared | FrameFailed) -> None:
        """Handles the result of a frame's preparation. If it failed, the job continues with the other frames."""
        job = self._scheduler.jobs.get(message.job)
        frame = job.frames.get(message.frame) if job is not None else None
        if job is None or job.shot is None or frame is None or message.kind not in job.compiled:
            return  # a still has no separately prepared frames
        found = message.info if isinstance(message, FramePrepared) else None
        self._artifact_tasks.moments.handle_answer(job, message.work, message.frame, message.worker, found)
        name = Sentence("label-frame", "frame {frame}", frame=frame_text(frame_number(message.frame)))
        if isinstance(message, FrameFailed):
            job.history.log.add_line(f"{name} could not be prepared by {message.worker}: {message.error}")
            if not frame.is_over:
                job.fail_frame(frame, message.error)
        else:
            info = message.info
            job.history.log.add_line(f"{name} was prepared by {message.worker} in {info.seconds:.2f} s")
            try:
                if job.request.get("strict"):
                    refuse_warnings(info.warnings, job.request)
                view, views = info.view, info.views
                if job.request.get("views"):
                    view, views = requested_view(job.request, frame_number(message.frame)) or view, []
                settings = frame_settings(job.request, job.settings, view, info.defaults, views)
            except SettingsError as error:
                job.fail_frame(frame, with_full_stop(error))
                return
            job.mark_prepared(frame, message.kind, settings, asdict(info.compiled) if info.compiled else None)
        self._record_change("job", job.id)

    def fail_lost_frame(self, job: ActiveJob, frame: ActiveFrame) -> None:
        """Fails a frame whose preparation was repeatedly lost together with its worker."""
        error = Sentence(
            "worker-lost-preparing-frame",
            "The worker was lost three times while it prepared this frame. Make the scene smaller, or give "
            "the worker more memory.",
        )
        self._bulkheads.run(job.id, Step.RECORD, lambda: job.fail_frame(frame, error))

    def fail(self, id: str, verdict: Verdict) -> None:
        """Fails a job or a scene with the error of `verdict`. The samples of a job are preserved."""
        job = self._scheduler.jobs.get(id)
        if job is not None:
            job.history.log.add_line(f"failed: {verdict.error}", verdict.reproduce or "")
            record_job_span(job, "failed", verdict.error)
            self._close_job(job)  # first, since it ends even if the database is away
        command = reproduce(verdict.reproduce, job) if verdict.reproduce and job is not None else verdict.reproduce
        if self._records.mark_failed(id, verdict.error, command) or job is not None:
            if job is not None:
                self._records.store_progress(job)
                self._release_frames(job)
            self._record_change("job", id)
            if FILM in verdict.error:
                self._events.publish(FilmSuspected(id))
        else:
            self.prepare_failed(id, None, verdict.error)

    def handle_prepared(self, scene: str, info: SceneInfo) -> None:
        """Marks a scene as prepared for a worker kind, and continues its jobs. info: the message of the worker."""
        self._artifact_tasks.preparing.forget_kind(scene, info.kind)
        if (error := self._records.fail_if_strict(scene, info.warnings)) is not None:
            self.prepare_failed(scene, None, error)
            return
        if not self._records.prepared(scene, info):
            return
        for id in self._records.derived_scenes(scene):
            self._changes.add("scene", id)
        for id in self._records.jobs_of(scene):
            if id in self._scheduler.jobs:
                job = self._scheduler.jobs[id]
                job.add_compiled_kind(info.kind, info.compiled.sha256)
                job.of_scene |= blobs_of([asdict(info.compiled)])
            else:
                self._changes.add("job", id)

    def add_thumbnail(self, scene: str, thumbnail: BlobRef) -> bool:
        """Stores the thumbnail of a prepared scene. Returns False if the scene already has one or is deleted."""
        return self._records.add_thumbnail(scene, thumbnail)

    def prepare_failed(self, scene: str, kind: str | None, error: str) -> None:
        """Fails a scene, and the jobs that wait for it: all of them, or only those that require this worker kind."""
        if self._records.prepare_failed(scene, error):
            self._artifact_tasks.preparing.remove_scene(scene)
        elif kind is not None:
            self._artifact_tasks.preparing.forget_kind(scene, kind)
        row = self._records.scene(scene)
        if row is None:
            return
        for id in self._records.derived_scenes(scene) if row.status == "failed" else ():
            self.prepare_failed(id, None, error)
        for id in self._records.jobs_of(scene):
            job = self._scheduler.jobs.get(id)
            if job is None and row.status == "failed":
                self._records.mark_failed(id, error)
            elif job is not None and kind not in job.compiled and job.kind in (None, kind):
                self._bulkheads.give_verdict(id, error)
            self._record_change("job", id)
        self._record_change("scene", scene)

    def fail_lost_scene(self, scene: str, kind: str | None) -> None:
        """Fails a scene whose preparation was repeatedly lost together with its worker."""
        error = Sentence(
            "worker-lost-preparing-scene",
            "The worker was lost three times while it prepared this scene. Make the scene smaller, or give "
            "the worker more memory.",
        )
        self._bulkheads.run(scene, Step.RECORD, lambda: self.prepare_failed(scene, kind, error), needs_database=True)

    def fail_impossible_scene(self, scene: str, kind: str | None, error: str) -> None:
        """Fails a scene because the machine of no connected worker can prepare it."""
        self._bulkheads.run(scene, Step.RECORD, lambda: self.prepare_failed(scene, kind, error), needs_database=True)

    def _apply_scene(self, id: str) -> bool:
        self._pending.clear()  # data of jobs of this scene
        scene = self._records.scene(id)
        if scene is None:
            self._artifact_tasks.preparing.remove_scene(id)
        elif scene.status == "preparing":
            base = self._records.scene(scene.of) if scene.of else None
            if base is None or base.status != "preparing":  # otherwise this scene is applied again once its base is prepared
                self._artifact_tasks.preparing.request(id, None, by_blender=self._records.needs_blender(scene))
        self._record_change("scene", id)
        return True

    def _close_job(self, job: ActiveJob) -> None:
        self._scheduler.outcomes.withdraw(job)
        self._scheduler.jobs.pop(job.id, None)
        self._artifact_tasks.moments.discard_job(job.id)
        self._artifact_tasks.path_guides.discard_job(job.id)
        self._logs.close(job.id)
        self._autos.pop(job.id, None)
        self._unpin_film(job.id)

    def _release_frames(self, job: ActiveJob) -> None:
        """Releases the compiled frames of an ended job."""
        gone = job.release_compiled(all_frames=True)
        if gone:
            self._records.store_progress(job)
            self._events.publish(BlobsReleased(gone))

    def _unpin_film(self, id: str) -> None:
        with suppress(FarmError):  # a film that is in use is unpinned later
            self._films.unpin(id)
