"""The caller of a request and what it may see, as the service's functions need them."""

from __future__ import annotations

from dataclasses import dataclass

from service.access.projects import NOTHING, ProjectVisibility
from service.access.roles import Caller

__all__ = ["Visit"]


@dataclass(frozen=True)
class Visit:
    """The caller of a request.

    caller: None if the request is not authenticated. needs_login: whether the request required a login. sight: the projects that
    the caller may see.
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
        """The queue in which costly requests wait: that of the user, or of the address without authentication."""
        return f"user {self.user}" if self.user is not None else f"address {self.address}"

    @property
    def token(self) -> str | None:
        """The id of the request's token; None if it used another credential."""
        return self.caller.key if self.caller is not None and self.caller.kind == "token" else None
