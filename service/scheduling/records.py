"""The engine's database operations.

Every write is one transaction and respects concurrent changes by users: a cancelled job stays cancelled.
"""

from __future__ import annotations

import json
import time
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from typing import Any

from sqlalchemy import BindParameter, bindparam, case, delete, exists, func, or_, select, update
from sqlalchemy.orm import Session, aliased

from protocol.contract import BlobRef, SceneInfo
from protocol.terms import Terms as WorkerTerms
from renderer.errors import SettingsError
from renderer.frames import frame_number, frames_text
from renderer.sentences import Sentence, joined_sentences, with_full_stop
from renderer.settings import RenderSettings
from service.errors import Conflict
from service.intake.resolve import refusal, resolve
from service.scheduling.jobs.active_frame import ActiveFrame, FrameRow
from service.scheduling.jobs.active_job import ActiveJob
from service.scheduling.jobs.measurements import Measured, updated, with_denoising
from service.scheduling.jobs.shares import Terms
from service.shot import Shot
from service.store.blends import blender_export_of, needs_blender
from service.store.database import Sessions
from service.store.models import (
    ACTIVE_STATES,
    FINAL_STATES,
    Environment,
    Frame,
    FrameChange,
    Job,
    Reference,
    Scene,
    ShareTerms,
    Wait,
)
from service.store.models import WorkerTerms as Asked

__all__ = ["PendingJob", "Records"]

# columns of a frame that the engine writes
NUMBERS = ("samples", "target", "bad_samples", "progress", "noise", "compiled", "settings")
AT_A_TIME = 2000  # frames of a shot read at once
NO_SYNCHRONIZE = {"synchronize_session": False}  # no loaded row needs the new values


# The columns of FrameRow. Settings make up most of a row and are read when needed.
_FRAME_COLUMNS = [
    *(getattr(Frame, name) for name in FrameRow._fields if name != "has_settings"),
    Frame.settings.is_not(None),
]

# Queries for `Records.pending`, built once: building one takes longer than running it.
_IDS: BindParameter[Any] = bindparam("ids", expanding=True)
_PENDING = select(Job, exists().where(Wait.job == Job.id), exists().where(FrameChange.job == Job.id), Job.history).where(
    Job.id.in_(_IDS)
)
_SCENES = select(Scene).where(Scene.id.in_(_IDS))
_FRAMES = select(Frame.job, *_FRAME_COLUMNS).where(Frame.job.in_(_IDS)).order_by(Frame.number)


@dataclass(frozen=True)
class PendingJob:
    """A job that is not in the scheduler, with the data that determines whether it may start."""

    row: Job
    scene: Scene | None  # the scene whose compiled form is rendered
    waits: bool  # whether it depends on unfinished jobs
    frames_change: bool  # whether its frames are being changed; the job is noted as changed afterwards
    history: dict[str, Any] | None
    frames: list[FrameRow] | None  # None for a shot, whose frames are read in parts


