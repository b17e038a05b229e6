"""/api/jobs: creates, watches, changes and deletes jobs."""

from __future__ import annotations

import logging
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Any, get_args

from fastapi import APIRouter, Header, Query, Response
from pydantic import TypeAdapter
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from renderer.errors import SettingsError
from renderer.frames import frame_key, frame_number, frames_text
from service.clock import deadline_of
from service.errors import Conflict, FarmError, NotFound
from service.events import RowWritten
from service.farm import Farm, FarmDependency
from service.http.problems import Problem
from service.http.visit import Visit, VisitDependency
from service.intake.resolve import resolve
from service.jobs.change_many import ChangesIn, ChangesOut, change_many, may_begin_anew
from service.jobs.describe import job_out, jobs_out
from service.jobs.listing import MOST_JOBS, Choice, Order
from service.jobs.lookup import find_job, no_job
from service.jobs.repeats import Key, earlier, kept_key, repeat
from service.jobs.shot_change import ShotChange
from service.keeping.reuse import Begun
from service.models.jobs import JobIn, JobOut, JobPatch, JobState
from service.models.queue import needs_of, wait_for, wait_for_fewer
from service.scheduling.jobs.shot_wishes import ShotWish, samples_of
from service.scheduling.jobs.wishes import ask_for_samples, focus_on, set_state, wait_no_longer_in_vain
from service.shot import IN_TURN, Shot
from service.store.frame_changes import Step, apply_at_once, begin, is_short
from service.store.models import FINAL, Frame, Job, Scene
from service.store.room import need_room
from worker.telemetry import tracing

__all__ = ["router"]


router = APIRouter(prefix="/api/jobs", tags=["jobs"])
log = logging.getLogger(__name__)

TRIES = 20  # attempts to change a shot despite concurrent changes
_JOBS = TypeAdapter(list[JobOut])

Traced = Annotated[str | None, Header(include_in_schema=False)]  # W3C Trace Context of the client


@router.post("", status_code=201, response_model=JobOut)
def create_job(
    request: JobIn,
    farm: FarmDependency,
    response: Response,
    visit: VisitDependency,
    idempotency_key: Key = None,
    traceparent: Traced = None,
) -> JobOut:
    """Ask for a picture of a scene. A scene that is still being prepared is waited for; with a full disk none is taken."""
    keys = _keys(request)
    asked = request.model_dump(mode="json", exclude=_left_out(request))
    if (first := earlier(idempotency_key, visit.user, farm)) is not None:
        return repeat(first, asked, farm, response, visit.sight)
    if not visit.sight.sees(farm.access.projects.of("scene", request.scene)):
        raise _no_scene(request.scene)
    farm.access.projects.check(farm.access.projects.of("scene", request.scene) or "", visit.sight)
    need_room(farm.settings.data, farm.settings.min_free_bytes)
    rendered = _rendered(request, asked, farm)
    job = Job(
        id=uuid.uuid4().hex[:20],
        scene=request.scene,
        lit=None if rendered == request.scene else rendered,
        light=farm.lighting.name_of(asked["environment"]),
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
        shot=_shot(request, keys).to_json() if request.is_shot else None,
        idempotency_key=kept_key(idempotency_key, visit.user),
        user=visit.user,
        key=visit.token,
        max_slots=request.max_slots,
        needs=needs_of(request.needs),
        deadline=None if request.deadline is None else deadline_of(request.deadline),
    )
    try:
        with (
            farm.lighting.held(rendered),
            _begun(job, keys, request.fresh or bool(request.verify), farm) as begun,
            farm.sessions.begin() as session,
        ):
            scene = session.get(Scene, request.scene, with_for_update=True)
            _check(job, scene, farm)
            farm.quotas.check_job(visit.caller, session, samples_of(job) * len(keys))
            session.add(job)
            session.flush()
            wait_for(job, request.after, session)
            # Quotas count these frames from now on, even before they are rendered.
            frames = [Step.of("add", keys, target=samples_of(job))]
            if is_long := not is_short(frames):
                begin(job.id, frames, session)
            else:
                apply_at_once(job, frames, session, begun)
                answer = job_out(job, session, farm.engine)
        if is_long:
            answer = _laid_out(job.id, farm, begun)
    except IntegrityError:
        if (first := earlier(idempotency_key, visit.user, farm)) is None:
            raise
        return repeat(first, asked, farm, response, visit.sight)
    root, asked_in = tracing.root_of("job", job.id), tracing.where(traceparent)
    tracing.record("submit", job.created, time.time(), root, links=[asked_in], job=job.id, scene=job.scene)
    farm.events.publish(RowWritten("job", job.id))
    response.headers["Location"] = f"/api/jobs/{job.id}"
    return answer


