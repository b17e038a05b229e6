"""Models of the messages from workers. Parsing an invalid message raises Unusable."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, replace
from typing import Annotated, Any, Literal, NamedTuple, TypeVar

from pydantic import BaseModel, Field, PlainValidator, TypeAdapter, ValidationError, field_validator, model_validator

from protocol.blends import converted_files
from protocol.contract import BlobRef, FrameInfo, SceneInfo, ScenePreview
from renderer.errors import SettingsError
from renderer.sentences import Sentence
from renderer.variation import Variation
from service.scheduling.fleet.reports import is_plain
from service.scheduling.incoming.results import Entry
from service.store.blobs import is_sha256

__all__ = [
    "SAME_RELEASE",
    "BatchDone",
    "BatchFailed",
    "BatchReturned",
    "DenoiseDone",
    "DenoiseFailed",
    "EnvironmentFailed",
    "EnvironmentShown",
    "FrameFailed",
    "FramePrepared",
    "FramesReturned",
    "Message",
    "PathGuideFailed",
    "PathGuideTrained",
    "PrepareDone",
    "PrepareFailed",
    "PrepareProgress",
    "PrepareReturned",
    "PrepareStarted",
    "ThumbnailMade",
    "Unusable",
    "VectorsFailed",
    "VectorsMade",
    "Wake",
    "parse_message",
]

SAME_RELEASE = Sentence(
    "advice-same-release", "Run the same release of Rayfarm on all machines."
)  # ends the error of a worker that does not understand a batch
DAY_S = 86400.0
MAX_SENTENCE_LENGTH = 20_000  # characters
MAX_STORED_NUMBER = 1 << 31  # limit of the numbers that a faulty worker may have stored
MAX_PIECES = 4096
MAX_BLOB_BYTES = 1 << 50  # bytes
Id = Annotated[str, Field(max_length=200, pattern=r"^[^\x00]*$")]


def _sentence(value: Any) -> str:
    """Validates a sentence in a message, and replaces its NUL characters. Preserves its code. Raises ValueError."""
    if not isinstance(value, str) or len(value) > MAX_SENTENCE_LENGTH:
        raise ValueError(f"not a text of at most {MAX_SENTENCE_LENGTH} characters")
    return value.mapped(_without_nul) if isinstance(value, Sentence) else _without_nul(value)


Info = TypeVar("Info", SceneInfo, FrameInfo)


def _with_warnings(info: Info, sent: Any) -> Info:
    """Returns `info` with the warnings of the sent message. Unlike the validated ones, these have their sentence codes."""
    warnings = sent["warnings"] if isinstance(sent, dict) else sent.warnings
    return replace(info, warnings=[_sentence(warning) for warning in warnings])


SentSentence = Annotated[str, PlainValidator(_sentence)]
Number = Annotated[int, Field(ge=0, le=MAX_STORED_NUMBER)]
Seconds = Annotated[float, Field(ge=0.0, le=DAY_S)]

MAX_TEXT_LENGTH = 1 << 16
MAX_DEPTH = 8  # nesting levels of lists and objects


class Unusable(ValueError):  # noqa: N818 - named as what it says
    """Raised for an invalid message. The text is the reason."""


Line = Annotated[str, Field(max_length=1000)]


class _Batch(BaseModel):
    batch: Id
    job: Id
    frame: Number
    tile: tuple[Number, Number, Number, Number]
    first: Number
    count: Annotated[int, Field(ge=1, le=MAX_STORED_NUMBER)]
    worker: Id = ""
    lines: Annotated[list[Line], Field(max_length=20)] = []  # warnings that the slot logged while rendering
    took: Annotated[dict[Id, float], Field(max_length=20)] = {}  # seconds of each rendering step

    @property
    def owner(self) -> str:
        """The id of the job to which the message belongs."""
        return self.job


class Piece(NamedTuple):
    """One of the consecutive batches of a tile whose sums a worker has added up."""

    batch: Id
    first: Number
    count: Annotated[int, Field(ge=1, le=MAX_STORED_NUMBER)]  # type: ignore[assignment]  # hides tuple.count, which is not used
    seconds: Seconds
    worker: Id = ""  # the worker that rendered it, if several contributed


class BatchDone(_Batch):
    """Message: a batch, or several consecutive batches of a tile, were rendered. Their sums are sent with it."""

    type: Literal["batch", "batches"]
    batch: Id = ""
    seconds: Seconds = 0.0
    parts: Annotated[list[Piece], Field(max_length=MAX_PIECES)] = []
    bad: Annotated[list[tuple[Number, Number, Number]], Field(max_length=MAX_PIECES)] = []
    bad_count: Number = 0
    traceparents: Annotated[
        list[Id], Field(max_length=MAX_PIECES)
    ] = []  # tracing spans in which it was rendered, if tracing is on

    @property
    def pieces(self) -> list[Piece]:
        """Returns the individual batches as they were dispatched, each with its rendering time and worker."""
        return self.parts or [Piece(self.batch, self.first, self.count, self.seconds)]

    @property
    def senders(self) -> tuple[str, ...]:
        """Returns the names of the workers that rendered the batches, without duplicates."""
        return tuple(self.shares)

    @property
    def shares(self) -> dict[str, int]:
        """Returns the number of samples per pixel of each worker that rendered the batches."""
        found: dict[str, int] = {}
        for piece in self.pieces:
            name = piece.worker or self.worker
            found[name] = found.get(name, 0) + piece.count
        return found

    @model_validator(mode="after")
    def _is_contiguous(self) -> BatchDone:
        end = self.first
        for piece in self.pieces:
            if piece.first != end:
                raise ValueError("its batches are not contiguous")
            end += piece.count
        if end != self.first + self.count or not all(piece.batch for piece in self.pieces):
            raise ValueError("its batches do not cover all of its samples")
        return self


class BatchFailed(_Batch):
    """Message: a batch could not be rendered."""

    type: Literal["batch-failed"]
    error: SentSentence
    reproduce: SentSentence | None = None
    trace: SentSentence = ""  # the last lines of the program's error output


class BatchReturned(_Batch):
    """Message: a worker sends back a batch because of a fault of its own, such as a lost connection or a full disk."""

    type: Literal["batch-returned"]
    error: SentSentence
    for_cpu: bool = False  # whether only a graphics card cannot render it (protocol.card)
    recalled: bool = False  # whether it was not begun when the service recalled its message


class _Artifact(BaseModel):
    work: Id
    worker: Id = ""

    @property
    def owner(self) -> str:
        """The id of the request to which the message belongs."""
        return self.work


class _ArtifactFailed(_Artifact):
    error: SentSentence
    unfit: bool = False  # the machine is the cause, so another worker may succeed


class DenoiseDone(_Artifact):
    """Message: a frame was denoised."""

    type: Literal["denoised"]
    sha256: Id
    version: Id
    samples: Annotated[int, Field(ge=0, lt=1 << 63)]
    seconds: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0  # that the denoiser took; 0 from earlier releases


class DenoiseFailed(_ArtifactFailed):
    """Message: a frame could not be denoised."""

    type: Literal["denoise-failed"]


class VectorsMade(_Artifact):
    """Message: a frame's motion vectors were computed."""

    type: Literal["vectors-made"]
    sha256: Id


