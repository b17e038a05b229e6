"""/api/references: uploaded pictures for comparison, for instance from another renderer."""

from __future__ import annotations

from functools import partial
from typing import Annotated, Literal

import anyio
from fastapi import Path as PathParameter
from fastapi import Query, Request, Response
from fastapi.responses import StreamingResponse
from pydantic import BaseModel, Field
from sqlalchemy import select
from sqlalchemy.orm import Session
from starlette.concurrency import run_in_threadpool

from renderer.sentences import Sentence
from service.farm import Farm
from service.http.curve_name import CurveName
from service.http.farm import FarmDependency
from service.http.file_names import content_disposition
from service.http.head_requests import headers_response, is_head
from service.http.pagination import PageDependency
from service.http.routers import api_router
from service.http.single_upload import UPLOAD_FORM, check_upload_quota, only_file, read_single_upload
from service.http.visit import InProject, IntoProject, VisitDependency
from service.intake.projects import UploadOwner, usable_in
from service.intake.references import SUFFIXES, keep_reference
from service.jobs.lookup import reference_not_found
from service.store.models import Reference
from service.watching import film_picture
from service.watching.film_packet import decompressed
from service.watching.pictures import MEDIA

__all__ = ["router"]

router = api_router(prefix="/api/references", tags=["references"])

CACHE_HEADERS = {"Cache-Control": "max-age=86400, immutable"}  # the id is a hash of the content
IMAGE = {"content": {media: {} for media in MEDIA.values()}, "description": "The picture."}
FILM = {"content": {"application/octet-stream": {}}, "description": "The picture."}
Id = Annotated[str, PathParameter(max_length=100)]


class ReferenceOut(BaseModel):
    """A reference picture, in linear Rec.709. It is stored with an error of at most 0.2 % of a pixel's brightest channel."""

    id: str = Field(description="id of the reference")
    name: str = Field(description="name of the file")
    created: float = Field(description="Unix time in seconds")
    bytes: int = Field(description="size of the uploaded file")
    width: int = Field(description="width in pixels")
    height: int = Field(description="height in pixels")
    display_referred: bool = Field(description="true: 8 bits per channel, decoded by sRGB; a tone curve in the file remains")
    clipped: int = Field(description="pixels with values outside 0 to 65408, which were clipped to that range")
    project: str = Field(default="", description="project whose members can see it; empty: visible to all users")


@router.get("", response_model=list[ReferenceOut])
def list_references(
    farm: FarmDependency, visit: VisitDependency, page: PageDependency, project: InProject = None
) -> list[ReferenceOut]:
    """Lists the reference pictures, newest first. The header X-Total-Count contains their number.

    project: limits the list to pictures of this project and of no project.
    """
    seen = select(Reference).where(visit.sight.clause(Reference.project))
    seen = seen if project is None else seen.where(usable_in(Reference.project, project))
    with farm.sessions() as session:
        _, rows = page.rows(seen.order_by(Reference.created.desc(), Reference.id), session)
        return [_reference_out(row) for row in rows]


@router.post("", status_code=201, response_model=ReferenceOut, openapi_extra=UPLOAD_FORM)
async def add_reference(
    request: Request, farm: FarmDependency, response: Response, visit: VisitDependency, project: IntoProject = ""
) -> ReferenceOut:
    """Uploads an image, preferably .exr or .hdr. Uploading the same image again returns the same picture.

    The picture then keeps its first name.
    """
    await run_in_threadpool(farm.access.projects.check, project, visit.sight)
    await check_upload_quota(request, farm, visit)
    form = await read_single_upload(request, farm, Sentence("kind-picture", "picture"))
    try:
        name, file = only_file(
            form, SUFFIXES, "/api/references", Sentence("reference-image-invalid", "not an image that can be used as a reference")
        )
        temporary = farm.settings.data / "tmp"
        await run_in_threadpool(farm.access.projects.recheck, project, visit.caller, visit.sight)
        owner = UploadOwner(project, visit.user, visit.token)
        kept = partial(keep_reference, name, file, farm.sessions, farm.blobs, farm.garbage, temporary, owner)
        row = await anyio.to_thread.run_sync(kept, limiter=farm.reading)
    finally:
        form.discard()
    response.headers["Location"] = f"/api/references/{row.id}"
    return _reference_out(row)