@router.get("", response_model=list[JobOut])
def list_jobs(
    chosen: Choice,
    farm: FarmDependency,
    sort: Order = "newest",
    limit: int = Query(100, ge=1, le=MOST_JOBS),
    offset: int = Query(0, ge=0, le=1 << 31),
) -> Response:
    """The jobs, or those that are chosen, a page of them. The header X-Total-Count has their number."""
    view = farm.engine.snapshot
    with farm.sessions() as session:
        rows = chosen.rows(sort, session, limit, offset)
        total = chosen.count(session)
        body = _JOBS.dump_json(jobs_out(rows, session, farm.engine, view))
    return Response(body, media_type="application/json", headers={"X-Total-Count": str(total)})


@router.get("/ids")
def list_ids(
    chosen: Choice, farm: FarmDependency, sort: Order = "newest", limit: int = Query(50_000, ge=1, le=50_000)
) -> list[str]:
    """As the list of jobs, but nothing except their ids, and of all of them at once."""
    with farm.sessions() as session:
        return chosen.ids_in(sort, session, limit)


@router.get("/tallies")
def tally_jobs(chosen: Choice, farm: FarmDependency) -> dict[JobState, int]:
    """How many jobs are in each state; `state` itself makes no difference to it."""
    with farm.sessions() as session:
        found = chosen.tallies(session)
    return {state: found.get(state, 0) for state in get_args(JobState)}


@router.post("/changes", response_model=ChangesOut)
def change_jobs(changes: ChangesIn, farm: FarmDependency, visit: VisitDependency) -> ChangesOut:
    """Pause, go on, cancel, change the priority of many jobs, or delete them. What cannot be done to one is done to the others.

    The answer has how those that changed were before, so that it can be taken back.
    """
    return change_many(changes, farm, visit)


@router.get("/{id}", response_model=JobOut)
def get_job(id: str, farm: FarmDependency) -> JobOut:
    """One job: its state, progress, speed and errors."""
    view = farm.engine.snapshot
    with farm.sessions() as session:
        return job_out(find_job(id, farm), session, farm.engine, view)


@router.patch("/{id}", response_model=JobOut)
def change_job(id: str, change: JobPatch, farm: FarmDependency, visit: VisitDependency) -> JobOut:
    """Pause, go on, cancel, change the priority, or ask for more samples. Cancelling keeps the picture so far.

    A job that is over and set to running renders what its picture lacks, frames that failed among it; a film that is damaged is
    set aside first. Of a shot: more frames, some of them anew or with more samples, one before all others. focus: a rectangle is
    rendered first, which changes no bit of how the picture ends. pinned: what a farm lets go by its rules, it keeps of this job.
    name and note are for people: what it is called, and what there is to say about it.
    """
    is_anew = change.state == "running" and may_begin_anew(id, farm)
    farm.lighting.restore(id)
    wish = ShotWish(**change.model_dump(include=set(ShotWish.__dataclass_fields__)))
    for _ in range(TRIES):
        of_shot = ShotChange.of(id, wish, farm)
        with farm.sessions.begin() as session:
            job = session.get(Job, id, with_for_update=True)
            if job is None:
                raise no_job(id)
            if of_shot is not None and not of_shot.fits(job, session):
                continue  # it was changed concurrently
            is_long = _change(job, change, of_shot, is_anew, session, farm, visit)
            # Sums a shot's frames, which takes time if they are many.
            answer = None if job.shot is not None else job_out(job, session, farm.engine)
        break
    else:
        raise Conflict("The shot is being changed by others at the same time. Try again.")
    farm.events.publish(RowWritten("job", id))
    if answer is not None:
        return answer
    return _laid_out(id, farm) if is_long else get_job(id, farm)


