"""Pagination of lists, which may have ten thousand entries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, TypeVar

from fastapi import Depends, Query, Response
from sqlalchemy import Select, func, select
from sqlalchemy.orm import Session

__all__ = ["MAX_ITEMS", "TOTAL", "Offset", "Page", "PageDependency"]

MAX_ITEMS = 1000  # items in one answer
TOTAL = "X-Total-Count"
T = TypeVar("T")


@dataclass(frozen=True)
class Page:
    """The requested range of a list. Methods set the response's header X-Total-Count to the length of the whole list."""

    limit: int
    offset: int
    response: Response

    def slice_of(self, items: Sequence[T]) -> Sequence[T]:
        """Returns the requested range of a list that is in memory."""
        self.response.headers[TOTAL] = str(len(items))
        return items[self.offset : self.offset + self.limit]

    def rows(self, query: Select[Any], session: Session, first: Sequence[T] = ()) -> tuple[Sequence[T], list[Any]]:
        """Returns the requested range of a list that consists of the items `first` followed by the rows of an ordered query.

        The range is returned as two lists: items of `first`, which are not stored in a table, and database rows.
        """
        count = session.scalar(select(func.count()).select_from(query.order_by(None).subquery())) or 0
        here = self.slice_of(first)
        self.response.headers[TOTAL] = str(len(first) + count)
        left, skipped = self.limit - len(here), max(0, self.offset - len(first))
        return here, list(session.scalars(query.limit(left).offset(skipped))) if left else []


Limit = Annotated[int, Query(ge=1, le=MAX_ITEMS, description="maximum number of items")]
Offset = Annotated[int, Query(ge=0, le=1 << 31, description="items to skip")]


def _page(
    response: Response,
    limit: Limit = 100,
    offset: Offset = 0,
) -> Page:
    return Page(limit, offset, response)


PageDependency = Annotated[Page, Depends(_page)]