@router.get("/{id}", response_model=ReferenceOut)
def get_reference(id: Id, farm: FarmDependency) -> ReferenceOut:
    """Returns one reference picture."""
    return _reference_out(_find_reference(id, farm))


@router.get("/{id}/film", response_class=Response, responses={200: FILM})
def reference_film(id: Id, request: Request, farm: FarmDependency) -> Response:
    """Returns a reference picture's colour in the format of /api/jobs/{id}/frames/{n}/film, as one tile with one sample."""
    blob = farm.blobs.serve(_find_reference(id, farm).film["sha256"])
    if "gzip" in request.headers.get("accept-encoding", ""):
        headers = {**CACHE_HEADERS, "Vary": "Accept-Encoding", "Content-Encoding": "gzip", "Content-Length": str(blob.size)}
        return StreamingResponse(blob.chunks, media_type="application/octet-stream", headers=headers)
    headers = {**CACHE_HEADERS, "Vary": "Accept-Encoding"}
    return StreamingResponse(decompressed(blob.chunks), media_type="application/octet-stream", headers=headers)


@router.get("/{id}/image.{extension}", response_class=Response, responses={200: IMAGE})
async def reference_image(
    id: Id,
    extension: Literal["png", "exr", "jpg", "hdr"],
    request: Request,
    farm: FarmDependency,
    visit: VisitDependency,
    exposure: Annotated[float, Query(ge=-32, le=32, allow_inf_nan=False, description="stops; for png and jpg")] = 0.0,
    tonemap_curve: CurveName = "neutral",
) -> Response:
    """Returns a reference picture, as it is compared with renderings, as a picture file. /file returns the uploaded file."""
    curve = await run_in_threadpool(farm.curves.find, tonemap_curve)
    row = await run_in_threadpool(_find_reference, id, farm)
    caching = CACHE_HEADERS if isinstance(curve, str) else {"Cache-Control": "no-cache"}  # the config of views may change
    headers = {**caching, "Content-Disposition": content_disposition(f"{row.name.rpartition('.')[0]}.{extension}")}
    if is_head(request):
        return headers_response(headers, MEDIA[extension])
    made = await farm.pictures.run(
        ("reference", id, extension, exposure, curve),
        film_picture.film_picture_memory(row.width, row.height),
        lambda: film_picture.film_picture(
            farm.blobs.serve(row.film["sha256"]).chunks, extension, exposure, curve, farm.settings.data / "tmp"
        ),
        user=visit.queue,
    )
    headers["Content-Length"] = str(made.size)
    return StreamingResponse(made.pieces(), media_type=MEDIA[extension], headers=headers)


@router.get("/{id}/file", response_class=Response, responses={200: FILM})
def reference_file(id: Id, farm: FarmDependency) -> Response:
    """Returns the uploaded file unchanged."""
    row = _find_reference(id, farm)
    blob = farm.blobs.serve(row.file["sha256"])
    headers = {
        **CACHE_HEADERS,
        "Content-Length": str(blob.size),
        "Content-Disposition": content_disposition(row.name, "attachment"),
    }
    return StreamingResponse(blob.chunks, media_type="application/octet-stream", headers=headers)


@router.delete("/{id}", status_code=204)
def delete_reference(id: Id, farm: FarmDependency) -> None:
    """Deletes a reference picture and its file."""

    def delete_row(session: Session) -> set[str]:
        found = session.get(Reference, id, with_for_update=True)
        if found is None:
            raise reference_not_found(id)
        session.delete(found)
        return found.blobs

    farm.reserve.run_deletion(lambda: farm.garbage.collect(delete_row))


def _find_reference(id: str, farm: Farm) -> Reference:
    with farm.sessions() as session:
        found = session.get(Reference, id)
    if found is None:
        raise reference_not_found(id)
    return found


def _reference_out(row: Reference) -> ReferenceOut:
    facts = {name: getattr(row, name) for name in ("id", "name", "created", "width", "height", "clipped", "project")}
    return ReferenceOut(**facts, bytes=row.file["size"], display_referred=row.is_display)
