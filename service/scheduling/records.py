"""What the engine reads from and writes to the database. Every write is one transaction, and respects what a person decided in
the meantime: a job that was cancelled stays cancelled."""

from __future__ import annotations

import json
import time
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from typing import Any

from sqlalchemy import BindParameter, bindparam, case, delete, exists, func, or_, select, update
from sqlalchemy.orm import Session, aliased

from protocol.contract import SceneInfo
from protocol.terms import Terms as WorkerTerms
from renderer.errors import SettingsError
from renderer.frames import frame_number, frames_text
from renderer.settings import RenderSettings
from service.errors import Conflict
from service.intake.resolve import refusal, resolve
from service.scheduling.jobs.active_frame import ActiveFrame, FrameRow
from service.scheduling.jobs.active_job import ActiveJob
from service.scheduling.jobs.shares import Terms
from service.shot import Shot
from service.store.blends import blend_of, is_to_be_opened
from service.store.database import Sessions
from service.store.models import ACTIVE, FINAL, Environment, Frame, FrameChange, Job, Reference, Scene, ShareTerms, Wait
from service.store.models import WorkerTerms as Asked

__all__ = ["PendingJob", "Records"]

NUMBERS = ("samples", "target", "bad_samples", "progress", "noise", "compiled", "settings")  # of a frame, that the engine tells
AT_A_TIME = 2000  # frames of a shot that are read at once
AS_TOLD = {"synchronize_session": False}  # no row was read that would have to know of it


# Those of FrameRow. Settings are most of a row: they are read when they are needed.
_FRAME_COLUMNS = [
    *(getattr(Frame, name) for name in FrameRow._fields if name != "has_settings"),
    Frame.settings.is_not(None),
]

# Queries for `Records.pending`, made once: making one takes longer than carrying it out.
_IDS: BindParameter[Any] = bindparam("ids", expanding=True)
_PENDING = select(Job, exists().where(Wait.job == Job.id), exists().where(FrameChange.job == Job.id), Job.history).where(
    Job.id.in_(_IDS)
)
_SCENES = select(Scene).where(Scene.id.in_(_IDS))
_FRAMES = select(Frame.job, *_FRAME_COLUMNS).where(Frame.job.in_(_IDS)).order_by(Frame.number)


@dataclass(frozen=True)
class PendingJob:
    """A job that the scheduler does not have yet, and all that decides whether it may begin."""

    row: Job
    scene: Scene | None  # whose compiled form is rendered
    waits: bool  # for other jobs
    frames_change: bool  # a change of its frames is being carried out; the job is noted as changed once that is over
    history: dict[str, Any] | None
    frames: list[FrameRow] | None  # None: of a shot, whose frames are read some at a time


