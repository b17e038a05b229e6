"""Request and response models of the API, as documented by OpenAPI."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, TypeAdapter, ValidationInfo, field_validator, model_validator

from renderer.cameras import MOST_CAMERAS
from renderer.errors import SettingsError
from renderer.frames import MAX_FRAME, MAX_FRAMES, parse_frames
from renderer.presets import PRESETS
from renderer.sentences import Sentence
from renderer.settings import ENVIRONMENT, MAX_SPP, OPTIONAL, SETTINGS, VIEW, Vec3, View
from renderer.variation import Variation
from renderer.work import ORDERS, SHOT, WORK
from service.errors import Invalid
from service.intake.names import plain_note, plain_title
from service.models.coded import Coded
from service.models.declared import with_fields
from service.models.notes import ReviewOut
from service.models.queue import QueueOptionsIn, QueueOut, QueuePatch
from service.models.strict import Strict

__all__ = [
    "EnvironmentIn",
    "FrameOut",
    "FrameState",
    "JobIn",
    "JobOut",
    "JobPatch",
    "ShotOut",
    "SkyIn",
    "TakenOut",
    "ViewModel",
]

FrameState = Literal["queued", "preparing", "running", "finished", "failed"]
JobState = Literal["queued", "running", "paused", "finished", "failed", "cancelled"]


MAX_VIEWS = 4000  # their JSON fits a request's body
_WHOLE_FRAMES = ("in-turn", "every-nth", "centre-out")  # orders that finish a frame before the next


# With a limit of length, pydantic also refuses surrogates, which no answer can name.
_CAMERA_NAME = TypeAdapter(Annotated[str, Field(max_length=1000)])


def _plain_text(value: str, field: str) -> str:
    try:
        return plain_title(value) if field == "name" else plain_note(value)
    except Invalid as error:
        raise ValueError(str(error).removeprefix(f"{field}: ")) from None


def _frames_text(value: str | int | float) -> str:
    """Validates the text of a frame range and returns it. Raises ValueError."""
    text = str(value).strip()
    try:
        if len(text) > 10_000:
            raise SettingsError(
                Sentence(
                    "frames-text-too-long",
                    "frames has {length} characters; at most 10000 characters and {most} frames are allowed",
                    length=len(text),
                    most=MAX_FRAMES,
                )
            )
        parse_frames(text)
    except SettingsError as error:
        raise ValueError(str(error)) from None
    return text


class DistortionIn(Strict):
    """A lens distortion, with OpenCV's coefficients in OpenCV's order: k1, k2, p1, p2, k3 ... k6, or of a fisheye k1 ... k4."""

    model: Literal["brown", "fisheye"]
    coefficients: list[float] = Field([], max_length=8)


@with_fields(VIEW)
class ViewModel(Strict):
    """A camera in world space; lengths in the scene's unit."""

    distortion: DistortionIn | None = Field(None, description="of a perspective camera without an aperture")

    @model_validator(mode="after")
    def _is_valid_view(self) -> ViewModel:
        try:
            View(**self.model_dump())
        except SettingsError as error:
            raise ValueError(str(error)) from None
        return self


class SkyIn(Strict):
    """A clear sky, given by the sun's direction in degrees: above the horizon, and clockwise from -Z seen from above (90: +X)."""

    elevation: float = Field(ge=-90.0, le=90.0)
    azimuth: float = Field(0.0, ge=-360.0, le=360.0)


@with_fields(ENVIRONMENT)
class EnvironmentIn(Strict):
    """Environment lighting that replaces the scene's: a constant linear RGB radiance, a sky, an image or a preset.

    With a scale factor and a rotation.
    """

    color: Vec3 | None = None
    sky: SkyIn | None = None
    image: str | None = Field(None, max_length=100, description="an uploaded environment's id: see /api/environments")
    preset: str | None = Field(None, json_schema_extra={"enum": [*PRESETS, None]}, description="light by name")

    @field_validator("preset")
    @classmethod
    def _is_known_preset(cls, value: str | None) -> str | None:
        if value is not None and value not in PRESETS:
            raise ValueError(
                Sentence(
                    "preset-unknown",
                    "there is no preset {name}; the presets are {presets}",
                    name=repr(value[:60]),
                    presets=[*PRESETS],
                )
            )
        return value

    @model_validator(mode="after")
    def _has_one_source(self) -> EnvironmentIn:
        given = [name for name in ("color", "sky", "image", "preset") if getattr(self, name) is not None]
        if len(given) > 1:
            raise ValueError(Sentence("fields-exclusive", "give only one of {fields}", fields=given))
        return self


