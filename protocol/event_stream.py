"""Server-sent events of GET /api/events: jobs, scenes and workers that have changed, as `text/event-stream`.

The page handles them in web/js/news/farm.js, in functions of the same names.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any, ClassVar

__all__ = ["EVENTS", "KEEP_ALIVE", "RETRY", "ItemEvent", "JobEvent", "SceneEvent", "WorkerEvent"]

RETRY = "retry: 2000\n\n"  # milliseconds before a client connects again
KEEP_ALIVE = ": still here\n\n"  # a comment


@dataclass(frozen=True)
class ItemEvent:
    """Base class of events about one item: a job, scene or worker.

    item: the item as its own GET request returns it. None if it no longer exists, which is sent as {"id": id, "deleted": true}.
    """

    TYPE: ClassVar[str]
    id: str
    item: dict[str, Any] | None

    def to_text(self) -> str:
        """Encodes the event as text/event-stream."""
        return f"event: {self.TYPE}\ndata: {json.dumps(self.item or {'id': self.id, 'deleted': True})}\n\n"


@dataclass(frozen=True)
class JobEvent(ItemEvent):
    """Event of a changed job. The job is as in GET /api/jobs."""

    TYPE: ClassVar[str] = "job"


@dataclass(frozen=True)
class SceneEvent(ItemEvent):
    """Event of a changed scene. The scene is as in GET /api/scenes."""

    TYPE: ClassVar[str] = "scene"


@dataclass(frozen=True)
class WorkerEvent(ItemEvent):
    """Event of a changed worker. The worker is as in GET /api/workers; its id is its name."""

    TYPE: ClassVar[str] = "worker"


EVENTS: dict[str, type[ItemEvent]] = {event.TYPE: event for event in (JobEvent, SceneEvent, WorkerEvent)}
