"""Owners of uploads (user and project), and ids of content that are unique to a project."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

from sqlalchemy import ColumnElement

__all__ = ["NO_OWNER", "UploadOwner", "id_in_project", "may_be_used_in", "usable_in"]


@dataclass(frozen=True)
class UploadOwner:
    """Who an upload belongs to.

    project: name of the project; empty: visible to all users. user, key: name of the uploader and id of the token used, or None.
    """

    project: str = ""
    user: str | None = None
    key: str | None = None


NO_OWNER = UploadOwner()


def id_in_project(project: str, id: str) -> str:
    """Returns the id of content inside a project: a hash of both. Without a project the id is unchanged.

    The same content has a different id in each project, so an id does not reveal that it exists in another one.
    """
    return hashlib.sha256(f"{project}\n{id}".encode()).hexdigest()[: len(id)] if project else id


def may_be_used_in(thing: str, project: str) -> bool:
    """Returns True if an object may be used inside a project.

    thing: the object's project, which must be the same one, or "" (none). project: the project in which the object is to be used.
    """
    return thing in ("", project)


def usable_in(column: Any, project: str) -> ColumnElement[bool]:
    """Returns the SQL condition equivalent to `may_be_used_in`, for a table's `project` column."""
    found: ColumnElement[bool] = column.in_(["", project])
    return found
