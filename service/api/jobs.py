"""/api/jobs: ask for pictures, watch, change and delete what was asked for."""

from __future__ import annotations

import time
import uuid
from typing import Annotated, Literal

from fastapi import APIRouter, Header, Query, Response
from sqlalchemy import func, select
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from renderer.errors import SettingsError
from renderer.frames import frame_key
from service.api.describe import job_out
from service.api.lookup import find_job, find_scene, no_job
from service.api.problem import Problem
from service.api.schemas import JobIn, JobOut, JobPatch
from service.errors import Conflict, NotFound
from service.farm import Farm, FarmDependency
from service.intake.record import record
from service.intake.resolve import resolve
from service.intake.uploads import changed
from service.scheduling.shot_wishes import ShotWish, change_shot
from service.scheduling.wishes import ask_for_samples, begins_anew, focus_on, set_state
from service.shot import IN_TURN, Shot
from service.store.models import Frame, Job, Scene

__all__ = ["router"]

router = APIRouter(prefix="/api/jobs", tags=["jobs"])

Key = Annotated[
    str | None, Header(max_length=255, pattern="^[ -~]*$", description="A repeated POST with the same key makes one job.")
]


@router.post("", status_code=201, response_model=JobOut)
def create_job(request: JobIn, farm: FarmDependency, response: Response, idempotency_key: Key = None) -> JobOut:
    """Ask for a picture of a scene. A scene that is still being prepared is waited for."""
    asked = request.model_dump(mode="json")
    if idempotency_key and (earlier := _earlier(idempotency_key, farm)):
        return _repeat(earlier, asked, farm, response)
    scene_id = _as_asked(request, farm)
    job = Job(
        id=uuid.uuid4().hex[:20],
        scene=scene_id,
        name=request.name or "",
        state="queued",
        priority=request.priority,
        created=time.time(),
        request=asked,
        active_s=0.0,
        tile_size=request.tile_size,
        spp=request.spp,
        noise=request.noise,
        seconds=request.seconds,
        shot=_shot(request).to_json() if request.is_shot else None,
        idempotency_key=idempotency_key or None,
    )
    try:
        with farm.sessions.begin() as session:
            scene = session.get(Scene, scene_id, with_for_update=True)
            _check(job, scene, farm)
            session.add(job)
            session.flush()
            session.add_all(Frame(job=job.id, number=key) for key in _keys(request))
            session.flush()
            answer = job_out(job, session, farm.engine)
    except IntegrityError:
        earlier = _earlier(idempotency_key, farm) if idempotency_key else None
        if earlier is None:
            raise
        return _repeat(earlier, asked, farm, response)
    farm.changed("job", job.id)
    response.headers["Location"] = f"/api/jobs/{job.id}"
    return answer


@router.get("", response_model=list[JobOut])
def list_jobs(
    farm: FarmDependency,
    response: Response,
    state: Literal["queued", "running", "paused", "finished", "failed", "cancelled"] | None = None,
    scene: str | None = Query(None, max_length=100),
    limit: int = Query(100, ge=1, le=1000),
    offset: int = Query(0, ge=0, le=1 << 31),
) -> list[JobOut]:
    """All jobs, the newest first. The header X-Total-Count has their number."""
    query = select(Job)
    if state is not None:
        query = query.where(Job.state == state)
    if scene is not None:
        query = query.where(Job.scene == scene)
    with farm.sessions() as session:
        response.headers["X-Total-Count"] = str(session.scalar(select(func.count()).select_from(query.subquery())))
        rows = session.scalars(query.order_by(Job.created.desc(), Job.id).limit(limit).offset(offset))
        return [job_out(row, session, farm.engine) for row in rows]


@router.get("/{id}", response_model=JobOut)
def get_job(id: str, farm: FarmDependency) -> JobOut:
    """One job: its state, progress, speed and errors."""
    with farm.sessions() as session:
        return job_out(find_job(id, farm), session, farm.engine)


