"""Paginated lists of the scenes visible to a caller."""

from __future__ import annotations

from typing import Any

from sqlalchemy import ColumnElement, func, select
from sqlalchemy.orm import Session

from service.access.projects import ProjectVisibility
from service.jobs.listing import matches, search_words
from service.store.models import Scene

__all__ = ["SceneFilter"]


class SceneFilter:
    """Filter on the uploaded scenes visible to the caller. search: words in the scene's name, or a prefix of its id."""

    def __init__(self, sight: ProjectVisibility, project: str | None, search: str) -> None:
        self._conditions: list[ColumnElement[Any]] = [Scene.of.is_(None), sight.clause(Scene.project)]
        self._conditions += [matches(word, Scene.name, Scene.id) for word in search_words(search)]
        self._conditions += [] if project is None else [Scene.project == project]

    def count(self, session: Session) -> int:
        """Returns the number of matching scenes."""
        return session.scalar(select(func.count()).select_from(Scene).where(*self._conditions)) or 0

    def rows(self, session: Session, limit: int, offset: int) -> list[Scene]:
        """Returns one page of the matching scenes, newest first."""
        query = select(Scene).where(*self._conditions).order_by(Scene.created.desc(), Scene.id)
        return list(session.scalars(query.limit(limit).offset(offset)))
