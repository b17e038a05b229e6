"""The door: security headers on every answer, and refusal of what a foreign page makes a browser send.

A page elsewhere may post to a service on the reader's own machine (CSRF), or point its own name at 127.0.0.1 and read the
answers too (DNS rebinding). So a service on loopback answers only to loopback's names, and requests that carry another
Origin than the Host they go to change nothing and open no WebSocket.
"""

from __future__ import annotations

from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.api.problem import Problem, response
from service.settings import Settings

__all__ = ["Door"]

HEADERS = {
    "Content-Security-Policy": (
        "default-src 'self'; img-src 'self' data: blob:; object-src 'none'; "
        "base-uri 'none'; frame-ancestors 'none'; form-action 'self'"
    ),
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=()",
}
LOOPBACK_NAMES = {"localhost", "127.0.0.1", "::1"}
SAFE_METHODS = {"GET", "HEAD", "OPTIONS"}
MAX_BODY = 1 << 20  # of all but uploads, which have limits of their own
STREAMED = ("/api/scenes", "/api/farm/blobs/", "/api/farm/kernels/")


class Door:
    """ASGI middleware around the whole application."""

    def __init__(self, app: ASGIApp, settings: Settings) -> None:
        self._app = app
        self._hosts = LOOPBACK_NAMES | set(settings.allowed_hosts) if settings.is_loopback else set(settings.allowed_hosts)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Judge a request and pass it on, or answer it here."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        refusal = self._judge(scope)
        if refusal is not None:
            if scope["type"] == "websocket":
                await send({"type": "websocket.close", "code": 1008, "reason": refusal.detail[:120]})
            else:
                await response(refusal.status, refusal.detail, refusal.headers)(scope, receive, _with_headers(send))
        elif scope["type"] == "websocket":
            await self._app(scope, receive, send)
        else:
            await self._app(_head_as_get(scope), _bounded(scope, receive), _with_headers(send))

    def _judge(self, scope: Scope) -> Problem | None:
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if self._hosts and _name(host) not in self._hosts:
            return Problem(421, "The service does not answer to this name. Open it as localhost, or set RAYFARM_ALLOWED_HOSTS.")
        changes = scope["type"] == "websocket" or scope["method"] not in SAFE_METHODS
        origin = headers.get("origin")
        if changes and origin is not None and urlsplit(origin).netloc.lower() != host.lower():
            return Problem(403, "The request comes from a page of another origin. Use the service's own page, or a program.")
        length = headers.get("content-length", "")
        if scope["type"] == "http" and not scope["path"].startswith(STREAMED) and length.isdigit() and int(length) > MAX_BODY:
            return _too_large()
        return None


def _head_as_get(scope: Scope) -> Scope:
    """Let every GET of the API be asked for its headers alone (RFC 9110, 9.1); the server drops the body of the answer.

    Only the endless stream of events stays out: its answer would never be complete.
    """
    if scope["method"] == "HEAD" and scope["path"] != "/api/events":
        return {**scope, "method": "GET"}
    return scope


def _name(host: str) -> str:
    """A Host header without its port."""
    return urlsplit(f"//{host}").hostname or ""


def _with_headers(send: Send) -> Send:
    async def wrapped(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in HEADERS.items():
                headers.setdefault(name, value)
            if "cache-control" not in headers:
                headers["Cache-Control"] = "no-store"
        await send(message)

    return wrapped


def _bounded(scope: Scope, receive: Receive) -> Receive:
    """Hold the limit also where the length is not told."""
    if scope["path"].startswith(STREAMED):
        return receive
    size = 0

    async def wrapped() -> Message:
        nonlocal size
        message = await receive()
        size += len(message.get("body", b""))
        if size > MAX_BODY:
            raise HTTPException(413, _too_large().detail)  # the one exception that FastAPI lets through while it reads a body
        return message

    return wrapped


def _too_large() -> Problem:
    return Problem(413, f"The body is larger than {MAX_BODY} bytes.", headers={"Connection": "close"})
