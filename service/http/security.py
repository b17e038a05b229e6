"""Adds security headers to every response, and rejects cross-site requests.

A foreign web page could post to a service on the visitor's own machine (CSRF), or point its host name at it and also read the
responses (DNS rebinding). So the service accepts only its own host names (service.http.hosts), and a request whose Origin differs
from its Host can change nothing and open no WebSocket.
"""

from __future__ import annotations

from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from renderer.sentences import Sentence
from service.http.head_requests import as_get
from service.http.hosts import Hosts, name_of
from service.http.problems import Problem, response
from service.settings import Settings

__all__ = ["SAFE_METHODS", "SecurityMiddleware", "exceeds_limit", "send_error"]

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
HSTS = f"max-age={365 * 86400}"  # not for localhost, where it would apply to programs on other ports too
CROSS_SITE_ERROR = Sentence(
    "request-origin-forbidden", "The request comes from a page of another origin. Use the service's own page, or a program."
)
SAME_SITE_VALUES = ("same-origin", "none")  # none: typed into the address bar
SAFE_METHODS = {"GET", "HEAD", "OPTIONS"}
MAX_BODY = 1 << 20  # bytes; uploads have separate limits
STREAMED = ("/api/scenes", "/api/environments", "/api/references", "/api/farm/blobs/", "/api/farm/kernels/")


class SecurityMiddleware:
    """ASGI middleware around the whole application, which adds security headers and rejects cross-site requests."""

    def __init__(self, app: ASGIApp, settings: Settings) -> None:
        self._app = app
        self._hosts = Hosts(settings)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Checks a request, then calls the application or responds with an error."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, _with_refusal(scope, send))
            return
        refusal = self._rejection(scope)
        if refusal is not None:
            await send_error(refusal, scope, receive, _with_headers(scope, send))
        elif scope["type"] == "websocket":
            await self._app(scope, receive, _with_headers(scope, send))
        else:
            await self._app(_head_as_get(scope), _limited_receive(scope, receive), _with_headers(scope, send))

    def _rejection(self, scope: Scope) -> Problem | None:
        headers = Headers(scope=scope)
        hosts = headers.getlist("host")
        name = name_of(hosts[0]) if len(hosts) == 1 else None
        if name is None:
            return Problem(
                400,
                Sentence(
                    "request-host-malformed", "The Host header is not a valid name or address. Send one, such as localhost:8000."
                ),
            )
        if not self._hosts.is_accepted(name):
            return Problem(
                421,
                Sentence(
                    "request-host-not-allowed",
                    "The service is not allowed to answer to the name {name}. Open it as localhost or by its "
                    "address; to allow this name, start it with --allow-host {name} "
                    "(RAYFARM_ALLOWED_HOSTS='[\"{name}\"]').",
                    name=name[:80],
                ),
            )
        if "\0" in scope["path"]:
            return Problem(
                404, Sentence("request-name-null-character", "Nothing has this name: names cannot contain the character 0.")
            )
        changes = scope["type"] == "websocket" or scope["method"] not in SAFE_METHODS
        if changes and any(_host_of(origin) != hosts[0].lower() for origin in headers.getlist("origin")):
            return Problem(403, CROSS_SITE_ERROR)
        if scope["type"] == "http" and changes and headers.get("sec-fetch-site", "none") not in SAME_SITE_VALUES:
            return Problem(403, CROSS_SITE_ERROR)
        length = headers.get("content-length", "")
        if scope["type"] == "http" and not scope["path"].startswith(STREAMED) and exceeds_limit(length, MAX_BODY):
            return _too_large()
        return None


async def send_error(refusal: Problem, scope: Scope, receive: Receive, send: Send) -> None:
    """Rejects a request, or a WebSocket before it is accepted, with an error response."""
    if scope["type"] == "http" or "websocket.http.response" in scope.get("extensions", {}):
        await response(refusal.status, refusal.detail, refusal.headers)(scope, receive, send)
    else:
        await send({"type": "websocket.close", "code": 1008})


def _host_of(origin: str) -> str | None:
    """Returns host and port of an Origin header; None if it has none ("null")."""
    try:
        return urlsplit(origin).netloc.lower() or None
    except ValueError:
        return None


def exceeds_limit(length: str, limit: int) -> bool:
    """Returns True if the size in a Content-Length header exceeds `limit` bytes.

    Returns False for a malformed header, which the server rejects itself.
    """
    return length.isascii() and length.isdigit() and (len(length) > 18 or int(length) > limit)


def _head_as_get(scope: Scope) -> Scope:
    """Changes the method of a HEAD request to GET, so that every GET route supports HEAD.

    Does not change it for the event stream, whose response never ends.
    """
    if scope["method"] == "HEAD" and scope["path"] != "/api/events":
        return as_get(scope)
    return scope


def _with_refusal(scope: Scope, send: Send) -> Send:
    """Wraps `send`: if the service cannot start, the server logs the reason (`app.state.refusal`) instead of a traceback."""

    async def send_with_refusal(message: Message) -> None:
        refusal = getattr(scope["app"].state, "refusal", None)
        if message["type"] == "lifespan.startup.failed" and refusal is not None:
            message = {**message, "message": refusal}
        await send(message)

    return send_with_refusal


def _with_headers(scope: Scope, send: Send) -> Send:
    is_secure = scope["scheme"] in ("https", "wss") and name_of(Headers(scope=scope).get("host", "")) != "localhost"

    async def send_with_headers(message: Message) -> None:
        if message["type"].endswith("http.response.start"):
            headers = MutableHeaders(scope=message)
            for name, value in HEADERS.items():
                headers.setdefault(name, value)
            if is_secure:
                headers.setdefault("Strict-Transport-Security", HSTS)
            if "cache-control" not in headers:
                headers["Cache-Control"] = "no-store"
        await send(message)

    return send_with_headers


def _limited_receive(scope: Scope, receive: Receive) -> Receive:
    """Wraps `receive` to enforce the size limit on bodies without a Content-Length."""
    if scope["path"].startswith(STREAMED):
        return receive
    size = 0

    async def receive_limited() -> Message:
        nonlocal size
        message = await receive()
        size += len(message.get("body", b""))
        if size > MAX_BODY:
            raise HTTPException(413, _too_large().detail)  # the only exception that FastAPI passes on while reading a body
        return message

    return receive_limited


def _too_large() -> Problem:
    return Problem(
        413,
        Sentence("request-body-too-large", "The body is larger than {most} bytes. Send a smaller one.", most=MAX_BODY),
        headers={"Connection": "close"},
    )
