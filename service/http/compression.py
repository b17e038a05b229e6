"""Gzip compression of JSON responses, which loads lists of jobs ten times as fast over slow connections.

Responses over loopback are compressed too, since requests through a tunnel (`ssh -L`) look local.
"""

from __future__ import annotations

import zlib

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

__all__ = ["CompressionMiddleware"]

FEWEST, MOST = 1400, 1 << 20  # bytes: fewer fit into one packet; more are for programs on fast networks
LEVEL = 1  # 1 ms of CPU time for 100 kB
MAX_INLINE_BYTES = 1 << 16  # bytes compressed on the event loop, which is faster than another thread
GZIP = 31  # zlib's window bits for the gzip format


class CompressionMiddleware:
    """ASGI middleware that compresses JSON responses."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Calls the application, and compresses its response if the client accepts gzip."""
        if scope["type"] != "http" or "gzip" not in Headers(scope=scope).get("accept-encoding", ""):
            await self._app(scope, receive, send)
            return
        start: Message | None = None

        async def packed(message: Message) -> None:
            nonlocal start
            if message["type"] == "http.response.start" and _is_compressed(message):
                start = message
                return
            if start is not None:
                first, start = start, None
                if not message.get("more_body"):
                    message = {**message, "body": await _compress(message.get("body", b""))}
                    headers = MutableHeaders(scope=first)
                    headers["Content-Encoding"] = "gzip"
                    headers["Content-Length"] = str(len(message["body"]))
                    headers.add_vary_header("Accept-Encoding")
                await send(first)
            await send(message)

        await self._app(scope, receive, packed)


def _is_compressed(start: Message) -> bool:
    headers = Headers(raw=start["headers"])
    length = headers.get("content-length", "")
    is_json = headers.get("content-type", "").startswith("application/json")
    is_free = "content-encoding" not in headers and "etag" not in headers
    return is_json and is_free and length.isdigit() and FEWEST <= int(length) <= MOST


async def _compress(body: bytes) -> bytes:
    return _gzip(body) if len(body) <= MAX_INLINE_BYTES else await run_in_threadpool(_gzip, body)


def _gzip(body: bytes) -> bytes:
    packer = zlib.compressobj(LEVEL, zlib.DEFLATED, GZIP)
    return packer.compress(body) + packer.flush()
