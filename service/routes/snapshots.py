"""/api/jobs/{id}/snapshots: intermediate pictures of a job, at 1, 2, 4, 8 ... samples per pixel."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from typing import Annotated, Literal

from fastapi import Path, Query, Request, Response
from fastapi.responses import StreamingResponse
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool

from renderer.image.tonemap import key_of
from renderer.sentences import Sentence
from service.errors import NotFound
from service.farm import Farm
from service.http.curve_name import CurveName
from service.http.farm import FarmDependency
from service.http.file_names import content_disposition, picture_name
from service.http.head_requests import headers_response, is_head
from service.http.routers import api_router
from service.http.visit import VisitDependency
from service.jobs.lookup import find_job
from service.store.film_snapshots import FilmSnapshot
from service.watching import film_picture
from service.watching.film_packet import decompressed
from service.watching.pictures import MEDIA

__all__ = ["router"]

router = api_router(prefix="/api/jobs/{id}/snapshots", tags=["snapshots"])

IMAGE = {"content": {media: {} for media in MEDIA.values()}, "description": "The picture."}
FILM = {"content": {"application/octet-stream": {}}, "description": "The film."}
Spp = Annotated[int, Path(ge=1, le=1 << 31, description="samples per pixel of a stored snapshot")]


class SnapshotOut(BaseModel):
    """An intermediate picture, stored when every tile had `spp` samples per pixel or was complete.

    It has only colour, as RGB9E5.
    """

    spp: int = Field(description="samples per pixel")
    least: int = Field(description="samples per pixel of the tile with the fewest")
    most: int = Field(description="samples per pixel of the tile with the most")
    samples: int = Field(description="samples over all pixels")
    seconds: float = Field(description="seconds of rendering until then, without pauses")
    noise: float | None = Field(description="relative noise of the job then; null: not known yet")
    created: float = Field(description="Unix time in seconds")


@router.get("", response_model=list[SnapshotOut])
def list_snapshots(id: str, farm: FarmDependency) -> list[SnapshotOut]:
    """Lists the stored snapshots of a still image by samples per pixel. Shots have none.

    A snapshot that is due soon after the previous one is skipped.
    """
    find_job(id, farm)
    return [SnapshotOut(**vars(found)) for found in farm.snapshots.all_metadata(id)]


@router.get("/{spp}/film", response_class=Response, responses={200: FILM, 304: {"description": "Not changed."}})
def snapshot_film(id: str, spp: Spp, request: Request, farm: FarmDependency) -> Response:
    """Returns a snapshot in the format of /api/jobs/{id}/frames/{n}/film."""
    found = _find_snapshot(id, spp, farm)
    gzip = "gzip" in request.headers.get("accept-encoding", "")
    headers = {"ETag": _etag(id, found, str(gzip)), "Cache-Control": "no-cache", "Vary": "Accept-Encoding"}
    if headers["ETag"] in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    size, pieces = _find_packet(id, spp, farm)
    if gzip:
        headers |= {"Content-Encoding": "gzip", "Content-Length": str(size)}
    return StreamingResponse(pieces if gzip else decompressed(pieces), media_type="application/octet-stream", headers=headers)


@router.get("/{spp}/image.{extension}", response_class=Response, responses={200: IMAGE, 304: {"description": "Not changed."}})
async def snapshot_image(
    id: str,
    spp: Spp,
    extension: Literal["png", "exr", "jpg", "hdr"],
    request: Request,
    farm: FarmDependency,
    visit: VisitDependency,
    exposure: Annotated[float, Query(ge=-32, le=32, allow_inf_nan=False, description="stops; for png and jpg")] = 0.0,
    tonemap_curve: CurveName = "neutral",
) -> Response:
    """Returns a snapshot as a picture file, with an error of at most 0.2 % of a pixel's brightest channel."""
    curve = await run_in_threadpool(farm.curves.find, tonemap_curve)
    job = await run_in_threadpool(find_job, id, farm)
    found = await run_in_threadpool(_find_snapshot, id, spp, farm)
    headers = {"ETag": _etag(id, found, f"{extension} {exposure} {key_of(curve)}"), "Cache-Control": "no-cache"}
    if headers["ETag"] in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    headers["Content-Disposition"] = content_disposition(picture_name(job, 0, found.samples, "", extension))
    if is_head(request):
        return headers_response(headers, MEDIA[extension])
    width, height = (int((job.settings or {}).get(name, 0)) for name in ("width", "height"))
    made = await farm.pictures.run(
        (id, "snapshot", headers["ETag"]),
        film_picture.film_picture_memory(width, height),
        lambda: film_picture.film_picture(_find_packet(id, spp, farm)[1], extension, exposure, curve, farm.settings.data / "tmp"),
        user=visit.queue,
    )
    headers["Content-Length"] = str(made.size)
    return StreamingResponse(made.pieces(), media_type=MEDIA[extension], headers=headers)


def _find_snapshot(id: str, spp: int, farm: Farm) -> FilmSnapshot:
    find_job(id, farm)
    found = farm.snapshots.find(id, spp)
    if found is None:
        raise _no_snapshot(spp)
    return found


def _find_packet(id: str, spp: int, farm: Farm) -> tuple[int, Iterator[bytes]]:
    try:
        return farm.snapshots.packed(id, spp)
    except FileNotFoundError:
        raise _no_snapshot(spp) from None


def _etag(id: str, found: FilmSnapshot, form: str) -> str:
    return f'"{hashlib.sha256(f"{id} {found} {form}".encode()).hexdigest()[:32]}"'


def _no_snapshot(spp: int) -> NotFound:
    return NotFound(
        Sentence(
            "snapshot-not-found",
            "This picture has no snapshot at {spp} samples. GET /api/jobs/{id}/snapshots lists them.",
            spp=spp,
        )
    )
