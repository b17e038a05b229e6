"""Tests that one table states who may call each route, that it has every route, and that the service enforces it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from starlette.routing import Mount

from service.access.roles import OPEN, Caller, Role
from service.http.access_requirements import ADMIN, ANYONE, IDENTIFIED_ADMIN, NEEDS, SUBMIT, UNKNOWN, VIEW, WORKER, need_of
from service.main import create_app
from service.settings import Settings

CHANGING = {"POST", "PUT", "PATCH", "DELETE"}


def routes(found: Any, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Yields method and pattern of every route of an application, including routers and mounted files."""
    for route in found:
        if isinstance(route, Mount):
            yield "GET", route.path or "/"
        elif hasattr(route, "original_router"):  # FastAPI stores an included router as one object
            yield from routes(route.original_router.routes, prefix + route.include_context.prefix)
        elif hasattr(route, "methods") and route.methods:
            yield from ((method, prefix + route.path) for method in route.methods - {"HEAD"})
        else:
            yield "WS", prefix + route.path


def test_access_table_equals_existing_routes(tmp_path: Path) -> None:
    there = set(routes(create_app(Settings(data=tmp_path)).routes))
    assert len(there) > 50
    assert not there - NEEDS.keys(), "says nowhere what it needs: service/http/access_requirements.py"
    assert not NEEDS.keys() - there, "in the table, and not there"


def test_changing_routes_need_more_than_view_role() -> None:
    own = {
        "/api/login",
        "/api/login/openid",
        "/api/login/openid/answer",
        "/api/logout",
        "/api/session/password",
        "/api/tokens",
        "/api/tokens/{id}",
    }
    for (method, pattern), need in NEEDS.items():
        shared = pattern == "/api/shared" or pattern.startswith("/api/shared/")  # for the holder of a share link
        if method in CHANGING and pattern not in own and not shared:
            assert need.role is None or need.role >= Role.SUBMIT, (method, pattern)
        if need is ANYONE:
            assert not pattern.startswith("/api/") or shared or pattern in {"/api/session", *own}, pattern


@pytest.mark.parametrize(
    ("method", "path", "need"),
    [
        ("GET", "/api/jobs/7f3a", VIEW),
        ("HEAD", "/api/jobs/7f3a", VIEW),
        ("DELETE", "/api/jobs/7f3a", SUBMIT),
        ("PATCH", "/api/workers/a b", ADMIN),
        ("POST", "/api/users", IDENTIFIED_ADMIN),
        ("WS", "/api/scenes/x/viewport", VIEW),
        ("PUT", "/api/farm/blobs/x", WORKER),
        ("GET", "/api/nowhere", UNKNOWN),
        ("DELETE", "/api", UNKNOWN),
        ("GET", "/api/jobs/x/y/z", UNKNOWN),
        ("GET", "/v/abc/js/main.js", ANYONE),
    ],
)
def test_requirement_of_request(method: str, path: str, need: object) -> None:
    assert need_of(method, path)[1] == need


def test_requirements_are_met_by_role() -> None:
    view, admin = Caller("v", Role.VIEW, "session"), Caller("a", Role.ADMIN, "token")
    worker = Caller("w", Role.NOBODY, "worker")
    met = {
        name: "".join(
            mark for mark, caller in zip("-ovaw", (None, OPEN, view, admin, worker), strict=True) if need.is_met(caller)
        )
        for name, need in [
            ("any", ANYONE),
            ("view", VIEW),
            ("submit", SUBMIT),
            ("keep", IDENTIFIED_ADMIN),
            ("work", WORKER),
            ("?", UNKNOWN),
        ]
    }
    assert met == {"any": "-ovaw", "view": "ova", "submit": "oa", "keep": "a", "work": "w", "?": "ovaw"}
