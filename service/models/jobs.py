"""Request and response models of the API, as documented by OpenAPI."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, Field, TypeAdapter, ValidationInfo, field_validator, model_validator

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
    "Floor",
    "FrameOut",
    "FrameState",
    "JobIn",
    "JobOut",
    "JobPatch",
    "PresetName",
    "ShotOut",
    "SkyIn",
    "TakenOut",
    "Up",
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

    model: Literal["brown", "fisheye"] = Field(description="`brown` for ordinary lenses, `fisheye` for fisheye lenses")
    coefficients: list[float] = Field([], max_length=8, description="OpenCV's coefficients, in OpenCV's order")


@with_fields(VIEW)
class ViewModel(Strict):
    """A camera in world space; lengths in the scene's unit."""

    distortion: DistortionIn | None = Field(None, description="lens distortion; only for perspective cameras without an aperture")

    @model_validator(mode="after")
    def _is_valid_view(self) -> ViewModel:
        try:
            View(**self.model_dump())
        except SettingsError as error:
            raise ValueError(str(error)) from None
        return self


class SkyIn(Strict):
    """A clear sky, given by the sun's direction in degrees: above the horizon, and clockwise from -Z seen from above (90: +X)."""

    elevation: float = Field(ge=-90.0, le=90.0, description="degrees of the sun above the horizon")
    azimuth: float = Field(0.0, ge=-360.0, le=360.0, description="degrees clockwise from -Z, seen from above; 90: +X")


def _known_preset(name: str) -> str:
    if name not in PRESETS:
        raise ValueError(
            Sentence(
                "preset-unknown",
                "there is no preset {name}; the presets are {presets}",
                name=repr(name[:60]),
                presets=[*PRESETS],
            )
        )
    return name


PresetName = Annotated[str, AfterValidator(_known_preset)]
Up = Literal["auto", "x", "y", "z", "-x", "-y", "-z"]
Floor = Literal["on", "auto", "off"]


