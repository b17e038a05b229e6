"""Creation of jobs: new jobs, repeated requests, and jobs started again from the first sample."""

from __future__ import annotations

import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from sqlalchemy.exc import IntegrityError

from renderer.errors import SettingsError
from renderer.frames import frame_key, frame_number, frames_text
from renderer.sentences import Sentence, with_full_stop
from renderer.variation import Variation
from service.access.visit import Visit
from service.clock import deadline_of
from service.errors import Conflict, Invalid
from service.events import RowWritten
from service.farm import Farm
from service.intake.lighting import scene_id_unknown
from service.intake.resolve import check_pixel_count, resolve
from service.jobs.default_name import default_name
from service.jobs.describe import describe, job_out
from service.jobs.frame_changes import carry_out_and_describe
from service.jobs.idempotency import job_with_key, repeated_answer, stored_key
from service.jobs.lookup import find_job
from service.jobs.queue import add_dependencies, needs_of
from service.maintenance.reuse import InitialValues
from service.models.jobs import JobIn, JobOut
from service.scheduling.jobs.job_changes import set_state
from service.scheduling.jobs.shot_changes import samples_of
from service.shot import IN_TURN_ORDER, Shot, variation_of
from service.store.disk_space import check_free_space
from service.store.frame_changes import Step, apply_short_steps, fits_one_transaction, record_steps
from service.store.models import FINAL_STATES, STATE_LABELS, Job, Scene
from telemetry import tracing

__all__ = ["Created", "begin_anew", "check_scene", "create"]


@dataclass(frozen=True)
class Created:
    """Result of a request to create a job. is_repeat: the job was created by an earlier request with the same idempotency key."""

    job: JobOut
    is_repeat: bool = False


def create(
    request: JobIn, visit: Visit, farm: Farm, idempotency_key: str | None = None, traceparent: str | None = None
) -> Created:
    """Creates a job with its frames. For a repeated idempotency key, returns the job of the earlier request.

    Raises NotFound, Conflict, Invalid, OverQuota, OutOfSpace and NotAllowed.
    """
    asked = request.model_dump(mode="json", exclude=_fields_not_stored(request))
    if (first := job_with_key(idempotency_key, visit.user, farm)) is not None:
        return Created(repeated_answer(first, asked, farm, visit.sight), is_repeat=True)
    check_scene(request.scene, visit, farm)
    check_free_space(farm.settings.data, farm.settings.min_free_bytes)
    keys = sorted(map(frame_key, request.numbers()))
    job = _new_job_row(request, keys, asked, idempotency_key, visit, farm)
    try:
        answer = _store_job(job, request, keys, visit, farm)
    except IntegrityError:  # a request with the same key was faster
        if (first := job_with_key(idempotency_key, visit.user, farm)) is None:
            raise
        return Created(repeated_answer(first, asked, farm, visit.sight), is_repeat=True)
    root, asked_in = tracing.root_span("job", job.id), tracing.parse_traceparent(traceparent)
    tracing.record_span("submit", job.created, time.time(), root, links=[asked_in], job=job.id, scene=job.scene)
    farm.events.publish(RowWritten("job", job.id))
    return Created(answer)


def check_scene(id: str, visit: Visit, farm: Farm) -> None:
    """Raises NotFound for a scene that the caller does not see, and NotAllowed for one that it may not use."""
    project = farm.access.projects.project_of("scene", id)
    if not visit.sight.is_visible(project):
        raise scene_id_unknown(id)
    farm.access.projects.check(project or "", visit.sight)


def begin_anew(id: str, visit: Visit, farm: Farm) -> JobOut:
    """Cancels a job and creates one that renders the same picture from the first sample.

    Raises Conflict, and as `create` does.
    """
    with farm.sessions.begin() as session:
        job = find_job(id, farm)
        if job.state in FINAL_STATES:
            raise Conflict(
                Sentence(
                    "job-not-finished",
                    "The job is {state}; only an unfinished job can be restarted.",
                    state=STATE_LABELS[job.state],
                )
            )
        request = _current_request(job)
        set_state(session.get_one(Job, id, with_for_update=True), "cancelled", is_anew=False)  # cancelled jobs count in no quota
    try:
        made = create(request, visit, farm).job
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
    return describe(made.id, farm)


def _new_job_row(
    request: JobIn, keys: list[int], stored_request: dict[str, Any], idempotency_key: str | None, visit: Visit, farm: Farm
) -> Job:
    """Returns the database row of a new job, not yet stored. keys: sorted frame keys. stored_request: the request as stored."""
    rendered = _scene_to_render(request, stored_request, farm)
    return Job(
        id=uuid.uuid4().hex[:20],
        scene=request.scene,
        lit=None if rendered == request.scene else rendered,
        light=farm.lighting.name_of(stored_request["environment"]),
        name="",  # until its scene is read
        state="queued",
        priority=request.priority,
        created=time.time(),
        request=stored_request,
        active_s=0.0,
        tile_size=request.tile_size,
        spp=request.spp,
        noise=request.noise,
        seconds=request.seconds,
        shot=_requested_shot(request, keys).to_json() if request.is_shot else None,
        idempotency_key=stored_key(idempotency_key, visit.user),
        user=visit.user,
        key=visit.token,
        max_slots=request.max_slots,
        needs=needs_of(request.needs),
        deadline=None if request.deadline is None else deadline_of(request.deadline),
    )


