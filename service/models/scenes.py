"""Models of scenes."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, Field

from service.models.coded import Coded

__all__ = ["MeasuredOut", "SceneOut", "SceneStatus"]

SceneStatus = Literal["preparing", "ready", "failed"]


class MeasuredOut(BaseModel):
    """Cost and noise of a scene, measured by the latest finished job that rendered it."""

    sample_s: float = Field(description="seconds that one slot takes for one sample of one pixel")
    noise: float | None = Field(
        description="relative standard error of a pixel at one sample; it falls with the square root of the samples"
    )


class SceneOut(Coded):
    """An uploaded scene: its files, state of preparation, cameras and warnings."""

    id: str
    name: str
    status: SceneStatus
    error: str | None
    step: str | None = Field(description="what preparing does at the moment")
    progress: float | None = Field(description="of preparing, 0 to 1")
    created: float = Field(description="unix time in seconds")
    main: str
    files: list[dict[str, Any]]
    bytes: int
    cameras: list[dict[str, Any]]
    counts: dict[str, int]
    bounds: list[list[float]] | None
    animations: list[str]
    fps: float | None = Field(description="the file's own, else 24; null where that is not known")
    clips: list[dict[str, Any]] = Field(description="of its animations: name, and from when to when it moves, in seconds")
    variants: list[str] = Field(description="of a glTF file's materials; a job may ask for one")
    light_groups: list[str] = Field(default_factory=list, description="names of its lights' groups, for a job's `light_groups`")
    variant: str | None = Field(description="the one that is shown; null: the file's own materials")
    up_axis: str | None = Field(
        description="which axis of an OBJ, PLY, STL or OFF file is up; null: not known, or stated by the file"
    )
    up: str | None = Field(description="the axis that was asked for; null: it is guessed")
    has_floor: bool = Field(description="whether the studio's floor lies below it")
    floor: str | None = Field(description="as it was asked for: on, or auto: if the file has no light; null: off")
    environment: str | None = Field(description="in place of its own: an image among the files, or sky:ELEVATION,AZIMUTH")
    measured: MeasuredOut | None = Field(description="null until a picture of it was rendered")
    warnings: list[str]
    strict: bool = Field(description="whether warnings fail it: then `error` and `warnings` list them")
    defaults: dict[str, Any]
    thumbnail: str | None
    preview: str | None = Field(
        default=None,
        description="a mesh to draw until there are samples; cameras, bounds and defaults come with it",
    )
    project: str = Field(default="", description="whose members see it; empty: everybody who is let in")
