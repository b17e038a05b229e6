"""What the API takes and gives, as the OpenAPI page shows it."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from renderer.cameras import MOST_CAMERAS
from renderer.errors import SettingsError
from renderer.settings import ENVIRONMENT, MAX_SPP, OPTIONAL, SETTINGS, VIEW, Vec3, View
from renderer.work import WORK
from service.api.declared_fields import with_fields
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

SceneStatus = Literal["preparing", "ready", "failed"]
JobState = Literal["queued", "running", "paused", "finished", "failed", "cancelled"]


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


@with_fields(VIEW)
class ViewModel(Strict):
    """A camera in world space; lengths in the scene's unit."""

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


@with_fields(ENVIRONMENT)
class EnvironmentIn(Strict):
    """Light from all around in place of the scene's: a linear RGB radiance, or a sky; a factor, and a further turn."""

    color: Vec3 | None = None
    sky: SkyIn | None = Field(None, description="prepares the scene anew under that sky: the job's `scene` is then that one")

    @model_validator(mode="after")
    def _one(self) -> EnvironmentIn:
        if self.color is not None and self.sky is not None:
            raise ValueError("give either color or sky, not both")
        return self


@with_fields(WORK)
@with_fields({name: SETTINGS[name] for name in ("width", "height", *OPTIONAL)}, of_scene=True)
class JobIn(Strict):
    """A request for a picture. Quality is asked for by spp, noise or seconds; whichever comes first ends it."""

    scene: str = Field(description="a scene's id", max_length=100)
    name: str | None = Field(None, max_length=200)
    camera: str | Annotated[int, Field(ge=0, lt=MOST_CAMERAS)] | None = Field(
        None, description="a camera of the scene, by its name or number"
    )
    view: ViewModel | None = Field(None, description="a camera of your own, instead of `camera`")
    spp: int | None = None
    noise: float | None = None
    seconds: float | None = None
    tile_size: int | None = None
    priority: int = 0
    frames: str | int = Field("0", description="only 0: a still")
    fps: float = Field(24.0, gt=0.0, le=1000.0)
    environment: EnvironmentIn | None = None
    variant: str | None = Field(
        None,
        max_length=200,
        description="of the scene's materials, by name or number; empty: the file's own. Prepares the scene anew: the job's "
        "`scene` is then that one",
    )

    @field_validator("camera", mode="before")
    @classmethod
    def _name_or_number(cls, value: Any) -> Any:
        if value is None or isinstance(value, str) or (isinstance(value, int) and 0 <= value < MOST_CAMERAS):
            return value
        raise ValueError("a camera is a name, or a number from 0")

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
    environment: str | None = Field(description="in place of its own: an image among the files, or sky:ELEVATION,AZIMUTH")
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