@with_fields(SHOT)
@with_fields(WORK)
@with_fields({name: SETTINGS[name] for name in ("width", "height", *OPTIONAL)}, of_scene=True)
class JobIn(QueueOptionsIn):
    """A request to render a picture. Goals: spp, noise or seconds; the job ends when the first of them is reached."""

    scene: str = Field(description="a scene's id", max_length=100)
    name: str | None = Field(None, max_length=200)
    camera: str | Annotated[int, Field(ge=0, lt=MOST_CAMERAS)] | None = Field(
        None, description="a camera of the scene, by its name or number"
    )
    view: ViewModel | None = Field(None, description="a camera of your own, instead of `camera`")
    views: list[ViewModel] | None = Field(
        None,
        min_length=1,
        max_length=MAX_VIEWS,
        description="a camera of your own for each frame, in the frames' order, instead of `camera`; `frames` is then 0 to n - 1 "
        "unless told",
    )
    vary: Annotated[dict[str, Any], Field(max_length=6)] | Literal[False] | None = Field(
        None,
        description="how the scene varies from frame to frame, by seed: distributions of `objects`, `materials`, `lights` and "
        "`environment`; with `seed` and `every`. A job with `views` has the scene file's own `vary` unless told; false for none",
    )
    spp: int | None = None
    noise: float | None = None
    seconds: float | None = None
    tile_size: int | None = None
    priority: int = 0
    frames: str | int | float = Field("0", description="which frames of a shot, as 0-99 or 1-250x5,300; halves are frames too")
    frame: float | None = Field(None, description="one of them: a still of that moment, in place of `frames`")
    clip: str | None = Field(
        None, max_length=200, description="of a glTF file's animations, by name or number, or `all`; the first unless told"
    )
    fps: float | None = None
    turntable: float | None = None
    order: str | None = None
    every: int = 8
    environment: EnvironmentIn | None = None
    variant: str | None = Field(
        None,
        max_length=200,
        description="of the scene's materials, by name or number; empty: the file's own",
    )
    up: Literal["auto", "x", "y", "z", "-x", "-y", "-z"] | None = Field(
        None, description="which axis of an OBJ, PLY, STL or OFF file is up; `auto`: a guess; null: as the scene was uploaded"
    )
    floor: Literal["on", "auto", "off"] | None = Field(
        None,
        description="a floor below the scene that takes its shadows; `auto`: if the file has no light; null: as the scene was "
        "uploaded",
    )
    verify: float | None = Field(
        None, ge=0, le=1, description="the share of its batches that is rendered twice and compared; empty: as the farm does"
    )
    denoise: bool = Field(False, description="its pictures are shown and saved denoised first, once it is finished")
    strict: bool = Field(False, description="refused, or failed, where the scene has warnings")
    fresh: bool = Field(False, description="rendered from the first sample, whatever earlier jobs have of the same picture")

    @field_validator("camera", mode="before")
    @classmethod
    def _name_or_number(cls, value: Any) -> Any:
        if isinstance(value, str):
            return _CAMERA_NAME.validate_python(value)
        if value is None or (isinstance(value, int) and 0 <= value < MOST_CAMERAS):
            return value
        raise ValueError(Sentence("camera-not-name-or-number", "a camera is a name, or a number from 0"))

    @field_validator("name")
    @classmethod
    def _is_plain_name(cls, value: str | None) -> str | None:
        return None if value is None else _plain_text(value, "name")

    @field_validator("vary")
    @classmethod
    def _is_variation(cls, value: dict[str, Any] | Literal[False] | None) -> dict[str, Any] | Literal[False] | None:
        if value is not None and value is not False:
            try:
                Variation.parse(value)
            except SettingsError as error:
                raise ValueError(str(error)) from None
        return value

    @field_validator("frames")
    @classmethod
    def _frames(cls, value: str | int | float) -> str:
        return _frames_text(value)

    @field_validator("frame")
    @classmethod
    def _frame(cls, value: float | None) -> float | None:
        if value is not None and not (0 <= value <= MAX_FRAME and (2 * value).is_integer()):
            raise ValueError(
                Sentence(
                    "frame-invalid",
                    "{frame} is not a frame; give a number from 0 to {most}, in steps of a half",
                    frame=f"{value:g}",
                    most=MAX_FRAME,
                )
            )
        return value

    @model_validator(mode="after")
    def _one_camera(self) -> JobIn:
        if self.view is not None and self.camera is not None:
            raise ValueError(Sentence("fields-exclusive", "give only one of {fields}", fields=["camera", "view"]))
        if self.views is not None:
            self._check_views(self.views)
        if self.frame is not None and self.frames != "0":
            raise ValueError(Sentence("fields-exclusive", "give only one of {fields}", fields=["frame", "frames"]))
        if len(self.numbers()) > 1 and self.seconds and self.spp is None and self.noise is None and self.order in _WHOLE_FRAMES:
            raise ValueError(
                Sentence(
                    "order-needs-goal",
                    "order: {order} renders one frame after another; give spp or noise beside seconds",
                    order=self.order,
                )
            )
        return self

    def _check_views(self, views: list[ViewModel]) -> None:
        """Numbers the frames from 0 if none are named. Raises ValueError for a second camera, or if the counts differ."""
        for name in ("camera", "view", "turntable"):
            if getattr(self, name) is not None:
                raise ValueError(Sentence("fields-exclusive", "give only one of {fields}", fields=[name, "views"]))
        if self.frame is None and "frames" not in self.model_fields_set:
            self.frames = f"0-{len(views) - 1}"
        if (count := len(self.numbers())) != len(views):
            raise ValueError(
                Sentence(
                    "views-frames-differ",
                    "views has {views} views and there are {frames} frames; give one view for each frame",
                    views=len(views),
                    frames=count,
                )
            )

    def numbers(self) -> list[float]:
        """Returns the requested frame numbers."""
        return parse_frames(str(self.frames)) if self.frame is None else [self.frame]

    @property
    def is_shot(self) -> bool:
        """Returns True if the request is for a shot: for anything other than one still image of the scene's beginning."""
        if self.views is not None or self.vary:
            return True
        return self.numbers() != [0.0] or self.fps is not None or self.clip is not None or self.turntable is not None


