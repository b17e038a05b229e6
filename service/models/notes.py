"""Request and response models of notes on pictures and of reviews."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, Field, model_validator

from renderer.frames import MAX_FRAME
from renderer.sentences import Sentence
from service.models.strict import Strict

__all__ = ["MAX_AUTHOR", "MAX_TEXT", "NoteIn", "NoteOut", "NotePatch", "ReviewIn", "ReviewOut", "Verdict"]

MAX_TEXT = 2000
MAX_AUTHOR = 60
MAX_ID = 20

Verdict = Literal["approved", "changes-requested"]
AUTHOR = Field(None, max_length=MAX_AUTHOR, description="who writes; a user who is logged in appears under the user's name")
Place = Field(None, ge=0, le=1, allow_inf_nan=False, description="place as a fraction of the picture's width (x) or height (y)")


class NoteIn(Strict):
    """A note to add: on a place of a frame, on the whole frame (without x and y), or as a reply to another note."""

    text: str = Field(max_length=MAX_TEXT, description="lines of plain text")
    author: str | None = AUTHOR
    frame: float | None = Field(None, ge=0, le=MAX_FRAME, allow_inf_nan=False, description="number of the frame; null: the first")
    x: float | None = Place
    y: float | None = Place
    reply_to: str | None = Field(None, max_length=MAX_ID, description="id of the note that it answers, whose place it has")

    @model_validator(mode="after")
    def _has_one_place(self) -> NoteIn:
        if (self.x is None) != (self.y is None):
            raise ValueError(Sentence("note-place-incomplete", "give both x and y, or neither"))
        if self.reply_to is not None and self.x is not None:
            raise ValueError(Sentence("fields-exclusive", "give only one of {fields}", fields=["reply_to", "x"]))
        return self


class NotePatch(Strict):
    """The change of a note. resolved: whether it is done; a reply cannot be resolved by itself."""

    resolved: bool = Field(description="whether the note is done")
    author: str | None = AUTHOR


class NoteOut(BaseModel):
    """A note on a picture, or a reply to one."""

    id: str = Field(description="id of the note")
    reply_to: str | None = Field(description="id of the note that this one replies to; null: it is not a reply")
    frame: int | float = Field(description="number of the frame; 0 for a still")
    x: float | None = Field(description="place as a fraction of the picture's width; null: the whole picture")
    y: float | None = Field(description="place as a fraction of the picture's height; null: the whole picture")
    author: str = Field(description="name of the author; empty: none was given")
    guest: bool = Field(description="whether it was written through a share link, under an unverified name")
    text: str = Field(description="plain text")
    created: float = Field(description="Unix time in seconds")
    resolved: float | None = Field(description="when it was resolved; null: it is open")
    resolved_by: str | None = Field(description="name of the person who resolved it; null: it is open")
    resolved_guest: bool = Field(description="whether that was through a share link, under an unverified name")


class ReviewIn(Strict):
    """The verdict on a job's pictures. state: null withdraws it."""

    state: Verdict | None = Field(description="the verdict; null withdraws it")
    author: str | None = AUTHOR


class ReviewOut(BaseModel):
    """The review of a job: its verdict, and how many notes there are."""

    state: Verdict | None = Field(None, description="null: no verdict")
    by: str | None = Field(None, description="who gave the verdict")
    guest: bool = Field(False, description="whether that was a guest, under an unverified name")
    at: float | None = Field(None, description="when, as Unix time")
    notes: int = Field(0, description="number of notes and replies")
    open: int = Field(0, description="number of notes that are not resolved")
    changed: float = Field(0.0, description="time of the latest change of notes or verdict, as Unix time")