class Records:
    """The engine's database operations."""

    def __init__(self, sessions: Sessions, max_pixels: int) -> None:
        self._sessions = sessions
        self._max_pixels = max_pixels

    def active_jobs(self) -> list[str]:
        """Returns the ids of the unfinished jobs: running ones first, then by priority and age."""
        with self._sessions() as session:
            order = case((Job.state == "running", 0), else_=1), Job.priority.desc(), Job.created
            return list(session.scalars(select(Job.id).where(Job.state.in_(ACTIVE_STATES)).order_by(*order)))

    def all_jobs(self) -> set[str]:
        """Returns the ids of all jobs."""
        with self._sessions() as session:
            return set(session.scalars(select(Job.id)))

    def jobs_of(self, scene: str) -> list[str]:
        """Returns the ids of the unfinished jobs that render a scene."""
        with self._sessions() as session:
            stage = func.coalesce(Job.lit, Job.scene)
            return list(session.scalars(select(Job.id).where(stage == scene, Job.state.in_(ACTIVE_STATES))))

    def derived_scenes(self, scene: str) -> list[str]:
        """Returns the ids of the scenes derived from this one that are not prepared yet."""
        with self._sessions() as session:
            return list(session.scalars(select(Scene.id).where(Scene.of == scene, Scene.status == "preparing")))

    def preparing_scenes(self) -> list[str]:
        """Returns the ids of the scenes that are not prepared yet."""
        with self._sessions() as session:
            return list(session.scalars(select(Scene.id).where(Scene.status == "preparing")))

    def blobs(self) -> set[str]:
        """Returns the hashes of all blobs that the database refers to."""
        with self._sessions() as session:
            frames = session.scalars(select(Frame).where(Frame.compiled.is_not(None)))
            owners: list[Scene | Environment | Reference | Frame] = [*frames]
            owners += session.scalars(select(Scene))
            owners += session.scalars(select(Environment))
            owners += session.scalars(select(Reference))
            return {sha256 for owner in owners for sha256 in owner.blobs}

    def job(self, id: str) -> Job | None:
        """Returns a job's row; None if it does not exist."""
        with self._sessions() as session:
            return session.get(Job, id)

    def history(self, id: str) -> dict[str, Any] | None:
        """Returns a job's stored history (service/scheduling/jobs/history.py)."""
        with self._sessions() as session:
            return session.scalar(select(Job.history).where(Job.id == id))

    def samples(self, job: str, frame: int = 0) -> int:
        """Returns the stored number of samples of a frame, over all pixels."""
        with self._sessions() as session:
            found = session.get(Frame, (job, frame))
            return found.samples if found is not None else 0

    def has_frame(self, job: str, frame: int) -> bool:
        """Returns True if a job has a frame with this key."""
        with self._sessions() as session:
            return session.get(Frame, (job, frame)) is not None

    def clear_distrusted(self, job: str) -> None:
        """Clears a job's list of distrusted workers, after their samples were removed from its film."""
        with self._sessions.begin() as session:
            session.execute(update(Job).where(Job.id == job).values(doubted=None))

    def pending(self, ids: Collection[str]) -> dict[str, PendingJob]:
        """Returns the data of those jobs that have a database row, by id.

        All are read together, since thousands may be submitted at once.
        """
        with self._sessions() as session:
            found = session.execute(_PENDING, {"ids": list(ids)}).all()
            stages = {job.compiled_scene_id for job, *_ in found}
            scenes = {scene.id: scene for scene in session.scalars(_SCENES, {"ids": list(stages)})}
            frames: dict[str, list[FrameRow]] = {job.id: [] for job, *_ in found if job.shot is None}
            for job, *row in session.execute(_FRAMES, {"ids": list(frames)}):
                frames[job].append(FrameRow._make(row))
        return {
            job.id: PendingJob(job, scenes.get(job.compiled_scene_id), waits, frames_change, history, frames.get(job.id))
            for job, waits, frames_change, history in found
        }

    def waiting_jobs(self) -> set[str]:
        """Returns the ids of the unfinished jobs that wait for other jobs."""
        with self._sessions() as session:
            return set(
                session.scalars(select(Wait.job).join(Job, Job.id == Wait.job).where(Job.state.in_(ACTIVE_STATES)).distinct())
            )

    def ended_dependencies(self) -> list[tuple[str, str, str | None, str | None]]:
        """Returns (job id, other job's id, name, state) for each unfinished job that waits for a job that has ended.

        Name and state are None if the other job was deleted.
        """
        other = aliased(Job)
        query = select(Wait.job, Wait.other, other.name, other.state).join(Job, Job.id == Wait.job)
        query = query.join(other, other.id == Wait.other, isouter=True)
        query = query.where(Job.state.in_(ACTIVE_STATES), or_(other.id.is_(None), other.state.in_(FINAL_STATES)))
        with self._sessions() as session:
            return [(job, id, name, state) for job, id, name, state in session.execute(query)]

    def shares(self) -> dict[str, Terms]:
        """Returns the weights and slot limits that administrators have set for users and projects, by share name."""
        with self._sessions() as session:
            return {row.name: Terms(row.weight, row.max_slots) for row in session.scalars(select(ShareTerms))}

    def worker_terms(self) -> dict[str, WorkerTerms]:
        """Returns the administrators' settings for workers, by name. Settings of an incompatible release are skipped."""
        found = {}
        with self._sessions() as session:
            for row in session.scalars(select(Asked)):
                with suppress(ValueError):
                    found[row.name] = WorkerTerms.from_bytes(json.dumps(row.terms).encode())
        return found

    def remove_waits(self, other: str) -> None:
        """Removes the dependencies of all jobs on a finished job."""
        with self._sessions.begin() as session:
            session.execute(delete(Wait).where(Wait.other == other))

    def store_lateness(self, id: str, since: float | None) -> bool:
        """Stores the Unix time since which a job is late; None if it is not late.

        Returns False if the job has ended or is deleted.
        """
        with self._sessions.begin() as session:
            changed = session.execute(update(Job).where(Job.id == id, Job.state.in_(ACTIVE_STATES)).values(late=since))
            return bool(changed.rowcount)  # type: ignore[attr-defined]

    def find_overdue(self, now: float) -> list[str]:
        """Returns the ids of the unfinished jobs whose deadline has passed and that are not marked late yet."""
        with self._sessions() as session:
            query = select(Job.id).where(Job.state.in_(ACTIVE_STATES), Job.deadline < now, Job.late.is_(None))
            return list(session.scalars(query))

    def frames(self, job: str) -> Iterator[list[FrameRow]]:
        """Yields the database rows of a job's frames in order, in lists of `AT_A_TIME`."""
        query = select(*_FRAME_COLUMNS).where(Frame.job == job).order_by(Frame.number).limit(AT_A_TIME)
        last = -1
        while True:
            with self._sessions() as session:
                rows = [FrameRow._make(row) for row in session.execute(query.where(Frame.number > last))]
            if rows:
                yield rows
            if len(rows) < AT_A_TIME:
                return
            last = rows[-1].number

    def frame_settings(self, job: str, frame: int) -> RenderSettings:
        """Returns the stored render settings of a frame. Raises Conflict or SettingsError."""
        with self._sessions() as session:
            found = session.scalar(select(Frame.settings).where(Frame.job == job, Frame.number == frame))
        if found is None:
            raise Conflict(
                Sentence("frame-record-damaged", "The record of a frame of this job is damaged. Render its frames again.")
            )
        return RenderSettings.from_json(found)

    def needs_blender(self, scene: Scene) -> bool:
        """Returns True if a scene's file must be opened with Blender before the scene can be prepared."""
        with self._sessions() as session:
            return needs_blender(session, scene)

    def scene(self, id: str) -> Scene | None:
        """Returns a scene's row; None if it does not exist."""
        with self._sessions() as session:
            return session.get(Scene, id)

    def resolve(self, id: str, scene: Scene) -> Job | None:
        """Sets a job's render settings from its scene, if not done before, and returns the row; None if the job is deleted.

        If the request does not fit the scene, marks the job as failed.
        """
        with self._sessions.begin() as session:
            job = session.get(Job, id, with_for_update=True)
            if job is not None and job.settings is None:
                try:
                    resolve(job, scene, self._max_pixels)
                except SettingsError as error:
                    job.state, job.error, job.finished = "failed", with_full_stop(error), time.time()
            return job

    def mark_started(self, id: str, kind: str) -> bool:
        """Marks a job as running on workers of this kind, before its first batch.

        Returns False if the job must not be rendered any more.
        """
        with self._sessions.begin() as session:
            job = session.get(Job, id, with_for_update=True)
            if job is None or job.state not in ("queued", "running"):
                return False
            job.state = "running"
            job.kind = kind
            job.started = job.started or time.time()
            return True

    def store_progress(self, job: ActiveJob) -> None:
        """Stores the progress of a job, or that of the changed frames of a shot."""
        with self._sessions.begin() as session:
            progress_values = {"active_s": job.active_s} | ({"history": job.history.to_json()} if job.history.has_changed else {})
            session.execute(update(Job).where(Job.id == job.id).values(progress_values), execution_options=NO_SYNCHRONIZE)
            if job.shot is None:
                _write_still(session, job)
            else:
                _write_shot(session, job, job.shot)
        job.unwritten.clear()
        job.history.has_changed = False

    def record_removed_samples(self, id: str, keys: list[int]) -> None:
        """Records that the samples of these frames were removed from the job's film."""
        with self._sessions.begin() as session:
            row = session.get(Job, id, with_for_update=True)
            shot = Shot.parse(row.shot) if row is not None else None
            if row is not None and shot is not None:
                left = set(shot.anew_keys).difference(keys)
                row.shot = replace(shot, anew=frames_text(map(frame_number, left))).to_json()

    def store_goals(self, job: ActiveJob) -> None:
        """Stores the sample goals that the order `noisiest-first` has computed for a shot's frames."""
        with self._sessions.begin() as session:
            goals = [{"of": job.id, "key": key, "goal": goal} for key, goal in job.agenda.new_goals.items()]
            row = update(Frame).where(Frame.job == bindparam("of"), Frame.number == bindparam("key"))
            session.connection().execute(row.values(spp=bindparam("goal")), goals)

    def mark_finished(self, job: ActiveJob, measured: Measured | None = None) -> bool:
        """Marks a job as finished, or as failed if all its frames failed.

        measured: measurements of the scene (service/scheduling/jobs/measurements.py). Returns False if the job has already
        ended, or its goal was changed concurrently.
        """
        with self._sessions.begin() as session:
            row = session.get(Job, job.id, with_for_update=True)
            if (
                row is None
                or row.state not in ACTIVE_STATES
                or (row.spp, row.noise, row.seconds) != (job.spp, job.noise, job.seconds)
            ):
                return False
            shot = Shot.parse(row.shot)
            if shot is not None and job.shot is not None and shot.revision != job.shot.revision:
                return False
            if measured is not None:
                before = session.scalar(select(Scene.measured).where(Scene.id == row.scene).with_for_update())
                session.execute(update(Scene).where(Scene.id == row.scene).values(measured=updated(before, measured)))
            finished = time.time()
            row.state, row.finished, row.active_s = "finished", finished, job.active_s
            if row.deadline is not None:
                row.late = None if finished <= row.deadline else row.late or finished
            if job.shot is not None and all(frame.state == "failed" for frame in job.frames.values()):
                first = next(iter(job.frames.values()))
                row.state, row.error = (
                    "failed",
                    joined_sentences(Sentence("job-without-renderable-frame", "No frame can be rendered."), first.error or ""),
                )
            else:  # removed here, since the job may be deleted soon
                session.execute(delete(Wait).where(Wait.other == job.id))
            return True

    def store_denoising(self, job: str, seconds: float, pixels: int) -> str | None:
        """Stores how long a frame of a job took to denoise with the measurements of its scene. Returns the scene's id."""
        with self._sessions.begin() as session:
            row = session.get(Job, job)
            if row is None:
                return None
            before = session.scalar(select(Scene.measured).where(Scene.id == row.scene).with_for_update())
            latest = with_denoising(before, seconds, pixels)
            session.execute(update(Scene).where(Scene.id == row.scene).values(measured=latest))
            return row.scene

    def mark_failed(self, id: str, error: str, reproduce: str | None = None) -> bool:
        """Marks a job as failed. Returns False if it has already ended or is deleted.

        error: error sentence. reproduce: command line that reproduces the error.
        """
        with self._sessions.begin() as session:
            changed = session.execute(
                update(Job)
                .where(Job.id == id, Job.state.in_(ACTIVE_STATES))
                .values(state="failed", error=error, reproduce=reproduce, finished=time.time())
            )
            return bool(changed.rowcount)  # type: ignore[attr-defined]

    def prepared(self, id: str, info: SceneInfo) -> bool:
        """Marks a scene as prepared for a worker kind, and stores its description. Returns False if it is deleted."""
        with self._sessions.begin() as session:
            scene = session.get(Scene, id)
            if scene is None:
                return False
            scene.compiled = {**scene.compiled, info.kind: asdict(info.compiled)}
            if scene.info is None:
                scene.info = {**asdict(info), "blend": info.blend or blender_export_of(session, scene)}
            scene.status, scene.error = "ready", None
            return True

    def add_thumbnail(self, id: str, thumbnail: BlobRef) -> bool:
        """Stores the thumbnail of a prepared scene. Returns False if the scene already has one or is deleted."""
        with self._sessions.begin() as session:
            scene = session.get(Scene, id, with_for_update=True)  # a poster may be added meanwhile
            if scene is None or scene.info is None or scene.info.get("thumbnail"):
                return False
            scene.info = {**scene.info, "thumbnail": asdict(thumbnail)}
            return True

    def fail_if_strict(self, id: str, warnings: Sequence[str]) -> str | None:
        """Marks a strict scene as failed if it was prepared with warnings. Returns its error; None if it was not failed.

        A scene that is ready for another worker kind stays ready. The warnings are added to the scene's notes.
        """
        with self._sessions.begin() as session:
            scene = session.get(Scene, id)
            if scene is None or not scene.strict or scene.status != "preparing":
                return None
            said = [*scene.notes, *warnings]
            if not said:
                return None
            scene.notes = said
            scene.status, scene.error = "failed", with_full_stop(refusal(said))
            return scene.error

    def prepare_failed(self, id: str, error: str) -> bool:
        """Marks a scene as failed. Returns False if it is deleted, or ready for another worker kind."""
        with self._sessions.begin() as session:
            scene = session.get(Scene, id)
            if scene is None or scene.status != "preparing":
                return False
            scene.status, scene.error = "failed", error
            return True