@with_fields(ENVIRONMENT)
class EnvironmentIn(Strict):
    """Environment lighting that replaces the scene's: a constant linear RGB radiance, a sky, an image or a preset.

    With a scale factor and a rotation.
    """

    color: Vec3 | None = None
    sky: SkyIn | None = Field(None, description="a clear sky with a sun")
    image: str | None = Field(None, max_length=100, description="id of an uploaded environment: see /api/environments")
    preset: PresetName | None = Field(None, json_schema_extra={"enum": [*PRESETS, None]}, description="name of a preset")

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

    scene: str = Field(description="id of the scene", max_length=100)
    name: str | None = Field(
        None, max_length=200, description="null: the name of the scene, with a number if it has jobs of that name"
    )
    camera: str | Annotated[int, Field(ge=0, lt=MOST_CAMERAS)] | None = Field(
        None, description="name or number of a camera of the scene"
    )
    view: ViewModel | None = Field(None, description="a camera in place of `camera`")
    views: list[ViewModel] | None = Field(
        None,
        min_length=1,
        max_length=MAX_VIEWS,
        description="a camera for each frame, in place of `camera`; `frames` is then 0 to n - 1 by default",
    )
    vary: Annotated[dict[str, Any], Field(max_length=6)] | Literal[False] | None = Field(
        None,
        description="how the scene varies from frame to frame, by seed: distributions of `objects`, `materials`, `lights` and "
        "`environment`; with `seed` and `every`. A job with `views` has the scene file's own `vary` by default; false for none",
    )
    spp: int | None = None
    noise: float | None = None
    seconds: float | None = None
    tile_size: int | None = None
    priority: int = 0
    frames: str | int | float = Field("0", description="frames of a shot, such as `0-99` or `1-250x5,300`; multiples of a half")
    frame: float | None = Field(None, description="a single frame, in place of `frames`")
    clip: str | None = Field(
        None, max_length=200, description="name or number of one of the file's animations, or `all`; the first by default"
    )
    fps: float | None = None
    turntable: float | None = None
    order: str | None = None
    every: int = 8
    environment: EnvironmentIn | None = Field(None, description="null: the environment of the scene")
    variant: str | None = Field(
        None,
        max_length=200,
        description="name or number of a variant of the scene's materials; empty: the file's own materials",
    )
    up: Up | None = Field(None, description="up axis of an OBJ, PLY, STL or OFF file; `auto`: guessed; null: as uploaded")
    floor: Floor | None = Field(
        None,
        description="a floor below the scene that takes its shadows; `auto`: if the file has no light; null: as uploaded",
    )
    verify: float | None = Field(
        None, ge=0, le=1, description="share of the batches that is rendered twice and compared; null: the farm's setting"
    )
    denoise: bool = Field(False, description="whether the page shows and saves denoised pictures by default")
    exposure: float = Field(
        0.0, ge=-32, le=32, allow_inf_nan=False, description="stops by which the page brightens the picture by default"
    )
    tonemap: str = Field("neutral", max_length=400, description="tone curve with which the page shows the picture by default")
    strict: bool = Field(False, description="whether warnings of the scene are errors")
    fresh: bool = Field(False, description="whether to render from the first sample, without reusing samples of earlier jobs")

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

    state: Literal["running", "paused", "cancelled"] | None = Field(
        None, description="`running` starts or resumes the job, `paused` and `cancelled` stop it"
    )
    name: str | None = Field(None, max_length=200, description="empty: the name of the scene")
    note: str | None = Field(None, max_length=2000, description="plain text, also of several lines; empty: none")
    priority: int | None = Field(None, ge=-100, le=100, description="jobs with a higher priority are rendered first")
    spp: int | None = Field(
        None,
        ge=1,
        le=MAX_SPP,
        description="samples per pixel; replaces goals of noise and time, and continues a finished job",
    )
    more: int | None = Field(None, ge=1, le=MAX_SPP, description="samples per pixel in addition to the present ones")
    frames: str | None = Field(None, description="shots: the frames to which `spp` or `more` applies; all by default")
    extend: str | None = Field(None, description="shots: frames to add")
    again: str | None = Field(None, description="shots: frames to render again from the first sample")
    first: float | None = Field(None, ge=-1.0, description="shots: the frame to render before all others; -1: none")
    order: str | None = Field(None, json_schema_extra={"enum": [*ORDERS, None]}, description="shots: order of the frames")
    focus: Focus | None = Field(
        None, description="rectangle x, y, w, h in pixels to render first, in every frame of a shot; null: none"
    )
    pinned: bool | None = Field(None, description="whether retention rules keep the job's film and its scene's files")

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

    x: int = Field(description="column of the pixel, from the left")
    y: int = Field(description="row of the pixel, from the top")
    sample: int = Field(description="number of the sample within the pixel, from 0")
    reproduce: str = Field(description="command that traces the sample again and prints its path")


class FrameOut(Coded):
    """A frame of a job: its state, samples and noise."""

    number: int | float = Field(description="number of the frame; 0 for a still")
    state: FrameState = Field(description="state of the frame")
    samples: int = Field(description="samples over all pixels")
    spp: float = Field(description="mean number of samples per pixel")
    bad_samples: int = Field(description="NaN and infinite samples, which are left out")
    bad: list[BadSampleOut] = Field(description="the first bad samples; of shots only at /api/jobs/{id}/frames/{n}")
    progress: float = Field(description="0 to 1")
    noise: float | None = Field(description="relative standard error; of a shot's frames from 8 samples on")
    error: str | None = Field(description="why the frame failed; null: it did not")
    denoised: bool = Field(
        description="whether a denoised picture or preview of it is stored; in a job, and at /api/jobs/{id}/frames/{n}",
    )


class ShotOut(BaseModel):
    """A job with several frames: their timing, rendering order and states."""

    frames: str = Field(description="the frames, such as 0-99,120")
    count: int = Field(description="number of frames")
    fps: float | None = Field(description="frames per second; null: the file's frame rate, or 24")
    clip: str | None = Field(description="animation that is played; null: the file's first")
    turntable: float | None = Field(
        description="degrees by which the camera turns around the scene over the whole shot; null: it does not turn"
    )
    order: str = Field(description="order in which frames are rendered")
    every: int = Field(description="step of the order `every-nth`")
    first: int | float | None = Field(description="the frame that is rendered before all others")
    states: dict[FrameState, int] = Field(description="number of frames in each state")
    failed: str = Field(description="the failed frames, such as 3,7-9")
    noise: float | None = Field(description="maximum over the frames; null while one is unknown")
    forecast: float | None = Field(description="expected `noise` at the end")


