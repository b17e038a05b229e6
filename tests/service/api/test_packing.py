"""Tests that JSON is compressed if the client accepts it and it pays off, and other responses are unchanged."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator

import httpx
import pytest
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import Route

from service.http.compression import FEWEST, MOST, CompressionMiddleware

LONG = [{"state": "finished", "name": f"take {i}"} for i in range(5000)]


async def _pieces() -> AsyncIterator[bytes]:
    for _ in range(3):
        yield b"1" * FEWEST


async def answer(request: Request) -> Response:
    """Returns a response of the kind that the request's path names, such as `long` (JSON), `picture` or `pieces` (a stream)."""
    kinds: dict[str, Response] = {
        "long": JSONResponse(LONG),
        "short": JSONResponse({}),
        "huge": JSONResponse(["x" * MOST]),
        "picture": Response(b"x" * FEWEST, media_type="image/png"),
        "tagged": JSONResponse(LONG, headers={"ETag": '"1"'}),
        "pieces": StreamingResponse(_pieces(), media_type="application/json"),
    }
    return kinds[request.path_params["kind"]]


def request_path(kind: str, encoding: str = "gzip, deflate, br", method: str = "GET") -> httpx.Response:
    app = CompressionMiddleware(Starlette(routes=[Route("/{kind}", answer)]))

    async def ask() -> httpx.Response:
        async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://farm") as client:
            return await client.request(method, f"/{kind}", headers={"Accept-Encoding": encoding})

    return asyncio.run(ask())


def test_long_list_is_compressed() -> None:
    plain, packed = request_path("long", "identity"), request_path("long")
    assert packed.headers["content-encoding"] == "gzip" and packed.json() == plain.json() == LONG
    assert packed.headers["vary"] == "Accept-Encoding"
    assert int(packed.headers["content-length"]) < len(plain.content) / 10


@pytest.mark.parametrize("kind", ["short", "huge", "picture", "tagged", "pieces"])
def test_incompressible_responses_are_unchanged(kind: str) -> None:
    assert "content-encoding" not in request_path(kind).headers
    assert request_path(kind).content == request_path(kind, "identity").content
