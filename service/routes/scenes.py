"""/api/scenes: uploads, describes and deletes scenes."""

from __future__ import annotations

import base64
from typing import Annotated, Any

from fastapi import Query, Request, Response
from fastapi.responses import StreamingResponse

from renderer.sentences import Sentence
from service.errors import NotFound
from service.farm import Farm
from service.http.farm import FarmDependency
from service.http.pagination import Offset
from service.http.routers import api_router
from service.http.single_upload import check_length, check_upload_quota
from service.http.visit import InProject, IntoProject, VisitDependency
from service.jobs.lookup import find_scene
from service.models.scenes import PreviewLightIn, PreviewLightOut, SceneOut
from service.scenes.delete import delete
from service.scenes.describe import scene_out
from service.scenes.light import current_preview, preview_light
from service.scenes.listing import SceneFilter
from service.scenes.upload import UploadRequest
from service.scenes.upload import upload as store
from telemetry import tracing

__all__ = ["router"]

router = api_router(prefix="/api/scenes", tags=["scenes"])

PREVIEW = {"content": {"application/octet-stream": {}}, "description": "the mesh"}
THUMBNAIL = {"content": {"image/png": {}}, "description": "the picture"}
POSTER = {"content": {"image/jpeg": {}}, "description": "the picture"}
PosterVersion = Annotated[
    str | None,
    Query(min_length=8, max_length=64, description="beginning of the poster's digest, with which clients may cache it"),
]
UPLOAD_FORM = {
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "required": ["files"],
                    "properties": {
                        "files": {
                            "type": "array",
                            "items": {"type": "string", "format": "binary"},
                            "description": "the scene's files, with their folders in the names, or one zip",
                        },
                        "main": {"type": "string", "description": "path of the scene file, if there are several"},
                        "environment": {
                            "type": "string",
                            "description": "image among the files that lights the scene, or a sky: `sky:ELEVATION,AZIMUTH`",
                        },
                        "up": {
                            "type": "string",
                            "enum": ["auto", "x", "y", "z", "-x", "-y", "-z"],
                            "description": "up axis of an OBJ, PLY, STL or OFF file; `auto`, the default: guessed",
                        },
                        "floor": {
                            "type": "string",
                            "enum": ["on", "auto", "off"],
                            "description": "a floor below the scene that takes its shadows; `auto`: if the file has no light; "
                            "`off`: the default",
                        },
                        "name": {"type": "string", "description": "name of the scene; by default its file's name"},
                        "strict": {
                            "type": "boolean",
                            "description": "whether warnings (what the reader guessed, left out or replaced) are errors",
                        },
                        "base": {
                            "type": "string",
                            "description": "id of a scene whose files are added to those that are sent",
                        },
                    },
                }
            }
        },
    }
}


@router.post("", status_code=201, response_model=SceneOut, openapi_extra=UPLOAD_FORM)
async def upload(
    request: Request,
    farm: FarmDependency,
    response: Response,
    visit: VisitDependency,
    project: IntoProject = "",
    strict: Annotated[bool, Query(description="whether warnings of the scene are errors, as the form's field `strict`")] = False,
) -> SceneOut:
    """Uploads a scene: one file, several with their folders in the names, or a zip. The same files always give the same scene.

    The scene's warnings are known once a worker has prepared it. A strict scene with warnings becomes `failed`, and requests
    for jobs of it are rejected with 409. A strict scene is another scene than that of the same files without `strict`.

    base: adds the files to a copy of this scene, by default in the same project. main: then selects another main file.
    """
    await check_upload_quota(request, farm, visit)
    check_length(request, farm, Sentence("kind-upload", "upload"), Sentence("advice-leave-files-out", "Leave files out"))
    traceparent, content_type = request.headers.get(tracing.HEADER), request.headers.get("content-type", "")
    scene = await store(UploadRequest(content_type, request.stream(), project, strict, traceparent), visit, farm)
    response.headers["Location"] = f"/api/scenes/{scene.id}"
    return scene_out(scene, farm.engine)


