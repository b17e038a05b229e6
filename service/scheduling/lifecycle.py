"""A job's way from the database into the scheduler's hands and out again: taken up, begun, changed, finished, failed.

All of it runs in the engine's thread. The database decides: what a person changed there in the meantime is never overwritten.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable

from renderer.errors import SettingsError
from renderer.settings import RenderSettings
from service.errors import FilmLost
from service.scheduling.active_job import ActiveJob
from service.scheduling.denoising import Denoising
from service.scheduling.preparing import Preparing
from service.scheduling.scheduler import Scheduler
from service.store.film_store import FilmStore
from service.store.models import ACTIVE
from service.store.records import Records
from worker.contract import SceneInfo

__all__ = ["Lifecycle", "Tell"]

Tell = Callable[[str, str], None]  # what ("job", "scene", "worker") and which


class Lifecycle:
    """Begins and ends jobs, and lets scenes be prepared for them."""

    def __init__(
        self,
        records: Records,
        films: FilmStore,
        scheduler: Scheduler,
        preparing: Preparing,
        denoising: Denoising,
        tell: Tell,
    ) -> None:
        self._records = records
        self._films = films
        self._scheduler = scheduler
        self._preparing = preparing
        self._denoising = denoising
        self._tell = tell

    def apply(self, what: str, id: str) -> None:
        """A job or a scene was made, changed or deleted in the database."""
        if what == "scene":
            self._apply_scene(id)
            return
        row = self._records.job(id)
        job = self._scheduler.jobs.get(id)
        if row is None or row.state not in ACTIVE:
            if job is not None:
                self._records.progress(job)
                self._drop(job)
            if row is None:
                self._films.delete(id)
                self._denoising.forget(id)
        elif job is None:
            self.take_up(id)
        else:
            if row.state == "paused" != job.state:
                self._scheduler.withdraw(job)
                self._records.progress(job)
            job.state, job.priority = row.state, row.priority
            if row.spp and row.spp != job.plan.spp:
                self._scheduler.withdraw(job)
                job.plan.extend(row.spp)
        self._tell("job", id)

    def take_up(self, id: str) -> None:
        """Begin or go on with a job, as soon as its scene is ready."""
        row = self._records.job(id)
        scene = self._records.scene(row.scene) if row else None
        if row is None:
            return
        if scene is None:
            self._records.failed(id, "The scene of this job was deleted. Upload it again, and make a new job.")
        elif scene.status == "failed":
            self._records.failed(id, scene.error or "The scene cannot be prepared.")
        if scene is None or scene.status != "ready":
            return
        row = self._records.resolve(id, scene)
        if row is None or row.state == "failed" or row.settings is None or row.tile_size is None:
            return
        try:
            film = self._films.open(id, RenderSettings.from_json(row.settings), row.tile_size, pin=True)
        except FilmLost as error:
            self._records.failed(id, str(error))
            return
        except SettingsError as error:
            self._records.failed(id, f"This job cannot go on: its settings cannot be read ({error}). Make a new one.")
            return
        job = ActiveJob(row, film, {kind: ref["sha256"] for kind, ref in scene.compiled.items()})
        self._scheduler.jobs[id] = job
        self._records.progress(job)
        self.end_if_done(job)

    def may_start(self, job: ActiveJob, kind: str) -> bool:
        """Whether the job can be rendered by workers of this kind now; if so its kind is fixed."""
        if kind not in job.compiled:
            self._preparing.want(job.scene, kind)
            return False
        if not job.started or job.kind is None or job.state == "queued":
            if not self._records.started(job.id, kind):
                return False
            job.started, job.state = True, "running"
            job.kind = job.kind or kind
            self._tell("job", job.id)
        return True

    def end_if_done(self, job: ActiveJob) -> None:
        """Finish a job that has all that was asked for."""
        if job.state in ("queued", "running") and job.done:
            job.tick(job.started)
            self._records.progress(job)
            if self._records.finished(job):
                self._drop(job)
                self._tell("job", job.id)

    def fail(self, job: ActiveJob, error: str, reproduce: str | None = None) -> None:
        """Stop a job that cannot go on; its film stays."""
        self._records.progress(job)
        scene = self._records.scene(job.scene)
        if reproduce and scene is not None and scene.environment:
            reproduce += " " + shlex.join([f"--env={scene.environment}"])  # of the scene, so not among the settings
        self._records.failed(job.id, error, reproduce)
        self._drop(job)
        self._tell("job", job.id)

    def prepared(self, scene: str, info: SceneInfo) -> None:
        """A scene is ready for a kind of worker: its jobs can go on."""
        self._preparing.forget_kind(scene, info.kind)
        if not self._records.prepared(scene, info):
            return
        for id in self._records.jobs_of(scene):
            if id in self._scheduler.jobs:
                self._scheduler.jobs[id].compiled[info.kind] = info.compiled.sha256
            else:
                self.take_up(id)
                self._tell("job", id)

    def prepare_failed(self, scene: str, kind: str | None, error: str) -> None:
        """The scene's error ends the jobs that wait for it: all, or those that need it for this kind of worker."""
        if self._records.prepare_failed(scene, error):
            self._preparing.forget(scene)
        elif kind is not None:
            self._preparing.forget_kind(scene, kind)
        row = self._records.scene(scene)
        for id in self._records.jobs_of(scene):
            job = self._scheduler.jobs.get(id)
            if job is None and (row is None or row.status == "failed"):
                self._records.failed(id, error)
            elif job is not None and kind not in job.compiled and job.kind in (None, kind):
                self.fail(job, error)
            self._tell("job", id)
        self._tell("scene", scene)

    def _apply_scene(self, id: str) -> None:
        scene = self._records.scene(id)
        if scene is None:
            self._preparing.forget(id)
        elif scene.status == "preparing":
            self._preparing.want(id, None)

    def _drop(self, job: ActiveJob) -> None:
        self._scheduler.withdraw(job)
        self._scheduler.jobs.pop(job.id, None)
        self._films.unpin(job.id)
