"""Loads jobs from the database into the scheduler.

A shot may have a hundred thousand frames, so it is loaded in steps, with a time limit in each iteration of the engine's loop.
Results of other jobs are merged between the iterations.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial

from renderer.sentences import Sentence
from renderer.settings import RenderSettings
from service.scheduling.dispatching.scheduler import Scheduler
from service.scheduling.jobs.active_job import ActiveJob
from service.scheduling.jobs.history import History
from service.scheduling.jobs.job_log import JobLogs
from service.scheduling.records import PendingJob, Records
from service.scheduling.waiting import DependencyTracker
from service.shot import Shot
from service.store.film_store import FilmStore
from service.store.films import Film
from service.store.models import Job, Scene, blobs_of

__all__ = ["Loading"]

ROUND_PROCESSOR_S = 0.05  # processor time per round
ROUND_S = 0.2  # wall time per round, which ends first on a busy machine


class Loading:
    """Loads jobs step by step. Used only by the engine's thread."""

    def __init__(
        self,
        records: Records,
        films: FilmStore,
        scheduler: Scheduler,
        waiting: DependencyTracker,
        logs: JobLogs,
        on_loaded: Callable[[ActiveJob, Scene], None],
    ) -> None:
        """Stores the parameters. on_loaded: called with each job that was added to the scheduler, and its scene."""
        self._records = records
        self._films = films
        self._scheduler = scheduler
        self._waiting = waiting
        self._logs = logs
        self._on_loaded = on_loaded
        self._under_way: dict[str, tuple[object, Iterator[None]]] = {}  # by job: its fields, and the remaining steps
        self._rounds = 0
        self._is_first = True  # no job was loaded in this round
        self._until = self._until_by_clock = 0.0

    def begin_round(self) -> None:
        """Resets the time limits. Called at the start of each iteration of the engine's loop."""
        self._rounds += 1
        self._is_first = True
        self._until = time.thread_time() + ROUND_PROCESSOR_S
        self._until_by_clock = time.monotonic() + ROUND_S

    @property
    def has_time(self) -> bool:
        """True if this iteration of the engine's loop has time to load another job, and always for the first job."""
        return self._is_first or (time.thread_time() <= self._until and time.monotonic() <= self._until_by_clock)

    @property
    def is_under_way(self) -> bool:
        """Returns True if a job is partly loaded."""
        return bool(self._under_way)

    def continue_loading(self, pending: PendingJob) -> bool:
        """Loads an unfinished job until this iteration of the engine's loop has used up its time.

        Returns True if the job is loaded or cannot be loaded at present, and False if steps remain.
        """
        self._is_first = False
        row = pending.row
        asked = row.shot, row.spp, row.noise, row.seconds, frozenset(self._scheduler.distrusted), row.doubted
        known, steps = self._under_way.get(row.id, (None, iter(())))
        if known != asked:
            steps = self._steps(pending)
        self._under_way.pop(row.id, None)
        for _ in steps:
            if not self.has_time:
                self._under_way[row.id] = asked, steps
                return False
        return True

    def discard(self, id: str) -> None:
        """Discards the remaining steps of a job."""
        self._under_way.pop(id, None)

    def _steps(self, pending: PendingJob) -> Iterator[None]:
        """Loads a job; yields after each step. Does nothing while the scene is not ready or dependencies are unfinished."""
        row, scene, since = pending.row, pending.scene, self._rounds
        self._waiting.set_waiting(row.id, pending.waits)
        if pending.waits or pending.frames_change:
            return
        if scene is None:
            self._records.mark_failed(
                row.id,
                Sentence("job-scene-deleted", "The scene of this job was deleted. Upload it again, and make a new job."),
            )
        elif scene.status == "failed":
            self._records.mark_failed(
                row.id, scene.error or Sentence("scene-preparation-failed", "The scene cannot be prepared. Upload it again.")
            )
        if scene is None or scene.status != "ready":
            return
        resolved = row if row.settings is not None else self._records.resolve(row.id, scene)
        if resolved is None or resolved.state == "failed" or resolved.settings is None or resolved.tile_size is None:
            return
        film = self._film(row, resolved)
        compiled = {kind: ref["sha256"] for kind, ref in scene.compiled.items()}
        job = ActiveJob(resolved, film, compiled, scene.blobs, partial(self._records.frame_settings, row.id))
        for frames in self._records.frames(row.id) if pending.frames is None else [pending.frames]:
            job.add_frames(frames)
            yield
        if not job.frames:
            return  # deleted concurrently, which is applied next
        for _ in job.prepare_in_steps():
            yield
        job.history = History.parse(pending.history)
        self._add(job, row, scene, is_of_this_round=since == self._rounds)

    def _film(self, row: Job, resolved: Job) -> Film:
        """Opens the job's film, and removes the samples that must be rendered again or come from distrusted workers.

        resolved: the job's row with render settings. Raises FilmUnavailable or FilmLost.
        """
        assert resolved.settings is not None and resolved.tile_size is not None
        film = self._films.open(row.id, RenderSettings.from_json(resolved.settings), resolved.tile_size, pin=True)
        shot = Shot.parse(row.shot)
        if shot is not None and (anew := shot.anew_keys):
            if film.has_only(set(anew)):
                self._films.delete(row.id)  # fast for a film of any size
                film = self._films.open(row.id, RenderSettings.from_json(resolved.settings), resolved.tile_size, pin=True)
            else:
                film.delete_frames(*anew)
            self._records.record_removed_samples(row.id, anew)
        film.separates_senders = self._verified_fraction(row) > 0
        for worker in self._scheduler.distrusted.union(row.doubted or ()):
            film.delete_samples_of(worker)
        if row.doubted:
            self._records.clear_distrusted(row.id)
        return film

    def _add(self, job: ActiveJob, row: Job, scene: Scene, is_of_this_round: bool) -> None:
        job.verify = self._verified_fraction(row)
        job.checks = self._scheduler.checks
        job.looks = self._scheduler.looks
        job.share = self._scheduler.shares.name_of(job.user, job.project)
        asked = {"env": row.light or scene.environment, "variant": scene.variant}
        job.scene_words = [f"--{name}={value}" for name, value in asked.items() if value]
        upload = self._records.scene(row.scene) if row.lit else scene
        job.foretold_s = float(((upload and upload.measured) or {}).get("sample_s") or 0.0)
        job.history.log = self._logs.log_of(row.id)
        job.history.log.add_line(_summary(job, scene))
        self._scheduler.jobs[row.id] = job
        if not is_of_this_round:
            self._add_missed_kinds(job, row.compiled_scene_id)
        self._on_loaded(job, scene)

    def _verified_fraction(self, row: Job) -> float:
        """Returns the fraction of batches that are rendered twice for verification: the job's setting, else the farm's."""
        asked: float | None = row.request.get("verify")
        return self._scheduler.verify if asked is None else asked

    def _add_missed_kinds(self, job: ActiveJob, scene_id: str) -> None:
        """Adds the worker kinds for which the scene was compiled after the loading of the job had begun."""
        scene = self._records.scene(scene_id)
        for kind, ref in (scene.compiled if scene is not None else {}).items():
            if kind not in job.compiled:
                job.add_compiled_kind(kind, ref["sha256"])
                job.of_scene |= blobs_of([ref])


def _summary(job: ActiveJob, scene: Scene) -> str:
    """Returns the first line of the job's log: its goals, and how its scene was prepared."""
    info = scene.info or {}
    goals = [f"{job.spp} samples per pixel", job.noise and f"noise {job.noise:g}", job.seconds and f"{job.seconds:g} s"]
    asked = f"{job.film.width} x {job.film.height}, {', '.join(str(goal) for goal in goals if goal)}, {len(job.frames)} frame(s)"
    kinds = ", ".join(sorted(job.compiled)) or "no kind yet"
    ready = f"the scene took {float(info.get('seconds') or 0):.2f} s to prepare, and is compiled for {kinds}"
    return f"{'loaded again' if job.started else 'loaded'}: {asked}; {ready}; {job.samples:,} samples in the film"
