"""/api/examples: the example scenes shipped with Rayfarm."""

from __future__ import annotations

from dataclasses import asdict

from fastapi import Response
from pydantic import BaseModel, Field

from service.http.farm import FarmDependency
from service.http.routers import api_router
from service.http.visit import IntoProject, VisitDependency
from service.intake.examples import examples
from service.models.scenes import SceneOut
from service.scenes.describe import scene_out
from service.scenes.examples import scenes_of_examples
from service.scenes.upload import open_example as store_example

__all__ = ["router"]

router = api_router(prefix="/api/examples", tags=["examples"])


class ExampleOut(BaseModel):
    """An example scene.

    frames, fps: values for the same fields of `POST /api/jobs`, if the example is an animation. scenes: ids of the scenes that
    were opened from it.
    """

    name: str = Field(description="name of the example in URLs")
    title: str = Field(description="name of the example on the page")
    description: str = Field(description="what it shows, in one sentence")
    frames: str | None = Field(description="value for the field `frames` of a job; null: a still")
    fps: float | None = Field(description="value for the field `fps` of a job; null: a still")
    scenes: list[str] = Field(description="ids of the scenes that were made from it")


@router.get("", response_model=list[ExampleOut])
def list_examples(farm: FarmDependency, visit: VisitDependency) -> list[ExampleOut]:
    """Lists the example scenes by name."""
    found = examples(farm.settings.examples)
    opened = scenes_of_examples([path for _, path in found], visit, farm)
    return [ExampleOut(**asdict(example), scenes=scenes) for (example, _), scenes in zip(found, opened, strict=True)]


@router.post("/{name}", status_code=201, response_model=SceneOut)
def open_example(
    name: str, farm: FarmDependency, response: Response, visit: VisitDependency, project: IntoProject = ""
) -> SceneOut:
    """Creates a scene from an example, as if its files had been uploaded. Opening it again returns the same scene."""
    scene = store_example(name, project, visit, farm)
    response.headers["Location"] = f"/api/scenes/{scene.id}"
    return scene_out(scene, farm.engine)