@router.patch("/{id}", response_model=JobOut)
def change_job(id: str, change: JobPatch, farm: FarmDependency) -> JobOut:
    """Pause, go on, cancel, change the priority, or ask for more samples. Cancelling keeps the picture so far.

    A job that is over and set to running renders what its picture lacks, frames that failed among it; a film that is damaged is
    set aside first. Of a shot: more frames, some of them anew or with more samples, one before all others. focus: a rectangle is
    rendered first, which changes no bit of how the picture ends.
    """
    may_begin_anew = change.state == "running" and id not in farm.engine.snapshot.jobs
    is_anew = may_begin_anew and begins_anew(find_job(id, farm), farm.films)
    with farm.sessions.begin() as session:
        job = session.get(Job, id, with_for_update=True)
        if job is None:
            raise no_job(id)
        if change.priority is not None:
            job.priority = change.priority
        shot = Shot.of(job.shot)
        if shot is not None:
            frames = {frame.number: frame for frame in session.scalars(select(Frame).where(Frame.job == id))}
            wish = ShotWish(**change.model_dump(include=set(ShotWish.__dataclass_fields__)))
            session.add_all(change_shot(job, shot, frames, wish))
        elif change.is_of_frames:
            raise Conflict("The job is a still: it has no frames to choose from. Make a new job, with frames.")
        elif change.spp is not None or change.more is not None:
            frame = session.get(Frame, (id, 0))
            ask_for_samples(job, change.spp, change.more, frame.samples if frame else 0)
        if "focus" in change.model_fields_set:
            focus_on(job, change.focus)
        if change.state is not None:
            set_state(job, change.state, is_anew)
        session.flush()
        answer = job_out(job, session, farm.engine)
    farm.changed("job", id)
    return answer


@router.delete("/{id}", status_code=204)
def delete_job(id: str, farm: FarmDependency) -> None:
    """Delete a job and its pictures; one that is being rendered is stopped."""

    def forget(session: Session) -> set[str]:
        job = session.get(Job, id)
        if job is None:
            raise no_job(id)
        own: set[str] = set()
        for frame in session.scalars(select(Frame).where(Frame.job == id)):
            own |= frame.blobs
            session.delete(frame)
        session.flush()
        session.delete(job)
        return own

    farm.reserve.spend_on(lambda: farm.garbage.collect(forget))
    farm.changed("job", id)  # which removes the film, once it is out of its hands


def _keys(request: JobIn) -> list[int]:
    return sorted(map(frame_key, request.numbers()))


def _shot(request: JobIn) -> Shot:
    """As it is asked for; where only a time ends it, all frames are to have their share of that."""
    only_time = request.seconds is not None and request.spp is None and request.noise is None
    order = request.order or ("breadth-first" if only_time else IN_TURN)
    return Shot(request.fps, request.clip, request.turntable, order, request.every)


def _as_asked(request: JobIn, farm: Farm) -> str:
    """The scene to render: under another sky, or with other materials of its file, it is another one, which is made here."""
    sky = request.environment.sky if request.environment else None
    if sky is None and request.variant is None:
        return request.scene
    stored = changed(_scene(request.scene, farm), (sky.elevation, sky.azimuth) if sky else None, request.variant)
    with farm.garbage.pinned(ref.sha256 for ref in stored.files):
        _scene(request.scene, farm)  # where it is deleted by now, its files may be
        return record(stored, farm.sessions, farm.changed).id


def _scene(id: str, farm: Farm) -> Scene:
    try:
        return find_scene(id, farm)
    except NotFound:
        raise _no_scene(id) from None  # the id is in the body


def _no_scene(id: str) -> NotFound:
    return NotFound(f"scene: there is no scene {id[:60]!r}. Upload it first, by POST /api/scenes.")


def _check(job: Job, scene: Scene | None, farm: Farm) -> None:
    """Fix the job's settings where its scene is ready; refuse what can never be rendered."""
    if scene is None:
        raise _no_scene(job.scene)
    if scene.status == "failed":
        raise Conflict(f"The scene cannot be rendered: {scene.error}")
    job.name = job.name or scene.name
    width, height = job.request["width"], job.request["height"]
    if width and height and width * height > farm.settings.max_pixels:
        raise _invalid(f"width x height is {width * height} pixels; at most {farm.settings.max_pixels} are rendered", "width")
    if scene.status == "ready":
        try:
            resolve(job, scene, farm.settings.max_pixels)
        except SettingsError as error:
            raise _invalid(str(error), str(error).split()[0]) from None


def _invalid(sentence: str, field: str) -> Problem:
    return Problem(422, f"{sentence}.", errors=[{"field": field, "message": sentence}])


def _earlier(key: str, farm: Farm) -> Job | None:
    with farm.sessions() as session:
        return session.scalar(select(Job).where(Job.idempotency_key == key))


def _repeat(earlier: Job, asked: dict[str, object], farm: Farm, response: Response) -> JobOut:
    if earlier.request != asked:
        raise Conflict("This Idempotency-Key was used for another request. Take a new key for a new job.")
    response.headers["Idempotent-Replayed"] = "true"
    response.headers["Location"] = f"/api/jobs/{earlier.id}"
    with farm.sessions() as session:
        return job_out(earlier, session, farm.engine)
