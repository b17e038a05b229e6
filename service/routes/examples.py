"""/api/examples: the scenes that Rayfarm ships, so that newcomers have a picture after two clicks."""

from __future__ import annotations

from dataclasses import asdict, replace

from fastapi import APIRouter, Response
from pydantic import BaseModel

from service.errors import NotFound
from service.http.farm import FarmDependency
from service.http.visit import IntoProject, VisitDependency
from service.intake.examples import examples, form_of
from service.intake.projects import Owner, id_in
from service.intake.record import record
from service.intake.uploads import Upload, keep
from service.jobs.describe import scene_out
from service.models.jobs import SceneOut
from service.store.models import Scene
from service.store.room import full_disk

__all__ = ["router"]

router = APIRouter(prefix="/api/examples", tags=["examples"])


class ExampleOut(BaseModel):
    """A scene that can be opened without an upload. frames, fps: of one made as a shot, as `POST /api/jobs` takes them."""

    name: str
    title: str
    description: str
    frames: str | None
    fps: float | None


@router.get("", response_model=list[ExampleOut])
def list_examples(farm: FarmDependency) -> list[ExampleOut]:
    """The examples, by name."""
    return [ExampleOut(**asdict(example)) for example, _ in examples(farm.settings.examples)]


@router.post("/{name}", status_code=201, response_model=SceneOut)
def open_example(
    name: str, farm: FarmDependency, response: Response, visit: VisitDependency, project: IntoProject = ""
) -> SceneOut:
    """Make a scene of an example, as if its files had been uploaded. Opened again, it is the same scene."""
    owner = Owner(farm.access.projects.check(project, visit.sight), visit.user, visit.token)

    def write(stored: Upload) -> Scene:
        farm.quotas.check_bytes(visit.caller, stored.size)
        return record(replace(stored, id=id_in(project, stored.id)), farm.sessions, farm.events, owner=owner)

    found = next((each for each in examples(farm.settings.examples) if each[0].name == name), None)
    if found is None:
        raise NotFound(f"There is no example {name[:60]!r}. GET /api/examples lists those that are there.")
    with full_disk():
        form = form_of(*found, farm.blobs)
    scene = keep(
        form,
        farm.blobs,
        farm.garbage,
        farm.settings,
        lambda size: None,
        write,
    )
    response.headers["Location"] = f"/api/scenes/{scene.id}"
    return scene_out(scene, farm.engine)
