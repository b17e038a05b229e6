"""Typed events by which the parts of the service notify each other, and the bus that carries them.

Handlers run in the publisher's thread, in the order of subscription, and only enqueue work or set flags. A handler that writes to
the database or the disk is subscribed with `in_background`: one thread runs these in the order of their events.
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
    "BlobsReleased",
    "Events",
    "FilmSuspected",
    "ItemChanged",
    "ItemKind",
    "PreparationRequested",
    "RowWritten",
    "TilesChanged",
    "WorkerSetAside",
]

log = logging.getLogger(__name__)

ItemKind = Literal["job", "scene", "worker"]


@dataclass(frozen=True, slots=True)
class RowWritten:
    """The row of a job or scene was created, changed or deleted outside the engine, and is committed."""

    kind: Literal["job", "scene"]
    id: str


@dataclass(frozen=True, slots=True)
class ItemChanged:
    """The engine's snapshot shows a change of a job, scene or worker."""

    kind: ItemKind
    id: str


@dataclass(frozen=True, slots=True)
class TilesChanged:
    """Samples were added to tiles of a frame."""

    job: str
    frame: int
    tiles: set[int]


@dataclass(frozen=True, slots=True)
class BlobsReleased:
    """References to blobs ended: how many, by SHA-256. Other references may remain."""

    references: Counter[str]


@dataclass(frozen=True, slots=True)
class PreparationRequested:
    """A scene is to be compiled for a kind of workers, independently of any job."""

    scene: str
    worker_kind: str


@dataclass(frozen=True, slots=True)
class FilmSuspected:
    """A job's film may be damaged and is to be checked."""

    job: str


@dataclass(frozen=True, slots=True)
class WorkerSetAside:
    """A worker's results differ from those of others. details: as webhooks report it; None if it was found in an earlier run."""

    worker: str
    details: dict[str, Any] | None


Event = TypeVar("Event")


class Events:
    """The bus. `subscribe` is called while the service is assembled; `publish` from any thread."""

    def __init__(self) -> None:
        self._handlers: defaultdict[type, list[Callable[[Any], object]]] = defaultdict(list)
        self._background = ThreadPoolExecutor(1, "events")

    def subscribe(self, kind: type[Event], handler: Callable[[Event], object], *, in_background: bool = False) -> None:
        """Calls `handler` with every event of this type that is published from now on."""

        def submit(event: Event) -> None:
            self._background.submit(_guarded, handler, event)

        self._handlers[kind].append(submit if in_background else handler)

    def publish(self, event: object) -> None:
        """Passes an event to the handlers of its type."""
        for handler in self._handlers.get(type(event), ()):
            handler(event)

    def close(self) -> None:
        """Waits for the background handlers of all events published so far."""
        self._background.shutdown()


def _guarded(handler: Callable[[Event], object], event: Event) -> None:
    try:
        handler(event)
    except FarmError as error:
        log.warning("%s is not fully handled: %s", type(event).__name__, error)
    except Exception:
        log.exception("a handler of %s failed", type(event).__name__)
