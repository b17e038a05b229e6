"""Tests of responses sent before the request's body has arrived: the client gets them whole, not a reset connection."""

from __future__ import annotations

import socket
import time

import pytest

from service.http import lingering_close
from tests.service.conftest import Service

HEAD = "POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: text/plain\r\nConnection: close\r\n"
PART = b"x" * 65536


def response_of(service: Service, path: str, parts: int, length: int) -> bytes:
    """Sends the first bytes of a body, waits for the response's start, sends `parts` more, and returns the response."""
    with socket.create_connection(("127.0.0.1", service.port), timeout=30) as client:
        client.sendall(HEAD.format(path=path).encode() + f"Content-Length: {length}\r\n\r\n".encode() + PART)
        answer = client.recv(1 << 16)
        for _ in range(parts):
            client.sendall(PART)
            time.sleep(0.01)  # a reset takes effect at the following call
        while piece := client.recv(1 << 16):
            answer += piece
    return answer


@pytest.mark.parametrize(
    ("path", "parts", "status"), [("/api/scenes?project=nowhere", 12, 404), ("/api/jobs", 20, 413), ("/api/nothing", 12, 404)]
)
def test_client_sends_rest_of_body_after_response(service: Service, path: str, parts: int, status: int) -> None:
    answer = response_of(service, path, parts, length=(1 + parts) * len(PART))
    assert int(answer.split()[1]) == status, answer
    assert answer.rstrip().endswith(b"}"), answer


def test_connection_ends_although_body_never_does(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lingering_close, "LINGER_S", 0.2)
    began = time.monotonic()
    assert b"413" in response_of(service, "/api/jobs", parts=0, length=1 << 30)
    assert time.monotonic() - began < lingering_close.LINGER_S + 5
