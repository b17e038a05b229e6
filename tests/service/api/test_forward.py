"""Tests of a standby service that forwards requests to the owner of the farm.

Two real servers run: one echoes requests in place of the owner, and a standby forwards to it.
"""

from __future__ import annotations

import asyncio
import json
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal

import pytest
import uvicorn
from starlette.types import ASGIApp, Receive, Scope, Send

from service.http.client_address import PASSED_ON, _verified_origin
from service.http.forward import OwnerClient
from service.settings import Settings
from tests.service.conftest import until


@contextmanager
def run_server(app: ASGIApp, lifespan: Literal["on", "off"] = "off") -> Iterator[int]:
    """Runs a server in the `with` block; yields its port on loopback."""
    server = uvicorn.Server(uvicorn.Config(app, port=0, lifespan=lifespan, log_level="warning"))
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    until(lambda: server.started, "the server listens", 60)
    try:
        yield server.servers[0].sockets[0].getsockname()[1]
    finally:
        server.should_exit = True
        thread.join(20)


async def echo(scope: Scope, receive: Receive, send: Send) -> None:
    """An ASGI application that responds with the request that it received, and sets a session cookie."""
    headers = {name.decode(): value.decode() for name, value in scope["headers"]}
    body = json.dumps({"path": scope["raw_path"].decode(), "headers": headers}).encode()
    cookie = (b"set-cookie", b"session=of-the-one-before; Path=/; HttpOnly")
    await send({"type": "http.response.start", "status": 200, "headers": [cookie, (b"content-length", b"%d" % len(body))]})
    await send({"type": "http.response.body", "body": body})


@pytest.fixture(scope="module")
def owner() -> Iterator[int]:
    with run_server(echo) as port:
        yield port


@pytest.fixture(scope="module")
def standby(owner: int) -> Iterator[int]:
    forward, over = OwnerClient(Settings(owner_token="the owner's")), asyncio.Event()

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "lifespan":
            for each in ("startup", "shutdown"):
                await receive()
                if each == "shutdown":
                    await forward.close()
                await send({"type": f"lifespan.{each}.complete"})
            return
        await forward.request(f"http://127.0.0.1:{owner}", over, scope, receive, send)

    with run_server(app, "on") as port:
        yield port


def send_raw(port: int, target: str, *headers: str) -> tuple[int, bytes]:
    """Sends a raw request that no HTTP client would write; returns status and body."""
    with socket.create_connection(("127.0.0.1", port), timeout=30) as wire:
        lines = [f"GET {target} HTTP/1.1", "Host: localhost", "Connection: close", *headers]
        wire.sendall("\r\n".join([*lines, "", ""]).encode())
        answer = b"".join(iter(lambda: wire.recv(1 << 16), b""))
    head, _, body = answer.partition(b"\r\n\r\n")
    return int(head.split()[1]), body


def test_cookies_are_not_shared_between_clients(standby: int) -> None:
    assert "cookie" not in json.loads(send_raw(standby, "/")[1])["headers"]
    assert "cookie" not in json.loads(send_raw(standby, "/")[1])["headers"], "what the owner gave another"
    assert json.loads(send_raw(standby, "/", "Cookie: session=mine")[1])["headers"]["cookie"] == "session=mine"


def test_path_cannot_change_forwarding_host(standby: int) -> None:
    """A request's path cannot change the host that it is forwarded to.

    The owner's address `http://owner:8000` followed by `*@elsewhere/` would be a URL at elsewhere.
    """
    with run_server(echo) as elsewhere:
        status, body = send_raw(standby, f"*@127.0.0.1:{elsewhere}/secret")
    assert status == 400
    assert b"secret" not in body
    assert send_raw(standby, "/" + "a" * (1 << 16))[0] == 400


def test_no_encoding_is_requested_without_client(standby: int) -> None:
    """A client that did not request gzip gets an uncompressed response, although the standby's own client supports gzip."""
    found = json.loads(send_raw(standby, "/a?b=%20c")[1])
    assert found["path"] == "/a"
    assert not {"accept", "accept-encoding", "user-agent"} & found["headers"].keys()
    assert json.loads(send_raw(standby, "/", "Accept-Encoding: br")[1])["headers"]["accept-encoding"] == "br"


def test_only_signed_client_address_is_forwarded() -> None:
    claimed = [(b"x-forwarded-for", b"127.0.0.1"), (b"x-forwarded-for", b"10.0.0.1")]
    scope = {"type": "http", "scheme": "https", "headers": claimed, "client": ("192.168.1.7", 1234)}
    forward = OwnerClient(Settings(owner_token="the owner's"))

    def origin(scope: Scope, secret: str) -> tuple[str, str] | None:
        *kept, (name, word) = forward._headers(scope, set())
        assert (kept, name) == (claimed, PASSED_ON.encode())
        return _verified_origin(word.decode(), secret)

    assert origin(scope, "the owner's") == ("192.168.1.7", "https")
    assert origin(scope, "another's") is None
    assert origin(scope, "") is None
    for address in (
        "127.0.0.1",
        "127.0.0.2",
        "::ffff:127.0.0.1",
        "::1",
    ):  # loopback addresses, which would mean another machine to the owner
        assert origin({**scope, "client": (address, 1234)}, "the owner's") == ("", "https")
    for forged in ("1", "", "192.168.1.7 https", "192.168.1.7 https ", "- ftp x"):
        assert _verified_origin(forged, "the owner's") is None
