"""Declarations of the RESULTS stream's events, by which workers report their work: the JSON fields of each `type`.

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

    parts: for each batch (id, first sample, number of samples, seconds). At a site, the name of the worker that rendered it
    follows.
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
    """A worker gives a batch back because of a fault of the worker. The batch is dispatched again. error: a sentence.

    for_cpu: whether a graphics card could not render it, so CPU slots must.
    """

    error: str
    for_cpu: NotRequired[bool]  # whether only a graphics card cannot render it (card.py)
    recalled: NotRequired[bool]  # whether it was not begun when the service recalled its message


class BatchFailed(_Batch):
    """A batch cannot be rendered because of the scene or its settings. error: a sentence."""

    error: str
    reproduce: NotRequired[str | None]  # command
    trace: NotRequired[str]


class _Work(TypedDict):
    work: str
    worker: str


class WorkMade(_Work):
    """An artifact was made and stored as a blob: motion vectors, the thumbnail of an environment, or a path guide."""

    sha256: str


class Denoised(WorkMade):
    """A frame was denoised and stored as a blob. version, samples: version and number of samples of the film at that time.

    seconds: duration of the denoising.
    """

    version: str
    samples: int
    seconds: float


class WorkFailed(_Work):
    """An artifact cannot be made: a denoised frame, motion vectors, a thumbnail, or a path guide.

    unfit: whether only this machine cannot make it, so another may succeed.
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
    """A worker gives a scene back because of a fault of the worker. The scene is sent again, to this or another worker.

    unfit: whether this machine cannot prepare the scene, so another may succeed. passing: whether the fault is temporary.
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
    """A worker gives frames back because of a fault of the worker. The frames that it has not answered are sent again.

    unfit: whether this machine cannot prepare them, so another may succeed. passing: whether the fault is temporary.
    """

    error: str
    unfit: NotRequired[bool]
    passing: NotRequired[bool]


class Wake(TypedDict):
    """An event without data. It makes the service's engine read the stream at once."""


EVENTS: dict[str, Any] = {
    "batch": BatchRendered,
    "batches": BatchesRendered,
    "batch-failed": BatchFailed,
    "batch-returned": BatchReturned,
    "denoised": Denoised,
    "vectors-made": WorkMade,
    "environment-shown": WorkMade,
    "path-guide-trained": WorkMade,
    "denoise-failed": WorkFailed,
    "vectors-failed": WorkFailed,
    "environment-failed": WorkFailed,
    "path-guide-failed": WorkFailed,
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
