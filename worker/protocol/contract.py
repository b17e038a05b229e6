"""What the service and a worker say to each other. Ids and numbers go through Celery; sums and news come back on a stream.

    service --- Celery task PREPARE ------> worker     {scene}
    service --- Celery task RENDER_BATCH -> worker     RenderBatch; RENDER_BATCHES: some of them, to be rendered in turn
    service --- Celery task PREPARE_FRAMES > worker    PrepareFrames
    service --- Celery task DENOISE ------> worker     DenoiseFrame
    service --- Celery task VECTORS ------> worker     FrameVectors
    service --- Celery task ENVIRONMENT --> worker     ShowEnvironment
    worker ---- stream RESULTS -----------> service    Result: an event and, for a rendered batch, its packed sums
    worker ---- key worker_key(name) -----> service    WorkerReport, expires after HEARTBEAT_TTL_S
    service --- key order_key(name) ------> worker     why it is to take no more tasks; no key: it takes them
    worker ---- HTTP /api/farm/... -------> service    join, manifests, films' means, blobs (both ways), by FARM_TOKEN

Queues have the worker's kind in their name: only a worker of the job's kind (same renderer sources, same machine code) takes its
batches, so films of two kinds cannot mix. No numba in it. Of views: view_parts.py; of pixels: explained.py.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import MISSING, asdict, dataclass, field, fields, replace
from functools import lru_cache
from typing import Any, Literal

from renderer.settings import RenderSettings, Tile

__all__ = [
    "DENOISE",
    "ENVIRONMENT",
    "HEARTBEAT_EVERY_S",
    "HEARTBEAT_TTL_S",
    "PREPARE",
    "PREPARE_FRAMES",
    "RENDER_BATCH",
    "RENDER_BATCHES",
    "RESULTS",
    "SAMPLES_HEADER",
    "VECTORS",
    "VERSION_HEADER",
    "WORKER_KEYS",
    "BlobRef",
    "DenoiseFrame",
    "FrameInfo",
    "FrameVectors",
    "Manifest",
    "PrepareFrames",
    "RenderBatch",
    "Result",
    "SceneInfo",
    "ShowEnvironment",
    "WorkerReport",
    "denoise_queue",
    "order_key",
    "prepare_queue",
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
RESULTS = "rayfarm:results"
WORKER_KEYS = "rayfarm:worker:*"
HEARTBEAT_EVERY_S, HEARTBEAT_TTL_S = 1.0, 6
VERSION_HEADER = "X-Film-Version"  # with a film's means: which content they are of, and how many samples that has
SAMPLES_HEADER = "X-Samples"
_settings_json = lru_cache(64)(RenderSettings.to_json)  # a third of what a message costs, and the same for a frame's batches


def _fields(cls: type, data: Any) -> dict[str, Any]:
    """Of a message, what this release knows: the other end may be of another one, and say more. Raises ValueError."""
    if not isinstance(data, Mapping):
        raise ValueError(f"{cls.__name__} is an object, and not {type(data).__name__}")
    known = {f.name: f for f in fields(cls)}
    for name, f in known.items():
        if name not in data and f.default is MISSING and f.default_factory is MISSING:
            raise ValueError(f"{cls.__name__} lacks {name!r}")
    return {name: value for name, value in data.items() if name in known}


def prepare_queue(kind: str) -> str:
    """The Celery queue for preparing scenes on workers of this kind."""
    return f"rayfarm.prepare.{kind}"


def own_prepare_queue(kind: str, worker: str) -> str:
    """The Celery queue for preparing on one worker of this kind: for what the machines of others could not prepare."""
    return f"{prepare_queue(kind)}.of.{worker}"


def render_queue(kind: str) -> str:
    """The Celery queue for batches of jobs of this kind."""
    return f"rayfarm.render.{kind}"


def denoise_queue(kind: str) -> str:
    """The Celery queue for denoising, taken from by workers that have Open Image Denoise."""
    return f"rayfarm.denoise.{kind}"


def worker_key(name: str) -> str:
    """The Redis key under which a worker reports itself."""
    return f"rayfarm:worker:{name}"


def order_key(name: str) -> str:
    """The Redis key that pauses a worker while it is there; its value is a sentence that says why."""
    return f"rayfarm:order:{name}"


@dataclass(frozen=True)
class BlobRef:
    """A stored file: its path inside the upload ('' for derived ones), the SHA-256 of its bytes, and its size.

    parts: the hashes and sizes of the blobs that it needs beside itself, where it is the manifest of a compiled scene.
    """

    path: str
    sha256: str
    size: int
    parts: tuple[tuple[str, int], ...] = ()

    @classmethod
    def from_json(cls, data: Any) -> BlobRef:
        """The reference that `dataclasses.asdict` made JSON of. Raises ValueError."""
        ref = cls(**_fields(cls, data))
        if not (isinstance(ref.path, str) and isinstance(ref.sha256, str) and isinstance(ref.size, int)):
            raise ValueError(f"{data!r} refers to no blob")
        return replace(ref, parts=tuple((str(sha256), int(size)) for sha256, size in ref.parts))


@dataclass(frozen=True)
class Manifest:
    """A scene as uploaded: its files, which of them is the scene, what lights it in place of its own environment (an image
    among them, or a name: renderer.scene.presets.is_named), and the variant of a glTF file's materials that it shows.
    base: a SceneInfo as a dict, of the scene that differs from this one by light from around alone, where that is prepared."""

    scene: str
    main: str
    files: list[BlobRef]
    environment: str | None = None
    variant: str | None = None
    base: dict[str, Any] | None = None

    @classmethod
    def from_json(cls, data: Any) -> Manifest:
        """The manifest that `dataclasses.asdict` made JSON of. Raises ValueError."""
        known = _fields(cls, data)
        if not (isinstance(known["main"], str) and isinstance(known["files"], list)):
            raise ValueError("Manifest names a file, and lists its files")
        return cls(**{**known, "files": [BlobRef.from_json(f) for f in known["files"]]})


@dataclass(frozen=True)
class SceneInfo:
    """What preparing a scene found out. `compiled` and `thumbnail` are blobs that the worker has stored at the service."""

    kind: str
    compiled: BlobRef
    thumbnail: BlobRef | None
    cameras: list[dict[str, Any]]  # {name, view: renderer.settings.View}; never empty: the last one frames the bounds
    counts: dict[str, int]  # triangles, spheres, materials, textures, lights, ...
    bounds: list[list[float]]  # lower and upper corner
    animations: list[str]
    warnings: list[str]
    defaults: dict[str, Any]  # settings that the scene file asks for
    seconds: float
    variants: list[str] = field(default_factory=list)
    fps: float = 24.0  # the file's own frames a second
    clips: list[dict[str, Any]] = field(default_factory=list)  # of its animations: name, start and end in seconds
    names: dict[str, list[str]] = field(default_factory=dict)  # of `objects` and `materials`, in the order of their numbers
    lights_power: float | None = None  # what its own lights send out: renderer.scene.lit needs it
    blend: dict[str, Any] | None = None  # what Blender wrote of it: the name of the `main` file, and `files`, a BlobRef each

    @classmethod
    def from_json(cls, data: Any) -> SceneInfo:
        """The info that `dataclasses.asdict` made JSON of. Raises ValueError."""
        known = _fields(cls, data)
        lists = ("cameras", "bounds", "animations", "warnings")
        if not (all(isinstance(known[name], list) for name in lists) and isinstance(known["counts"], dict)):
            raise ValueError("SceneInfo has fields of other types")
        if not all(isinstance(camera, dict) and {"name", "view"} <= camera.keys() for camera in known["cameras"]):
            raise ValueError("SceneInfo has cameras without a name or a view")
        compiled, thumbnail = known["compiled"], known["thumbnail"]
        stored = {"compiled": BlobRef.from_json(compiled), "thumbnail": BlobRef.from_json(thumbnail) if thumbnail else None}
        return cls(**{**known, **stored})


@dataclass(frozen=True)
class PrepareFrames:
    """Frames of a shot to prepare, in this order, each answered by itself. Frames are in halves (renderer.frames.frame_key)."""

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
    shutter: dict[str, Any] = field(default_factory=dict)  # what is asked for of its settings; of the others the file's count

    @classmethod
    def from_json(cls, data: Any) -> PrepareFrames:
        """The wish that `dataclasses.asdict` made JSON of. Raises ValueError."""
        return cls(**_fields(cls, data))


@dataclass(frozen=True)
class FrameInfo:
    """What preparing a frame found out. compiled: what its scene is compiled to; None: to the same as at its beginning."""

    compiled: BlobRef | None
    view: dict[str, Any]
    defaults: dict[str, Any]  # settings that the scene file asks for
    warnings: list[str]
    seconds: float
    views: list[dict[str, Any]] = field(default_factory=list)  # of a camera that moves while the shutter is open

    @classmethod
    def from_json(cls, data: Any) -> FrameInfo:
        """The info that `dataclasses.asdict` made JSON of. Raises ValueError."""
        known = _fields(cls, data)
        compiled = known["compiled"]
        return cls(**{**known, "compiled": BlobRef.from_json(compiled) if compiled else None})


@dataclass(frozen=True)
class RenderBatch:
    """The unit of work: sample numbers first ... first + count - 1 of every pixel of a tile of a frame (in halves)."""

    batch: str  # unique for every time it is handed out
    job: str
    frame: int
    compiled: str  # SHA-256 of the compiled scene's blob
    tile: Tile
    first: int
    count: int
    settings: RenderSettings
    packing: int = 1  # what the service understands of worker.sums

    def to_json(self) -> dict[str, Any]:
        """A JSON-ready dict for the Celery message."""
        return {**vars(self), "tile": list(self.tile), "settings": _settings_json(self.settings)}

    @classmethod
    def from_json(cls, data: Any) -> RenderBatch:
        """The batch that `to_json` wrote. Raises ValueError, or SettingsError where it asks for what is not known here."""
        known = _fields(cls, data)
        settings = RenderSettings.from_json(known["settings"])
        return cls(**{**known, "tile": Tile(*known["tile"]), "settings": settings})


@dataclass(frozen=True)
class DenoiseFrame:
    """Ask for a frame as it is now to be denoised. The worker fetches its means, three pictures one behind the other (colour,
    albedo, normal), and stores the result, one, as a blob: float32 little-endian, three values a pixel, rows from the top."""

    work: str  # unique for every time it is handed out
    job: str
    frame: int
    width: int
    height: int

    @classmethod
    def from_json(cls, data: Any) -> DenoiseFrame:
        """The wish that `dataclasses.asdict` made JSON of. Raises ValueError."""
        return cls(**_fields(cls, data))


@dataclass(frozen=True)
class FrameVectors:
    """Ask for a frame's motion vectors (renderer/vectors.py), which the worker stores as a blob: float32 little-endian, four
    values a pixel, rows from the top."""

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

    @classmethod
    def from_json(cls, data: Any) -> FrameVectors:
        """The wish that `dataclasses.asdict` made JSON of. Raises ValueError."""
        return cls(**_fields(cls, data))


@dataclass(frozen=True)
class ShowEnvironment:
    """Ask for an image that lights scenes to be looked at: the worker stores a small picture of it as a blob, a JPEG."""

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
        """The wish that `dataclasses.asdict` made JSON of. Raises ValueError."""
        return cls(**_fields(cls, data))


@dataclass(frozen=True)
class WorkerReport:
    """A worker of itself, every HEARTBEAT_EVERY_S."""

    name: str
    host: str
    pid: int
    slots: int
    cpu: str
    kind: str
    state: Literal["starting", "ready", "paused"]  # starting: compiling or loading its kernels; paused: takes no more tasks
    started: float  # unix time
    samples_per_s: float = 0.0  # of one slot, over its latest batches
    # A slot each: {}, {batch, message, job, frame, tile, first, count}, {scene}, {denoise or vectors, frame} or {view, message}
    current: list[dict[str, Any]] = field(default_factory=list)
    denoises: bool = False  # whether it has Open Image Denoise
    frames: bool = False  # whether it prepares frames of shots: workers of before release 0.2 do not
    blurs: bool = False  # whether it prepares them with an open shutter
    vectors: bool = False  # whether it makes motion vectors
    several: bool = False  # whether it takes several batches in one message
    views: bool = False  # whether it renders views that somebody looks at (worker.view_parts)
    explains: bool = False  # whether it explains pixels (worker.explained)
    adds: bool = False  # whether its slots share a tile, and add up its sums (worker.joint)
    in_hand: list[str] = field(default_factory=list)  # messages of which something waits on the machine, beside `current`

    def to_bytes(self) -> bytes:
        """JSON for the worker's key."""
        return json.dumps(asdict(self)).encode()

    @classmethod
    def from_bytes(cls, data: bytes) -> WorkerReport:
        """The report that `to_bytes` wrote, here or in another release. Raises ValueError where it is none."""
        try:
            report = cls(**_fields(cls, json.loads(data)))
        except (TypeError, RecursionError) as error:
            raise ValueError(f"no report of a worker: {error}") from None
        texts = (report.name, report.host, report.cpu, report.kind, report.state)
        numbers = (report.pid, report.slots, report.started, report.samples_per_s)
        if not (
            all(isinstance(text, str) for text in texts)
            and all(isinstance(number, (int, float)) for number in numbers)
            and isinstance(report.current, list)
            and all(isinstance(doing, dict) for doing in report.current)
            and report.state in ("starting", "ready", "paused")
        ):
            raise ValueError("no report of a worker: its fields are of other types")
        return report


