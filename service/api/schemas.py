"""What the API takes and gives, as the OpenAPI page shows it."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator, model_validator

from renderer.errors import SettingsError
from renderer.settings import (
    FILTERS,
    HEURISTICS,
    INTEGRATORS,
    LIGHT_CHOICES,
    MAX_DEPTH,
    MAX_FLOOR,
    MAX_LIGHT_SAMPLES,
    MAX_SIZE,
    MAX_SPP,
    MISTAKES,
    OPTIONAL,
    PROJECTIONS,
    SAMPLERS,
    SAMPLINGS,
    RenderSettings,
    View,
)
from service.errors import Invalid
from service.intake.names import plain_title

__all__ = [
    "CameraOut",
    "EnvironmentIn",
    "FrameOut",
    "JobIn",
    "JobOut",
    "JobPatch",
    "SceneOut",
    "SceneStatus",
    "SkyIn",
    "ViewModel",
    "WorkerOut",
    "WorkerPatch",
]

Finite = Annotated[float, Field(allow_inf_nan=False, ge=-1e12, le=1e12)]
Vec3 = tuple[Finite, Finite, Finite]
Length = Annotated[float, Field(allow_inf_nan=False, ge=0.0, le=1e12)]
Radiance = Annotated[float, Field(allow_inf_nan=False, ge=0.0, le=1e6)]
SceneStatus = Literal["preparing", "ready", "failed"]
JobState = Literal["queued", "running", "paused", "finished", "failed", "cancelled"]


def _one_of(names: tuple[str, ...]) -> dict[str, Any]:
    """For the OpenAPI page; RenderSettings itself refuses what is not known."""
    return {"enum": [*names, None]}


class Strict(BaseModel):
    """A body in which unknown fields are an error: a misspelt option must not be ignored."""

    model_config = ConfigDict(extra="forbid")

    @field_validator("*", mode="before")
    @classmethod
    def _no_truth(cls, value: Any) -> Any:
        """true and false are no numbers, though Python counts with them."""
        if isinstance(value, bool) or (isinstance(value, list) and any(isinstance(each, bool) for each in value)):
            raise ValueError("true and false mean nothing here; give a value of the kind that the API's description names")
        return value


class ViewModel(Strict):
    """A camera in world space; lengths in the scene's unit."""

    eye: Vec3
    target: Vec3
    up: Vec3 = (0.0, 1.0, 0.0)
    fov: float = Field(40.0, ge=0.01, le=179.0, description="vertical field of view in degrees; perspective")
    projection: str = Field("perspective", json_schema_extra={"enum": list(PROJECTIONS)})
    aperture: Length = Field(0.0, description="radius of the lens; 0 is a pinhole, sharp everywhere")
    focus: Length | None = Field(None, description="distance of the plane that is sharp; the target's where left out")
    height: Length = Field(2.0, description="what an orthographic camera shows from top to bottom")
    near: Length = Field(0.0, description="distance along the line of sight where rays start: what stands before is cut away")

    @model_validator(mode="after")
    def _possible(self) -> ViewModel:
        try:
            View(**dict(self))
        except SettingsError as error:
            raise ValueError(str(error)) from None
        return self


class SkyIn(Strict):
    """A clear sky with the sun there, in degrees: above the horizon, and clockwise from -Z as seen from above (90 is +X)."""

    elevation: float = Field(ge=-90.0, le=90.0)
    azimuth: float = Field(0.0, ge=-360.0, le=360.0)


class EnvironmentIn(Strict):
    """Light from all around in place of the scene's: a linear RGB radiance, or a sky; a factor, and a further turn."""

    color: tuple[Radiance, Radiance, Radiance] | None = None
    sky: SkyIn | None = Field(None, description="prepares the scene anew under that sky: the job's `scene` is then that one")
    strength: Radiance = 1.0
    rotation: float = Field(0.0, ge=-360.0, le=360.0, description="degrees about +Y, counter-clockwise seen from above")

    @model_validator(mode="after")
    def _one(self) -> EnvironmentIn:
        if self.color is not None and self.sky is not None:
            raise ValueError("give either color or sky, not both")
        return self


