"""What a connection may take before it has said what it wants: so much time, so many bytes, and a place among so many others.

The server beneath (uvicorn) waits for ever for the rest of a request, and keeps whatever a client sends as its head. Anybody who
reaches the port could so fill the service's memory, or take all the files that it may open, films and database included.
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

HEAD_WITHIN_S = 20.0
LARGEST_HEAD = 1 << 16  # bytes, beside what came at one time with its begin
BODY_WITHIN_S = 60.0  # and a second more for each of
BODY_BYTES_A_SECOND = 1 << 10
SHORT_BODY = 1 << 16  # bytes; the server beneath holds so many before it reads no more
FILES = 1 << 16  # that the service asks to be allowed to open
OWN_FILES = 512  # of them at least are left for films, blobs and the database
REFUSED = b"HTTP/1.1 %s\r\ncontent-type: text/plain\r\ncontent-length: %d\r\nconnection: close\r\n\r\n%s"


def most_connections() -> int:
    """As many as leave enough of the files that this process may open; it is allowed as many as the system lets it be."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = FILES if hard == resource.RLIM_INFINITY else min(FILES, hard)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
            soft = wanted
    allowed = FILES if soft == resource.RLIM_INFINITY else soft
    return max(allowed - max(OWN_FILES, allowed // 4), allowed // 4)


class Connection(HttpToolsProtocol):
    """One connection, as uvicorn makes it."""

    most = 1 << 16  # at a time, of all connections: set by whoever runs the server
    _saying: dict[Connection, None] = {}  # noqa: RUF012 - of all: those whose request is not complete, the oldest first

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._head: int | None = 0  # bytes of a head that is not complete; None: it is
        self._has_begun = False  # a head, with what was received last
        self._is_silent = True
        self._received = 0  # bytes of the body
        self._body_since = 0.0
        self._timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Where there are too many, one that has waited longest with its request makes room, or this one is refused."""
        super().connection_made(transport)
        if len(self.connections) > self.most:
            oldest = next(iter(self._saying), None)
            if oldest is None:
                self._refuse(b"503 Service Unavailable", b"Too many connections are open. Try again in a moment.")
                return
            oldest.transport.abort()
            self._saying.pop(oldest, None)
        self._wait(HEAD_WITHIN_S)

    def connection_lost(self, exc: Exception | None) -> None:
        """It is over."""
        self._rest()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Take in what came, as far as it may."""
        self._has_begun = self._is_silent = False
        super().data_received(data)
        if self.transport.is_closing() or self._head is None or self._has_begun:
            return
        self._head += len(data)
        if self._head > LARGEST_HEAD:
            self._refuse(b"431 Request Header Fields Too Large", b"The request's address and headers are too long.")

    def handle_websocket_upgrade(self) -> None:
        """From here on it is a WebSocket's."""
        self._rest()
        super().handle_websocket_upgrade()

    def on_message_begin(self) -> None:
        """Another request."""
        super().on_message_begin()
        self._head, self._has_begun = 0, True
        if self._timer is None:
            self._wait(HEAD_WITHIN_S)

    def on_headers_complete(self) -> None:
        """It is known what is asked for."""
        self._head, self._received, self._body_since = None, 0, time.monotonic()
        super().on_headers_complete()
        self._wait(BODY_WITHIN_S)

    def on_body(self, body: bytes) -> None:
        """Some of the body."""
        self._received += len(body)
        super().on_body(body)

    def on_message_complete(self) -> None:
        """All of it is here."""
        self._rest()
        super().on_message_complete()

    def _start_asgi_task(self, cycle: RequestResponseCycle, app: Any) -> None:
        """A short body is waited for here: thousands of requests that do not go on cost others next to nothing then."""
        super()._start_asgi_task(cycle, partial(_once_whole, cycle, app) if _is_short(cycle) else app)

    def _wait(self, seconds: float) -> None:
        self._rest()
        self._saying[self] = None
        self._timer = self.loop.call_later(seconds, self._is_late)

    def _rest(self) -> None:
        self._saying.pop(self, None)
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _is_late(self) -> None:
        self._timer = None
        if self._head is None:
            if self.flow.read_paused:  # it waits for the service
                self._body_since += BODY_WITHIN_S
            left_s = self._body_since + BODY_WITHIN_S + self._received / BODY_BYTES_A_SECOND - time.monotonic()
            if left_s > 0:
                self._wait(left_s)
                return
            if self.cycle is not None and self.cycle.response_started:
                self._rest()
                self.transport.close()
                return
        if self._is_silent:  # a browser opens connections ahead of time, and takes an answer on one for its next request's
            self._rest()
            self.transport.close()
            return
        self._refuse(b"408 Request Timeout", b"The request did not arrive in time.")

    def _refuse(self, status: bytes, sentence: bytes) -> None:
        self._rest()
        if self.cycle is None or self.cycle.response_complete or self._head is None:
            self.transport.write(REFUSED % (status, len(sentence), sentence))
        self.transport.close()


def _is_short(cycle: RequestResponseCycle) -> bool:
    """Whether a request says that it has a short body, and not that it waits for a word before it sends that."""
    length = next((value for name, value in cycle.scope["headers"] if name == b"content-length"), b"0")
    return not cycle.waiting_for_100_continue and length.isdigit() and 0 < int(length[:18]) <= SHORT_BODY


async def _once_whole(cycle: RequestResponseCycle, app: Any, *request: Any) -> None:
    """Let the application answer a request when all of it is here; one whose sender has left needs no answer."""
    while cycle.more_body and not cycle.disconnected:
        cycle.message_event.clear()
        await cycle.message_event.wait()
    if not cycle.disconnected:
        await app(*request)
