"""What the engine reads from and writes to the database. Every write is one transaction, and keeps what a person decided
in the meantime: a job that was cancelled stays so."""

from __future__ import annotations

import time
from dataclasses import asdict

from sqlalchemy import select, update

from renderer.errors import SettingsError
from service.intake.resolve import resolve
from service.scheduling.active_job import ActiveJob
from service.store.database import Sessions
from service.store.models import ACTIVE, Frame, Job, Scene
from worker.contract import SceneInfo

__all__ = ["Records"]


class Records:
    """The engine's view of the database."""

    def __init__(self, sessions: Sessions, max_pixels: int) -> None:
        self._sessions = sessions
        self._max_pixels = max_pixels

    def active_jobs(self) -> list[str]:
        """The jobs that are not over."""
        with self._sessions() as session:
            return list(session.scalars(select(Job.id).where(Job.state.in_(ACTIVE)).order_by(Job.created)))

    def all_jobs(self) -> set[str]:
        """All jobs."""
        with self._sessions() as session:
            return set(session.scalars(select(Job.id)))

    def jobs_of(self, scene: str) -> list[str]:
        """The jobs of a scene that are not over."""
        with self._sessions() as session:
            return list(session.scalars(select(Job.id).where(Job.scene == scene, Job.state.in_(ACTIVE))))

    def preparing_scenes(self) -> list[str]:
        """The scenes that nobody has prepared yet."""
        with self._sessions() as session:
            return list(session.scalars(select(Scene.id).where(Scene.status == "preparing")))

    def blobs(self) -> set[str]:
        """The hashes of all blobs that scenes refer to."""
        with self._sessions() as session:
            return {sha256 for scene in session.scalars(select(Scene)) for sha256 in scene.blobs}

    def job(self, id: str) -> Job | None:
        """A job's row."""
        with self._sessions() as session:
            return session.get(Job, id)

    def samples(self, job: str) -> int:
        """The samples of a job's frame 0 that are in its film, as they were last written down."""
        with self._sessions() as session:
            frame = session.get(Frame, (job, 0))
            return frame.samples if frame is not None else 0

    def scene(self, id: str) -> Scene | None:
        """A scene's row."""
        with self._sessions() as session:
            return session.get(Scene, id)

    def resolve(self, id: str, scene: Scene) -> Job | None:
        """Fix a job's settings by its scene, once; a request that the scene cannot fulfil fails the job."""
        with self._sessions.begin() as session:
            job = session.get(Job, id, with_for_update=True)
            if job is not None and job.settings is None:
                try:
                    resolve(job, scene, self._max_pixels)
                except SettingsError as error:
                    job.state, job.error, job.finished = "failed", f"{error}.", time.time()
            return job

    def started(self, id: str, kind: str) -> bool:
        """The job's first batch is about to go to workers of a kind. False where the job is no longer to be rendered."""
        with self._sessions.begin() as session:
            job = session.get(Job, id, with_for_update=True)
            if job is None or job.state not in ("queued", "running"):
                return False
            job.state = "running"
            job.kind = job.kind or kind
            job.started = job.started or time.time()
            return True

    def progress(self, job: ActiveJob) -> None:
        """Write down how far a job is."""
        with self._sessions.begin() as session:
            session.execute(update(Job).where(Job.id == job.id).values(active_s=job.active_s))
            frame = session.get(Frame, (job.id, job.frame))
            if frame is not None:
                frame.samples, frame.target = job.plan.samples, job.plan.target_samples
                frame.bad_samples, frame.progress = job.bad_samples, job.progress

    def finished(self, job: ActiveJob) -> bool:
        """A job has all that was asked for. False where it was over already, or more was asked for in the meantime."""
        with self._sessions.begin() as session:
            changed = session.execute(
                update(Job)
                .where(Job.id == job.id, Job.state.in_(ACTIVE), Job.spp == job.plan.spp)
                .where(Job.noise.is_not_distinct_from(job.plan.noise), Job.seconds.is_not_distinct_from(job.seconds))
                .values(state="finished", finished=time.time(), active_s=job.active_s)
            )
            return bool(changed.rowcount)  # type: ignore[attr-defined]

    def failed(self, id: str, error: str, reproduce: str | None = None) -> bool:
        """A job cannot go on. False where it was over or gone already."""
        with self._sessions.begin() as session:
            changed = session.execute(
                update(Job)
                .where(Job.id == id, Job.state.in_(ACTIVE))
                .values(state="failed", error=error, reproduce=reproduce, finished=time.time())
            )
            return bool(changed.rowcount)  # type: ignore[attr-defined]

    def prepared(self, id: str, info: SceneInfo) -> bool:
        """A scene is prepared for a kind of worker. False where it is gone."""
        with self._sessions.begin() as session:
            scene = session.get(Scene, id)
            if scene is None:
                return False
            scene.compiled = {**scene.compiled, info.kind: asdict(info.compiled)}
            if scene.info is None:
                scene.info = asdict(info)
            scene.status, scene.error = "ready", None
            return True

    def prepare_failed(self, id: str, error: str) -> bool:
        """A scene cannot be prepared. False where it is gone, or is ready for another kind."""
        with self._sessions.begin() as session:
            scene = session.get(Scene, id)
            if scene is None or scene.status != "preparing":
                return False
            scene.status, scene.error = "failed", error
            return True
