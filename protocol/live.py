"""Messages of WS /api/jobs/{id}/live, on which a client watches a job. Tiles are binary (pictures.py)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from protocol.websocket import Acknowledge, FromClient, FromService

__all__ = ["FROM_CLIENT", "FROM_SERVICE", "Frames", "Have", "JobState", "WatchFrame"]


@dataclass(frozen=True)
class WatchFrame(FromClient):
    """Client message: switch to another frame, {"frame": n}. snapshot: whether to send all of the frame's tiles first."""

    KEY: ClassVar[str] = "frame"
    frame: float
    snapshot: bool = True

    @classmethod
    def of(cls, message: Mapping[str, Any]) -> WatchFrame:
        """Parses the message. Raises ValueError, TypeError or OverflowError if it is malformed."""
        return cls(float(message["frame"]), message.get("snapshot") is not False)

    def to_json(self) -> dict[str, Any]:
        """Returns the message as JSON data."""
        return {"frame": self.frame} if self.snapshot else {"frame": self.frame, "snapshot": False}


@dataclass(frozen=True)
class Have(FromClient):
    """Client message {"have": [...]} with the number of samples per pixel of each tile that the client has.

    The service then sends the tiles that differ.
    """

    KEY: ClassVar[str] = "have"
    samples: list[Any]

    @classmethod
    def of(cls, message: Mapping[str, Any]) -> Have:
        """Parses the message. Raises TypeError if it is malformed."""
        return cls(list(message["have"]))


@dataclass(frozen=True)
class JobState(FromService):
    """Service message with the job, as in GET /api/jobs/{id}."""

    TYPE: ClassVar[str] = "state"
    job: dict[str, Any]


@dataclass(frozen=True)
class Frames(FromService):
    """Service message with those frames of a shot that have changed, as in GET /api/jobs/{id}/frames."""

    TYPE: ClassVar[str] = "frames"
    frames: list[dict[str, Any]]


FROM_CLIENT: tuple[type[WatchFrame | Have | Acknowledge], ...] = (WatchFrame, Have, Acknowledge)
FROM_SERVICE: tuple[type[JobState | Frames], ...] = (JobState, Frames)
