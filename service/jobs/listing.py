"""Filtered and sorted lists of jobs. Reads only the rows of the requested page, since a farm may have ten thousand jobs."""

from __future__ import annotations

from collections import namedtuple
from dataclasses import dataclass, replace
from typing import Any, Literal, cast

from sqlalchemy import ColumnElement, Select, case, false, func, or_, select
from sqlalchemy.orm import InstrumentedAttribute, Session, aliased

from service.access.projects import NOTHING, ProjectVisibility
from service.store.models import Job, Scene

__all__ = ["JobFilter", "Order", "matches", "search_words"]

MAX_WORDS = 8

Order = Literal["newest", "oldest", "name", "priority", "state"]
_LISTED_COLUMNS = [column for column in Job.__table__.columns if column.name != "history"]  # large, and not part of a list
_Row = namedtuple("_Row", [column.name for column in _LISTED_COLUMNS])  # type: ignore[misc]
_ID = _Row._fields.index("id")
_STATES = ("running", "queued", "paused", "failed", "cancelled", "finished")  # sort order: states that may need action first


@dataclass(frozen=True)
class JobFilter:
    """Filter on the jobs visible to the caller.

    words: a job matches if each occurs in a name or note of the job or its scene, or is a prefix of an id.
    """

    states: tuple[str, ...] = ()
    scene: str | None = None
    words: tuple[str, ...] = ()
    shots: bool | None = None
    ids: tuple[str, ...] = ()
    sight: ProjectVisibility = NOTHING
    project: str | None = None

    def count(self, session: Session) -> int:
        """Returns the number of matching jobs."""
        return session.scalar(self._apply(select(func.count()).select_from(Job))) or 0

    def tallies(self, session: Session) -> dict[str, int]:
        """Returns the number of matching jobs in each state. Jobs in states that the filter excludes are counted too."""
        query: Any = select(Job.state, func.count()).group_by(Job.state)
        query = replace(self, states=())._apply(query)
        return {row[0]: row[1] for row in session.execute(query)}

    def ids_in(self, order: Order, session: Session, limit: int, offset: int = 0) -> list[str]:
        """Returns the ids of matching jobs, in order."""
        query = self._apply(select(Job.id)).order_by(*_sort_columns(order))
        return list(session.scalars(query.limit(limit).offset(offset)))

    def rows(self, order: Order, session: Session, limit: int, offset: int = 0) -> list[Job]:
        """Returns the matching jobs in order, as tuples of a Job's columns.

        Tuples, since creating a thousand ORM objects would take a quarter of the time of a list.
        """
        ids = self.ids_in(order, session, limit, offset)  # from an index; sorting rows would read them all
        query = select(*_LISTED_COLUMNS).where(Job.id.in_(ids))
        found = {row[_ID]: _Row._make(row) for row in session.execute(query)}
        return cast("list[Job]", [found[id] for id in ids if id in found])

    def _apply(self, query: Select[Any]) -> Select[Any]:
        query = query.where(self.sight.clause(Job.project))
        if self.project is not None:
            query = query.where(Job.project == self.project)
        if self.ids:
            query = query.where(Job.id.in_(self.ids))
        if self.states:
            query = query.where(Job.state.in_(self.states))
        if self.scene is not None:
            query = query.where(Job.scene == self.scene)
        if self.shots is not None:
            query = query.where(Job.shot.is_not(None) if self.shots else Job.shot.is_(None))
        for word in self.words:
            query = query.where(_matches_word(word))
        return query


def search_words(search: str) -> tuple[str, ...]:
    """Splits a search text into words."""
    return tuple(search.lower().split()[:MAX_WORDS])


def matches(
    word: str, name: InstrumentedAttribute[str] | InstrumentedAttribute[str | None], id: InstrumentedAttribute[str]
) -> ColumnElement[bool]:
    """Returns the SQL condition that the word occurs in the name, or is a prefix of the id."""
    if "\0" in word:  # NUL ends a pattern in SQLite, and is an error in PostgreSQL; no name has it
        return false()
    return or_(func.lower(name).contains(word, autoescape=True), id.startswith(word, autoescape=True))


def _matches_word(word: str) -> ColumnElement[bool]:
    other = aliased(Job)  # few jobs have notes, which a partial index covers
    noted = select(other.id).where(other.note.is_not(None), matches(word, other.note, other.id))
    scenes = select(Scene.id).where(matches(word, Scene.name, Scene.id))
    return or_(matches(word, Job.name, Job.id), Job.scene.in_(scenes), Job.id.in_(noted))


def _sort_columns(order: Order) -> tuple[Any, ...]:
    newest = (Job.created.desc(), Job.id)
    match order:
        case "newest":
            return newest
        case "oldest":
            return Job.created.asc(), Job.id
        case "name":
            return func.lower(Job.name), *newest
        case "priority":
            return Job.priority.desc(), *newest
        case "state":
            return case({state: n for n, state in enumerate(_STATES)}, value=Job.state), *newest