class Records:
    """The engine's view of the database."""

    def __init__(self, sessions: Sessions, max_pixels: int) -> None:
        self._sessions = sessions
        self._max_pixels = max_pixels

    def active_jobs(self) -> list[str]:
        """The jobs that are not over: first those that are rendered, then by priority and age."""
        with self._sessions() as session:
            order = case((Job.state == "running", 0), else_=1), Job.priority.desc(), Job.created
            return list(session.scalars(select(Job.id).where(Job.state.in_(ACTIVE)).order_by(*order)))

    def all_jobs(self) -> set[str]:
        """All jobs."""
        with self._sessions() as session:
            return set(session.scalars(select(Job.id)))

    def jobs_of(self, scene: str) -> list[str]:
        """The jobs that render a scene and are not over."""
        with self._sessions() as session:
            stage = func.coalesce(Job.lit, Job.scene)
            return list(session.scalars(select(Job.id).where(stage == scene, Job.state.in_(ACTIVE))))

    def waiting_for(self, scene: str) -> list[str]:
        """The scenes that are to be made of this one, and are not prepared yet."""
        with self._sessions() as session:
            return list(session.scalars(select(Scene.id).where(Scene.of == scene, Scene.status == "preparing")))

    def preparing_scenes(self) -> list[str]:
        """The scenes that nobody has prepared yet."""
        with self._sessions() as session:
            return list(session.scalars(select(Scene.id).where(Scene.status == "preparing")))

    def blobs(self) -> set[str]:
        """The hashes of all blobs that rows refer to."""
        with self._sessions() as session:
            frames = session.scalars(select(Frame).where(Frame.compiled.is_not(None)))
            owners = [*session.scalars(select(Scene)), *session.scalars(select(Environment)), *frames]
            owners += session.scalars(select(Reference))
            return {sha256 for owner in owners for sha256 in owner.blobs}

    def job(self, id: str) -> Job | None:
        """A job's row."""
        with self._sessions() as session:
            return session.get(Job, id)

    def history(self, id: str) -> dict[str, Any] | None:
        """How a job has come so far."""
        with self._sessions() as session:
            return session.scalar(select(Job.history).where(Job.id == id))

    def samples(self, job: str, frame: int = 0) -> int:
        """The samples of a job's frame that are in its film, as they were last written down."""
        with self._sessions() as session:
            found = session.get(Frame, (job, frame))
            return found.samples if found is not None else 0

    def has_frame(self, job: str, frame: int) -> bool:
        """Whether a job has a frame of this key."""
        with self._sessions() as session:
            return session.get(Frame, (job, frame)) is not None

    def believed(self, job: str) -> None:
        """All that was doubted of its film is taken out of it."""
        with self._sessions.begin() as session:
            session.execute(update(Job).where(Job.id == job).values(doubted=None))

    def pending(self, ids: Collection[str]) -> dict[str, PendingJob]:
        """Returns those of these jobs that have a row, all read together: thousands may be submitted at once."""
        with self._sessions() as session:
            found = session.execute(_PENDING, {"ids": list(ids)}).all()
            stages = {job.stage for job, *_ in found}
            scenes = {scene.id: scene for scene in session.scalars(_SCENES, {"ids": list(stages)})}
            frames: dict[str, list[FrameRow]] = {job.id: [] for job, *_ in found if job.shot is None}
            for job, *row in session.execute(_FRAMES, {"ids": list(frames)}):
                frames[job].append(FrameRow._make(row))
        return {
            job.id: PendingJob(job, scenes.get(job.stage), waits, frames_change, history, frames.get(job.id))
            for job, waits, frames_change, history in found
        }

    def all_waiting(self) -> set[str]:
        """The jobs that wait for others and are not over."""
        with self._sessions() as session:
            return set(session.scalars(select(Wait.job).join(Job, Job.id == Wait.job).where(Job.state.in_(ACTIVE)).distinct()))

    def ended_waits(self) -> list[tuple[str, str, str | None, str | None]]:
        """Jobs that wait for one that is over: which, for which, and the name and the state of that; None: it was deleted."""
        other = aliased(Job)
        query = select(Wait.job, Wait.other, other.name, other.state).join(Job, Job.id == Wait.job)
        query = query.join(other, other.id == Wait.other, isouter=True)
        query = query.where(Job.state.in_(ACTIVE), or_(other.id.is_(None), other.state.in_(FINAL)))
        with self._sessions() as session:
            return [(job, id, name, state) for job, id, name, state in session.execute(query)]

    def shares(self) -> dict[str, Terms]:
        """The terms of the shares that have any."""
        with self._sessions() as session:
            return {row.name: Terms(row.weight, row.max_slots) for row in session.scalars(select(ShareTerms))}

    def worker_terms(self) -> dict[str, WorkerTerms]:
        """What is asked of workers, by name; what another release wrote and this one does not understand is left out."""
        found = {}
        with self._sessions() as session:
            for row in session.scalars(select(Asked)):
                with suppress(ValueError):
                    found[row.name] = WorkerTerms.from_bytes(json.dumps(row.terms).encode())
        return found

    def waited(self, other: str) -> None:
        """A job is finished: none waits for it any more."""
        with self._sessions.begin() as session:
            session.execute(delete(Wait).where(Wait.other == other))

    def late(self, id: str, since: float | None) -> bool:
        """Write down since when a job is expected to miss its deadline; None: it is not. False where it is over or gone."""
        with self._sessions.begin() as session:
            changed = session.execute(update(Job).where(Job.id == id, Job.state.in_(ACTIVE)).values(late=since))
            return bool(changed.rowcount)  # type: ignore[attr-defined]

    def overdue(self, now: float) -> list[str]:
        """The unfinished jobs whose deadline has passed and that are not known to be late."""
        with self._sessions() as session:
            query = select(Job.id).where(Job.state.in_(ACTIVE), Job.deadline < now, Job.late.is_(None))
            return list(session.scalars(query))

    def frames(self, job: str) -> Iterator[list[FrameRow]]:
        """The frames of a job, in their order, some at a time."""
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
        """What a frame is rendered with, as its row says. Raises Conflict, SettingsError."""
        with self._sessions() as session:
            found = session.scalar(select(Frame.settings).where(Frame.job == job, Frame.number == frame))
        if found is None:
            raise Conflict("The record of a frame of this job is damaged. Have its frames rendered again.")
        return RenderSettings.from_json(found)

    def is_to_be_opened(self, scene: Scene) -> bool:
        """Whether Blender has to open a scene's file before it can be prepared."""
        with self._sessions() as session:
            return is_to_be_opened(session, scene)

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
            job.kind = kind
            job.started = job.started or time.time()
            return True

    def progress(self, job: ActiveJob) -> None:
        """Write down how far a job is: of a shot those of its frames that have changed."""
        with self._sessions.begin() as session:
            told = {"active_s": job.active_s} | ({"history": job.history.to_json()} if job.history.has_changed else {})
            session.execute(update(Job).where(Job.id == job.id).values(told), execution_options=AS_TOLD)
            if job.shot is None:
                _write_still(session, job)
            else:
                _write_shot(session, job, job.shot)
        job.unwritten.clear()
        job.history.has_changed = False

    def forgot(self, id: str, keys: list[int]) -> None:
        """The samples of these frames are removed from the film."""
        with self._sessions.begin() as session:
            row = session.get(Job, id, with_for_update=True)
            shot = Shot.of(row.shot) if row is not None else None
            if row is not None and shot is not None:
                left = set(shot.anew_keys).difference(keys)
                row.shot = replace(shot, anew=frames_text(map(frame_number, left))).to_json()

    def goals(self, job: ActiveJob) -> None:
        """Write down what a round gives each frame of a job."""
        with self._sessions.begin() as session:
            goals = [{"of": job.id, "key": key, "goal": goal} for key, goal in job.agenda.new_goals.items()]
            row = update(Frame).where(Frame.job == bindparam("of"), Frame.number == bindparam("key"))
            session.connection().execute(row.values(spp=bindparam("goal")), goals)

    def finished(self, job: ActiveJob, measured: dict[str, float | None] | None = None) -> bool:
        """A job has all that was asked for: of a shot, all but the frames that failed; where all of them did, it has failed.
        measured: what it says of its scene (service/scheduling/jobs/measurements.py).
        False where it was over already, or something else was asked for in the meantime."""
        with self._sessions.begin() as session:
            row = session.get(Job, job.id, with_for_update=True)
            if row is None or row.state not in ACTIVE or (row.spp, row.noise, row.seconds) != (job.spp, job.noise, job.seconds):
                return False
            shot = Shot.of(row.shot)
            if shot is not None and job.shot is not None and shot.revision != job.shot.revision:
                return False
            if measured is not None:
                session.execute(update(Scene).where(Scene.id == row.scene).values(measured=measured))
            row.state, row.finished, row.active_s = "finished", time.time(), job.active_s
            if row.deadline is not None:
                row.late = None if row.finished <= row.deadline else row.late or row.finished
            if job.shot is not None and all(frame.state == "failed" for frame in job.frames.values()):
                first = next(iter(job.frames.values()))
                row.state, row.error = "failed", f"No frame can be rendered. {first.error}"
            else:  # here, as it may be deleted a moment later
                session.execute(delete(Wait).where(Wait.other == job.id))
            return True

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
                scene.info = {**asdict(info), "blend": info.blend or blend_of(session, scene)}
            scene.status, scene.error = "ready", None
            return True

    def refuse(self, id: str, warnings: Sequence[str]) -> str | None:
        """Fails a strict scene that was prepared with warnings, and returns its error; None for other scenes.

        One that is ready for another kind of worker stays ready. The warnings, with the upload's own, become the scene's notes.
        """
        with self._sessions.begin() as session:
            scene = session.get(Scene, id)
            if scene is None or not scene.strict or scene.status != "preparing":
                return None
            said = [*scene.notes, *warnings]
            if not said:
                return None
            scene.notes = said
            scene.status, scene.error = "failed", f"{refusal(said)}."
            return scene.error

    def prepare_failed(self, id: str, error: str) -> bool:
        """A scene cannot be prepared. False where it is gone, or is ready for another kind."""
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
        session.execute(row.values(progress=job.progress, noise=frame.noise, **numbers), execution_options=AS_TOLD)


def _write_shot(session: Session, job: ActiveJob, asked: Shot) -> None:
    """Those of its frames that have changed."""
    if not job.unwritten:
        return
    row = session.get(Job, job.id)
    shot = Shot.of(row.shot) if row is not None else None
    changed = list(job.unwritten)
    names: tuple[str, ...]
    if shot is None or shot.revision != asked.revision:
        # Somebody has asked for something else: the frames are what that made of them, and those anew have nothing.
        anew = set(shot.anew_keys) if shot is not None else set()
        changed = [key for key in changed if key not in anew]
        # What they come to is as that says too, and so is how far they are.
        names = tuple(name for name in NUMBERS if name not in ("target", "progress"))
    else:
        names = (*NUMBERS, "state", "error")
    given = update(Frame).where(Frame.job == bindparam("of"), Frame.number == bindparam("key"))
    values: dict[str, Any] = {name: bindparam(f"new_{name}", type_=getattr(Frame, name).type) for name in names}
    values["settings"] = func.coalesce(values["settings"], Frame.settings)  # of one that was over it is not known any more
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
