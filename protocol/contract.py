"""Messages between the service and a worker. Tasks with ids and numbers go through Celery; sums and events return on a stream.

service --- Celery task PREPARE ------> worker     {scene}
service --- Celery task RENDER_BATCH -> worker     RenderBatch; RENDER_BATCHES: several of them, rendered in turn
service --- Celery task PREPARE_FRAMES > worker    PrepareFrames
service --- Celery task DENOISE ------> worker     DenoiseFrame
service --- Celery task VECTORS ------> worker     FrameVectors
service --- Celery task ENVIRONMENT --> worker     ShowEnvironment
service --- Celery task PATH_GUIDE ---> worker     TrainPathGuide
worker ---- stream RESULTS -----------> service    Result: an event and, for a rendered batch, its packed sums
worker ---- key worker_key(name) -----> service    WorkerReport, expires after HEARTBEAT_TTL_S
service --- key pause_key(name) ------> worker     the reason for a pause; without the key the worker takes tasks
service --- key recall_key(message) --> slot       while it exists, the slot returns the batches that it has not begun
worker ---- HTTP /api/farm/... -------> service    join, manifests, films' means, blobs (both ways), with a token

A worker that cannot reach Redis sends all of this through the service: channel.py.

Queue names contain the worker kind: only a worker of the job's kind (same renderer sources, same machine code) takes its
batches, so films of two kinds cannot mix. Imports no numba. For views see view_parts.py; for pixels, explained.py.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import MISSING, asdict, dataclass, field, fields, replace
from functools import lru_cache
from typing import Any, Literal

from renderer.errors import SettingsError
from renderer.sentences import Sentence, decoded, encoded
from renderer.settings import RenderSettings, Tile

__all__ = [
    "DENOISE",
    "ENVIRONMENT",
    "HEARTBEAT_EVERY_S",
    "HEARTBEAT_TTL_S",
    "PATH_GUIDE",
    "PREPARE",
    "PREPARE_FRAMES",
    "PREVIEW_GROWTH",
    "RENDER_BATCH",
    "RENDER_BATCHES",
    "RESULTS",
    "ROUGH_PREVIEW_GROWTH",
    "ROUGH_PREVIEW_SAMPLES",
    "SAMPLES_HEADER",
    "UNRESTED_PREVIEW_GROWTH",
    "VECTORS",
    "VERSION_HEADER",
    "WORKER_KEYS",
    "BlobRef",
    "DenoiseFrame",
    "FrameInfo",
    "FrameVectors",
    "GuideScene",
    "Manifest",
    "PrepareFrames",
    "RenderBatch",
    "Result",
    "SceneInfo",
    "ShowEnvironment",
    "TrainPathGuide",
    "WorkerReport",
    "denoise_queue",
    "home_camera",
    "pause_key",
    "prepare_queue",
    "recall_key",
    "render_queue",
    "worker_key",
]

PREPARE = "rayfarm.prepare"
PREPARE_FRAMES = "rayfarm.prepare_frames"
RENDER_BATCH = "rayfarm.render_batch"
RENDER_BATCHES = "rayfarm.render_batches"
DENOISE = "rayfarm.denoise"
VECTORS = "rayfarm.vectors"
ENVIRONMENT = "rayfarm.environment"
PATH_GUIDE = "rayfarm.path_guide"
RESULTS = "rayfarm:results"
WORKER_KEYS = "rayfarm:worker:*"
HEARTBEAT_EVERY_S, HEARTBEAT_TTL_S = 1.0, 6
VERSION_HEADER = "X-Film-Version"  # HTTP headers of a film's means: the film's version and its number of samples
SAMPLES_HEADER = "X-Samples"
# Fields of reports that are omitted if they have the default.
_LATER_FIELDS = (
    "cards",
    "has_card_queue",
    "cards_unused",
    "transport",
    "denoises_views",
    "views_on_cards",
    "drafts_views",
    "recalls",
    "trains_guides",
)
_settings_json = lru_cache(64)(RenderSettings.to_json)  # cached: a third of a message's cost, equal for all batches of a frame


def _without_vary(data: dict[str, Any]) -> dict[str, Any]:
    """Returns the JSON data of a request without `vary` if that is None, as in earlier releases."""
    return {name: value for name, value in data.items() if value is not None or name != "vary"}


def _fields(cls: type, data: Any) -> dict[str, Any]:
    """Returns those values in `data` that are fields of class `cls`. Drops other keys, which another release may send.

    Raises ValueError if a required field is missing.
    """
    if not isinstance(data, Mapping):
        raise ValueError(
            Sentence(
                "message-not-object", "{message} must be an object, not {type}", message=cls.__name__, type=type(data).__name__
            )
        )
    known = {f.name: f for f in fields(cls)}
    for name, f in known.items():
        if name not in data and f.default is MISSING and f.default_factory is MISSING:
            raise ValueError(Sentence("message-field-missing", "{message} lacks {field}", message=cls.__name__, field=repr(name)))
    return {name: value for name, value in data.items() if name in known}


def prepare_queue(kind: str) -> str:
    """Returns the Celery queue for preparing scenes on workers of this kind."""
    return f"rayfarm.prepare.{kind}"


def own_prepare_queue(kind: str, worker: str) -> str:
    """Returns the Celery queue for preparing scenes on the worker of this name only.

    It is used after workers on other machines could not prepare the scene.
    """
    return f"{prepare_queue(kind)}.of.{worker}"


def render_queue(kind: str) -> str:
    """Returns the Celery queue for batches of jobs of this kind."""
    return f"rayfarm.render.{kind}"


def denoise_queue(kind: str) -> str:
    """Returns the Celery queue for denoising, served by workers of this kind that have Open Image Denoise."""
    return f"rayfarm.denoise.{kind}"


def worker_key(name: str) -> str:
    """Returns the Redis key of a worker's report."""
    return f"rayfarm:worker:{name}"


