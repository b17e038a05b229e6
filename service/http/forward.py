"""Forwards requests from a standby to the service that owns the farm, and streams the responses back.

The owner treats them as if it had received them directly: the standby sends the client's address and scheme in a signed field.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Coroutine
from contextlib import suppress
from http.cookiejar import CookieJar, DefaultCookiePolicy
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import quote, urlsplit

from starlette.datastructures import Headers
from starlette.types import Receive, Scope, Send
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidStatus

from renderer.sentences import Sentence
from service.errors import Unavailable
from service.http.client_address import PASSED_ON, signed_origin
from service.http.hosts import is_local_address
from service.http.problems import Problem
from service.http.security import send_error
from service.settings import Settings

if TYPE_CHECKING:
    import httpx

__all__ = ["OwnerClient"]

CONNECT_S = 3.0
CLOSE_SERVICE_RESTART = 1012  # a WebSocket's close code: the client should reconnect
NO_CLOSE_CODE = (None, 1005, 1006)
T = TypeVar("T")
NO_PATH = Problem(400, Sentence("request-path-invalid", "The path is invalid. It must begin with / and be shorter than 64 KiB."))
# Fields of one connection only (RFC 9110, 7.6.1), and those that the next server sets.
HOP_BY_HOP_HEADERS = {
    "connection",
    "keep-alive",
    "proxy-authenticate",
    "proxy-authorization",
    "te",
    "trailer",
    "transfer-encoding",
    "upgrade",
}
SERVER_HEADERS = {"date", "server"}  # also set by this server
HANDSHAKE = {"host", "sec-websocket-key", "sec-websocket-version", "sec-websocket-extensions", "sec-websocket-protocol"}


class OwnerClient:
    """Client of the service that owns the farm, for HTTP requests and WebSockets.

    `ended`, a parameter of its methods, is an event that is set when this service becomes the owner itself.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._http: httpx.AsyncClient | None = None

    async def close(self) -> None:
        """Closes the connections."""
        if self._http is not None:
            await self._http.aclose()
            self._http = None

    async def is_ready(self, url: str, ended: asyncio.Event) -> bool:
        """Returns True if the service at this URL is ready. Returns False if `ended` is set before it answers."""
        import httpx  # imported only if needed: the import takes a tenth of a second of a starting service

        asking = self._client().get(f"{url}/readyz", headers={"Host": "localhost", PASSED_ON: "1"}, timeout=CONNECT_S)
        try:
            answer = await _result_unless(ended, asking)
        except httpx.HTTPError:
            return False
        return answer is not None and answer.is_success

    async def request(self, url: str, ended: asyncio.Event, scope: Scope, receive: Receive, send: Send) -> None:
        """Forwards an HTTP request; stops if `ended` is set.

        Raises Unavailable if the owner does not respond; then nothing was sent to the client.
        """
        import httpx

        headers = Headers(scope=scope)
        has_body = headers.get("content-length", "0") != "0" or "transfer-encoding" in headers
        path = _path(scope)
        try:
            if not path.startswith("/"):
                raise httpx.InvalidURL("no path")  # a path such as `*@elsewhere/` would change the host of the URL
            request = self._client().build_request(
                scope["method"],
                url + path,
                headers=self._headers(scope, HOP_BY_HOP_HEADERS),
                content=_body(receive) if has_body else None,
            )
        except httpx.InvalidURL:
            await send_error(NO_PATH, scope, receive, send)
            return
        try:
            answer = await _result_unless(ended, self._client().send(request, stream=True))
        except httpx.HTTPError as error:
            raise _unreachable_owner(type(error).__name__) from error
        if answer is None:
            raise _unreachable_owner("no answer")
        leaving = asyncio.create_task(_wait_for_disconnect(receive))
        try:
            await _result_unless(ended, _stream_back(answer, send), leaving)
        finally:
            leaving.cancel()
            await answer.aclose()

    async def socket(self, url: str, ended: asyncio.Event, scope: Scope, receive: Receive, send: Send) -> None:
        """Forwards a WebSocket connection until `ended` is set. Raises Unavailable if the owner does not respond."""
        await receive()
        there, path = urlsplit(url), _path(scope)
        if not path.startswith("/"):
            await send_error(NO_PATH, scope, receive, send)
            return
        host = Headers(scope=scope).get("host", there.netloc)
        connection = connect(
            f"{'wss' if there.scheme == 'https' else 'ws'}://{host}{path}",
            host=there.hostname,
            port=there.port,
            additional_headers=[
                (_text(name), _text(value)) for name, value in self._headers(scope, HOP_BY_HOP_HEADERS | HANDSHAKE)
            ],
            subprotocols=scope["subprotocols"] or None,
            user_agent_header=None,
            compression=None,
            max_size=None,
            proxy=None,
            open_timeout=CONNECT_S,
        )
        try:
            async with connection as far:
                await _relay(far, ended, receive, send)
        except InvalidStatus as error:
            response = error.response
            await send_error(Problem(response.status_code, _text(bytes(response.body or b""))[:300]), scope, receive, send)
        except (InvalidHandshake, OSError, TimeoutError) as error:
            raise _unreachable_owner(type(error).__name__) from error

    def _headers(self, scope: Scope, left_out: set[str]) -> list[tuple[bytes, bytes]]:
        """Returns the header fields to forward: the request's without those in `left_out`, and the client's signed address.

        For a loopback client, the signed address is empty.
        """
        client = (scope.get("client") or ("", 0))[0]
        origin = signed_origin(scope, "" if is_local_address(client) else client, self._settings.owner_token)
        kept = [(name, value) for name, value in scope["headers"] if _text(name).lower() not in left_out]
        return [*kept, (PASSED_ON.encode(), origin.encode())]

    def _client(self) -> httpx.AsyncClient:
        import httpx

        if self._http is None:
            limits = httpx.Limits(max_connections=None, max_keepalive_connections=20)
            timeout = httpx.Timeout(None, connect=CONNECT_S)
            # Cookies of the owner belong to the clients, so this client stores none.
            no_cookies = CookieJar(DefaultCookiePolicy(allowed_domains=()))
            self._http = httpx.AsyncClient(limits=limits, timeout=timeout, trust_env=False, cookies=no_cookies)
            for name in ("accept", "accept-encoding", "user-agent"):
                del self._http.headers[name]  # set only if the client sets them
        return self._http


