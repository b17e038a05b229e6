"""What a caller may do, and who a caller is."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

__all__ = ["OPEN", "OWNER", "Caller", "Kind", "Role", "RoleName"]

RoleName = Literal["view", "submit", "admin"]
Kind = Literal["open", "owner", "session", "token", "worker"]

OWNER = "owner"  # whoever reads the data folder's owner-token: no user can be called so


class Role(IntEnum):
    """Each may what those before it may."""

    NOBODY = 0
    VIEW = 1  # look at everything
    SUBMIT = 2  # upload, render, change and delete
    ADMIN = 3  # workers too, and who else may

    @classmethod
    def of(cls, name: str) -> Role:
        """By its name in the API; a name of another release means nothing here."""
        return {"view": cls.VIEW, "submit": cls.SUBMIT, "admin": cls.ADMIN}.get(name, cls.NOBODY)

    @property
    def word(self) -> str:
        """Its name in the API."""
        return self.name.lower()


@dataclass(frozen=True)
class Caller:
    """Who sent a request. name: of the user, or of the worker's token. key: the id of what was shown; None: no row of keys."""

    name: str
    role: Role
    kind: Kind
    key: str | None = None

    @property
    def is_worker(self) -> bool:
        """Whether it showed a worker's token."""
        return self.kind == "worker"

    @property
    def sees_everything(self) -> bool:
        """Whether no project is closed to it: who keeps the farm can read its data folder too."""
        return self.role >= Role.ADMIN

    @property
    def is_known(self) -> bool:
        """Whether it showed who it is, and is not only let in because the service is open to this machine."""
        return self.kind != "open"


OPEN = Caller("this machine", Role.ADMIN, "open")