def pause_key(name: str) -> str:
    """Returns the Redis key that pauses a worker while it exists. Its value is the reason, as a sentence."""
    return f"rayfarm:order:{name}"


def recall_key(message: str) -> str:
    """Returns the Redis key that recalls a message while it exists: its slot returns the batches that it has not begun."""
    return f"rayfarm:recall:{message}"


@dataclass(frozen=True)
class BlobRef:
    """Reference to a stored file: its path inside the upload ('' for derived files), the SHA-256 of its bytes, and its size.

    parts: hashes and sizes of the blobs that it depends on, if it is the manifest of a compiled scene.
    """

    path: str
    sha256: str
    size: int
    parts: tuple[tuple[str, int], ...] = ()

    @classmethod
    def from_json(cls, data: Any) -> BlobRef:
        """Parses the reference from the JSON of `dataclasses.asdict`. Raises ValueError."""
        ref = cls(**_fields(cls, data))
        if not (isinstance(ref.path, str) and isinstance(ref.sha256, str) and isinstance(ref.size, int)):
            raise ValueError(
                Sentence("message-blob-invalid", "{value} is not a reference to a stored file", value=repr(data)[:200])
            )
        return replace(ref, parts=tuple((str(sha256), int(size)) for sha256, size in ref.parts))


@dataclass(frozen=True)
class Manifest:
    """An uploaded scene: its files, the main file, a replacement environment, and the material variant of a glTF file.

    environment: path of an image among the files, or a preset's name (renderer.scene.presets.is_named). base: SceneInfo, as a
    dict, of the prepared scene that differs from this one only in its environment; None if there is none. up: the file's axis
    that becomes Y, for formats that do not state it; None: guessed. floor: "on" adds a floor below the scene, "auto" only if
    the files have no light.
    """

    scene: str
    main: str
    files: list[BlobRef]
    environment: str | None = None
    variant: str | None = None
    base: dict[str, Any] | None = None
    up: str | None = None
    floor: str | None = None

    @classmethod
    def from_json(cls, data: Any) -> Manifest:
        """Parses the manifest from its JSON. Raises ValueError."""
        known = _fields(cls, data)
        if not (isinstance(known["main"], str) and isinstance(known["files"], list)):
            raise ValueError(Sentence("message-manifest", "a Manifest must name the main file and list the files"))
        return cls(**{**known, "files": [BlobRef.from_json(f) for f in known["files"]]})

    def to_json(self) -> dict[str, Any]:
        """Returns the manifest as JSON data. Omits `up` and `floor` if they are None, as in earlier releases."""
        return {name: value for name, value in asdict(self).items() if value is not None or name not in ("up", "floor")}


