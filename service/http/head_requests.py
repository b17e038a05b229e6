"""HEAD requests for content that is generated on request: responds with the known headers without generating it."""

from __future__ import annotations

from collections.abc import Mapping

from fastapi import Request
from fastapi.responses import StreamingResponse
from starlette.types import Scope

__all__ = ["as_get", "headers_response", "is_head"]

HEAD = "rayfarm.head"  # key in the ASGI scope of a HEAD request


def as_get(scope: Scope) -> Scope:
    """Returns the scope with GET in place of HEAD (RFC 9110, 9.1). The server omits the response's body."""
    return {**scope, "method": "GET", HEAD: True}


def is_head(request: Request) -> bool:
    """Returns True if the original method of a request was HEAD."""
    return HEAD in request.scope


def headers_response(headers: Mapping[str, str], media_type: str) -> StreamingResponse:
    """Returns the response to a HEAD request, without Content-Length, which is unknown until the content is generated."""
    return StreamingResponse(iter(()), media_type=media_type, headers=headers)
