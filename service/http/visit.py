"""The caller of the current request, for routes that need it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends, Query
from starlette.datastructures import Headers
from starlette.requests import HTTPConnection

from service.access.projects import NOTHING, Sight
from service.access.roles import Caller

__all__ = ["VISIT", "InProject", "IntoProject", "Visit", "VisitDependency", "address_of", "shown_secret"]

InProject = Annotated[str | None, Query(max_length=64, description="those of this project alone; empty: those of none")]
IntoProject = Annotated[str, Query(max_length=64, description="whose members alone see it; empty: everybody who is let in")]

VISIT = "rayfarm.visit"  # key in the ASGI scope


@dataclass(frozen=True)
class Visit:
    """The caller of a request.

    caller: None if the request is not authenticated. needs_login: whether the request required a login. sight: the projects that
    the caller may see.
    """

    caller: Caller | None
    needs_login: bool
    address: str
    sight: Sight = NOTHING

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


def address_of(connection: HTTPConnection) -> str:
    """The address that a request came from."""
    return connection.client.host if connection.client else ""


def shown_secret(headers: Headers) -> str:
    """The bearer token of a request; empty if it has none."""
    scheme, _, token = headers.get("authorization", "").partition(" ")
    return token.strip() if scheme.lower() == "bearer" else ""


async def get_visit(connection: HTTPConnection) -> Visit:
    """The visit that the gate stored in the connection's scope."""
    visit: Visit = connection.scope[VISIT]
    return visit


VisitDependency = Annotated[Visit, Depends(get_visit)]
