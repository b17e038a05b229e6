"""Messages between the service and a worker for the explanation of a pixel.

service --- Celery task EXPLAIN -------------> worker     ExplainPixel, in the queue of views (view_parts.py)
worker ---- list explained_key(message) -----> service    JSON objects, see below; the list expires after a timeout

The client's HTTP request waits for the answers on a separate Redis list; there is no other state. The types of answers, with
their fields:

begun      a slot has taken the task: worker
compiling  the worker is compiling its kernel, which may take minutes: worker
done       the paths were traced: explained (worker/work/explain.py), worker
failed     the pixel cannot be explained: error (a sentence), worker
returned   the worker is at fault, so the request is sent again: error; unfit: must be sent to another worker
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from protocol.contract import PrepareFrames
from renderer.settings import RenderSettings

__all__ = ["ANSWER_TTL_S", "EXPLAIN", "ExplainPixel", "explained_key"]

EXPLAIN = "rayfarm.explain"
ANSWER_TTL_S = 60


def explained_key(message: str) -> str:
    """Returns the Redis list to which the worker appends its answers. message: id of the ExplainPixel message."""
    return f"rayfarm:explained:{message}"


@dataclass(frozen=True)
class ExplainPixel:
    """Request to explain a pixel of a job's frame. A worker renders the pixel's first `count` samples again.

    sample: number of one further sample whose path is returned; None: none. moment: request to compile the frame, if its
    compiled scene is no longer stored; None: the worker uses the scene with the hash `compiled`.
    """

    message: str  # unique for every question
    job: str
    compiled: str  # SHA-256 of the compiled scene's blob; with `moment`, of the scene at its beginning
    settings: RenderSettings
    x: int
    y: int
    count: int
    sample: int | None = None  # one that is asked for by its number
    moment: PrepareFrames | None = None  # the one frame to prepare first, of what moves and is kept nowhere any more

    def to_json(self) -> dict[str, Any]:
        """Returns the message as JSON data for Celery."""
        return {**vars(self), "settings": self.settings.to_json(), "moment": self.moment.to_json() if self.moment else None}

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> ExplainPixel:
        """Parses the JSON data from `to_json`. Raises ValueError, KeyError, TypeError, or SettingsError."""
        names = ("message", "job", "compiled", "x", "y", "count", "sample")
        moment = data.get("moment")
        return cls(
            **{name: data[name] for name in names},
            settings=RenderSettings.from_json(data["settings"]),
            moment=PrepareFrames.from_json(moment) if moment else None,
        )
