"""/api/jobs: creates, lists, changes and deletes jobs."""

from __future__ import annotations

from typing import Annotated, get_args

from fastapi import Depends, Header, Query, Response
from fastapi.exceptions import RequestValidationError
from pydantic import TypeAdapter, ValidationError

from service.http.farm import FarmDependency
from service.http.pagination import Offset
from service.http.routers import api_router
from service.http.visit import InProject, VisitDependency
from service.jobs.change import change
from service.jobs.change_many import change_many
from service.jobs.create import begin_anew, create
from service.jobs.describe import describe, jobs_out
from service.jobs.from_template import request_of
from service.jobs.listing import JobFilter, Order, search_words
from service.jobs.lookup import job_not_found
from service.models.changes import MAX_JOBS, ChangesIn, ChangesOut
from service.models.jobs import JobIn, JobOut, JobPatch, JobState
from service.models.templates import TemplateIn

__all__ = ["router"]


router = api_router(prefix="/api/jobs", tags=["jobs"])

_JOBS = TypeAdapter(list[JobOut])

TraceParent = Annotated[str | None, Header(include_in_schema=False)]  # W3C Trace Context of the client
Key = Annotated[
    str | None,
    Header(max_length=255, pattern="^[ -~]*$", description="repeated requests of a user with the same key create one job"),
]


def _filter_from_query(
    visit: VisitDependency,
    project: InProject = None,
    state: Annotated[list[JobState] | None, Query(description="only jobs in one of these states")] = None,
    scene: Annotated[str | None, Query(max_length=100, description="only jobs of the scene with this id")] = None,
    search: Annotated[
        str,
        Query(
            max_length=200, description="words in the job's name, its note or its scene's name, or the first characters of its id"
        ),
    ] = "",
    shot: Annotated[bool | None, Query(description="true: only shots; false: only stills")] = None,
    ids: Annotated[str, Query(max_length=4000, description="only jobs with these ids, separated by commas")] = "",
) -> JobFilter:
    return JobFilter(
        tuple(state or ()), scene, search_words(search), shot, tuple(id for id in ids.split(",") if id), visit.sight, project
    )


Sort = Annotated[Order, Query(description="order of the jobs")]
Choice = Annotated[JobFilter, Depends(_filter_from_query)]


@router.post("", status_code=201, response_model=JobOut)
def create_job(
    request: JobIn,
    farm: FarmDependency,
    response: Response,
    visit: VisitDependency,
    idempotency_key: Key = None,
    traceparent: TraceParent = None,
) -> JobOut:
    """Creates a job that renders a scene. If the scene is still being prepared, the job waits for it. 507 if the disk is full."""
    farm.curves.find(request.tonemap)
    created = create(request, visit, farm, idempotency_key, traceparent)
    response.headers["Location"] = f"/api/jobs/{created.job.id}"
    if created.is_repeat:
        response.headers["Idempotent-Replayed"] = "true"
    return created.job


@router.get("", response_model=list[JobOut])
def list_jobs(
    chosen: Choice,
    farm: FarmDependency,
    sort: Sort = "newest",
    limit: Annotated[int, Query(ge=1, le=MAX_JOBS, description="maximum number of jobs")] = 100,
    offset: Offset = 0,
) -> Response:
    """Lists the jobs that match the filter, one page. The header X-Total-Count contains the number of all matching jobs."""
    view = farm.engine.snapshot
    with farm.sessions() as session:
        rows = chosen.rows(sort, session, limit, offset)
        total = chosen.count(session)
        body = _JOBS.dump_json(jobs_out(rows, session, farm.engine, view))
    return Response(body, media_type="application/json", headers={"X-Total-Count": str(total)})


@router.get("/ids")
def list_ids(
    chosen: Choice,
    farm: FarmDependency,
    sort: Sort = "newest",
    limit: Annotated[int, Query(ge=1, le=50_000, description="maximum number of ids")] = 50_000,
) -> list[str]:
    """Lists only the ids of all jobs that match the filter, without pages."""
    with farm.sessions() as session:
        return chosen.ids_in(sort, session, limit)


@router.get("/tallies")
def tally_jobs(chosen: Choice, farm: FarmDependency) -> dict[JobState, int]:
    """Returns the number of matching jobs in each state. The filter `state` is ignored."""
    with farm.sessions() as session:
        found = chosen.tallies(session)
    return {state: found.get(state, 0) for state in get_args(JobState)}


@router.post("/changes", response_model=ChangesOut)
def change_jobs(changes: ChangesIn, farm: FarmDependency, visit: VisitDependency) -> ChangesOut:
    """Pauses, resumes, cancels or deletes many jobs, or changes their priority. Jobs that do not allow the change are skipped.

    The response contains the previous values of the changed jobs, so that the change can be undone.
    """
    return change_many(changes, farm, visit)


@router.get("/{id}", response_model=JobOut)
def get_job(id: str, farm: FarmDependency) -> JobOut:
    """Returns a job: its state, progress, speed and errors."""
    return describe(id, farm)


@router.patch("/{id}", response_model=JobOut)
def change_job(id: str, change_: JobPatch, farm: FarmDependency, visit: VisitDependency) -> JobOut:
    """Pauses, resumes or cancels a job, or changes its goal or priority. A cancelled job keeps its picture.

    Setting an ended job to running renders what its picture lacks, including failed frames; a damaged film is moved aside first.
    For a shot: adds frames, renders some again or with more samples, or one before all others. focus: rectangle to render first,
    which does not change the final picture. pinned: exempts the job's film from the farm's retention rules. name, note: texts for
    users.
    """
    return change(id, change_, visit, farm)


@router.post("/openjd", status_code=201, response_model=JobOut)
def create_job_from_template(
    request: TemplateIn,
    farm: FarmDependency,
    response: Response,
    visit: VisitDependency,
    idempotency_key: Key = None,
    traceparent: TraceParent = None,
) -> JobOut:
    """Creates a job from a job template of Open Job Description whose tasks call `rayfarm render`.

    The frames of its tasks become a shot. Its other parts are refused by a sentence that names them. 503 if the service lacks the
    package openjd-model.
    """
    try:
        asked = request_of(request, visit, farm)
    except ValidationError as error:
        raise RequestValidationError(error.errors()) from None
    return create_job(asked, farm, response, visit, idempotency_key, traceparent)


@router.post("/{id}/anew", status_code=201, response_model=JobOut, name="begin_anew")
def begin_job_anew(id: str, farm: FarmDependency, response: Response, visit: VisitDependency) -> JobOut:
    """Cancels a job, which keeps its picture, and creates a new one that renders the same picture from the first sample.

    It is for a job whose kind of worker is gone, for instance after an upgrade: another kind may compute different bits, so it
    never continues the film. To undo this, set the old job to running and cancel the new one.
    """
    made = begin_anew(id, visit, farm)
    response.headers["Location"] = f"/api/jobs/{made.id}"
    return made


@router.delete("/{id}", status_code=204)
def delete_job(id: str, farm: FarmDependency) -> None:
    """Deletes a job and its pictures. Stops it if it is being rendered."""
    if not farm.deleting.delete([id]):
        raise job_not_found(id)
