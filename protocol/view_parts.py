"""Messages between the service and a worker about live views: interactive pictures without a job, which are not stored.

service --- Celery task RENDER_VIEW --> worker     ViewParts, in a queue that slots serve before all others
service --- Celery task VIEW_FRAME ---> worker     ViewFrame, in the same queue
service --- Celery task DENOISE_VIEW -> worker     ViewDenoise, in the same queue; the worker fetches the picture by HTTP
service --- key view_key(watch) ------> worker     the number of the current view; without the key nothing is viewed
worker ---- list VIEW_ANSWERS --------> service    ViewAnswer; the list expires if no service reads it

A slot compares the number before each part, and drops parts of an outdated view at once. Answers have a list of their own,
since a restarted service does not need them and they need not wait for results that are merged into films.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from protocol import json_head
from protocol.contract import PrepareFrames
from renderer.settings import RenderSettings, Tile

__all__ = [
    "ANSWERS_TTL_S",
    "CARD_VIEW_QUEUES",
    "CLEAN_GUIDE_SAMPLES",
    "DENOISE_VIEW",
    "MAX_ANSWERS",
    "RENDER_VIEW",
    "VIEW_ANSWERS",
    "VIEW_FRAME",
    "VIEW_QUEUES",
    "Part",
    "ViewAnswer",
    "ViewDenoise",
    "ViewFrame",
    "ViewParts",
    "card_view_queue",
    "view_key",
    "view_queue",
]

RENDER_VIEW = "rayfarm.render_view"
VIEW_FRAME = "rayfarm.view_frame"
DENOISE_VIEW = "rayfarm.denoise_view"
VIEW_ANSWERS = "rayfarm:view-answers"
VIEW_QUEUES = "rayfarm.view."
CARD_VIEW_QUEUES = "rayfarm.card-view."
ANSWERS_TTL_S = 20
MAX_ANSWERS = 1000  # in the list: the oldest go, and are asked for again
MAX_PART_S = 3600.0
CLEAN_GUIDE_SAMPLES = 16  # samples per pixel from which a denoiser takes albedo and normal as free of noise


def view_queue(kind: str) -> str:
    """Returns the Celery queue for live views. Workers of this kind serve it before all other queues."""
    return f"{VIEW_QUEUES}{kind}"


def card_view_queue(worker: str) -> str:
    """Returns the Celery queue of the parts of views that this worker's graphics cards render; it precedes batches."""
    return f"{CARD_VIEW_QUEUES}{worker}"


def view_key(watch: str) -> str:
    """Returns the Redis key with the number of a session's current view. watch: id of the session, which is one open view."""
    return f"rayfarm:view:{watch}"


@dataclass(frozen=True)
class Part:
    """The unit of work of a live view: samples first to first + count - 1 of every pixel of one rectangle.

    number: index in the message.
    """

    number: int
    tile: Tile
    first: int
    count: int


@dataclass(frozen=True)
class ViewParts:
    """Request to render parts of a live view in this order, with one answer per part.

    watch: id of the view's session. view: number of the view. compiled: SHA-256 of the compiled scene. is_whole: whether
    answers have the sums of all channels; otherwise only those of colour.
    """

    message: str  # unique for every time that parts are handed out
    watch: str
    view: int
    compiled: str  # SHA-256 of the compiled scene's blob
    settings: RenderSettings
    parts: list[Part]
    is_whole: bool = False  # whether all planes are wanted, and not colour and samples alone
    has_guides: bool = False  # whether albedo and normal are wanted, too, which guide a denoiser
    on_card: bool = False  # whether the slot's graphics card renders them; if it cannot, they are declined
    draft: float | None = None  # exposure, in stops, of the draft that answers the only part; None: sums answer the parts
    is_smooth: bool = False  # whether the draft is smoothed (renderer/kernel/draft.py)
    needs_kernel: bool = False  # whether they are declined if the kernel would have to be compiled

    @property
    def is_first_hits(self) -> bool:
        """Returns True if only the first hits of the samples are rendered, as guides of the denoiser."""
        return self.has_guides and self.settings.max_depth == 1

    def to_json(self) -> dict[str, Any]:
        """Returns the message as JSON data for Celery; without guides, card, draft and kernel, as in earlier releases."""
        parts = [[part.number, list(part.tile), part.first, part.count] for part in self.parts]
        fields = {
            name: value
            for name, value in vars(self).items()
            if value is not None and (value or name not in ("has_guides", "on_card", "is_smooth", "needs_kernel"))
        }
        return {**fields, "settings": self.settings.to_json(), "parts": parts}

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> ViewParts:
        """Parses the JSON data from `to_json`. Raises ValueError, KeyError, TypeError, or SettingsError."""
        return cls(
            **{name: data[name] for name in ("message", "watch", "view", "compiled")},
            settings=RenderSettings.from_json(data["settings"]),
            parts=[Part(number, Tile(*tile), first, count) for number, tile, first, count in data["parts"]],
            is_whole=bool(data.get("is_whole")),
            has_guides=bool(data.get("has_guides")),
            on_card=bool(data.get("on_card")),
            draft=None if data.get("draft") is None else float(data["draft"]),
            is_smooth=bool(data.get("is_smooth")),
            needs_kernel=bool(data.get("needs_kernel")),
        )


