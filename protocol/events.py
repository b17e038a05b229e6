"""Declarations of the RESULTS stream's events: the JSON that workers send about their work, by `type`.

service/scheduling/incoming/messages.py validates them; a test checks that it has exactly the fields declared here. Annotations
are not postponed here, since that would hide NotRequired from `__required_keys__`.
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
    """A batch was rendered. Its packed sums are attached."""

    parts: NotRequired[list[list[Any]]]


class BatchesRendered(_Rendered):
    """Consecutive batches of a tile were rendered, and their sums added together (joint.py).

    parts: (batch, first, count, seconds) of each batch; at a site, the name of the worker that rendered it follows.
    """

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
    """A worker could not render a batch because of a fault of the worker; the batch is dispatched again. error: a sentence."""

    error: str
    for_cpu: NotRequired[bool]  # whether only a graphics card cannot render it (card.py)


class BatchFailed(_Batch):
    """A batch cannot be rendered because of the scene or its settings. error: a sentence."""

    error: str
    reproduce: NotRequired[str | None]  # command
    trace: NotRequired[str]


class _Work(TypedDict):
    work: str
    worker: str


class WorkMade(_Work):
    """A result other than a batch was computed and stored as a blob: motion vectors, or the thumbnail of an environment."""

    sha256: str


class Denoised(WorkMade):
    """A frame was denoised and stored as a blob.

    version, samples: of the means that were denoised, repeated from the service's request.
    """

    version: str
    samples: int


class WorkFailed(_Work):
    """A result other than a batch cannot be computed: a denoised frame, motion vectors, or a thumbnail.

    unfit: only this machine cannot compute it; another may succeed.
    """

    error: str
    unfit: NotRequired[bool]


class PrepareStarted(TypedDict):
    """A worker has started to prepare a scene."""

    scene: str
    kind: str
    worker: str


class PrepareProgress(PrepareStarted):
    """Progress of preparing a scene: the current step, and the fraction done from 0 to 1."""

    step: str
    fraction: float
    preview: NotRequired[dict[str, Any]]  # once the scene was read: contract.ScenePreview


class Prepared(PrepareStarted):
    """A scene was prepared. info: contract.SceneInfo."""

    info: dict[str, Any]


class ThumbnailMade(PrepareStarted):
    """The thumbnail of a prepared scene is stored. thumbnail: contract.BlobRef."""

    thumbnail: dict[str, Any]


class PrepareFailed(PrepareStarted):
    """A scene cannot be prepared. error: a sentence."""

    error: str


class PrepareReturned(PrepareFailed):
    """A worker could not prepare a scene because of a fault of the worker; the scene is sent again.

    unfit: this machine cannot prepare the scene, but another may. passing: the fault is temporary.
    """

    unfit: NotRequired[bool]
    passing: NotRequired[bool]


class _Frames(TypedDict):
    work: str
    job: str
    kind: str
    worker: str


class FramePrepared(_Frames):
    """A frame of a shot was prepared. info: contract.FrameInfo."""

    frame: int
    info: dict[str, Any]


class FrameFailed(_Frames):
    """A frame of a shot cannot be prepared. error: a sentence."""

    frame: int
    error: str


class FramesReturned(_Frames):
    """A worker could not prepare some frames because of a fault of the worker.

    The frames that it has not answered are sent again. unfit, passing: as in PrepareReturned.
    """

    error: str
    unfit: NotRequired[bool]
    passing: NotRequired[bool]


class Wake(TypedDict):
    """An event without data that only wakes the service's engine."""


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