class TakenOut(BaseModel):
    """Samples that a job reused at its start, from an earlier job of the same picture."""

    job: str = Field(description="id of the earlier job, of a shot the one with the most reused samples; it may be deleted")
    spp: float = Field(description="mean number of reused samples per pixel, of a shot in the reused frames")
    samples: int | None = Field(None, description="reused samples over all pixels; null in records of older releases")
    frames: str | None = Field(None, description="shots: frames with reused samples, such as 0-99,120")


class JobOut(QueueOut):
    """A job with its settings, state and progress."""

    id: str = Field(description="id of the job")
    scene: str = Field(description="id of the scene")
    project: str = Field(default="", description="project of the scene; empty: visible to all users")
    name: str = Field(description="name of the job")
    state: JobState = Field(description="state of the job")
    message: str | None = Field(description="why the job does not progress at present")
    stranded: bool = Field(description="whether no connected worker is of the kind that began the job: see /anew")
    error: str | None = Field(description="why the job failed; null: it did not")
    reproduce: str | None = Field(description="command that reproduces the error")
    priority: int = Field(description="jobs with a higher priority are rendered first")
    created: float = Field(description="Unix time in seconds")
    started: float | None = Field(description="Unix time of the first sample's dispatch; null: not started")
    finished: float | None = Field(description="Unix time of the end; null: not ended")
    as_of: float = Field(
        default=0.0,
        description="Unix time of this description; of two descriptions of a job, the one with the larger value is newer",
    )
    active_s: float = Field(description="wall-clock time spent on rendering")
    elapsed_s: float = Field(
        description="wall-clock time until the picture is as requested: active_s, and of a finished still with `denoise` "
        "the time from the request for its denoised picture until that is stored, or until now"
    )
    progress: float = Field(description="0 to 1")
    eta_s: float | None = Field(description="expected seconds until the end; null: unknown")
    samples: int = Field(description="samples in the film, over all pixels and frames")
    samples_per_s: float = Field(description="samples per second at present, over all slots")
    bad_samples: int = Field(description="NaN and infinite samples, which are left out")
    width: int | None = Field(description="picture width in pixels")
    height: int | None = Field(description="picture height in pixels")
    spp: int | None = Field(description="goal: samples per pixel; null: none")
    noise: float | None = Field(description="goal: relative noise; null: none")
    seconds: float | None = Field(description="goal: seconds of rendering; null: none")
    tile_size: int | None = Field(description="edge of a tile in pixels; null: chosen by the farm")
    focus: list[int] | None = Field(description="rectangle that is rendered first: x, y, w, h in pixels")
    kind: str | None = Field(
        description="renderer version and processor kind of the workers that render the job; null: not started"
    )
    settings: dict[str, Any] | None = Field(description="render settings, as `POST /api/jobs` takes them")
    environment: dict[str, Any] | None = Field(description="environment, as requested; `name` is the image's name")
    variant: str | None = Field(description="material variant, as requested")
    up: str | None = Field(description="up axis, as requested")
    floor: str | None = Field(description="floor below the scene, as requested")
    denoise: bool = Field(description="whether the page shows and saves denoised pictures by default")
    exposure: float = Field(0.0, description="stops by which the page brightens the picture by default")
    tonemap: str = Field("neutral", description="tone curve with which the page shows the picture by default")
    pinned: bool = Field(description="whether retention rules keep the film and the scene's files")
    note: str | None = Field(description="note on the job, plain text")
    review: ReviewOut | None = Field(default=None, description="verdict and counts of notes; null: neither")
    taken: TakenOut | None = Field(description="reused samples; null: none")
    doubted: list[str] = Field(
        description="workers with samples in the film that have since failed verification: "
        "set the job to running to render those samples again"
    )
    frames: list[FrameOut] = Field(description="frames; of a shot only the first ones: `GET /api/jobs/{id}/frames` lists all")
    shot: ShotOut | None = Field(description="timing and states of a shot; null: a still")
