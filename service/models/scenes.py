"""Models of scenes."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, Field

from service.models.coded import Coded
from service.models.jobs import Floor, PresetName, Up

__all__ = ["MeasuredOut", "PreviewLightIn", "PreviewLightOut", "SceneOut", "SceneStatus"]

SceneStatus = Literal["preparing", "ready", "failed"]


class MeasuredOut(BaseModel):
    """Cost and noise of a scene, measured by the latest finished job that rendered it."""

    sample_s: float = Field(description="seconds that one slot takes for one sample of one pixel")
    noise: float | None = Field(
        description="relative standard error of a pixel at one sample; it falls with the square root of the samples"
    )
    pace: float | None = Field(
        None,
        description="duration of the job, relative to that of its batches on all slots; null: too short, or it shared the slots",
    )
    denoise_s: float | None = Field(
        None, description="seconds for a pixel of its denoised picture, from the request until it is stored; null: not measured"
    )


class PreviewLightIn(BaseModel):
    """A light that replaces a scene's: a preset, a sky or an image, for the scene as a view shows it."""

    preset: PresetName | None = Field(None, description="name of a preset")
    elevation: float | None = Field(None, ge=-90.0, le=90.0, description="of the sun of a clear sky, in degrees")
    azimuth: float = Field(0.0, ge=-360.0, le=360.0, description="of the sun, in degrees clockwise from -Z")
    image: str | None = Field(None, max_length=100, description="id of an uploaded environment")
    variant: str | None = Field(None, max_length=200, description="material variant")
    up: Up | None = Field(None, description="up axis")
    floor: Floor | None = Field(None, description="floor below the scene")

    @property
    def request(self) -> dict[str, Any]:
        """The fields of a view's request."""
        sky = None if self.elevation is None else {"elevation": self.elevation, "azimuth": self.azimuth}
        environment = {"preset": self.preset, "sky": sky, "image": self.image}
        return {"environment": environment, "variant": self.variant, "up": self.up, "floor": self.floor}


class PreviewLightOut(BaseModel):
    """The light of a preview mesh, neither turned nor scaled."""

    width: int = Field(description="columns of the environment's texels")
    height: int = Field(description="rows of them; 0: it is black")
    words: str = Field(description="the texels as RGB9E5, little-endian, rows from the top; base64")
    lamps: list[dict[str, Any]] = Field(description="lamps, with the sun of a sky")


class SceneOut(Coded):
    """An uploaded scene: its files, state of preparation, cameras and warnings."""

    id: str = Field(description="id of the scene")
    name: str = Field(description="name of the scene")
    status: SceneStatus = Field(description="state of the preparation")
    error: str | None = Field(description="why the preparation failed; null: it did not")
    step: str | None = Field(description="current step of the preparation")
    progress: float | None = Field(description="progress of the preparation, 0 to 1")
    created: float = Field(description="Unix time in seconds")
    main: str = Field(description="path of the file that the scene is read from")
    files: list[dict[str, Any]] = Field(description="uploaded files: path, size and digest")
    bytes: int = Field(description="size of all files")
    cameras: list[dict[str, Any]] = Field(description="cameras of the scene: name and view")
    counts: dict[str, int] = Field(description="number of triangles, lights, materials and so on")
    bounds: list[list[float]] | None = Field(
        description="minimum and maximum corner of the bounding box in world space; null while unknown"
    )
    animations: list[str] = Field(description="names of the animations")
    fps: float | None = Field(description="the file's frame rate, or 24; null while unknown")
    clips: list[dict[str, Any]] = Field(description="animations: name, begin and end in seconds")
    variants: list[str] = Field(description="names of material variants, for a job's `variant`")
    light_groups: list[str] = Field(default_factory=list, description="names of light groups, for a job's `light_groups`")
    variant: str | None = Field(description="the variant that is shown; null: the file's own materials")
    up_axis: str | None = Field(description="up axis of an OBJ, PLY, STL or OFF file; null: unknown, or stated by the file")
    up: str | None = Field(description="the requested up axis; null: guessed")
    has_floor: bool = Field(description="whether there is a floor below the scene")
    floor: str | None = Field(
        description="floor below the scene, as requested: on, or auto (if the file has no light); null: off"
    )
    environment: str | None = Field(
        description="environment in place of the file's: an image among the files, or sky:ELEVATION,AZIMUTH"
    )
    measured: MeasuredOut | None = Field(description="measured cost and noise; null until a picture is rendered")
    warnings: list[str] = Field(description="what the reader left out or replaced, one sentence each")
    strict: bool = Field(description="whether warnings are errors, which `error` and `warnings` then list")
    defaults: dict[str, Any] = Field(description="render settings of the file, which jobs use if they set none")
    thumbnail: str | None = Field(description="URL of a small picture; null: none yet")
    poster: str | None = Field(
        default=None, description="URL of a sharp picture of the scene as its live view opens; null: none yet"
    )
    preview: str | None = Field(
        default=None,
        description="a mesh to draw until there are samples; cameras, bounds and defaults come with it",
    )
    project: str = Field(default="", description="project of it; empty: visible to all users")