@router.post("/{id}/anew", status_code=201, response_model=JobOut)
def begin_anew(id: str, farm: FarmDependency, response: Response, visit: VisitDependency) -> JobOut:
    """Ask for the same picture in a new job, from the first sample, and cancel this one, which keeps its picture so far.

    For a job that was begun by workers of a kind that is gone, after an upgrade: another kind may compute other bits, so it never
    continues a film. To take it back, set this job to running and cancel the new one.
    """
    with farm.sessions.begin() as session:
        job = find_job(id, farm)
        if job.state in FINAL:
            raise Conflict(f"The job is {job.state}; only one that is not over begins anew.")
        request = _as_it_is_now(job)
        set_state(session.get_one(Job, id, with_for_update=True), "cancelled", is_anew=False)  # cancelled jobs count in no quota
    try:
        made = create_job(request, farm, response, visit)
    except Exception:
        with farm.sessions.begin() as session:
            row = session.get_one(Job, id, with_for_update=True)
            row.state, row.finished = job.state, None
        raise
    finally:
        farm.events.publish(RowWritten("job", id))
    with farm.sessions.begin() as session:
        new = session.get_one(Job, made.id, with_for_update=True)
        new.max_slots, new.needs, new.deadline = job.max_slots, job.needs, job.deadline
        new.focus, new.pinned, new.note = job.focus, job.pinned, job.note
    farm.events.publish(RowWritten("job", made.id))
    return get_job(made.id, farm)


def _as_it_is_now(job: Job) -> JobIn:
    """A job's request with its later changes (goals, frames, name, priority), without dependencies and queue options."""
    now: dict[str, Any] = {"name": job.name, "priority": job.priority, "spp": job.spp, "noise": job.noise, "seconds": job.seconds}
    if job.shot is not None and (shot := Shot.of(job.shot)) is not None:
        now |= {"frames": shot.frames, "order": shot.order}
    given = {name: value for name, value in job.request.items() if name not in ("after", "deadline", "needs", "max_slots")}
    return JobIn.model_validate({**given, **now, "fresh": True})


def _change(
    job: Job, change: JobPatch, of_shot: ShotChange | None, is_anew: bool, session: Session, farm: Farm, visit: Visit
) -> bool:
    """Applies a change within a transaction; returns whether changes of frames remain to be carried out."""
    is_long = False
    state, samples = job.state, samples_of(job)
    if change.priority is not None:
        job.priority = change.priority
    if change.pinned is not None:
        job.pinned = change.pinned
    if change.name is not None:
        job.name = change.name or _name_of_scene(job, session)
    if change.note is not None:
        job.note = change.note or None
    is_more = change.spp is not None or change.more is not None or change.extend is not None or change.again is not None
    if of_shot is not None:
        if is_more or (state in FINAL and change.state == "running"):  # before the job itself counts
            farm.quotas.check_job(visit.caller, session, of_shot.samples, is_new=state in FINAL)
        is_long = of_shot.give(job, session)
    elif job.shot is None and change.is_of_frames:
        raise Conflict("The job is a still: it has no frames to choose from. Make a new job, with frames.")
    elif job.shot is None and (change.spp is not None or change.more is not None):
        frame = session.get(Frame, (job.id, 0))
        ask_for_samples(job, change.spp, change.more, frame.samples if frame else 0)
    if "focus" in change.model_fields_set:
        focus_on(job, change.focus)
    if "max_slots" in change.model_fields_set:
        job.max_slots = change.max_slots
    if "deadline" in change.model_fields_set:
        job.deadline, job.late = None if change.deadline is None else deadline_of(change.deadline), None
    if change.needs is not None:
        job.needs = needs_of(change.needs)
    if change.after is not None:
        wait_for_fewer(job.id, change.after, session)
    if change.state is not None:
        set_state(job, change.state, is_anew)
    if of_shot is None and (is_more or (state in FINAL and job.state not in FINAL)):
        more = max(0, samples_of(job) - samples)
        with session.no_autoflush:  # unflushed, so the job itself does not count
            farm.quotas.check_job(visit.caller, session, more, is_new=state in FINAL)
    if change.state == "running":
        wait_no_longer_in_vain([job.id], session)
    session.flush()
    return is_long