class JobIn(Strict):
    """A request for a picture. Quality is asked for by spp, noise or seconds; whichever comes first ends it."""

    scene: str = Field(description="a scene's id", max_length=100)
    name: str | None = Field(None, max_length=200)
    camera: str | Annotated[int, Field(ge=0)] | None = Field(None, description="a camera of the scene, by its name or number")
    view: ViewModel | None = Field(None, description="a camera of your own, instead of `camera`")
    width: int | None = Field(None, ge=1, le=MAX_SIZE)
    height: int | None = Field(None, ge=1, le=MAX_SIZE)
    spp: int | None = Field(None, ge=1, le=MAX_SPP, description="samples a pixel")
    noise: float | None = Field(None, gt=0.0, le=10.0, description="relative noise at which a tile is done, for example 0.02")
    seconds: float | None = Field(None, gt=0.0, le=1e7, description="wall-clock time spent on rendering")
    frames: str | int = Field("0", description="only 0: a still")
    fps: float = Field(24.0, gt=0.0, le=1000.0)
    integrator: str | None = Field(None, json_schema_extra=_one_of(INTEGRATORS), description="how light is followed")
    max_depth: int | None = Field(None, ge=1, le=MAX_DEPTH, description="path segments, the camera's included")
    sampling: str | None = Field(None, json_schema_extra=_one_of(SAMPLINGS), description="how paths find lights")
    heuristic: str | None = Field(None, json_schema_extra=_one_of(HEURISTICS), description="how mis weighs its strategies")
    light_choice: str | None = Field(
        None, json_schema_extra=_one_of(LIGHT_CHOICES), description="by what chance a light is taken of many"
    )
    roulette: float | None = Field(
        None, ge=0.0, le=1.0, description="probability with which paths go on, from 0.05; 0: by throughput, after three bounces"
    )
    roulette_floor: float | None = Field(None, ge=0.0, le=MAX_FLOOR, description="the least of it where it goes by throughput")
    clamp_indirect: float | None = Field(
        None, ge=0.0, le=1e9, allow_inf_nan=False, description="the most that indirect light adds to a sample; 0: no limit"
    )
    light_samples: int | None = Field(None, ge=1, le=MAX_LIGHT_SAMPLES, description="shadow rays at the camera's first hit")
    ao_distance: Length | None = Field(None, description="how far ambient occlusion looks; 0: to infinity")
    ambient: tuple[Radiance, Radiance, Radiance] | None = Field(None, description="light from all sides, of whitted alone")
    mistake: str | None = Field(None, json_schema_extra=_one_of(MISTAKES), description="an error of other renderers, to show it")
    sampler: str | None = Field(None, json_schema_extra=_one_of(SAMPLERS), description="where random numbers come from")
    filter: str | None = Field(None, json_schema_extra=_one_of(FILTERS), description="the pixel filter")
    seed: int | None = Field(None, ge=0, lt=1 << 32, description="another seed, another noise")
    environment: EnvironmentIn | None = None
    variant: str | None = Field(
        None,
        max_length=200,
        description="of the scene's materials, by name or number; empty: the file's own. Prepares the scene anew: the job's "
        "`scene` is then that one",
    )
    priority: int = Field(0, ge=-100, le=100, description="higher is sooner")
    tile_size: int | None = Field(None, ge=8, le=512)

    @field_validator("name")
    @classmethod
    def _plain(cls, value: str | None) -> str | None:
        try:
            return None if value is None else plain_title(value)
        except Invalid as error:
            raise ValueError(str(error).removeprefix("name: ")) from None

    @field_validator("frames")
    @classmethod
    def _one_frame(cls, value: str | int) -> str:
        if str(value).strip() != "0":
            raise ValueError('animation is not rendered yet; leave frames out, or give "0"')
        return "0"

    @field_validator(*OPTIONAL)
    @classmethod
    def _possible(cls, value: Any, info: ValidationInfo) -> Any:
        if value is not None:
            try:
                RenderSettings(1, 1, View((0, 0, 1), (0, 0, 0)), **{str(info.field_name): value})
            except SettingsError as error:
                raise ValueError(str(error)) from None
        return value

    @model_validator(mode="after")
    def _one_camera(self) -> JobIn:
        if self.view is not None and self.camera is not None:
            raise ValueError("give either camera or view, not both")
        return self


class JobPatch(Strict):
    """What can change in a job."""

    state: Literal["running", "paused", "cancelled"] | None = None
    priority: int | None = Field(None, ge=-100, le=100)
    spp: int | None = Field(
        None,
        ge=1,
        le=MAX_SPP,
        description="samples in every pixel, whatever noise or time said; a finished job goes on",
    )
    more: int | None = Field(None, ge=1, le=MAX_SPP, description="as spp: so many more than now")


class CameraOut(BaseModel):
    """A camera of a scene."""

    name: str
    view: ViewModel


class SceneOut(BaseModel):
    """An uploaded scene."""

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
    variants: list[str] = Field(description="of a glTF file's materials; a job may ask for one")
    variant: str | None = Field(description="the one that is shown; null: the file's own materials")
    warnings: list[str]
    defaults: dict[str, Any]
    thumbnail: str | None


class BadSampleOut(BaseModel):
    """A sample that was NaN or infinite, and so left out."""

    x: int
    y: int
    sample: int
    reproduce: str = Field(description="a command that follows its path and prints it")


class FrameOut(BaseModel):
    """One picture of a job."""

    number: int
    samples: int
    bad_samples: int
    bad: list[BadSampleOut] = Field(description="the first of them")
    progress: float


class JobOut(BaseModel):
    """A job and how far it is."""

    id: str
    scene: str
    name: str
    state: JobState
    message: str | None = Field(description="why it does not go on at the moment")
    error: str | None
    reproduce: str | None = Field(description="a command that shows the error again")
    priority: int
    created: float
    started: float | None
    finished: float | None
    active_s: float = Field(description="wall-clock time spent on rendering")
    progress: float
    eta_s: float | None
    samples: int = Field(description="in the film, all pixels of all frames together")
    samples_per_s: float
    bad_samples: int = Field(description="samples that were NaN or infinite, and left out")
    width: int | None
    height: int | None
    spp: int | None
    noise: float | None
    seconds: float | None
    tile_size: int | None
    kind: str | None
    settings: dict[str, Any] | None
    frames: list[FrameOut]


class WorkerPatch(Strict):
    """What can change in a worker."""

    state: Literal["running", "paused"]


class WorkerOut(BaseModel):
    """A worker, by its own report."""

    name: str
    host: str
    pid: int
    slots: int
    cpu: str
    kind: str
    state: Literal["starting", "ready", "paused"]
    message: str | None = Field(description="why it is paused")
    started: float
    samples_per_s: float = Field(description="of one slot")
    current: list[dict[str, Any]]
    denoises: bool = Field(description="whether it has Open Image Denoise")
