"""/api/scenes/{id}/takes: saved cameras with the settings of a scene's live view."""

from __future__ import annotations

from typing import Annotated

from fastapi import Path, Request, Response
from starlette.concurrency import run_in_threadpool

from service.access.visit import Visit
from service.http.farm import FarmDependency
from service.http.pagination import PageDependency
from service.http.routers import api_router
from service.http.visit import VisitDependency
from service.jobs.lookup import find_scene
from service.jobs.notes import Writer
from service.models.takes import TakeIn, TakeOut, TakePatch
from service.scenes.takes import add_take, delete_take, rename_take, select_takes, take_out, take_picture

__all__ = ["router"]

router = api_router(prefix="/api/scenes/{id}/takes", tags=["scenes"])

PICTURE = {"content": {"image/webp": {}}, "description": "the picture"}
TakeId = Annotated[str, Path(max_length=100)]


@router.get("", response_model=list[TakeOut])
def list_takes(id: str, farm: FarmDependency, page: PageDependency) -> list[TakeOut]:
    """Lists the takes of a scene, oldest first. The header X-Total-Count contains their number."""
    find_scene(id, farm)
    with farm.sessions() as session:
        _, rows = page.rows(select_takes(id), session)
        return [take_out(row) for row in rows]


@router.post("", status_code=201, response_model=TakeOut)
async def make_take(id: str, body: TakeIn, visit: VisitDependency, farm: FarmDependency, response: Response) -> TakeOut:
    """Saves a take of a scene. 409 if the scene has too many, 429 if there were too many changes within a minute."""
    await run_in_threadpool(find_scene, id, farm)
    made = await run_in_threadpool(add_take, id, body, _writer(visit), farm)
    farm.visitors.report_takes(id)
    response.headers["Location"] = f"/api/scenes/{id}/takes/{made.id}"
    return made


@router.patch("/{take}", response_model=TakeOut)
async def change_take(id: str, take: TakeId, body: TakePatch, visit: VisitDependency, farm: FarmDependency) -> TakeOut:
    """Renames a take."""
    changed = await run_in_threadpool(rename_take, id, take, body.name, _writer(visit), farm)
    farm.visitors.report_takes(id)
    return changed


@router.delete("/{take}", status_code=204)
async def remove_take(id: str, take: TakeId, visit: VisitDependency, farm: FarmDependency) -> None:
    """Deletes a take."""
    await run_in_threadpool(delete_take, id, take, _writer(visit), farm)
    farm.visitors.report_takes(id)


@router.get("/{take}/picture.webp", response_class=Response, responses={200: PICTURE, 304: {"description": "not changed"}})
def get_take_picture(id: str, take: TakeId, request: Request, farm: FarmDependency) -> Response:
    """Returns the small picture of a take, which never changes."""
    picture = take_picture(id, take, farm)
    headers = {"Cache-Control": "no-cache", "ETag": f'"{take}"'}
    if headers["ETag"] in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    return Response(picture, media_type="image/webp", headers=headers)


def _writer(visit: Visit) -> Writer:
    return Writer(visit.user, None, None, visit.address)
