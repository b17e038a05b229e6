"""Notes on a job's pictures, replies to them, and the verdict of its review.

Users write under their own names, guests of a share link under the name that they type. `Job.review` has the verdict and the
number of notes (models.notes.ReviewOut), so that lists and events of jobs need no further query.
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from sqlalchemy import Select, delete, func, or_, select
from sqlalchemy.orm import Session

from renderer.frames import frame_key, frame_number
from renderer.sentences import Sentence
from service.access.rate_limit import network_of
from service.errors import Conflict, Invalid, NotFound, OverQuota
from service.events import RowWritten
from service.farm import Farm
from service.intake.names import is_visible, plain_note, plain_title
from service.jobs.lookup import frame_not_found, job_not_found
from service.models.notes import NoteIn, NoteOut, ReviewOut, Verdict
from service.store.models import Frame, Job, ReviewNote

__all__ = ["Writer", "add_note", "delete_note", "note_out", "resolve_note", "select_notes", "set_verdict"]

MAX_NOTES = 500  # notes and replies of a job
MAX_OF_LINK = 200  # of these, written by one share link
MAX_PER_WRITER = 60  # changes within access.NOTES_WINDOW_S, of a user or a share link
MAX_PER_ADDRESS = 20  # likewise, of a guest's address


@dataclass(frozen=True)
class Writer:
    """The author of a note or verdict. user: the authenticated user's name; None for guests and on a farm without logins.

    name: as typed, for others than users. link: id of a guest's share link. address: the client's.
    """

    user: str | None
    name: str | None
    link: str | None
    address: str

    def author(self) -> str:
        """Returns the name under which it appears. Raises Invalid if there is none."""
        if self.user is not None:
            return self.user
        if not is_visible(name := plain_title(self.name or "")):
            raise Invalid(Sentence("note-author-missing", "Give your name."), field="author")
        return name

    def check_rate(self, farm: Farm) -> None:
        """Counts a change. Raises OverQuota if there were too many within the last minute."""
        limits = [(("link", self.link) if self.link else ("user", self.user or ""), MAX_PER_WRITER)]
        if self.link:
            limits.append((("address", network_of(self.address)), MAX_PER_ADDRESS))
        if (seconds := farm.access.note_rate.count(limits)) is not None:
            raise OverQuota(
                Sentence(
                    "notes-too-fast",
                    "Too many changes within a minute. Try again in {seconds} s.",
                    seconds=max(1, round(seconds)),
                ),
                seconds,
            )


def select_notes(job: str) -> Select[Any]:
    """Returns the query for the notes and replies of a job, oldest first."""
    return select(ReviewNote).where(ReviewNote.job == job).order_by(ReviewNote.created, ReviewNote.id)


def add_note(job: str, asked: NoteIn, writer: Writer, farm: Farm) -> NoteOut:
    """Adds a note or a reply. Raises NotFound, Invalid, Conflict if there are too many notes, and OverQuota."""
    text, author = plain_note(asked.text), writer.author()
    if not is_visible(text):
        raise Invalid(Sentence("note-empty", "The note is empty. Write what should change, or what is good."), field="text")

    with _changes(job, writer, farm) as (_, session):
        _check_room(job, writer, session)
        note = ReviewNote(id=secrets.token_hex(6), job=job, author=author, link=writer.link, text=text, created=time.time())
        note.x, note.y, note.reply_to = asked.x, asked.y, asked.reply_to
        if asked.reply_to is not None:
            answered = _find_note(job, asked.reply_to, session)
            if answered.reply_to is not None:
                raise _is_reply(answered.id)
            note.frame = answered.frame
        else:
            note.frame = _frame_of(job, asked.frame, session)
        session.add(note)
        session.flush()
        return note_out(note)


def resolve_note(job: str, note: str, resolved: bool, writer: Writer, farm: Farm) -> NoteOut:
    """Resolves a note, or opens it again. Raises NotFound, Invalid, Conflict for a reply, and OverQuota."""
    author = writer.author()

    with _changes(job, writer, farm) as (_, session):
        found = _find_note(job, note, session)
        if found.reply_to is not None:
            raise _is_reply(note)
        if resolved != (found.resolved is not None):
            found.resolved, found.resolved_by = (time.time(), author) if resolved else (None, None)
            found.resolved_guest = resolved and writer.link is not None
        return note_out(found)


def delete_note(job: str, note: str, writer: Writer, farm: Farm) -> None:
    """Deletes a note with its replies. Raises NotFound and OverQuota."""
    with _changes(job, writer, farm) as (_, session):
        _find_note(job, note, session)
        session.execute(delete(ReviewNote).where(ReviewNote.job == job, or_(ReviewNote.id == note, ReviewNote.reply_to == note)))


def set_verdict(job: str, verdict: Verdict | None, writer: Writer, farm: Farm) -> ReviewOut:
    """Sets the verdict on a job's pictures, and by whom it was given. Raises NotFound, Invalid and OverQuota."""
    author = writer.author()
    with _changes(job, writer, farm) as (row, _):
        given = {"by": author, "guest": writer.link is not None, "at": time.time()} if verdict is not None else {}
        row.review = {"state": verdict, **given}
    with farm.sessions() as session:
        return ReviewOut(**(session.scalar(select(Job.review).where(Job.id == job)) or {}))


