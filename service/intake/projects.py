"""The owner of an upload, and the ids of content within a project."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

from sqlalchemy import ColumnElement

__all__ = ["NOBODY", "Owner", "id_in", "may_be_used_in", "usable_in"]


@dataclass(frozen=True)
class Owner:
    """The owner of an upload.

    project: the project whose members see it; empty: all users. user, key: the uploader and the id of its token, if known.
    """

    project: str = ""
    user: str | None = None
    key: str | None = None


NOBODY = Owner()


def id_in(project: str, id: str) -> str:
    """Returns the id of content within a project.

    The same content has another id in another project, so an id does not reveal to others that it exists there.
    """
    return hashlib.sha256(f"{project}\n{id}".encode()).hexdigest()[: len(id)] if project else id


def may_be_used_in(thing: str, project: str) -> bool:
    """Returns True if content of one project may be used in another: its own, and content of no project (empty)."""
    return thing in ("", project)


def usable_in(column: Any, project: str) -> ColumnElement[bool]:
    """Returns the condition of `may_be_used_in` for a table's column `project`."""
    found: ColumnElement[bool] = column.in_(["", project])
    return found