@dataclass(frozen=True)
class ViewFrame:
    """Request to prepare frames of an animated scene for a live view.

    watch: id of the view's session. work: the frames to prepare; its `job` is the session's id too.
    """

    message: str
    watch: str
    view: int
    work: PrepareFrames

    def to_json(self) -> dict[str, Any]:
        """Returns the message as JSON data for Celery."""
        return {**vars(self), "work": self.work.to_json()}

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> ViewFrame:
        """Parses the JSON data from `to_json`. Raises ValueError, KeyError or TypeError."""
        return cls(data["message"], data["watch"], data["view"], PrepareFrames.from_json(data["work"]))


@dataclass(frozen=True)
class ViewDenoise:
    """Request to denoise a live view's picture of width x height pixels.

    The worker downloads it from /api/farm/views/{message}: mean colour, albedo and normal, one after another, each
    (height, width, 3) float32 little-endian. has_clean_guides: whether albedo and normal have enough samples to be
    treated as free of noise.
    """

    message: str
    watch: str
    view: int
    width: int
    height: int
    has_clean_guides: bool = False

    def to_json(self) -> dict[str, Any]:
        """Returns the message as JSON data for Celery."""
        return dict(vars(self))

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> ViewDenoise:
        """Parses the JSON data from `to_json`. Raises KeyError, ValueError or TypeError."""
        size = int(data["width"]), int(data["height"])
        return cls(data["message"], data["watch"], int(data["view"]), *size, bool(data.get("has_clean_guides")))


@dataclass(frozen=True)
class ViewAnswer:
    """A worker's answer to a view message. Values of `type`, each with its fields:

    begun      a slot has taken the message: message, worker
    compiling  the worker is compiling its kernel, which may take minutes: message, worker
    part       a part is rendered: number, seconds, with the sums attached
    draft      the part of a message with `draft` is rendered, which ends the message: seconds, with the draft attached, a JPEG
               (DraftHead). Its slot sends neither `begun` nor `over`
    frame      a frame is prepared: frame, info (FrameInfo)
    declined   the slot's graphics card does not render the parts, so CPU slots must. is_loading: it loads the scene for later
               messages, and ends this one with `over`. Otherwise error: why it cannot, which ends the message. Of a message with
               `needs_kernel` to a CPU slot: the kernel would have to be compiled
    denoised   the picture is denoised, with its RGB9E5 words attached, rows from the top
    over       the message is finished: every part is answered or outdated
    failed     the message cannot be processed: error (a sentence)
    returned   sent back because of a fault of the worker, to be sent again: error; unfit: must be sent to another worker
    """

    type: str
    watch: str
    view: int
    message: str
    worker: str
    more: dict[str, Any] = field(default_factory=dict)
    sums: bytes = b""

    @property
    def seconds(self) -> float:
        """Returns the rendering time of a part in seconds. Raises ValueError, KeyError or TypeError if it is invalid."""
        seconds = float(self.more["seconds"])
        if not 0.0 <= seconds <= MAX_PART_S:
            raise ValueError(f"a part took {seconds} s")
        return seconds

    def to_bytes(self) -> bytes:
        """Serializes the answer: the length of a JSON object, the object, and the sums."""
        return json_head.encode({name: value for name, value in vars(self).items() if name != "sums"}, self.sums)

    @classmethod
    def from_bytes(cls, data: bytes) -> ViewAnswer:
        """Parses the bytes from `to_bytes`. Raises ValueError."""
        try:
            head, sums = json_head.decode(data)
            answer = cls(**head, sums=sums)
        except (ValueError, TypeError) as error:
            raise ValueError(f"invalid view answer: {error}") from None
        texts = (answer.type, answer.watch, answer.message, answer.worker)
        if not (all(isinstance(text, str) for text in texts) and isinstance(answer.view, int) and isinstance(answer.more, dict)):
            raise ValueError("invalid view answer: its fields are of other types")
        return answer