def _write_still(session: Session, job: ActiveJob) -> None:
    for frame in job.frames.values():
        numbers = {"samples": frame.samples, "target": frame.target_samples, "bad_samples": frame.bad_samples}
        row = update(Frame).where(Frame.job == job.id, Frame.number == frame.key)
        session.execute(row.values(progress=job.progress, noise=frame.noise, **numbers), execution_options=NO_SYNCHRONIZE)


def _write_shot(session: Session, job: ActiveJob, requested: Shot) -> None:
    """Stores the changed frames of a shot. requested: the shot's request as the engine has loaded it.

    If a user has changed the request since, the states and targets that the change has set are not overwritten.
    """
    if not job.unwritten:
        return
    shot = Shot.parse(session.scalar(select(Job.shot).where(Job.id == job.id)))  # the row has the request, with all its views
    changed = list(job.unwritten)
    names: tuple[str, ...]
    if shot is None or shot.revision != requested.revision:
        # A user has changed the shot: the frames' states are those of the change, and frames rendered anew have no samples.
        anew = set(shot.anew_keys) if shot is not None else set()
        changed = [key for key in changed if key not in anew]
        # The change has also set their targets and progress.
        names = tuple(name for name in NUMBERS if name not in ("target", "progress"))
    else:
        names = (*NUMBERS, "state", "error")
    given = update(Frame).where(Frame.job == bindparam("of"), Frame.number == bindparam("key"))
    values: dict[str, Any] = {name: bindparam(f"new_{name}", type_=getattr(Frame, name).type) for name in names}
    values["settings"] = func.coalesce(values["settings"], Frame.settings)  # unknown here for a frame that had ended
    given = given.values(values)
    rows = [_row(job, job.frames[key], names) for key in changed]
    if rows:
        session.connection().execute(given, rows)


def _row(job: ActiveJob, frame: ActiveFrame, names: Sequence[str]) -> dict[str, Any]:
    now = {
        "samples": frame.samples,
        "target": frame.target_samples,
        "bad_samples": frame.bad_samples,
        "progress": frame.progress,
        "noise": frame.noise,
        "compiled": frame.own or None,
        "settings": frame.settings_json,
        "state": frame.state,
        "error": frame.error,
    }
    return {"of": job.id, "key": frame.key, **{f"new_{name}": now[name] for name in names}}