class VectorsFailed(_ArtifactFailed):
    """Message: a frame's motion vectors could not be computed."""

    type: Literal["vectors-failed"]


class PathGuideTrained(_Artifact):
    """Message: a frame's path guide was trained."""

    type: Literal["path-guide-trained"]
    sha256: Id


class PathGuideFailed(_ArtifactFailed):
    """Message: a frame's path guide could not be trained."""

    type: Literal["path-guide-failed"]


class EnvironmentShown(_Artifact):
    """Message: the thumbnail of an uploaded environment image was made."""

    type: Literal["environment-shown"]
    sha256: Id


class EnvironmentFailed(_ArtifactFailed):
    """Message: an uploaded environment image cannot be used for lighting."""

    type: Literal["environment-failed"]


class _Prepare(BaseModel):
    scene: Id
    kind: Id
    worker: Id = ""

    @property
    def owner(self) -> str:
        """The id of the scene to which the message belongs."""
        return self.scene


class PrepareStarted(_Prepare):
    """Message: a worker has started to prepare a scene."""

    type: Literal["prepare-started"]


class PrepareProgress(_Prepare):
    """Message: progress of a scene's preparation. `fraction`: completed fraction, 0 to 1."""

    type: Literal["prepare-progress"]
    step: SentSentence
    fraction: float = Field(ge=0.0, le=1.0)
    preview: ScenePreview | None = None

    @field_validator("preview")
    @classmethod
    def _check_preview(cls, preview: ScenePreview | None) -> ScenePreview | None:
        if preview is not None:
            _check(preview.preview)
            _check_cameras(preview)
        return preview


class PrepareDone(_Prepare):
    """Message: a scene was prepared for a worker kind."""

    type: Literal["prepared"]
    info: SceneInfo

    @field_validator("info", mode="wrap")
    @classmethod
    def _without_nul_in_info(cls, info: Any, validated: Callable[[Any], SceneInfo]) -> SceneInfo:
        return _with_warnings(validated(_without_nul(info)), info)

    @field_validator("info")
    @classmethod
    def _check_info(cls, info: SceneInfo) -> SceneInfo:
        written = converted_files({"blend": info.blend})
        for blob in (info.compiled, info.thumbnail, info.preview, *(written[1] if written is not None else ())):
            _check(blob)
        _check_seconds(info.seconds)
        _check_plain(info)
        _check_cameras(info)
        if info.vary is not None:
            try:
                Variation.parse(info.vary)
            except SettingsError as error:
                raise ValueError(str(error)) from None
        return info

    @model_validator(mode="after")
    def _has_one_kind(self) -> PrepareDone:
        if self.info.kind != self.kind:
            raise ValueError(f"it is of workers of the kind {self.info.kind[:80]!r}")
        return self


class ThumbnailMade(_Prepare):
    """Message: the thumbnail of a prepared scene was made."""

    type: Literal["thumbnail-made"]
    thumbnail: BlobRef

    @field_validator("thumbnail")
    @classmethod
    def _check_thumbnail(cls, thumbnail: BlobRef) -> BlobRef:
        _check(thumbnail)
        return thumbnail


