"""Which project an upload belongs to, and the ids of what is in a project."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

__all__ = ["NOBODY", "Owner", "id_in"]


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