@dataclass(frozen=True)
class Result:
    """One entry of the RESULTS stream: Redis fields `event` (JSON) and, for a rendered batch, `sums`.

    type and the further keys of `event`:
        batch            batch, job, frame, tile, first, count, worker, seconds, bad: [[x, y, sample], ...], bad_count
        batches          worker.joint says of what
        batch-failed     batch, job, frame, tile, first, count, worker, error (a sentence), reproduce (a command), trace
        batch-returned   the same but for reproduce: the worker's own trouble, to be handed out again without blaming the scene
        denoised         work, worker, sha256 (of the blob), version and samples (of the means, as the service told them)
        vectors-made, environment-shown: the first three; denoise-, vectors-, environment-failed: work, worker, error (a sentence)
        prepare-started  scene, kind, worker
        prepare-progress scene, kind, step (a phrase), fraction 0..1
        prepared         scene, kind, worker, info: SceneInfo
        prepare-failed   scene, kind, worker, error (a sentence)
        prepare-returned the same, unfit, passing: the worker's own trouble, to be handed out again. unfit: its machine cannot do
                         it, another may; passing: for now
        frame-prepared   work, job, kind, worker, frame, info: FrameInfo
        frame-failed     work, job, kind, worker, frame, error (a sentence)
        frames-returned  work, job, kind, worker, error (a sentence), unfit, passing: those that are not answered, as above
    """

    event: dict[str, Any]
    sums: bytes | None = None

    def to_fields(self) -> dict[bytes, bytes]:
        """The fields to XADD."""
        fields = {b"event": json.dumps(self.event).encode()}
        if self.sums is not None:
            fields[b"sums"] = self.sums
        return fields

    @classmethod
    def from_fields(cls, fields: dict[bytes, bytes]) -> Result:
        """The result that `to_fields` wrote."""
        return cls(json.loads(fields[b"event"]), fields.get(b"sums"))