@router.delete("/{id}", status_code=204)
def delete_job(id: str, farm: FarmDependency) -> None:
    """Delete a job and its pictures; one that is being rendered is stopped."""
    if not farm.deleting.delete([id]):
        raise no_job(id)


def _laid_out(id: str, farm: Farm, begun: Begun | None = None) -> JobOut:
    """The job, after pending changes of its frames are carried out.

    Those that fail in the database or on disk are retried later.
    """
    try:
        farm.frame_changes.carry_out(id, begun)
    except FarmError as error:
        log.warning("job %s: its frames are written down later: %s", id, error)
    farm.events.publish(RowWritten("job", id))
    return get_job(id, farm)


def _left_out(request: JobIn) -> set[str]:
    """Names of fields with default values to omit from the stored request, so that requests of older releases compare equal."""
    return {name for name in ("fresh", "strict", "verify") if not getattr(request, name)} - (
        {"verify"} if request.verify == 0 else set()
    )


@contextmanager
def _begun(job: Job, keys: list[int], is_fresh: bool, farm: Farm) -> Iterator[Begun]:
    """Starts a new job with the films of earlier jobs of the same picture; yields the resulting numbers of its frames.

    Deletes the films again if the context raises.
    """
    begun: Begun = {}
    if not is_fresh and farm.settings.reuse_films:
        with farm.sessions() as session:
            _check(job, session.get(Scene, job.scene), farm)
        begun = farm.reuse.begin(job, keys)
    try:
        yield begun
    except BaseException:
        if begun:
            farm.films.delete(job.id)
        raise


def _keys(request: JobIn) -> list[int]:
    return sorted(map(frame_key, request.numbers()))


def _shot(request: JobIn, keys: list[int]) -> Shot:
    """The requested shot.

    If only a time limit ends it, frames are rendered breadth-first, so that all get a share of the time.
    """
    only_time = request.seconds is not None and request.spp is None and request.noise is None
    order = request.order or ("breadth-first" if only_time else IN_TURN)
    frames = frames_text(map(frame_number, keys))
    return Shot(request.fps, request.clip, request.turntable, order, request.every, frames=frames)


def _rendered(request: JobIn, asked: dict[str, Any], farm: Farm) -> str:
    """The id of the scene to render: for another environment or material variant, that of a derived scene, which may be new."""
    if asked["environment"] is None and request.variant is None:
        return request.scene
    return farm.lighting.row(request.scene, asked["environment"], request.variant).id


def _name_of_scene(job: Job, session: Session) -> str:
    scene = session.get(Scene, job.scene)
    return job.name if scene is None else scene.name


def _no_scene(id: str) -> NotFound:
    return NotFound(f"scene: there is no scene {id[:60]!r}. Upload it first, by POST /api/scenes.")


def _check(job: Job, scene: Scene | None, farm: Farm) -> None:
    """Fixes the job's settings if its scene is ready; raises an error for a request that can never be rendered."""
    if scene is None or scene.of is not None:
        raise _no_scene(job.scene)
    if scene.status == "failed":
        raise Conflict(f"The scene cannot be rendered: {scene.error}")
    job.name, job.project = job.name or scene.name, scene.project
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