def _store_job(job: Job, request: JobIn, keys: list[int], visit: Visit, farm: Farm) -> JobOut:
    """Stores a job with its frames and dependencies; returns its description for the API."""
    with (
        farm.lighting.holding(job.lit or job.scene),
        _with_reused_samples(job, keys, request.fresh or bool(request.verify), farm) as begun,
        farm.sessions.begin() as session,
    ):
        scene = _check_request(job, session.get(Scene, request.scene, with_for_update=True), farm)
        job.name = request.name or default_name(scene, session)
        farm.quotas.check_job(visit.caller, session, samples_of(job) * len(keys))
        session.add(job)
        session.flush()
        add_dependencies(job, request.after, session)
        # Quotas count these frames from now on, even before they are rendered.
        frames = [Step.for_keys("add", keys, target=samples_of(job))]
        if fits_one_transaction(frames):
            apply_short_steps(job, frames, session, begun)
            return job_out(job, session, farm.engine)
        record_steps(job.id, frames, session)
    return carry_out_and_describe(job.id, farm, begun)


def _current_request(job: Job) -> JobIn:
    """Returns the request that would create a job in its present form.

    It includes later changes of goals (samples, noise or time), frames, name and priority, but no dependencies and queue options.
    """
    now: dict[str, Any] = {"name": job.name, "priority": job.priority, "spp": job.spp, "noise": job.noise, "seconds": job.seconds}
    if job.shot is not None and (shot := Shot.parse(job.shot)) is not None:
        now["order"] = shot.order
        if not job.request.get("views"):
            now["frames"] = shot.frames
    given = {name: value for name, value in job.request.items() if name not in ("after", "deadline", "needs", "max_slots")}
    return JobIn.model_validate({**given, **now, "fresh": True})


def _fields_not_stored(request: JobIn) -> set[str]:
    """Returns the names of the request's fields that are not stored while they have their default values.

    Requests stored by older releases lack these fields, and compare equal to a request in which they have the defaults.
    """
    names = ("denoise", "exposure", "fresh", "strict", "vary", "verify", "views")
    said = {name for name, value in (("verify", request.verify == 0), ("vary", request.vary is False)) if value}
    usual = {"tonemap"} if request.tonemap == JobIn.model_fields["tonemap"].default else set()
    return {name for name in names if not getattr(request, name)} - said | usual


@contextmanager
def _with_reused_samples(job: Job, keys: list[int], is_fresh: bool, farm: Farm) -> Iterator[InitialValues]:
    """Copies samples that earlier jobs rendered of the same picture into a new job's film.

    Yields the initial column values of the frames with reused samples, by frame key; an empty dict if there is nothing to reuse.
    If the `with` block raises, deletes the film again.
    """
    begun: InitialValues = {}
    if not is_fresh and farm.settings.reuse_films:
        with farm.sessions() as session:
            _check_request(job, session.get(Scene, job.scene), farm)
        begun = farm.reuse.begin(job, keys)
    try:
        yield begun
    except BaseException:
        if begun:
            farm.films.delete(job.id)
        raise


def _requested_shot(request: JobIn, keys: list[int]) -> Shot:
    """Returns the shot to render, with the frames in rendering order.

    If a time limit is the only goal, frames are rendered breadth-first, so that all frames get a share of the time.
    """
    only_time = request.seconds is not None and request.spp is None and request.noise is None
    order = request.order or ("breadth-first" if only_time else IN_TURN_ORDER)
    frames = frames_text(map(frame_number, keys))
    return Shot(request.fps, request.clip, request.turntable, order, request.every, frames=frames)


def _scene_to_render(request: JobIn, stored_request: dict[str, Any], farm: Farm) -> str:
    """Returns the id of the scene to render.

    If the request changes environment, material variant, up axis or floor, this is a derived scene, which is created if needed.
    """
    if all(stored_request[name] is None for name in ("environment", "variant", "up", "floor")):
        return request.scene
    return farm.lighting.row(request.scene, stored_request).id


def _check_request(job: Job, scene: Scene | None, farm: Farm) -> Scene:
    """Resolves the job's settings if its scene is ready. Returns the scene.

    Raises an error if the request can never be rendered.
    """
    if scene is None or scene.of is not None:
        raise scene_id_unknown(job.scene)
    if scene.status == "failed":
        raise Conflict(Sentence("scene-not-renderable", "The scene cannot be rendered: {error}", error=scene.error))
    job.project = scene.project
    try:
        check_pixel_count(job.request["width"] or 0, job.request["height"] or 0, farm.settings.max_pixels)
        if scene.status == "ready":
            resolve(job, scene, farm.settings.max_pixels)
            _check_variation(job, scene)
    except SettingsError as error:
        raise Invalid(with_full_stop(error), field=error.field) from None
    return scene


def _check_variation(job: Job, scene: Scene) -> None:
    """Raises SettingsError if the job varies objects or materials that the scene does not have."""
    if (given := variation_of(job.request, Shot.parse(job.shot))) is None:
        return
    variation = Variation.parse(given)
    names: dict[str, Any] = (scene.info or {}).get("names") or {}
    for section in ("objects", "materials"):
        if section in names:
            variation.check_names(section, names[section])
