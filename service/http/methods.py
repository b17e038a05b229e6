"""The methods that a path supports, for the Allow header of OPTIONS and of unsupported methods (RFC 9110, 10.2.1)."""

from __future__ import annotations

from starlette.applications import Starlette
from starlette.routing import Match, Mount
from starlette.types import Scope

__all__ = ["methods_of"]

CHANGING_METHODS = ("POST", "PUT", "PATCH", "DELETE")
API = "/api/"
ENDLESS_STREAM = "/api/events"  # endless stream, so HEAD is not supported


def methods_of(app: Starlette, scope: Scope) -> list[str]:
    """Returns the methods that a request's path supports; empty for an unknown path."""
    path = scope["path"]
    asked = {"type": "http", "path": path, "root_path": scope.get("app_root_path", scope.get("root_path", "")), "headers": []}
    # The mounted files match every path without a route; they exist only outside /api/.
    routes = [route for route in app.routes if not (isinstance(route, Mount) and path.startswith(API))]

    def can(method: str) -> bool:
        found = (route.matches({**asked, "method": method})[0] for route in routes if not isinstance(route, Mount))
        return any(match is Match.FULL for match in found)

    known = [method for method in CHANGING_METHODS if can(method)]
    if can("GET") or (not known and any(route.matches({**asked, "method": "GET"})[0] is Match.FULL for route in routes)):
        known = ["GET", *([] if path == ENDLESS_STREAM else ["HEAD"]), *known]
    return [*known, "OPTIONS"] if known else []
