"""The caller of a request and the projects visible to it, for functions outside the HTTP layer."""

from __future__ import annotations

from dataclasses import dataclass

from service.access.projects import NOTHING, ProjectVisibility
from service.access.roles import Caller

__all__ = ["Visit"]


@dataclass(frozen=True)
class Visit:
    """Context of a request: who sent it, from where, and what is visible to them.

    caller: None if the request is not authenticated. needs_login: whether the request required a login. address: the client's.
    sight: the visible projects.
    """

    caller: Caller | None
    needs_login: bool
    address: str
    sight: ProjectVisibility = NOTHING

    @property
    def user(self) -> str | None:
        """The user's name; None without authentication."""
        return self.caller.name if self.caller is not None and self.caller.is_known else None

    @property
    def queue(self) -> str:
        """Name of the queue in which the caller's costly requests wait.

        There is one queue per user; without authentication, one per client address.
        """
        return f"user {self.user}" if self.user is not None else f"address {self.address}"

    @property
    def token(self) -> str | None:
        """The id of the token that the request used; None if it used another credential."""
        return self.caller.key if self.caller is not None and self.caller.kind == "token" else None
