"""/api/environments: the environments to choose from: presets and uploaded images."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path
from typing import Annotated, Any, Literal

from fastapi import Path as PathParameter
from fastapi import Request, Response
from fastapi.responses import FileResponse, StreamingResponse
from pydantic import BaseModel, Field
from sqlalchemy import select
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session
from starlette.concurrency import run_in_threadpool

from protocol.contract import BlobRef, ShowEnvironment
from renderer.presets import PRESETS
from renderer.sentences import Sentence
from service.access.projects import lock_project
from service.errors import Conflict
from service.farm import Farm
from service.http.farm import FarmDependency
from service.http.pagination import PageDependency
from service.http.routers import api_router
from service.http.single_upload import UPLOAD_FORM, check_upload_quota, only_file, read_single_upload
from service.http.visit import InProject, IntoProject, VisitDependency
from service.intake.projects import id_in_project, usable_in
from service.jobs.lookup import environment_not_found
from service.store.disk_space import translated_disk_errors
from service.store.models import ACTIVE_STATES, Environment, Job

__all__ = ["router"]

router = api_router(prefix="/api/environments", tags=["environments"])

PICTURES = Path(__file__).parent.parent / "light_pictures"  # of the presets; made by scenes/light_pictures.py
WIDTH = 160  # pixels across a thumbnail, twice its height
SUFFIXES = (".exr", ".hdr", ".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp")
_Id = Annotated[str, PathParameter(max_length=100)]


class EnvironmentOut(BaseModel):
    """An environment for lighting. environment: the value of a job's field `environment` that selects it."""

    id: str = Field(description="id of the environment, or name of the preset")
    name: str = Field(description="name on the page")
    help: str = Field(description="description in one sentence")
    kind: Literal["preset", "image"] = Field(description="`preset`, or an uploaded `image`")
    environment: dict[str, Any] = Field(description="value for a job's field `environment`")
    created: float | None = Field(description="Unix time; null: a preset")
    bytes: int | None = Field(description="size of the file; null: a preset")
    thumbnail: str = Field(description="URL of a small picture")
    project: str = Field(default="", description="project of it; empty: visible to all users")


@router.get("", response_model=list[EnvironmentOut])
def list_environments(
    farm: FarmDependency, visit: VisitDependency, page: PageDependency, project: InProject = None
) -> list[EnvironmentOut]:
    """Lists the presets, then the uploaded environments, newest first. The header X-Total-Count contains their number.

    project: limits the list to environments of this project and of no project.
    """
    presets = [
        EnvironmentOut(
            id=name,
            name=preset.label,
            help=preset.help,
            kind="preset",
            environment={"preset": name}
            if preset.sky is None
            else {"sky": dict(zip(("elevation", "azimuth"), preset.sky, strict=True))},
            created=None,
            bytes=None,
            thumbnail=_thumbnail_of(name),
        )
        for name, preset in PRESETS.items()
    ]
    with farm.sessions() as session:
        seen = select(Environment).where(visit.sight.clause(Environment.project))
        seen = seen if project is None else seen.where(usable_in(Environment.project, project))
        here, rows = page.rows(seen.order_by(Environment.created.desc(), Environment.id), session, presets)
        return [*here, *map(_environment_out, rows)]


@router.post("", status_code=201, response_model=EnvironmentOut, openapi_extra=UPLOAD_FORM)
async def add_environment(
    request: Request, farm: FarmDependency, response: Response, visit: VisitDependency, project: IntoProject = ""
) -> EnvironmentOut:
    """Uploads an equirectangular image, preferably .exr or .hdr, which a worker validates.

    Uploading the same image again returns the same environment.
    """
    await run_in_threadpool(farm.access.projects.check, project, visit.sight)
    await check_upload_quota(request, farm, visit)
    form = await read_single_upload(request, farm, Sentence("kind-image", "image"))
    try:
        name, file = only_file(
            form, SUFFIXES, "/api/environments", Sentence("environment-image-invalid", "not an image that can light a scene")
        )
        await run_in_threadpool(farm.access.projects.recheck, project, visit.caller, visit.sight)
        sha256, size = file.sha256, file.size
        id = id_in_project(project, sha256[:20])
        if (known := await run_in_threadpool(_existing_environment, id, farm)) is None:
            with farm.garbage.pinned([sha256]):
                with translated_disk_errors():
                    await run_in_threadpool(file.commit)
                owner = {"project": project, "user": visit.user, "key": visit.token}
                known = await _store_environment(id, name, BlobRef(name, sha256, size), owner, farm)
    finally:
        form.discard()
    response.headers["Location"] = f"/api/environments/{id}"
    return known


