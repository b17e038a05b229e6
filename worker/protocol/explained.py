"""What the service and a worker say to each other about a pixel that somebody wants explained.

    service --- Celery task EXPLAIN -------------> worker     ExplainPixel, in the queue of views (worker.view_parts)
    worker ---- list explained_key(message) -----> service    JSON objects, see below; the list expires by itself

The request waits for answers on a list of the question's own: nothing else has to know of it, and nothing stays.

    begun      it is in a slot's hands: worker
    compiling  the kernel for it is got ready there, which may take minutes: worker
    done       explained (worker.explain.told), worker
    failed     error (a sentence), worker
    returned   the worker's own trouble, error: to be asked again
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from renderer.settings import RenderSettings
from worker.protocol.contract import PrepareFrames

__all__ = ["ANSWER_TTL_S", "EXPLAIN", "ExplainPixel", "explained_key"]

EXPLAIN = "rayfarm.explain"
ANSWER_TTL_S = 60


def explained_key(message: str) -> str:
    """The Redis list of the answers to a question."""
    return f"rayfarm:explained:{message}"


@dataclass(frozen=True)
class ExplainPixel:
    """A pixel of a job's frame, whose first `count` samples are to be rendered once more."""

    message: str  # unique for every question
    job: str
    compiled: str  # SHA-256 of the compiled scene's blob; where `moment` is given, of the scene at its beginning
    settings: RenderSettings
    x: int
    y: int
    count: int
    sample: int | None = None  # one that is asked for by its number
    moment: PrepareFrames | None = None  # the one frame to prepare first, of what moves and is kept nowhere any more

    def to_json(self) -> dict[str, Any]:
        """A JSON-ready dict for the Celery message."""
        return {**vars(self), "settings": self.settings.to_json(), "moment": asdict(self.moment) if self.moment else None}

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> ExplainPixel:
        """The question that `to_json` wrote. Raises ValueError, KeyError, TypeError, or SettingsError."""
        names = ("message", "job", "compiled", "x", "y", "count", "sample")
        moment = data.get("moment")
        return cls(
            **{name: data[name] for name in names},
            settings=RenderSettings.from_json(data["settings"]),
            moment=PrepareFrames.from_json(moment) if moment else None,
        )
