"""What a worker makes of the service's answers."""

from __future__ import annotations

import hashlib
import io
import json

import httpx
import pytest

from worker.errors import LinkError, RefusedError
from worker.link import Link


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
        ("http://farm.example:8000", "redis://:pw@queue.example:6379/0", "redis://:pw@queue.example:6379/0"),
    ],
)
def test_redis_on_the_services_own_machine_is_reached_by_the_services_name(service: str, told: str, used: str) -> None:
    answer = httpx.Response(200, json={"redis_url": told, "instance": "i", "data_dir": ""})
    assert link(answer, service).join().redis_url == used


def test_what_is_worth_another_try_and_what_is_not() -> None:
    for answer in (httpx.ConnectError("refused"), httpx.Response(503), httpx.Response(200, json={"hello": 1})):
        with pytest.raises(LinkError):
            link(answer).join()
    for status in (401, 404):
        with pytest.raises(RefusedError):
            link(httpx.Response(status)).join()


def test_a_blob_that_arrives_damaged_is_refused() -> None:
    data = b"compiled scene"
    out = io.BytesIO()
    link(httpx.Response(200, content=data)).fetch(hashlib.sha256(data).hexdigest(), out)
    assert out.getvalue() == data
    with pytest.raises(LinkError, match="damaged"):
        link(httpx.Response(200, content=data + b"!")).fetch(hashlib.sha256(data).hexdigest(), io.BytesIO())


def test_waiting_is_said_once_for_each_reason() -> None:
    said: list[str] = []
    answers = iter([httpx.ConnectError("refused"), httpx.ConnectError("refused"), httpx.Response(503)])
    good = {"redis_url": "redis://localhost", "instance": "i", "data_dir": ""}
    made = Link("http://127.0.0.1:1", "token")

    def handle(request: httpx.Request) -> httpx.Response:
        answer = next(answers, None)
        if isinstance(answer, Exception):
            raise answer
        return answer or httpx.Response(200, content=json.dumps(good))

    made._client = httpx.Client(base_url=made.service, transport=httpx.MockTransport(handle))
    found = made.join_patiently(said.append)
    assert found is not None
    assert found.instance == "i"
    assert len(said) == 2