@router.get("/{id}/thumbnail.jpg", response_class=StreamingResponse)
def environment_thumbnail(id: _Id, farm: FarmDependency) -> Response:
    """Returns a tone-mapped thumbnail of the environment, twice as wide as high."""
    headers = {"Cache-Control": "max-age=86400"}
    if id in PRESETS:
        return FileResponse(PICTURES / f"{id}.jpg", media_type="image/jpeg", headers=headers)
    with farm.sessions() as session:
        found = session.get(Environment, id)
    if found is None:
        raise environment_not_found(id)
    blob = farm.blobs.serve(found.thumbnail)
    return StreamingResponse(blob.chunks, media_type="image/jpeg", headers={**headers, "Content-Length": str(blob.size)})


@router.delete("/{id}", status_code=204)
def delete_environment(id: _Id, farm: FarmDependency) -> None:
    """Deletes an uploaded environment. Finished pictures stay; 409 if unfinished jobs need it."""
    if id in PRESETS:
        raise Conflict(Sentence("environment-not-deletable", "This environment is built in and cannot be deleted."))

    def delete_row(session: Session) -> set[str]:
        found = session.get(Environment, id, with_for_update=True)
        if found is None:
            raise environment_not_found(id)
        active = session.scalars(select(Job).where(Job.state.in_(ACTIVE_STATES), Job.light.is_not(None)))
        needed = sum((job.request.get("environment") or {}).get("image") == id for job in active)
        if needed:
            raise Conflict(
                Sentence(
                    "environment-in-use", "{count} unfinished job(s) need this environment. Cancel them first.", count=needed
                )
            )
        session.delete(found)
        return found.blobs

    farm.reserve.run_deletion(lambda: farm.garbage.collect(delete_row))


async def _store_environment(id: str, name: str, file: BlobRef, owner: dict[str, Any], farm: Farm) -> EnvironmentOut:
    """Requests the thumbnail of an uploaded image from a worker, then stores the image's row and returns it.

    owner: values of the row's columns about its owner.
    """
    work = ShowEnvironment("", id, name, file.sha256, file.size, WIDTH)
    asked = await run_in_threadpool(farm.engine.show_environment, work)
    made = await asyncio.shield(asyncio.wrap_future(asked))
    row = {"id": id, "name": name, "created": time.time(), "thumbnail": made.sha256, **owner}
    row["file"] = {"path": file.path, "sha256": file.sha256, "size": file.size, "parts": []}

    def write() -> EnvironmentOut:
        with farm.garbage.pinned([made.sha256]):
            try:
                with farm.sessions.begin() as session:
                    found = session.get(Environment, id)
                    if found is None:
                        lock_project(owner["project"], session)
                        found = Environment(**row)
                        session.add(found)
                        session.flush()
                    return _environment_out(found)
            except IntegrityError:  # concurrent upload of the same image
                found_now = _existing_environment(id, farm)
                if found_now is None:
                    raise
                return found_now

    return await run_in_threadpool(write)


def _existing_environment(id: str, farm: Farm) -> EnvironmentOut | None:
    with farm.sessions() as session:
        found = session.get(Environment, id)
        return None if found is None else _environment_out(found)


def _environment_out(row: Environment) -> EnvironmentOut:
    return EnvironmentOut(
        id=row.id,
        name=row.name,
        help="",
        kind="image",
        environment={"image": row.id},
        created=row.created,
        bytes=row.file.get("size"),
        thumbnail=_thumbnail_of(row.id),
        project=row.project,
    )


def _thumbnail_of(id: str) -> str:
    return f"/api/environments/{id}/thumbnail.jpg"