def note_out(note: ReviewNote) -> NoteOut:
    """Returns a note as the API's model."""
    return NoteOut(
        id=note.id,
        reply_to=note.reply_to,
        frame=frame_number(note.frame),
        x=note.x,
        y=note.y,
        author=note.author,
        guest=note.link is not None,
        text=note.text,
        created=note.created,
        resolved=note.resolved,
        resolved_by=note.resolved_by,
        resolved_guest=bool(note.resolved_guest),
    )


@contextmanager
def _changes(job: str, writer: Writer, farm: Farm) -> Iterator[tuple[Job, Session]]:
    """Context manager of a transaction that holds the job's row. Then counts the notes again, and notifies open pages."""
    writer.check_rate(farm)
    with farm.sessions.begin() as session:
        row = session.get(Job, job, with_for_update=True)
        if row is None:
            raise job_not_found(job)
        yield row, session
        session.flush()
        is_open = ReviewNote.reply_to.is_(None) & ReviewNote.resolved.is_(None)
        counts = select(func.count(), func.count().filter(is_open)).where(ReviewNote.job == job)
        notes, still_open = session.execute(counts).one()
        row.review = {**(row.review or {}), "notes": notes, "open": still_open, "changed": time.time()}
    farm.events.publish(RowWritten("job", job))


def _check_room(job: str, writer: Writer, session: Session) -> None:
    of_job = select(func.count()).where(ReviewNote.job == job)
    if (session.scalar(of_job) or 0) >= MAX_NOTES or (
        writer.link is not None and (session.scalar(of_job.where(ReviewNote.link == writer.link)) or 0) >= MAX_OF_LINK
    ):
        raise Conflict(
            Sentence(
                "notes-too-many",
                "There are too many notes: at most {most} by one link, and {most_job} on one job. Delete some first.",
                most=MAX_OF_LINK,
                most_job=MAX_NOTES,
            )
        )


def _frame_of(job: str, asked: float | None, session: Session) -> int:
    """Returns the key of the frame that a note is on: the requested one, or the job's first."""
    if asked is None:
        return session.scalar(select(func.min(Frame.number)).where(Frame.job == job)) or 0
    key = frame_key(asked)
    if frame_number(key) != asked or session.get(Frame, (job, key)) is None:
        raise frame_not_found(asked)
    return key


def _find_note(job: str, note: str, session: Session) -> ReviewNote:
    found = session.get(ReviewNote, note)
    if found is None or found.job != job:
        raise NotFound(
            Sentence("note-not-found", "There is no note {id} on this job; it may have been deleted.", id=repr(note[:60]))
        )
    return found


def _is_reply(note: str) -> Conflict:
    return Conflict(Sentence("note-is-reply", "{id} is a reply. Name the note that it answers.", id=note))
