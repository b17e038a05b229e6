"""Events of the RESULTS stream, declared: the JSON that a worker sends about its work, by `type`.

service/scheduling/incoming/messages.py validates them; a test holds that it knows the fields declared here, and no others.
Annotations are not postponed here, as that would hide NotRequired from `__required_keys__`.
"""

from typing import Any, NotRequired, TypedDict

__all__ = ["EVENTS"]


class _Batch(TypedDict):
    batch: str
    job: str
    frame: int  # in halves
    tile: list[int]  # x, y, width, height
    first: int
    count: int
    worker: str
    lines: NotRequired[list[str]]  # warnings of the slot
    took: NotRequired[dict[str, float]]  # seconds of each step


class _Rendered(TypedDict):
    seconds: NotRequired[float]
    bad: NotRequired[list[list[int]]]  # NaN and infinite samples: x, y, sample
    bad_count: NotRequired[int]
    traceparents: NotRequired[list[str]]  # spans that it was rendered in


class BatchRendered(_Batch, _Rendered):
    """A batch is rendered; its packed sums are attached."""

    parts: NotRequired[list[list[Any]]]


class BatchesRendered(_Rendered):
    """Consecutive batches of a tile, added up (joint.py): parts are batch, first, count, seconds, and at a site the worker."""

    batch: NotRequired[str]
    job: str
    frame: int
    tile: list[int]
    first: int
    count: int
    worker: str
    parts: list[list[Any]]
    lines: NotRequired[list[str]]
    took: NotRequired[dict[str, float]]


class BatchReturned(_Batch):
    """A failure of the worker, not of the scene: the batch is handed out again. error: a sentence."""

    error: str


class BatchFailed(BatchReturned):
    """A batch cannot be rendered."""

    reproduce: NotRequired[str | None]  # command
    trace: NotRequired[str]


class _Work(TypedDict):
    work: str
    worker: str


class WorkMade(_Work):
    """Motion vectors or the picture of an environment are stored as a blob."""

    sha256: str


class Denoised(WorkMade):
    """A denoised frame is stored as a blob. version, samples: of the means, as the service gave them."""

    version: str
    samples: int


class WorkFailed(_Work):
    """A frame cannot be denoised, or the like. unfit: its machine cannot do the work, another may."""

    error: str
    unfit: NotRequired[bool]


class PrepareStarted(TypedDict):
    """A worker prepares a scene."""

    scene: str
    kind: str
    worker: str


class PrepareProgress(PrepareStarted):
    """Progress of a preparation: a phrase, and a fraction from 0 to 1."""

    step: str
    fraction: float
    preview: NotRequired[dict[str, Any]]  # once the scene was read: contract.ScenePreview


class Prepared(PrepareStarted):
    """A scene is prepared. info: contract.SceneInfo."""

    info: dict[str, Any]


class ThumbnailMade(PrepareStarted):
    """The thumbnail of a prepared scene is stored. thumbnail: contract.BlobRef."""

    thumbnail: dict[str, Any]


class PrepareFailed(PrepareStarted):
    """A scene cannot be prepared. error: a sentence."""

    error: str


class PrepareReturned(PrepareFailed):
    """A failure of the worker: the scene is handed out again.

    unfit: its machine cannot do the work, another may. passing: only temporarily.
    """

    unfit: NotRequired[bool]
    passing: NotRequired[bool]


class _Frames(TypedDict):
    work: str
    job: str
    kind: str
    worker: str


class FramePrepared(_Frames):
    """A frame of a shot is prepared. info: contract.FrameInfo."""

    frame: int
    info: dict[str, Any]


class FrameFailed(_Frames):
    """A frame of a shot cannot be prepared. error: a sentence."""

    frame: int
    error: str


class FramesReturned(_Frames):
    """A failure of the worker: the unanswered frames are handed out again. unfit, passing: as in PrepareReturned."""

    error: str
    unfit: NotRequired[bool]
    passing: NotRequired[bool]


class Wake(TypedDict):
    """Wakes the service's engine; carries nothing."""


EVENTS: dict[str, Any] = {
    "batch": BatchRendered,
    "batches": BatchesRendered,
    "batch-failed": BatchFailed,
    "batch-returned": BatchReturned,
    "denoised": Denoised,
    "vectors-made": WorkMade,
    "environment-shown": WorkMade,
    "denoise-failed": WorkFailed,
    "vectors-failed": WorkFailed,
    "environment-failed": WorkFailed,
    "prepare-started": PrepareStarted,
    "prepare-progress": PrepareProgress,
    "prepared": Prepared,
    "thumbnail-made": ThumbnailMade,
    "prepare-failed": PrepareFailed,
    "prepare-returned": PrepareReturned,
    "frame-prepared": FramePrepared,
    "frame-failed": FrameFailed,
    "frames-returned": FramesReturned,
    "wake": Wake,
}