@dataclass(frozen=True)
class SceneInfo:
    """Result of preparing a scene. `compiled` and `thumbnail` are blobs that the worker has stored at the service."""

    kind: str
    compiled: BlobRef
    thumbnail: BlobRef | None
    cameras: list[dict[str, Any]]  # renderer.scene.compile.camera_dicts; never empty: the last one frames the bounds
    counts: dict[str, int]  # triangles, spheres, materials, textures, lights, ...
    bounds: list[list[float]]  # lower and upper corner
    animations: list[str]
    warnings: list[str]
    defaults: dict[str, Any]  # settings that the scene file asks for
    seconds: float
    variants: list[str] = field(default_factory=list)
    fps: float = 24.0  # the file's own frames a second
    clips: list[dict[str, Any]] = field(default_factory=list)  # animations: name, start and end in seconds
    names: dict[str, list[str]] = field(default_factory=dict)  # of `objects` and `materials`, by number; of `light_groups`
    lights_power: float | None = None  # what its own lights send out: renderer.scene.relight needs it
    blend: dict[str, Any] | None = None  # files that Blender wrote: the name of `main`, and `files`, a BlobRef each
    preview: BlobRef | None = None  # a mesh (protocol/mesh.py) that a viewer draws until there are samples
    up_axis: str | None = None  # the axis of the file that became Y, if its format states none
    floor: bool = False  # whether the studio's floor was added
    vary: dict[str, Any] | None = None  # how the file says that views vary: renderer/variation.py

    @classmethod
    def from_json(cls, data: Any) -> SceneInfo:
        """Parses the info from the JSON of `dataclasses.asdict`. Raises ValueError."""
        known = _fields(cls, data)
        lists = ("cameras", "bounds", "animations", "warnings")
        if not (all(isinstance(known[name], list) for name in lists) and isinstance(known["counts"], dict)):
            raise ValueError(Sentence("message-field-types", "{message} has fields of wrong types", message=cls.__name__))
        if not all(isinstance(camera, dict) and {"name", "view"} <= camera.keys() for camera in known["cameras"]):
            raise ValueError(Sentence("message-cameras", "SceneInfo has cameras without a name or a view"))
        pictures = {name: BlobRef.from_json(known[name]) if known.get(name) else None for name in ("thumbnail", "preview")}
        stored = {"compiled": BlobRef.from_json(known["compiled"]), **pictures}
        return cls(**{**known, **stored})


def home_camera(cameras: list[dict[str, Any]]) -> int:
    """Returns the number of the camera by which a page and a thumbnail show a scene: the last one if the first sees nothing."""
    return len(cameras) - 1 if cameras[0].get("sees_nothing") else 0


@dataclass(frozen=True)
class ScenePreview:
    """Preview of a scene: the fields of SceneInfo from which viewers can draw it before it is compiled."""

    preview: BlobRef
    cameras: list[dict[str, Any]]
    bounds: list[list[float]]
    defaults: dict[str, Any]


@dataclass(frozen=True)
class PrepareFrames:
    """Request to prepare frames of a shot (an animated scene) in the given order. The worker sends one answer per frame.

    frames: keys of the frames: 2 * frame number, since frame numbers are multiples of 0.5 (renderer.frames.frame_key).
    """

    work: str  # unique for every time it is handed out
    job: str
    scene: str
    frames: list[int]
    base: str  # SHA-256 of the scene as it was compiled for its beginning
    base_auto: dict[str, Any]  # the view that frames it there
    fps: float | None = None  # these two: renderer.scene.animation.Moment
    clip: str | None = None
    camera: str | int | None = None  # by name or number
    view: dict[str, Any] | None = None  # one of the request's own, instead
    turntable: float | None = None  # seconds in which it goes around
    shutter: dict[str, Any] = field(default_factory=dict)  # requested shutter settings; the file's apply for missing ones
    vary: dict[str, Any] | None = None  # how the scene varies from frame to frame: renderer/variation.py

    @classmethod
    def from_json(cls, data: Any) -> PrepareFrames:
        """Parses the request from the JSON of `to_json`. Raises ValueError."""
        return cls(**_fields(cls, data))

    def to_json(self) -> dict[str, Any]:
        """Returns the request as JSON data. Omits `vary` if it is None, as in earlier releases."""
        return _without_vary(asdict(self))


@dataclass(frozen=True)
class FrameInfo:
    """Result of preparing a frame. compiled: the frame's compiled scene; None if it equals the one at the shot's start."""

    compiled: BlobRef | None
    view: dict[str, Any]
    defaults: dict[str, Any]  # settings that the scene file asks for
    warnings: list[str]
    seconds: float
    views: list[dict[str, Any]] = field(default_factory=list)  # of a camera that moves while the shutter is open

    @classmethod
    def from_json(cls, data: Any) -> FrameInfo:
        """Parses the info from the JSON of `dataclasses.asdict`. Raises ValueError."""
        known = _fields(cls, data)
        compiled = known["compiled"]
        return cls(**{**known, "compiled": BlobRef.from_json(compiled) if compiled else None})


