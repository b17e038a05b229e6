"""The caller of the current request, as a dependency of routes."""

from __future__ import annotations

from typing import Annotated

from fastapi import Depends, Query
from starlette.datastructures import Headers
from starlette.requests import HTTPConnection

from service.access.visit import Visit

__all__ = ["VISIT", "InProject", "IntoProject", "VisitDependency", "address_of", "bearer_token"]

InProject = Annotated[
    str | None, Query(max_length=64, description="only items of this project; empty: only items without a project")
]
IntoProject = Annotated[str, Query(max_length=64, description="project whose members can see it; empty: visible to all users")]

VISIT = "rayfarm.visit"  # key in the ASGI scope


def address_of(connection: HTTPConnection) -> str:
    """Returns the client's IP address of a connection."""
    return connection.client.host if connection.client else ""


def bearer_token(headers: Headers) -> str:
    """Returns the bearer token of a request; "" if it has none."""
    scheme, _, token = headers.get("authorization", "").partition(" ")
    return token.strip() if scheme.lower() == "bearer" else ""


async def get_visit(connection: HTTPConnection) -> Visit:
    """Returns the Visit that the authorization middleware stored in the connection's scope."""
    visit: Visit = connection.scope[VISIT]
    return visit


VisitDependency = Annotated[Visit, Depends(get_visit)]
