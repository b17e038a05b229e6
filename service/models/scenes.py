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
    step: str | None = Field(description="current step of the preparation")
    progress: float | None = Field(description="progress of the preparation, 0 to 1")
    created: float = Field(description="unix time in seconds")
    main: str
    files: list[dict[str, Any]]
    bytes: int
    cameras: list[dict[str, Any]]
    counts: dict[str, int]
    bounds: list[list[float]] | None
    animations: list[str]
    fps: float | None = Field(description="the file's frame rate, or 24; null while unknown")
    clips: list[dict[str, Any]] = Field(description="animations: name, begin and end in seconds")
    variants: list[str] = Field(description="names of material variants, for a job's `variant`")
    light_groups: list[str] = Field(default_factory=list, description="names of light groups, for a job's `light_groups`")
    variant: str | None = Field(description="the variant that is shown; null: the file's own materials")
    up_axis: str | None = Field(description="up axis of an OBJ, PLY, STL or OFF file; null: unknown, or stated by the file")
    up: str | None = Field(description="the requested up axis; null: guessed")
    has_floor: bool = Field(description="whether there is a floor below the scene")
    floor: str | None = Field(description="as requested: on, or auto (if the file has no light); null: off")
    environment: str | None = Field(
        description="environment in place of the file's: an image among the files, or sky:ELEVATION,AZIMUTH"
    )
    measured: MeasuredOut | None = Field(description="null until a picture is rendered")
    warnings: list[str]
    strict: bool = Field(description="whether warnings are errors, which `error` and `warnings` then list")
    defaults: dict[str, Any]
    thumbnail: str | None
    preview: str | None = Field(
        default=None,
        description="a mesh to draw until there are samples; cameras, bounds and defaults come with it",
    )
    project: str = Field(default="", description="empty: visible to all users")