@dataclass(frozen=True)
class RenderBatch:
    """A batch, the unit of work: samples first to first + count - 1 of every pixel of one tile of one frame.

    frame: the frame's key, which is 2 * frame number, since frame numbers are multiples of 0.5. compiled: SHA-256 of the
    compiled scene.
    """

    batch: str  # unique for every time it is handed out
    job: str
    frame: int
    compiled: str  # SHA-256 of the compiled scene's blob
    tile: Tile
    first: int
    count: int
    settings: RenderSettings
    packing: int = 1  # what the service understands of protocol.sums
    guide: str = ""  # SHA-256 of the frame's path guide (TrainPathGuide); "": the worker trains it, if the settings ask for one

    def to_json(self) -> dict[str, Any]:
        """Returns the batch as JSON data for the Celery message; without `guide` if there is none, as in earlier releases."""
        data = {**vars(self), "tile": list(self.tile), "settings": _settings_json(self.settings)}
        return data if self.guide else {name: value for name, value in data.items() if name != "guide"}

    @classmethod
    def from_json(cls, data: Any) -> RenderBatch:
        """Parses the JSON data from `to_json`. Raises ValueError, or SettingsError for settings unknown to this release."""
        known = _fields(cls, data)
        settings = RenderSettings.from_json(known["settings"])
        return cls(**{**known, "tile": Tile(*known["tile"]), "settings": settings})


VERSION_SEPARATOR = "+"
ROUGH_PREVIEW_SAMPLES = 64  # samples per pixel below which a preview is rough: renewed often, its guides taken as noisy
ROUGH_PREVIEW_GROWTH = 1.25  # of the samples after which a rough preview is renewed
PREVIEW_GROWTH = 2  # the same of other previews
UNRESTED_PREVIEW_GROWTH = 4  # after which a rough preview is renewed without a rest: at about 1, 4, 16 and 64 samples


@dataclass(frozen=True)
class GuideScene:
    """The scene of a frame that is denoised, from which a worker renders the denoiser's guide (renderer/denoise_guides.py).

    moment: of a frame of a shot, the request to compile it, if `own` is no longer stored; None: the scene is `compiled`.
    """

    kind: str  # of the workers for which the scene is compiled; others have no guide but the film's
    compiled: str  # SHA-256 of the compiled scene's blob; of a shot, of the scene at its beginning
    settings: RenderSettings
    moment: PrepareFrames | None = None
    own: str | None = None  # SHA-256 of the form compiled for the frame alone

    @classmethod
    def from_json(cls, data: Any) -> GuideScene:
        """Parses the JSON data from `to_json`. Raises ValueError, or SettingsError for settings unknown to this release."""
        known = _fields(cls, data)
        moment = known.get("moment")
        settings = RenderSettings.from_json(known["settings"])
        return cls(**{**known, "settings": settings, "moment": PrepareFrames.from_json(moment) if moment else None})

    def to_json(self) -> dict[str, Any]:
        """Returns the scene as JSON data."""
        moment = self.moment.to_json() if self.moment else None
        return {**vars(self), "settings": _settings_json(self.settings), "moment": moment}