Coordinate = Annotated[int, Field(ge=0, le=1 << 20)]
Focus = tuple[Coordinate, Coordinate, Annotated[int, Field(ge=1, le=1 << 20)], Annotated[int, Field(ge=1, le=1 << 20)]]


class JobPatch(QueuePatch):
    """The changeable fields of a job. Frames are given as in a request, such as 10-20 or 7,9."""

    state: Literal["running", "paused", "cancelled"] | None = None
    name: str | None = Field(None, max_length=200, description="what it is called; empty: as its scene")
    note: str | None = Field(
        None, max_length=2000, description="what there is to say about it, in lines of plain text; empty: none"
    )
    priority: int | None = Field(None, ge=-100, le=100)
    spp: int | None = Field(
        None,
        ge=1,
        le=MAX_SPP,
        description="samples in every pixel, whatever noise or time said; a finished job goes on",
    )
    more: int | None = Field(None, ge=1, le=MAX_SPP, description="as spp: so many more than now")
    frames: str | None = Field(None, description="of a shot: spp or more are for these frames alone")
    extend: str | None = Field(None, description="of a shot: these frames too")
    again: str | None = Field(None, description="of a shot: these frames anew, from nothing")
    first: float | None = Field(None, ge=-1.0, description="of a shot: this frame before all others; -1: none")
    order: str | None = Field(None, json_schema_extra={"enum": [*ORDERS, None]}, description="of a shot")
    focus: Focus | None = Field(None, description="x, y, w, h in pixels: rendered first, of a shot in every frame; null: no more")
    pinned: bool | None = Field(None, description="whether it is kept, whatever its age: its picture, and its scene's files")

    @property
    def is_of_frames(self) -> bool:
        """Returns True if the patch sets a field that only shots have."""
        return any(getattr(self, name) is not None for name in ("frames", "extend", "again", "first", "order"))

    @field_validator("name", "note")
    @classmethod
    def _check_plain_text(cls, value: str | None, field: ValidationInfo) -> str | None:
        return None if value is None else _plain_text(value, str(field.field_name))

    @field_validator("frames", "extend", "again")
    @classmethod
    def _frames(cls, value: str | None) -> str | None:
        return None if value is None else _frames_text(value)

    @field_validator("order")
    @classmethod
    def _check_order(cls, value: str | None) -> str | None:
        if value is not None and value not in ORDERS:
            raise ValueError(
                Sentence(
                    "order-unknown", "there is no order {name}; the orders are {orders}", name=repr(value[:60]), orders=[*ORDERS]
                )
            )
        return value


