"""Who sent the request that is answered, for routes that ask."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends
from starlette.datastructures import Headers
from starlette.requests import HTTPConnection

from service.access.roles import Caller

__all__ = ["VISIT", "Visit", "VisitDependency", "address_of", "shown_secret"]

VISIT = "rayfarm.visit"  # in the scope


@dataclass(frozen=True)
class Visit:
    """caller: None where nobody is let in by what was shown. needs_login: whether this request needed one."""

    caller: Caller | None
    needs_login: bool
    address: str


def address_of(connection: HTTPConnection) -> str:
    """The address that a request came from."""
    return connection.client.host if connection.client else ""


def shown_secret(headers: Headers) -> str:
    """The token that a request shows; empty where it shows none."""
    scheme, _, token = headers.get("authorization", "").partition(" ")
    return token.strip() if scheme.lower() == "bearer" else ""


async def get_visit(connection: HTTPConnection) -> Visit:
    """What the gate found out."""
    visit: Visit = connection.scope[VISIT]
    return visit


VisitDependency = Annotated[Visit, Depends(get_visit)]