@dataclass(frozen=True)
class DenoiseFrame:
    """Request to denoise a frame in its present state.

    The worker downloads the means of the frame's samples: three consecutive pictures (colour, albedo, normal). It stores the
    denoised picture as a blob. All pictures are float32 little-endian, three values per pixel, rows from the top.

    frames: of a shot, the frame and its neighbours in order, each with the blob of its motion vectors: the worker denoises all,
    and averages them along the vectors (renderer/temporal_denoise.py). Their means have the object and material planes behind
    them, one value per pixel. The version in its answer is theirs, joined by VERSION_SEPARATOR. Empty: the frame alone, as by
    workers of earlier releases.

    is_preview: of a frame that is being rendered: in a twelfth of the processor time, by one thread, with edges that are less
    sharp; a picture of ROUGH_PREVIEW_SAMPLES samples per pixel or more in a third.

    guide: the scene of a frame that is denoised alone and is no preview; the worker replaces the albedo by that behind mirrors
    and smooth glass. None, and for workers of earlier releases: the albedo of the film.

    lights: names of the frame's light groups, of which each is denoised in place of the colour. The means are then their lights,
    in this order, before the albedo; the blob has the rows of all of them for each row of pixels, so it can be mixed as it is
    read. Workers of earlier releases denoise the colour, and the service refuses their blob by its size.
    """

    work: str  # unique for every time it is handed out
    job: str
    frame: int
    width: int
    height: int
    frames: tuple[tuple[int, str], ...] = ()
    is_preview: bool = False
    guide: GuideScene | None = None
    lights: tuple[str, ...] = ()

    @classmethod
    def from_json(cls, data: Any) -> DenoiseFrame:
        """Parses the request from the JSON of `to_json`, without a guide that this release cannot read. Raises ValueError."""
        known = _fields(cls, data)
        frames = known.get("frames", ())
        if not all(isinstance(each, list | tuple) and len(each) == 2 for each in frames):
            raise ValueError(Sentence("message-denoise-frames", "frames must be pairs of a frame and a file"))
        guide = None
        with suppress(SettingsError, ValueError, KeyError, TypeError):
            guide = GuideScene.from_json(known["guide"])
        pairs = tuple((int(frame), str(sha256)) for frame, sha256 in frames)
        return cls(**{**known, "frames": pairs, "guide": guide, "lights": tuple(map(str, known.get("lights", ())))})

    def to_json(self) -> dict[str, Any]:
        """Returns the request as JSON data. Omits the optional fields where they are not set, as in earlier releases."""
        data = {**vars(self), "guide": self.guide.to_json() if self.guide else None}
        return {name: value for name, value in data.items() if value or name not in ("frames", "is_preview", "guide", "lights")}


@dataclass(frozen=True)
class FrameVectors:
    """Request for a frame's motion vectors (renderer/vectors.py).

    The worker stores them as a blob: float32 little-endian, four values per pixel, rows from the top.
    """

    work: str  # unique for every time it is handed out
    job: str
    frame: int
    scene: str
    width: int
    height: int
    auto: dict[str, Any]  # the view that frames the scene at its beginning
    fps: float | None = None  # these two: renderer.scene.animation.Moment
    clip: str | None = None
    camera: str | int | None = None  # by name or number
    view: dict[str, Any] | None = None  # one of the request's own, instead
    turntable: float | None = None  # seconds in which it goes around
    vary: dict[str, Any] | None = None  # as in PrepareFrames

    @classmethod
    def from_json(cls, data: Any) -> FrameVectors:
        """Parses the request from the JSON of `to_json`. Raises ValueError."""
        return cls(**_fields(cls, data))

    def to_json(self) -> dict[str, Any]:
        """Returns the request as JSON data. Omits `vary` if it is None, as in earlier releases."""
        return _without_vary(asdict(self))


@dataclass(frozen=True)
class ShowEnvironment:
    """Request for a thumbnail of an environment image. The worker stores a small JPEG as a blob."""

    work: str  # unique for every time it is handed out
    job: str  # no job but the environment's id: which one waits for it
    path: str  # what the image is called
    sha256: str
    size: int
    width: int  # of the picture, which is half as high
    height: int = 0
    frame: int = 0

    @classmethod
    def from_json(cls, data: Any) -> ShowEnvironment:
        """Parses the request from the JSON of `dataclasses.asdict`. Raises ValueError."""
        return cls(**_fields(cls, data))


@dataclass(frozen=True)
class TrainPathGuide:
    """Request to train a frame's path guide. The worker stores it as a blob (renderer/guiding/stored_guide.py)."""

    work: str  # unique for every time it is handed out
    job: str
    frame: int
    kind: str  # of the workers that render the frame
    compiled: str  # SHA-256 of the compiled scene
    settings: RenderSettings

    @property
    def width(self) -> int:
        """Width of the picture in pixels."""
        return self.settings.width

    @property
    def height(self) -> int:
        """Height of the picture in pixels."""
        return self.settings.height

    @classmethod
    def from_json(cls, data: Any) -> TrainPathGuide:
        """Parses the request from the JSON of `to_json`. Raises ValueError, or SettingsError for unknown settings."""
        known = _fields(cls, data)
        return cls(**{**known, "settings": RenderSettings.from_json(known["settings"])})

    def to_json(self) -> dict[str, Any]:
        """Returns the request as JSON data."""
        return {**vars(self), "settings": _settings_json(self.settings)}


