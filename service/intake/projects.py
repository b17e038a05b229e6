"""Which project an upload belongs to, and the ids of what is in a project."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

from sqlalchemy import ColumnElement

__all__ = ["NOBODY", "Owner", "id_in", "serves", "serving"]


@dataclass(frozen=True)
class Owner:
    """project: whose members see it; empty: everybody. user, key: who sent it, and by which token, where that is known."""

    project: str = ""
    user: str | None = None
    key: str | None = None


NOBODY = Owner()


def id_in(project: str, id: str) -> str:
    """The id of a content within a project. The same content elsewhere is another thing: neither its name nor that it is there
    tells anything to others."""
    return hashlib.sha256(f"{project}\n{id}".encode()).hexdigest()[: len(id)] if project else id


def serves(thing: str, project: str) -> bool:
    """Whether a thing of one project may be used in another: its own things and everybody's may be. Empty: of no project."""
    return thing in ("", project)


def serving(column: Any, project: str) -> ColumnElement[bool]:
    """As `serves`, of a table's column `project`."""
    found: ColumnElement[bool] = column.in_(["", project])
    return found
