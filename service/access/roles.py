"""Roles, and the identity of a request's caller."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

from renderer.sentences import Sentence

__all__ = ["OPEN", "OWNER", "Caller", "Kind", "Role", "RoleName"]

RoleName = Literal["view", "submit", "admin"]
Kind = Literal["open", "owner", "session", "token", "worker"]

OWNER = "owner"  # user name for holders of the data folder's owner-token; reserved


class Role(IntEnum):
    """Ordered roles: each includes the permissions of the lower ones."""

    NOBODY = 0
    VIEW = 1  # read everything
    SUBMIT = 2  # upload, render, change and delete
    ADMIN = 3  # also manage workers and users

    @classmethod
    def from_name(cls, name: str) -> Role:
        """Returns the role with this name in the API; NOBODY for an unknown name."""
        return {"view": cls.VIEW, "submit": cls.SUBMIT, "admin": cls.ADMIN}.get(name, cls.NOBODY)

    @property
    def api_name(self) -> str:
        """The role's name as used in the API."""
        return self.name.lower()

    @property
    def label(self) -> str:
        """The role's name as a translatable text, to insert into a message."""
        match self:
            case Role.VIEW:
                return Sentence("role-view", "view")
            case Role.SUBMIT:
                return Sentence("role-submit", "submit")
            case Role.ADMIN:
                return Sentence("role-admin", "admin")
        return Sentence("role-nobody", "nobody")


@dataclass(frozen=True)
class Caller:
    """The sender of a request. name: the user's name, or the worker token's.

    key: id of the session or token in the database; None if the credential is not stored there.
    """

    name: str
    role: Role
    kind: Kind
    key: str | None = None

    @property
    def is_worker(self) -> bool:
        """Returns True if the caller authenticated with a worker token."""
        return self.kind == "worker"

    @property
    def sees_everything(self) -> bool:
        """Returns True if the caller sees all projects. True for administrators, who can read the data folder anyway."""
        return self.role >= Role.ADMIN

    @property
    def is_known(self) -> bool:
        """Whether the caller has authenticated. False if admitted only because the service needs no login on its own machine."""
        return self.kind != "open"


OPEN = Caller("this machine", Role.ADMIN, "open")