@router.get("", response_model=list[SceneOut])
def list_scenes(
    farm: FarmDependency,
    response: Response,
    visit: VisitDependency,
    project: InProject = None,
    limit: Annotated[int, Query(ge=1, le=1000, description="maximum number of scenes")] = 100,
    offset: Offset = 0,
    search: Annotated[
        str, Query(max_length=200, description="words in the scene's name, or the first characters of its id")
    ] = "",
) -> list[SceneOut]:
    """Lists all scenes, or those that match the search, newest first. The header X-Total-Count contains their number."""
    chosen = SceneFilter(visit.sight, project, search)
    with farm.sessions() as session:
        response.headers["X-Total-Count"] = str(chosen.count(session))
        return [scene_out(row, farm.engine) for row in chosen.rows(session, limit, offset)]


@router.get("/{id}", response_model=SceneOut)
def get_scene(id: str, farm: FarmDependency) -> SceneOut:
    """Returns a scene: whether it is ready, its cameras, counts, bounds and warnings."""
    return scene_out(find_scene(id, farm), farm.engine)


@router.get("/{id}/thumbnail.png", response_class=Response, responses={200: THUMBNAIL, 304: {"description": "not changed"}})
def thumbnail(id: str, request: Request, farm: FarmDependency) -> Response:
    """Returns the thumbnail of a scene, made when the scene was prepared."""
    scene = find_scene(id, farm)
    ref = (scene.info or {}).get("thumbnail")
    if not ref:
        raise NotFound(Sentence("scene-without-thumbnail", "This scene has no thumbnail yet."))
    return _blob(ref, "image/png", request, farm)


@router.get("/{id}/poster.jpg", response_class=Response, responses={200: POSTER, 304: {"description": "not changed"}})
def poster(id: str, request: Request, farm: FarmDependency, v: PosterVersion = None) -> Response:
    """Returns a sharp picture of the scene as its live view opens: the latest clear one of such a view."""
    scene = find_scene(id, farm)
    ref = (scene.info or {}).get("poster")
    if not ref:
        raise NotFound(Sentence("scene-without-poster", "This scene has no poster yet."))
    response = _blob(ref, "image/jpeg", request, farm)
    if v is not None and ref["sha256"].startswith(v):
        response.headers["Cache-Control"] = "private, max-age=31536000, immutable"
    return response


@router.get("/{id}/preview", response_class=Response, responses={200: PREVIEW, 304: {"description": "not changed"}})
def preview(id: str, request: Request, farm: FarmDependency) -> Response:
    """Returns a mesh of the scene with its materials, once a worker has read the files.

    It is a packet for the page, whose layout may change with each release.
    """
    progress = farm.engine.snapshot.preparing.get(id)
    ref = current_preview(find_scene(id, farm), progress, farm)
    if ref is None:
        raise NotFound(Sentence("scene-without-preview", "This scene has no preview yet."))
    return _blob(ref, "application/octet-stream", request, farm)


@router.get("/{id}/preview-light", response_model=PreviewLightOut | None)
def light(id: str, farm: FarmDependency, chosen: Annotated[PreviewLightIn, Query()]) -> PreviewLightOut | None:
    """Returns the light of the preview mesh in another environment; null until a worker has prepared a view with it.

    Presets without a sun need no worker. The fields may change with each release.
    """
    found = preview_light(id, chosen.request, farm)
    if found is None:
        return None
    words = base64.b64encode(found.words).decode()
    return PreviewLightOut(width=found.width, height=found.height, words=words, lamps=found.lamps)


def _blob(ref: dict[str, Any], media_type: str, request: Request, farm: Farm) -> Response:
    headers = {"Cache-Control": "no-cache", "ETag": f'"{ref["sha256"]}"'}
    if headers["ETag"] in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    blob = farm.blobs.serve(ref["sha256"])
    return StreamingResponse(blob.chunks, media_type=media_type, headers=headers | {"Content-Length": str(blob.size)})


@router.delete("/{id}", status_code=204)
def delete_scene(id: str, farm: FarmDependency) -> None:
    """Deletes a scene and its files. Finished pictures stay; 409 if unfinished jobs need it."""
    delete(id, farm)
