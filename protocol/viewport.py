"""Messages of WS /api/scenes/{id}/viewport, by which a page shows a live view. Pictures are binary (pictures.py)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from protocol.websocket import Acknowledge, FromClient, FromService

__all__ = [
    "FROM_CLIENT",
    "FROM_SERVICE",
    "Look",
    "Pause",
    "People",
    "Pick",
    "Picked",
    "Presence",
    "Refused",
    "TakesChanged",
    "ViewState",
]


@dataclass(frozen=True)
class Look(FromClient):
    """Client message: show a new view, which replaces the previous one. {"id": n, ...} with the fields of a job's request.

    Size, camera or view, settings, frame, clip, fps and turntable of POST /api/jobs are used. spp limits the samples per pixel
    (256 at most); a tile that has reached `noise` is complete with fewer. denoise: show denoised pictures where the workers can
    make them. alpha: tiles have alpha if the background is transparent; without it the background is visible. draft: the
    client's exposure in stops; a graphics card's first picture of a view may then be a draft (DraftHead) for that exposure, which
    is smoothed if the view is denoised.
    """

    KEY: ClassVar[str] = "id"
    view: dict[str, Any]

    @classmethod
    def of(cls, message: Mapping[str, Any]) -> Look:
        """Returns the message without validating its fields, which the service does as for a job's request."""
        return cls(dict(message))

    def to_json(self) -> dict[str, Any]:
        """Returns the message as JSON data."""
        return self.view


@dataclass(frozen=True)
class Pick(FromClient):
    """Client message: request the surface under a pixel of the view, {"pick": [x, y]}."""

    KEY: ClassVar[str] = "pick"
    x: int
    y: int

    @classmethod
    def of(cls, message: Mapping[str, Any]) -> Pick:
        """Parses the message. Raises ValueError, TypeError or OverflowError if it is malformed."""
        x, y = message["pick"]
        return cls(int(x), int(y))

    def to_json(self) -> dict[str, Any]:
        """Returns the message as JSON data."""
        return {"pick": [self.x, self.y]}


@dataclass(frozen=True)
class Pause(FromClient):
    """Client message {"paused": true}: the page is hidden and needs no pictures. {"paused": false}: it is visible again."""

    KEY: ClassVar[str] = "paused"
    paused: bool

    @classmethod
    def of(cls, message: Mapping[str, Any]) -> Pause:
        """Parses the message."""
        return cls(bool(message["paused"]))


@dataclass(frozen=True)
class Presence(FromClient):
    """Client message {"presence": {"name", "cursor", "view"}}: what others who view this scene see of the client.

    name: without authentication, as typed. cursor: [x, y] from the picture's centre, in heights of the picture, right and down;
    null: not on the picture. view: the camera.
    """

    KEY: ClassVar[str] = "presence"
    presence: dict[str, Any]

    @classmethod
    def of(cls, message: Mapping[str, Any]) -> Presence:
        """Returns the message without validating its fields, which the service does. Raises TypeError if it is malformed."""
        if not isinstance(message[cls.KEY], dict):
            raise TypeError("presence must be a JSON object")
        return cls(message[cls.KEY])


@dataclass(frozen=True)
class ViewState(FromService):
    """Service message: progress of the current view."""

    TYPE: ClassVar[str] = "state"
    id: int | None  # the client's number of the view
    samples: int = 0  # minimum per pixel
    bound: int = 0  # samples per pixel at which the view is done
    mean: float = 0  # samples per pixel, on average
    noise: float | None = None  # relative; None while unknown
    done: bool = False
    slots: int = 0
    message: str | None = None  # why nothing new comes; None while pictures come
    denoised: bool = False  # whether the picture that is shown is denoised
    denoised_samples: float | None = None  # its samples per pixel, on average; 0: it is smaller than the view
    denoises: bool = False  # whether denoised pictures of the view come
    sample_s: float | None = None  # slot-seconds for a sample of a pixel; None while unknown, or if only cards render it


@dataclass(frozen=True)
class Refused(FromService):
    """Service message: a view or another message of the client is invalid. detail: a sentence."""

    TYPE: ClassVar[str] = "error"
    id: int | None
    detail: str


@dataclass(frozen=True)
class Picked(FromService):
    """Service message: the surface at pixel (x, y). direction: of the pixel's ray.

    depth, position, normal: of the surface; None if the ray hits nothing.
    """

    TYPE: ClassVar[str] = "picked"
    x: int
    y: int
    direction: Any  # of the pixel; None: unknown at the moment
    depth: float | None
    position: Any
    normal: Any


@dataclass(frozen=True)
class People(FromService):
    """Service message: the others who view this scene now, each with the fields of `Presence` and the `id` of the connection."""

    TYPE: ClassVar[str] = "people"
    people: list[dict[str, Any]]


@dataclass(frozen=True)
class TakesChanged(FromService):
    """Service message: a take of this scene was saved, renamed or deleted. GET /api/scenes/{id}/takes returns them.

    changes: number of changes since the connection was opened.
    """

    TYPE: ClassVar[str] = "takes"
    changes: int


FROM_CLIENT: tuple[type[Acknowledge | Pick | Pause | Presence | Look], ...] = (Acknowledge, Pick, Pause, Presence, Look)
FROM_SERVICE: tuple[type[ViewState | Refused | Picked | People | TakesChanged], ...] = (
    ViewState,
    Refused,
    Picked,
    People,
    TakesChanged,
)