def _check_cameras(info: SceneInfo | ScenePreview) -> None:
    if not all(math.isfinite(value) for corner in info.bounds for value in corner):
        raise ValueError("bounds are not numbers")
    if not info.cameras:
        raise ValueError("no cameras; the last one frames the scene")
    for camera in info.cameras:
        if not isinstance(camera.get("name"), str) or not isinstance(camera.get("view"), dict):
            raise ValueError("a camera without a name or a view")


def _check(blob: BlobRef | None) -> None:
    for sha256, size in () if blob is None else ((blob.sha256, blob.size), *blob.parts):
        if not is_sha256(sha256):
            raise ValueError(f"{sha256[:80]!r} is not a hash")
        if not 0 <= size <= MAX_BLOB_BYTES:
            raise ValueError(f"{size} bytes is not a valid size")


def _check_seconds(seconds: float) -> None:
    if not 0.0 <= seconds <= DAY_S:
        raise ValueError(f"{seconds} s is not a valid duration")


def _without_nul(value: Any) -> Any:
    """Replaces NUL characters in all texts of a JSON value, since PostgreSQL cannot store them."""
    if isinstance(value, str):
        return value.replace("\0", "\ufffd")
    if isinstance(value, list):
        return [_without_nul(each) for each in value]
    return {_without_nul(key): _without_nul(each) for key, each in value.items()} if isinstance(value, dict) else value


def _check_plain(info: SceneInfo | FrameInfo) -> None:
    """Checks values that are stored as JSON and displayed. Raises ValueError.

    Numbers must be finite, and the lengths of texts and the depth of nesting are limited.
    """
    if not is_plain(asdict(info), MAX_DEPTH, MAX_TEXT_LENGTH):
        raise ValueError("a value that is not finite, too long or too deep")


class PrepareFailed(_Prepare):
    """Message: a scene cannot be prepared."""

    type: Literal["prepare-failed"]
    error: SentSentence


class PrepareReturned(_Prepare):
    """Message: a worker sends back a scene because of a fault of its own, such as a full disk.

    unfit: whether the worker's machine cannot prepare the scene. passing: whether the cause is temporary.
    """

    type: Literal["prepare-returned"]
    error: SentSentence
    unfit: bool = False
    passing: bool = False


class _Frames(BaseModel):
    work: Id
    job: Id
    kind: Id
    worker: Id = ""

    @property
    def owner(self) -> str:
        """The id of the job to which the message belongs."""
        return self.job


class FramePrepared(_Frames):
    """Message: a frame of a shot was prepared for a worker kind."""

    type: Literal["frame-prepared"]
    frame: Number
    info: FrameInfo

    @field_validator("info", mode="wrap")
    @classmethod
    def _storable(cls, info: Any, validated: Callable[[Any], FrameInfo]) -> FrameInfo:
        return _with_warnings(validated(_without_nul(info)), info)

    @field_validator("info")
    @classmethod
    def _check_info(cls, info: FrameInfo) -> FrameInfo:
        _check(info.compiled)
        _check_seconds(info.seconds)
        _check_plain(info)
        return info


class FrameFailed(_Frames):
    """Message: a frame of a shot cannot be prepared."""

    type: Literal["frame-failed"]
    frame: Number
    error: SentSentence


class FramesReturned(_Frames):
    """Message: a worker sends back the frames that it has not prepared.

    unfit: whether the worker's machine cannot prepare them. passing: whether the cause is temporary.
    """

    type: Literal["frames-returned"]
    error: SentSentence
    unfit: bool = False
    passing: bool = False


class Wake(BaseModel):
    """Empty message that ends the engine's wait for messages, because other work is pending."""

    type: Literal["wake"]
    owner: Literal[""] = ""


Message = (
    BatchDone
    | BatchFailed
    | BatchReturned
    | DenoiseDone
    | DenoiseFailed
    | PrepareStarted
    | PrepareProgress
    | PrepareDone
    | ThumbnailMade
    | PrepareFailed
    | PrepareReturned
    | FramePrepared
    | FrameFailed
    | FramesReturned
    | EnvironmentShown
    | EnvironmentFailed
    | VectorsMade
    | VectorsFailed
    | PathGuideTrained
    | PathGuideFailed
    | Wake
)
_MESSAGES: TypeAdapter[Message] = TypeAdapter(Annotated[Message, Field(discriminator="type")])


def parse_message(entry: Entry) -> Message:
    """Parses and validates the message in a stream entry. Raises Unusable."""
    if entry.result is None:
        raise Unusable(entry.fault)
    try:
        message = _MESSAGES.validate_python(entry.result.event)
    except ValidationError as error:
        raise Unusable("; ".join(f"{each['loc']}: {each['msg']}" for each in error.errors()[:3])) from None
    except Exception as error:  # an unexpected error of a validator
        raise Unusable(f"{type(error).__name__}: {error}") from error
    if isinstance(message, BatchDone) and entry.result.sums is None:
        raise Unusable(f"a batch of {message.worker} without its sums")
    return message