@dataclass(frozen=True)
class WorkerReport:
    """A worker's heartbeat report, sent every HEARTBEAT_EVERY_S seconds."""

    name: str
    host: str
    pid: int
    slots: int
    cpu: str
    kind: str
    state: Literal["starting", "ready", "paused"]  # starting: joining, and loading its kernel; paused: takes no more tasks
    started: float  # unix time
    samples_per_s: float = 0.0  # of one slot, over its latest batches
    # A slot each: {}, {batch, message, job, frame, tile, first, count}, {scene}, {view, message}, or {denoise, vectors or
    # path_guide, frame}
    current: list[dict[str, Any]] = field(default_factory=list)
    denoises: bool = False  # whether it has Open Image Denoise
    frames: bool = False  # whether it prepares frames of shots: workers of before release 0.2 do not
    blurs: bool = False  # whether it prepares them with an open shutter
    vectors: bool = False  # whether it makes motion vectors
    several: bool = False  # whether it takes several batches in one message
    trains_guides: bool = False  # whether it trains path guides, and reads those of other workers
    recalls: bool = False  # whether it returns those that it has not begun when the service recalls the message
    views: bool = False  # whether it renders interactive views (protocol.view_parts)
    explains: bool = False  # whether it explains pixels (protocol.explained)
    denoises_views: bool = False  # whether it denoises interactive views
    adds: bool = False  # whether its slots share a tile, and add up its sums (protocol.joint)
    in_hand: list[str] = field(default_factory=list)  # messages of which something waits on the machine, beside `current`
    # Graphics cards with which slots render: {number, name, memory: bytes, capability: "8.6", slot, samples_per_s}
    cards: list[dict[str, Any]] = field(default_factory=list)
    has_card_queue: bool = False  # whether all its slots have cards: it takes batches from its own queue alone (protocol.card)
    views_on_cards: bool = False  # whether its cards render parts of views (protocol.view_parts.card_view_queue)
    drafts_views: bool = False  # whether these cards make drafts of views
    cards_unused: list[str] = field(default_factory=list)  # why other cards are not used (renderer.sentences.to_text)
    transport: Literal["", "https"] = ""  # how it reaches the queue: "": Redis; https: through the service (protocol/channel.py)

    def to_bytes(self) -> bytes:
        """Serializes the report as JSON for the worker's key.

        For a worker without graphics cards that uses Redis, the JSON is as in earlier releases.
        """
        return json.dumps({name: value for name, value in asdict(self).items() if value or name not in _LATER_FIELDS}).encode()

    @classmethod
    def from_bytes(cls, data: bytes) -> WorkerReport:
        """Parses a report from `to_bytes` of this or another release. Raises ValueError if it is malformed."""
        try:
            report = cls(**_fields(cls, json.loads(data)))
        except (TypeError, RecursionError) as error:
            raise ValueError(Sentence("message-report", "the report of a worker is malformed ({error})", error=error)) from None
        texts = (report.name, report.host, report.cpu, report.kind, report.state)
        numbers = (report.pid, report.slots, report.started, report.samples_per_s)
        if not (
            all(isinstance(text, str) for text in texts)
            and all(isinstance(number, (int, float)) for number in numbers)
            and isinstance(report.current, list)
            and all(isinstance(doing, dict) for doing in report.current)
            and report.state in ("starting", "ready", "paused")
        ):
            raise ValueError(Sentence("message-field-types", "{message} has fields of wrong types", message=cls.__name__))
        return report


@dataclass(frozen=True)
class Result:
    """One entry of the RESULTS stream: Redis fields `event` (JSON) and, for a rendered batch, `sums`.

    The event's `type` and other keys are declared in events.py. Sentences in the event are sent as English text. Its key
    `codes` has their translatable codes (renderer.sentences.encoded); other releases ignore it.
    """

    event: dict[str, Any]
    sums: bytes | None = None

    def to_fields(self) -> dict[bytes, bytes]:
        """Returns the fields for XADD."""
        fields = {b"event": json.dumps(encoded(self.event)).encode()}
        if self.sums is not None:
            fields[b"sums"] = self.sums
        return fields

    @classmethod
    def from_fields(cls, fields: dict[bytes, bytes]) -> Result:
        """Parses the fields that `to_fields` returned."""
        return cls(decoded(json.loads(fields[b"event"])), fields.get(b"sums"))