def _path(scope: Scope) -> str:
    path = scope.get("raw_path") or quote(scope["path"]).encode()
    query = scope["query_string"]
    return _text(path).partition("?")[0] + (f"?{_text(query)}" if query else "")


def _text(header: bytes) -> str:
    return header.decode("latin-1")


async def _body(receive: Receive) -> AsyncIterator[bytes]:
    import httpx

    while True:
        message = await receive()
        if message["type"] == "http.disconnect":
            raise httpx.ReadError("the client has disconnected")
        yield message.get("body", b"")
        if not message.get("more_body", False):
            return


async def _stream_back(answer: httpx.Response, send: Send) -> None:
    kept = [(name, value) for name, value in answer.headers.raw if _text(name).lower() not in HOP_BY_HOP_HEADERS | SERVER_HEADERS]
    await send(
        {"type": "http.response.start", "status": answer.status_code, "headers": [(name.lower(), value) for name, value in kept]}
    )
    async for piece in answer.aiter_raw():
        await send({"type": "http.response.body", "body": piece, "more_body": True})
    await send({"type": "http.response.body", "body": b"", "more_body": False})


async def _wait_for_disconnect(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass


async def _relay(owner_socket: ClientConnection, ended: asyncio.Event, receive: Receive, send: Send) -> None:
    """Forwards WebSocket messages in both directions until either side disconnects or `ended` is set."""
    await send({"type": "websocket.accept", "subprotocol": owner_socket.subprotocol})
    going = asyncio.create_task(_relay_to_owner(owner_socket, receive))
    try:
        with suppress(ConnectionClosed):  # the owner died, and another service takes its place
            await _result_unless(ended, _relay_to_client(owner_socket, send), going)
        if not going.done():
            code = owner_socket.close_code if owner_socket.close_code not in NO_CLOSE_CODE else CLOSE_SERVICE_RESTART
            await send({"type": "websocket.close", "code": code, "reason": owner_socket.close_reason or ""})
    finally:
        going.cancel()
        owner_socket.transport.abort()  # without a closing handshake, since the owner may be suspended


async def _relay_to_owner(owner_socket: ClientConnection, receive: Receive) -> None:
    with suppress(ConnectionClosed, OSError):
        while (message := await receive())["type"] != "websocket.disconnect":
            text = message.get("text")
            await owner_socket.send(text if text is not None else message["bytes"])


async def _relay_to_client(owner_socket: ClientConnection, send: Send) -> None:
    async for message in owner_socket:
        await send({"type": "websocket.send", "text" if isinstance(message, str) else "bytes": message})


async def _result_unless(ended: asyncio.Event, doing: Coroutine[Any, Any, T], *others: asyncio.Task[Any]) -> T | None:
    """Returns the result of the coroutine `doing`, or None if it was cancelled.

    It is cancelled if the event `ended` is set first, or if one of the tasks `others` ends first.
    """
    task, ending = asyncio.create_task(doing), asyncio.create_task(ended.wait())
    try:
        await asyncio.wait((task, ending, *others), return_when=asyncio.FIRST_COMPLETED)
        return task.result() if task.done() else None
    finally:
        for each in (task, ending):
            each.cancel()


def _unreachable_owner(why: str) -> Unavailable:
    return Unavailable(
        Sentence("owner-not-reachable", "The service that runs the farm does not answer ({error}).", error=why), 1.0
    )
