"""/api/farm: routes for workers, which authenticate with the farm's token or with a worker token."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Annotated, Any, Literal

import anyio
from fastapi import Path as PathParameter
from fastapi import Query, Request, Response
from fastapi.responses import FileResponse, StreamingResponse
from starlette.background import BackgroundTask
from starlette.concurrency import run_in_threadpool

from protocol.blends import converted_files
from protocol.channel import CHANNEL_PATH, HTTPS, name_suffix
from protocol.contract import SAMPLES_HEADER, VERSION_HEADER, BlobRef, Manifest
from renderer import aovs
from renderer.sentences import Sentence
from service.errors import Conflict, Invalid, NotFound, TooLarge
from service.http.farm import FarmDependency
from service.http.routers import api_router
from service.http.visit import VisitDependency
from service.intake.uploads import joined_chunks
from service.jobs.describe import UNREADABLE_SCENE
from service.jobs.lookup import find_job
from service.store.bands import bands
from service.store.blends import blender_export_of
from service.store.blobs import blob_not_found, is_sha256
from service.store.disk_space import disk_checker, translated_disk_errors
from service.store.models import Scene

__all__ = ["router"]


router = api_router(prefix="/api/farm", tags=["farm"])


@router.get("/join")
def join(
    farm: FarmDependency,
    visit: VisitDependency,
    transport: Annotated[Literal["redis", "https"], Query(description="`https` for a worker without access to Redis")] = "redis",
) -> dict[str, str]:
    """Returns the address of Redis, and data by which a worker on the same machine recognises the service's files.

    A worker that authenticates with a worker token also gets a Redis password of its own. A worker that joins over HTTPS gets
    neither of these, but what its name must end with. `channel` is the WebSocket that replaces Redis, if the farm allows it.
    """
    key = visit.caller.key if visit.caller is not None else None
    answer = {"instance": farm.instance, "reduces": "yes", "name_suffix": name_suffix(key)}
    if farm.settings.https_workers:
        answer["channel"] = CHANNEL_PATH
    if transport == HTTPS:
        return answer | {"redis_url": "", "data_dir": ""}
    redis_url = farm.settings.worker_redis_url
    if key is not None:
        redis_url = farm.redis_users.address_for(key, redis_url)
    return answer | {"redis_url": redis_url, "data_dir": str(farm.settings.data) if farm.blobs.is_local else ""}


@router.get("/scenes/{id}/manifest")
def manifest(id: str, farm: FarmDependency) -> dict[str, Any]:
    """Returns the names and hashes of a scene's files; for a .blend file also of Blender's export, once it exists."""
    with farm.sessions() as session:
        scene = session.get(Scene, id)
        base = session.get(Scene, scene.of) if scene is not None and scene.of else None
        blend = blender_export_of(session, scene) if scene is not None else None
    if scene is None:
        raise NotFound(Sentence("scene-deleted", "There is no such scene; it may have been deleted."))
    if not scene.files:
        raise Conflict(UNREADABLE_SCENE)
    main, files = scene.main, [BlobRef(**ref) for ref in scene.files]
    if (written := converted_files({"blend": blend})) is not None:
        main, files = written[0], [*written[1], *(file for file in files if file.path == scene.environment)]
    read_alike = ("main", "variant", "up", "floor")
    is_alike = base is not None and all(getattr(base, name) == getattr(scene, name) for name in read_alike)
    known = base.info if base is not None and is_alike else None
    return Manifest(id, main, files, scene.environment, scene.variant, known, scene.up, scene.floor).to_json()


@router.get("/blobs/{sha256}", response_class=StreamingResponse)
def get_blob(sha256: str, farm: FarmDependency) -> StreamingResponse:
    """Returns the blob with this hash."""
    if not is_sha256(sha256):
        raise blob_not_found()
    blob = farm.blobs.serve(sha256)
    return StreamingResponse(blob.chunks, media_type="application/octet-stream", headers={"Content-Length": str(blob.size)})


@router.post("/blobs/{sha256}/keep", status_code=204)
def keep_blob(sha256: str, farm: FarmDependency) -> Response:
    """Protects a blob from deletion for as long as one just stored. 404 if it does not exist and has to be uploaded."""
    if not is_sha256(sha256):
        raise blob_not_found()
    farm.garbage.pin_until_recorded(sha256)
    if not farm.blobs.exists(sha256):
        farm.garbage.remove_pins(sha256)  # sending a blob renews its retention
        raise blob_not_found()
    return Response(status_code=204)


@router.get("/films/{job}/{frame}", response_class=FileResponse)
def get_means(
    job: str,
    frame: Annotated[int, PathParameter(ge=0, le=1 << 31)],
    farm: FarmDependency,
    ids: Annotated[bool, Query(description="whether the object and material planes follow")] = False,
    lights: Annotated[str, Query(max_length=4000, description="light groups whose light comes in place of the colour")] = "",
) -> FileResponse:
    """Returns the mean colour, albedo and normal of a frame for a denoiser; layout: protocol.contract.DenoiseFrame.

    frame: twice the frame number. ids: whether the object and material planes follow. lights: names of light groups, separated by
    commas, whose light comes in place of the colour.
    """
    found = find_job(job, farm)
    film = farm.film(found)
    if film is None or not farm.records.has_frame(job, frame):
        raise NotFound(Sentence("job-picture-not-available", "The job does not have this picture yet."))
    groups = lights.split(",") if lights else []
    if not {*groups} <= {*film.groups}:
        raise NotFound(Sentence("film-light-groups-missing", "The job does not have these light groups."))
    colors = [aovs.LIGHT + group for group in groups] or ["color"]
    version, samples = film.version(frame), film.samples(frame)
    handle, name = tempfile.mkstemp(dir=farm.settings.data / "tmp", prefix="means-")
    try:
        with os.fdopen(handle, "wb") as file:
            for means in (*colors, "albedo", "normal", *(("object", "material") if ids else ())):
                for band in bands(film, frame, [means]):
                    band.astype("<f4", copy=False).tofile(file)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
    return FileResponse(
        name,
        media_type="application/octet-stream",
        headers={VERSION_HEADER: version, SAMPLES_HEADER: str(samples)},
        background=BackgroundTask(lambda: Path(name).unlink(missing_ok=True)),
    )


@router.get("/views/{message}", response_class=Response, responses={200: {"content": {"application/octet-stream": {}}}})
def get_view_means(message: str, farm: FarmDependency) -> Response:
    """Returns the picture of a live view for a denoiser; layout: protocol.view_parts.ViewDenoise."""
    found = farm.views.means(message)
    if found is None:
        raise NotFound(Sentence("view-picture-gone", "The live view shows something else by now."))
    return Response(found, media_type="application/octet-stream")


@router.put("/blobs/{sha256}", status_code=204)
async def put_blob(sha256: str, request: Request, farm: FarmDependency) -> Response:
    """Stores a blob. Its content must have the hash in the path."""
    if not is_sha256(sha256):
        raise Invalid(
            Sentence("blob-name-invalid", "The name of a blob must be the SHA-256 of its bytes in lower-case hexadecimal.")
        )
    check_disk = disk_checker(farm.settings.data, farm.settings.min_free_bytes)

    def write_piece(piece: bytes) -> None:
        check_disk(len(piece))
        writer.write(piece)

    def commit() -> None:
        farm.garbage.pin_until_recorded(sha256)
        writer.commit()

    with translated_disk_errors():
        writer = await run_in_threadpool(farm.blobs.writer)
        try:
            async for piece in joined_chunks(request.stream()):
                await run_in_threadpool(write_piece, piece)
                if writer.size > farm.settings.max_blob_bytes:
                    raise TooLarge(
                        Sentence("blob-too-large", "A blob may have at most {most} bytes.", most=farm.settings.max_blob_bytes)
                    )
            if writer.sha256 != sha256:
                raise Invalid(Sentence("blob-hash-mismatch", "The uploaded bytes do not match their SHA-256. Send them again."))
            await run_in_threadpool(commit)
        finally:
            with anyio.CancelScope(shield=True):
                await run_in_threadpool(writer.discard)
    return Response(status_code=204)
