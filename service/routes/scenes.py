"""/api/scenes: upload, inspect and delete scenes."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import StreamingResponse
from sqlalchemy import func, or_, select
from sqlalchemy.orm import Session
from starlette.concurrency import run_in_threadpool

from service.errors import Conflict, NotFound
from service.events import RowWritten
from service.http.farm import FarmDependency
from service.http.one_file import check_length, check_room
from service.http.visit import InProject, IntoProject, VisitDependency
from service.intake.projects import Owner, id_in
from service.intake.record import record
from service.intake.uploads import Upload, receive
from service.jobs.describe import scene_out
from service.jobs.listing import says, words_of
from service.jobs.lookup import find_scene, no_scene
from service.models.jobs import SceneOut
from service.store.models import ACTIVE, Job, Scene
from worker.telemetry import tracing

__all__ = ["router"]

router = APIRouter(prefix="/api/scenes", tags=["scenes"])

THUMBNAIL = {"content": {"image/png": {}}, "description": "the picture"}
UPLOAD_FORM = {
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "required": ["files"],
                    "properties": {
                        "files": {"type": "array", "items": {"type": "string", "format": "binary"}},
                        "main": {"type": "string", "description": "which of several scene files is meant"},
                        "environment": {
                            "type": "string",
                            "description": "an image among the files that lights the scene, or a sky as sky:ELEVATION,AZIMUTH",
                        },
                        "name": {"type": "string"},
                        "strict": {
                            "type": "boolean",
                            "description": "warnings (what the reader guessed, dropped or replaced) fail the scene",
                        },
                        "base": {
                            "type": "string",
                            "description": "the id of a scene whose files are taken over: only what it lacks is sent",
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
    strict: Annotated[bool, Query(description="as the form's field `strict`")] = False,
) -> SceneOut:
    """Upload a scene: one file, many with their folders in the names, or a zip. The same files again are the same scene.

    Warnings are known once a worker has prepared the scene: a strict one with warnings is then `failed`, and jobs of it are
    refused with 409. It is another scene than the same files without `strict`.

    With `base`, in that scene's project unless told; with `main` beside it, another of its files is the one that is shown.
    """
    await check_room(request, farm, visit)
    owner = Owner(await run_in_threadpool(farm.access.projects.check, project, visit.sight), visit.user, visit.token)
    bases: list[Scene] = []

    def find_base(id: str) -> Scene:
        found = find_scene(id, farm)
        if not visit.sight.sees(found.project):
            raise no_scene(id)
        bases[:] = [found]
        return found

    def write(stored: Upload) -> Scene:
        its = replace(owner, project=bases[0].project) if bases and not project else owner
        farm.access.projects.check_again(its.project, visit.caller, visit.sight)
        stored = stored.as_strict() if strict else stored
        stored = replace(stored, id=id_in(its.project, stored.id))
        farm.quotas.check_bytes(visit.caller, stored.size)
        return record(stored, farm.sessions, farm.events, owner=its)

    check_length(request, farm, "upload", "Leave files out")
    begun, content_type = time.time(), request.headers.get("content-type", "")
    scene = await receive(
        content_type,
        request.stream(),
        farm.blobs,
        farm.garbage,
        farm.settings,
        write,
        find_base,
    )
    response.headers["Location"] = f"/api/scenes/{scene.id}"
    first = tracing.root_of("scene", scene.id)
    is_new = scene.created >= begun  # otherwise its trace started earlier
    asked = [tracing.where(request.headers.get(tracing.HEADER))]
    tracing.record(
        *("upload", begun, time.time(), None if is_new else first),
        own=first if is_new else None,
        links=asked,
        scene=scene.id,
        bytes=scene.bytes,
        files=len(scene.files),
    )
    return scene_out(scene, farm.engine)


@router.get("", response_model=list[SceneOut])
def list_scenes(
    farm: FarmDependency,
    response: Response,
    visit: VisitDependency,
    project: InProject = None,
    limit: int = Query(100, ge=1, le=1000),
    offset: int = Query(0, ge=0, le=1 << 31),
    search: str = Query("", max_length=200, description="words that its name has, or the begin of its id"),
) -> list[SceneOut]:
    """All scenes, or those that are sought, the newest first. The header X-Total-Count has their number."""
    wanted = [Scene.of.is_(None), visit.sight.clause(Scene.project)]
    wanted += [says(word, Scene.name, Scene.id) for word in words_of(search)]
    wanted += [] if project is None else [Scene.project == project]
    with farm.sessions() as session:
        response.headers["X-Total-Count"] = str(session.scalar(select(func.count()).select_from(Scene).where(*wanted)))
        uploads = select(Scene).where(*wanted)
        rows = session.scalars(uploads.order_by(Scene.created.desc(), Scene.id).limit(limit).offset(offset))
        return [scene_out(row, farm.engine) for row in rows]


@router.get("/{id}", response_model=SceneOut)
def get_scene(id: str, farm: FarmDependency) -> SceneOut:
    """One scene: whether it is ready, its cameras, counts, bounds and warnings."""
    return scene_out(find_scene(id, farm), farm.engine)


@router.get("/{id}/thumbnail.png", response_class=Response, responses={200: THUMBNAIL, 304: {"description": "not changed"}})
def thumbnail(id: str, request: Request, farm: FarmDependency) -> Response:
    """A small picture of the scene, made when it was prepared."""
    scene = find_scene(id, farm)
    ref = (scene.info or {}).get("thumbnail")
    if not ref:
        raise NotFound("This scene has no thumbnail yet.")
    headers = {"Cache-Control": "no-cache", "ETag": f'"{ref["sha256"]}"'}
    if headers["ETag"] in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    blob = farm.blobs.serve(ref["sha256"])
    return StreamingResponse(blob.chunks, media_type="image/png", headers=headers | {"Content-Length": str(blob.size)})


@router.delete("/{id}", status_code=204)
def delete_scene(id: str, farm: FarmDependency) -> None:
    """Delete a scene and its files. Finished pictures stay; jobs that still need the scene are in the way."""

    def forget(session: Session) -> set[str]:
        scene = session.get(Scene, id, with_for_update=True)
        if scene is None or scene.of is not None:
            raise no_scene(id)
        is_needed = or_(Job.scene == id, Job.lit == id)
        needed = session.scalar(select(func.count()).select_from(Job).where(is_needed, Job.state.in_(ACTIVE)))
        if needed:
            raise Conflict(f"{needed} unfinished job(s) need this scene. Cancel them first.")
        blobs = scene.blobs
        for lit in session.scalars(select(Scene).where(Scene.of == id)):
            blobs |= lit.blobs
            gone.append(lit.id)
            session.delete(lit)
        session.delete(scene)
        return blobs

    gone: list[str] = []
    farm.reserve.spend_on(lambda: farm.garbage.collect(forget))
    for lit in gone:
        farm.events.publish(RowWritten("scene", lit))
    farm.events.publish(RowWritten("scene", id))
