"""HEAD requests for content that is made on demand: returns the known headers without making the content."""

from __future__ import annotations

from collections.abc import Mapping

from fastapi import Request
from fastapi.responses import StreamingResponse
from starlette.types import Scope

__all__ = ["as_get", "headers_alone", "is_head"]

HEAD = "rayfarm.head"  # key in the ASGI scope of a HEAD request


def as_get(scope: Scope) -> Scope:
    """Rewrites a HEAD request as GET (RFC 9110, 9.1); the server drops the body of the answer."""
    return {**scope, "method": "GET", HEAD: True}


def is_head(request: Request) -> bool:
    """Returns True if the request was a HEAD request."""
    return HEAD in request.scope


def headers_alone(headers: Mapping[str, str], media_type: str) -> StreamingResponse:
    """Returns the response to a HEAD request, without a length, which is unknown before the content is made."""
    return StreamingResponse(iter(()), media_type=media_type, headers=headers)
