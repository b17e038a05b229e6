"""Request and response models of takes: saved cameras and settings of scenes' live views."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, Field

from service.models.jobs import JobIn
from service.models.notes import MAX_AUTHOR
from service.models.strict import Strict

__all__ = ["MAX_SIDE", "TakeIn", "TakeOut", "TakePatch"]

MAX_NAME = 100
MAX_PICTURE = 200_000  # characters of base64
MAX_SIDE = 512  # pixels of the picture's longer side

_Name = Field(max_length=MAX_NAME, description="one line of plain text")


class TakeIn(Strict):
    """A take to save: what a live view shows, and how."""

    name: str = _Name
    author: str | None = Field(
        None, max_length=MAX_AUTHOR, description="who saves it; a user who is logged in appears under the user's name"
    )
    request: JobIn = Field(description="the view as a job's request; fields that a live view does not read are dropped")
    exposure: float = Field(0.0, ge=-32, le=32, allow_inf_nan=False, description="stops")
    tonemap: str = Field("neutral", max_length=400, description="the tone curve, as for a picture")
    picture: str | None = Field(
        None,
        max_length=MAX_PICTURE,
        description=f"what the view showed: PNG, WebP or JPEG of at most {MAX_SIDE} pixels a side, in base64",
    )


class TakePatch(Strict):
    """The change of a take."""

    name: str = _Name


class TakeOut(BaseModel):
    """A saved camera with the settings of a scene's live view."""

    id: str = Field(description="id of the take")
    name: str = Field(description="name of the take")
    author: str | None = Field(description="name of the author; null: none was given")
    created: float = Field(description="Unix time in seconds")
    request: dict[str, Any] = Field(description="the view as a job's request: POST it to /api/jobs to render it")
    exposure: float = Field(description="stops")
    tonemap: str = Field(description="tone curve")
    picture: str | None = Field(description="URL of its picture; null: it has none")
