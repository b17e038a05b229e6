"""Tests of the limits on connections with incomplete requests: memory and number."""

from __future__ import annotations

import resource
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from http.client import HTTPResponse
from typing import Any

import pytest
import uvicorn

from rayfarm.local.farm import free_port
from service import connections
from service.connections import Connection
from tests.service.conftest import until

PIECE = b"a" * (1 << 16)
begun: list[str] = []  # paths of the application's requests


async def _echo(scope: Any, receive: Any, send: Any) -> None:
    """An application that responds with the length of the body, or 0 if none arrived."""
    assert scope["type"] == "http"
    begun.append(scope["path"])
    size, more = 0, True
    while more:
        message = await receive()
        if message["type"] == "http.disconnect":
            return
        size, more = size + len(message.get("body", b"")), message.get("more_body", False)
    body = str(size).encode()
    await send({"type": "http.response.start", "status": 200, "headers": [(b"content-length", str(len(body)).encode())]})
    await send({"type": "http.response.body", "body": body})


class Server:
    """A server that answers with the length of each body, to test the code between the socket and the application."""

    def __init__(self) -> None:
        self.port = free_port("127.0.0.1")
        config = uvicorn.Config(_echo, port=self.port, http=Connection, lifespan="off", log_level="error")
        self.server = uvicorn.Server(config)
        self.thread = threading.Thread(target=self.server.run, daemon=True)
        self.thread.start()
        until(lambda: self.server.started, "it starts")

    def connect(self, said: bytes = b"") -> socket.socket:
        client = socket.create_connection(("127.0.0.1", self.port), timeout=20)
        client.sendall(said)
        return client

    def stop(self) -> None:
        self.server.should_exit = True
        self.thread.join(10)


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    monkeypatch.setattr(Connection, "most", 1 << 16)
    server = Server()
    yield server
    server.stop()


def answer(client: socket.socket) -> bytes:
    """Returns all bytes received until the server closes the connection."""
    found = b""
    try:
        while piece := client.recv(1 << 16):
            found += piece
    except ConnectionResetError:
        pass
    return found


@pytest.mark.parametrize("begin", [b"GET /", b"GET / HTTP/1.1\r\nX: ", b"GET / HTTP/1.1\r\nX: y\r\n"])
def test_endless_head_is_rejected(server: Server, begin: bytes) -> None:
    with server.connect(begin) as client, pytest.raises(OSError, match=r"reset|pipe"):
        for _ in range(1000):
            client.sendall(b"A: b\r\n" * 10000 if begin.endswith(b"\n") else PIECE)


def test_several_requests_on_one_connection(server: Server) -> None:
    long = b"GET / HTTP/1.1\r\nHost: h\r\nCookie: " + b"c" * 30_000 + b"\r\n\r\n"
    body = b"POST / HTTP/1.1\r\nHost: h\r\nContent-Length: 300000\r\n\r\n" + b"b" * 300_000
    last = b"GET / HTTP/1.1\r\nHost: h\r\nConnection: close\r\n\r\n"
    with server.connect() as client:
        for request in (long, body, long, body, last):
            client.sendall(request[:1000])
            client.sendall(request[1000:])
        found = answer(client)
    assert [found.count(size) for size in (b"\r\n\r\n0", b"\r\n\r\n300000")] == [3, 2]


def test_incomplete_request_times_out(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "HEAD_TIMEOUT_S", 0.2)
    monkeypatch.setattr(connections, "BODY_TIMEOUT_S", 0.2)
    with server.connect() as silent, server.connect(b"GET / HT") as slow:
        assert answer(silent) == b"", "a browser takes it for the answer to its next request"
        assert answer(slow).startswith(b"HTTP/1.1 408")
    with server.connect(b"POST / HTTP/1.1\r\nHost: h\r\nContent-Length: 10\r\n\r\nabc") as slow:
        assert answer(slow).startswith(b"HTTP/1.1 408")
    until(lambda: not server.server.server_state.tasks, "nothing waits for it any more")


@pytest.mark.parametrize("field", [b"Content-Length: 5", b"Transfer-Encoding: chunked"])
def test_websocket_request_with_a_body_is_rejected(server: Server, field: bytes) -> None:
    """The WebSocket protocol would wait for the body without limit, and such connections are not counted."""
    upgrade = (
        b"Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA=="
    )
    with server.connect(b"GET / HTTP/1.1\r\nHost: x\r\n" + field + b"\r\n" + upgrade + b"\r\n\r\n") as client:
        assert b"400 Bad Request" in answer(client)


def test_excess_connection_aborts_longest_waiting_one(server: Server) -> None:
    Connection.most = 20
    working = server.connect(b"GET / HTTP/1.1\r\nHost: h\r\n\r\n")
    response = HTTPResponse(working)  # its head and its body may arrive apart
    response.begin()
    assert response.read() == b"0"
    waiting = [server.connect(b"GET / HT") for _ in range(40)]
    with server.connect(b"GET / HTTP/1.1\r\nHost: h\r\nConnection: close\r\n\r\n") as client:
        assert answer(client).startswith(b"HTTP/1.1 200")
    assert len(server.server.server_state.connections) <= 21
    for each in (working, *waiting):
        each.close()


def test_connection_limit_reserves_file_descriptors() -> None:
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    said = "import resource, service.connections as c; resource.setrlimit(resource.RLIMIT_NOFILE, (256, 2048))"
    told = f"{said}; print(c.most_connections(), resource.getrlimit(resource.RLIMIT_NOFILE)[0])"
    if hard != resource.RLIM_INFINITY and hard < 2048:
        pytest.skip("this machine lets processes open few files")
    done = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["1536", "2048"]


def test_application_starts_after_short_body_is_complete(server: Server) -> None:
    def post(path: bytes, length: int, body: bytes = b"", more: bytes = b"") -> bytes:
        return b"POST %s HTTP/1.1\r\n%sContent-Length: %d\r\nConnection: close\r\n\r\n%s" % (path, more, length, body)

    begun.clear()
    with server.connect(post(b"/left", 4, b"ab")):
        pass
    with server.connect(post(b"/slow", 4, b"ab")) as slow:
        with server.connect(post(b"/long", 1 << 20)), server.connect(post(b"/asks", 4, more=b"Expect: 100-continue\r\n")) as asks:
            until(lambda: set(begun) == {"/long", "/asks"}, "these are looked at", say=lambda: begun)
            assert asks.recv(1 << 10).startswith(b"HTTP/1.1 100 ")
        slow.sendall(b"cd")
        assert answer(slow).endswith(b"4")
    assert "/left" not in begun
    with server.connect(post(b"/whole", 1 << 16, PIECE)) as client:
        assert answer(client).endswith(b"65536")
