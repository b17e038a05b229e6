"""Tests of how a worker handles the service's responses."""

from __future__ import annotations

import hashlib
import io
from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from tests.foreign_server import NOT_A_FARM, foreign_server, http_answer
from worker.exchange.errors import LinkError, NotAFarmError, RefusedError, TokenError
from worker.exchange.link import Link


def link(answer: httpx.Response | Exception, service: str = "http://farm.example:8000") -> Link:
    made = Link(service, "token")

    def handle(request: httpx.Request) -> httpx.Response:
        assert request.headers["Authorization"] == "Bearer token"
        if isinstance(answer, Exception):
            raise answer
        return answer

    made._client = httpx.Client(base_url=service, headers=made.client.headers, transport=httpx.MockTransport(handle))
    return made


@pytest.mark.parametrize(
    ("service", "told", "used"),
    [
        ("http://farm.example:8000", "redis://:pw@127.0.0.1:6379/0", "redis://:pw@farm.example:6379/0"),
        ("http://[fd00::5]:8000", "redis://:pw@localhost:6379/0", "redis://:pw@[fd00::5]:6379/0"),
        ("http://127.0.0.1:8000", "redis://:pw@127.0.0.1:6379/0", "redis://:pw@127.0.0.1:6379/0"),
        ("http://farm.example:8000", "redis://localhost", "redis://farm.example"),
        ("http://farm.example:8000", "redis://:pw@queue.example:6379/0", "redis://:pw@queue.example:6379/0"),
    ],
)
def test_loopback_redis_is_reached_by_service_host(service: str, told: str, used: str) -> None:
    answer = httpx.Response(200, json={"redis_url": told, "instance": "i", "data_dir": ""})
    assert link(answer, service).join().redis_url == used


@pytest.mark.parametrize(
    "told", [None, 7, "", "nonsense", "http://127.0.0.1:6379", "redis://[", "redis://host:port/0", "redis://host/0?colour=red"]
)
def test_invalid_redis_url_error_omits_password(told: Any) -> None:
    answer = httpx.Response(200, json={"redis_url": told, "instance": "i", "data_dir": ""})
    with pytest.raises(NotAFarmError, match="answers with an invalid redis_url"):
        link(answer).join()


def test_temporary_and_permanent_errors_are_distinguished() -> None:
    for answer in (httpx.ConnectError("refused"), httpx.Response(502), httpx.Response(503), httpx.Response(429)):
        with pytest.raises(LinkError):
            link(answer).join()
    with pytest.raises(TokenError, match="does not know this token"):
        link(httpx.Response(401)).join()
    with pytest.raises(NotAFarmError):
        link(httpx.Response(404)).join()
    with pytest.raises(RefusedError, match="answers 404"):
        link(httpx.Response(404)).manifest("scene")


def test_service_error_message_is_passed_on() -> None:
    problem = {"title": "Insufficient Storage", "status": 507, "detail": "The disk is full. Delete scenes or jobs."}
    answer = httpx.Response(507, json=problem, headers={"Content-Type": "application/problem+json"})
    with pytest.raises(LinkError, match="Delete scenes or jobs"):
        link(answer).manifest("scene")


@pytest.mark.parametrize("name", NOT_A_FARM)
def test_other_server_gives_error_message(name: str) -> None:
    answer, words = NOT_A_FARM[name]
    with foreign_server(answer) as port:
        made = Link(f"http://127.0.0.1:{port}", "token")
        with pytest.raises(NotAFarmError, match="rayfarm up") as said:
            made.join()
        assert words in str(said.value)
        for other in (lambda: made.manifest("scene"), lambda: made.fetch_means("job", 0, io.BytesIO())):
            with pytest.raises((NotAFarmError, RefusedError)):
                other()
        made.client.close()


def test_endless_response_is_aborted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("worker.exchange.link.MAX_ANSWER", 1 << 20)

    def endless(request: bytes) -> Iterator[bytes]:
        yield b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\nConnection: close\r\n\r\n"
        while True:
            yield b"[" * 65536

    with foreign_server(endless) as port:
        made = Link(f"http://127.0.0.1:{port}", "token")
        with pytest.raises(NotAFarmError, match="is too long"):
            made.join()
        made.client.close()


def test_truncated_body_is_temporary_error() -> None:
    with foreign_server(http_answer(b'{"redis_url"', length=5000)) as port:
        made = Link(f"http://127.0.0.1:{port}", "token")
        for ask in (made.join, lambda: made.manifest("scene"), lambda: made.fetch("0" * 64, io.BytesIO())):
            with pytest.raises(LinkError, match="no answer"):
                ask()
        made.client.close()


@pytest.mark.parametrize("service", ["", "nonsense", "ftp://host", "http://", "http://exa mple", "http://host:99999", "http://["])
def test_invalid_address_is_rejected(service: str) -> None:
    with pytest.raises(RefusedError, match="is not an address"):
        Link(service, "token")


def test_token_invalid_in_header_is_rejected() -> None:
    for token in ("tokén", "two\nlines"):
        with pytest.raises(RefusedError, match="token"):
            Link("http://host", token)


def test_damaged_blob_is_rejected() -> None:
    data = b"compiled scene"
    out = io.BytesIO()
    link(httpx.Response(200, content=data)).fetch(hashlib.sha256(data).hexdigest(), out)
    assert out.getvalue() == data
    with pytest.raises(LinkError, match="damaged"):
        link(httpx.Response(200, content=data + b"!")).fetch(hashlib.sha256(data).hexdigest(), io.BytesIO())


@pytest.mark.parametrize("token", ["", " ", "\n"])
def test_empty_token_is_rejected(token: str) -> None:
    """Checks that an empty RAYFARM_TOKEN, as from `$(cat missing-file)`, is refused at once."""
    with pytest.raises(RefusedError, match="RAYFARM_TOKEN is empty"):
        Link("http://127.0.0.1:9", token)
