"""Typed events by which parts of the service notify each other, and the event bus.

Handlers run in the publisher's thread, in the order of subscription, and only enqueue work or set flags. Handlers that write to
the database or the disk are subscribed with `in_background`: a single thread runs them in the order of the events.
"""

from __future__ import annotations

import logging
from collections import Counter, defaultdict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

from service.errors import FarmError

__all__ = [
    "ArtifactStored",
    "BlobsReleased",
    "Events",
    "FilmSuspected",
    "FrameDenoised",
    "ItemChanged",
    "ItemKind",
    "PreparationRequested",
    "RowWritten",
    "TilesChanged",
    "WorkerQuarantined",
]

log = logging.getLogger(__name__)

ItemKind = Literal["job", "scene", "worker"]


@dataclass(frozen=True, slots=True)
class RowWritten:
    """The row of a job or scene was created, changed or deleted outside the engine, and the transaction is committed."""

    kind: Literal["job", "scene"]
    id: str


@dataclass(frozen=True, slots=True)
class ItemChanged:
    """A job, scene or worker differs between two successive snapshots of the engine's state."""

    kind: ItemKind
    id: str


@dataclass(frozen=True, slots=True)
class TilesChanged:
    """New samples were added to tiles of a frame."""

    job: str
    frame: int
    tiles: set[int]


@dataclass(frozen=True, slots=True)
class BlobsReleased:
    """Database rows no longer refer to these blobs. Other references to them may remain.

    references: number of removed references by the blob's SHA-256.
    """

    references: Counter[str]


@dataclass(frozen=True, slots=True)
class ArtifactStored:
    """An artifact is in use, to whose blob no database row refers, until it is released by BlobsReleased."""

    sha256: str


@dataclass(frozen=True, slots=True)
class FrameDenoised:
    """A frame of a job was denoised alone. seconds: from its request until its picture was stored. pixels: of the frame."""

    job: str
    pixels: int
    seconds: float


@dataclass(frozen=True, slots=True)
class PreparationRequested:
    """A scene must be compiled for a worker kind (renderer.jit.kind), although no job needs it."""

    scene: str
    worker_kind: str


@dataclass(frozen=True, slots=True)
class FilmSuspected:
    """A job's film may be damaged and must be checked."""

    job: str


@dataclass(frozen=True, slots=True)
class WorkerQuarantined:
    """A worker was quarantined because its results differ from those of other workers.

    details: the content of the webhook message; None if an earlier run of the service found the difference.
    """

    worker: str
    details: dict[str, Any] | None


Event = TypeVar("Event")


class Events:
    """Event bus. `subscribe` is called while the service is assembled; `publish` can be called from any thread."""

    def __init__(self) -> None:
        self._handlers: defaultdict[type, list[Callable[[Any], object]]] = defaultdict(list)
        self._background = ThreadPoolExecutor(1, "events")

    def subscribe(self, kind: type[Event], handler: Callable[[Event], object], *, in_background: bool = False) -> None:
        """Registers a handler for all events of type `kind` that are published later.

        in_background: whether a background thread calls it instead of the publisher's.
        """

        def submit(event: Event) -> None:
            self._background.submit(_call_handler, handler, event)

        self._handlers[kind].append(submit if in_background else handler)

    def publish(self, event: object) -> None:
        """Calls the handlers of the event's type."""
        for handler in self._handlers.get(type(event), ()):
            handler(event)

    def close(self) -> None:
        """Waits until the background handlers have processed all events published so far."""
        self._background.shutdown()


def _call_handler(handler: Callable[[Any], object], event: object) -> None:
    try:
        handler(event)
    except FarmError as error:
        log.warning("%s is not fully handled: %s", type(event).__name__, error)
    except Exception:
        log.exception("a handler of %s failed", type(event).__name__)