class BadSampleOut(BaseModel):
    """A sample that was NaN or infinite, and was therefore discarded."""

    x: int
    y: int
    sample: int
    reproduce: str = Field(description="a command that follows its path and prints it")


class FrameOut(Coded):
    """A frame of a job: its state, samples and noise."""

    number: int | float
    state: FrameState
    samples: int
    spp: float = Field(description="samples that it has, of a pixel on the average")
    bad_samples: int
    bad: list[BadSampleOut] = Field(description="the first of them; of a shot's frames at /api/jobs/{id}/frames/{n}")
    progress: float
    noise: float | None = Field(description="relative; of a shot's frames, from 8 samples on")
    error: str | None


class ShotOut(BaseModel):
    """A job with several frames: their timing, rendering order and states."""

    frames: str = Field(description="which there are, as 0-99,120")
    count: int
    fps: float | None = Field(description="null: the file's own, else 24")
    clip: str | None
    turntable: float | None
    order: str
    every: int
    first: int | float | None = Field(description="the frame that goes before all others")
    states: dict[FrameState, int] = Field(description="how many frames are so")
    failed: str = Field(description="the frames that failed, as 3,7-9")
    noise: float | None = Field(description="the greatest of its frames; null while that of one is not known")
    forecast: float | None = Field(description="the greatest that it is expected to end with")


class TakenOut(BaseModel):
    """Samples that a job reused at its start, from an earlier job of the same picture."""

    job: str = Field(description="from which it was taken, of a shot most of it; it may be deleted by now")
    spp: float = Field(description="samples that it had, of a pixel on the average; of a shot in the frames that were taken")
    samples: int | None = Field(None, description="of all pixels together; null: of a release before, which took stills alone")
    frames: str | None = Field(None, description="of a shot: the frames that were taken, whole or in part, as 0-99,120")


class JobOut(QueueOut):
    """A job with its settings, state and progress."""

    id: str
    scene: str
    project: str = Field(default="", description="its scene's: whose members see it; empty: everybody who is let in")
    name: str
    state: JobState
    message: str | None = Field(description="why it does not go on at the moment")
    stranded: bool = Field(description="begun by a kind of workers of which none is connected, while others are: see /anew")
    error: str | None
    reproduce: str | None = Field(description="a command that shows the error again")
    priority: int
    created: float
    started: float | None
    finished: float | None
    as_of: float = Field(
        default=0.0,
        description="when this was true, as Unix time; of two descriptions of a job the smaller is older",
    )
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
    focus: list[int] | None = Field(description="the rectangle that is rendered first: x, y, w, h")
    kind: str | None
    settings: dict[str, Any] | None
    environment: dict[str, Any] | None = Field(description="as it was asked for, and `name`: what the image is called")
    variant: str | None = Field(description="as it was asked for")
    up: str | None = Field(description="likewise")
    floor: str | None = Field(description="likewise")
    denoise: bool = Field(description="its pictures are shown and saved denoised first, once it is finished")
    pinned: bool = Field(description="kept, whatever its age")
    note: str | None = Field(description="what somebody wrote about it")
    review: ReviewOut | None = Field(default=None, description="null: it has neither notes nor a verdict")
    taken: TakenOut | None = Field(description="null: all of its samples were rendered for it")
    doubted: list[str] = Field(
        description="workers that were found out since to render something else than others, and whose samples it holds: "
        "set it to running to have those rendered again"
    )
    frames: list[FrameOut] = Field(description="of a shot only its first: all are at /api/jobs/{id}/frames")
    shot: ShotOut | None = Field(description="null: a still")
