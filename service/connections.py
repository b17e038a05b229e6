"""Limits on HTTP connections: their number, and the duration and size of an incomplete request.

uvicorn waits without limit for the rest of a request, and buffers request heads of any size. So any client could fill the
service's memory or use up its file descriptors, which films and the database need too.
"""

from __future__ import annotations

import asyncio
import contextlib
import resource
import time
from functools import partial
from typing import Any

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol, RequestResponseCycle

__all__ = ["Connection", "most_connections"]

HEAD_TIMEOUT_S = 20.0
MAX_HEAD_BYTES = 1 << 16  # bytes, in addition to those received together with its beginning
BODY_TIMEOUT_S = 60.0  # seconds, plus one second for each MIN_BODY_RATE received
MIN_BODY_RATE = 1 << 10
MAX_SHORT_BODY = 1 << 16  # bytes; uvicorn buffers as many before it pauses reading
BODY_HEADERS = (b"content-length", b"transfer-encoding")
WANTED_DESCRIPTORS = 1 << 16  # file descriptors that the service requests from the system
RESERVED_DESCRIPTORS = 512  # the minimum of these that is left for films, blobs and the database
REFUSAL_RESPONSE = b"HTTP/1.1 %s\r\ncontent-type: text/plain\r\ncontent-length: %d\r\nconnection: close\r\n\r\n%s"


def most_connections() -> int:
    """Returns the maximum number of connections. It leaves enough file descriptors for films and the database.

    First raises the process's limit on descriptors, if possible.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = WANTED_DESCRIPTORS if hard == resource.RLIM_INFINITY else min(WANTED_DESCRIPTORS, hard)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
            soft = wanted
    allowed = WANTED_DESCRIPTORS if soft == resource.RLIM_INFINITY else soft
    return max(allowed - max(RESERVED_DESCRIPTORS, allowed // 4), allowed // 4)


class Connection(HttpToolsProtocol):
    """uvicorn's protocol class for HTTP connections, extended by the limits of this module."""

    most = 1 << 16  # limit of all connections, set by the caller that runs the server
    _saying: dict[Connection, None] = {}  # noqa: RUF012 - all connections with an incomplete request, oldest first

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._head: int | None = 0  # bytes of an incomplete head; None: the head is complete
        self._has_begun = False  # whether a head began in the data received last
        self._is_silent = True
        self._received = 0  # bytes of the body
        self._body_since = 0.0
        self._timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Accepts a connection.

        Above the limit, aborts the connection whose request has been incomplete for longest; if there is none, rejects the new
        one.
        """
        super().connection_made(transport)
        if len(self.connections) > self.most:
            oldest = next(iter(self._saying), None)
            if oldest is None:
                self._send_refusal(b"503 Service Unavailable", b"Too many connections are open. Try again in a moment.")
                return
            oldest.transport.abort()
            self._saying.pop(oldest, None)
        self._start_timer(HEAD_TIMEOUT_S)

    def connection_lost(self, exc: Exception | None) -> None:
        """Cancels the timeout of a closed connection."""
        self._cancel_timer()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Parses received data. Rejects a request whose head is larger than MAX_HEAD_BYTES bytes."""
        self._has_begun = self._is_silent = False
        super().data_received(data)
        if self.transport.is_closing() or self._head is None or self._has_begun:
            return
        self._head += len(data)
        if self._head > MAX_HEAD_BYTES:
            self._send_refusal(b"431 Request Header Fields Too Large", b"The request's address and headers are too long.")

    def handle_websocket_upgrade(self) -> None:
        """Passes the connection to the WebSocket protocol and cancels its timeout.

        Rejects a request with a body, for which the WebSocket protocol would wait without limit.
        """
        if any(name in BODY_HEADERS and value != b"0" for name, value in self.scope["headers"]):
            self._send_refusal(b"400 Bad Request", b"A request for a WebSocket has no body.")
            return
        self._cancel_timer()
        super().handle_websocket_upgrade()

    def on_message_begin(self) -> None:
        """Starts the timeout for a new request's head."""
        super().on_message_begin()
        self._head, self._has_begun = 0, True
        if self._timer is None:
            self._start_timer(HEAD_TIMEOUT_S)

    def on_headers_complete(self) -> None:
        """Starts the timeout for the request's body."""
        self._head, self._received, self._body_since = None, 0, time.monotonic()
        super().on_headers_complete()
        self._start_timer(BODY_TIMEOUT_S)

    def on_body(self, body: bytes) -> None:
        """Extends the timeout in proportion to the received bytes of the body."""
        self._received += len(body)
        super().on_body(body)

    def on_message_complete(self) -> None:
        """Cancels the timeout, since the request is complete."""
        self._cancel_timer()
        super().on_message_complete()

    def _start_asgi_task(self, cycle: RequestResponseCycle, app: Any) -> None:
        """Starts the application for a request.

        If the request's body is short, the application starts only once the body is complete, so that stalled requests use few
        resources.
        """
        super()._start_asgi_task(cycle, partial(_run_when_complete, cycle, app) if _has_short_body(cycle) else app)

    def _start_timer(self, seconds: float) -> None:
        self._cancel_timer()
        self._saying[self] = None
        self._timer = self.loop.call_later(seconds, self._time_out)

    def _cancel_timer(self) -> None:
        self._saying.pop(self, None)
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _time_out(self) -> None:
        self._timer = None
        if self._head is None:
            if self.flow.read_paused:  # the service itself has paused reading
                self._body_since += BODY_TIMEOUT_S
            left_s = self._body_since + BODY_TIMEOUT_S + self._received / MIN_BODY_RATE - time.monotonic()
            if left_s > 0:
                self._start_timer(left_s)
                return
            if self.cycle is not None and self.cycle.response_started:
                self._cancel_timer()
                self.transport.close()
                return
        if self._is_silent:  # browsers open connections in advance, and would take a response for that of their next request
            self._cancel_timer()
            self.transport.close()
            return
        self._send_refusal(b"408 Request Timeout", b"The request did not arrive in time.")

    def _send_refusal(self, status: bytes, sentence: bytes) -> None:
        self._cancel_timer()
        if self.cycle is None or self.cycle.response_complete or self._head is None:
            self.transport.write(REFUSAL_RESPONSE % (status, len(sentence), sentence))
        self.transport.close()


def _has_short_body(cycle: RequestResponseCycle) -> bool:
    """Returns True if a request's body is short and the client sends it without waiting for `100 Continue`."""
    length = next((value for name, value in cycle.scope["headers"] if name == b"content-length"), b"0")
    return not cycle.waiting_for_100_continue and length.isdigit() and 0 < int(length[:18]) <= MAX_SHORT_BODY


async def _run_when_complete(cycle: RequestResponseCycle, app: Any, *request: Any) -> None:
    """Runs the application once the request is complete. Does nothing if the client disconnects first."""
    while cycle.more_body and not cycle.disconnected:
        cycle.message_event.clear()
        await cycle.message_event.wait()
    if not cycle.disconnected:
        await app(*request)
