"""Tests of the checks of a request before its route is called: the caller, the host name, the origin and the method."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from service.http.security import _with_headers
from tests.helpers import running_redis
from tests.service.conftest import Service, until


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, redis_server: running_redis) -> Iterator[Service]:
    service = Service(tmp_path_factory.mktemp("door") / "data", redis_server)
    yield service
    service.stop()


@pytest.fixture(scope="module")
def open_service(tmp_path_factory: pytest.TempPathFactory, redis_server: running_redis) -> Iterator[Service]:
    """Yields a service whose settings say that all machines can reach it, so that it requires a login."""
    data = tmp_path_factory.mktemp("open") / "data"
    service = Service(data, redis_server, host="0.0.0.0", allowed_hosts=["Farm.example"], published=" 0.0.0.0 Render.example")
    yield service
    service.stop()


def problem_detail(answer: Any, status: int) -> str:
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    detail = str(answer.json()["detail"])
    assert detail.endswith(".")
    return detail


@pytest.mark.parametrize("host", ["[", "[]", "[::1", "][", "]", "a b", "a/b", "a@localhost", "localhost:x", "[nothing]", "ü"])
def test_invalid_host_is_bad_request(service: Service, host: str) -> None:
    assert "Host" in problem_detail(service.http.get("/healthz", headers={"Host": host.encode()}), 400)


def test_missing_or_repeated_host_is_bad_request(service: Service) -> None:
    for lines in (b"", b"Host: localhost\r\nHost: elsewhere.example\r\n"):
        with socket.create_connection(("127.0.0.1", service.port), timeout=5) as connection:
            connection.sendall(b"GET /healthz HTTP/1.1\r\n" + lines + b"Connection: close\r\n\r\n")
            assert connection.recv(65536).startswith(b"HTTP/1.1 400")


def test_loopback_accepts_only_its_names(service: Service) -> None:
    for host in ("localhost", "LOCALHOST:99", "127.0.0.1", "[::1]:8000", "localhost."):
        assert service.http.get("/healthz", headers={"Host": host}).status_code == 200, host
    for host in ("elsewhere.example", "10.0.0.1", socket.gethostname() + ".example"):
        assert "RAYFARM_ALLOWED_HOSTS" in problem_detail(service.http.get("/healthz", headers={"Host": host}), 421)


def test_public_service_accepts_addresses_and_own_names(open_service: Service) -> None:
    own = socket.gethostname()
    given = "farm.EXAMPLE", "render.example"
    for host in ("localhost", "192.168.1.7:8000", "[fe80::1]", own, own.upper(), f"{own.split('.')[0]}.local", *given):
        assert open_service.http.get("/healthz", headers={"Host": host}).status_code == 200, host
    for host in ("evil.com", f"{own}.evil.com", "service", "127.0.0.1.evil.com"):
        refusal = problem_detail(open_service.http.get("/healthz", headers={"Host": host}), 421)
        assert f"RAYFARM_ALLOWED_HOSTS='[\"{host}\"]'" in refusal


def test_worker_joins_by_host_name(open_service: Service) -> None:
    headers = {"Host": f"{socket.gethostname()}:8000", "Authorization": f"Bearer {open_service.options['token']}"}
    assert open_service.http.get("/api/farm/join", headers=headers).json()["instance"]


def test_fully_qualified_host_name_is_accepted(
    tmp_path: Path, redis_server: running_redis, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(socket, "getfqdn", lambda: "Render1.lan.example")
    service = Service(tmp_path / "data", redis_server, host="0.0.0.0")
    try:
        until(lambda: service.http.get("/healthz", headers={"Host": "render1.lan.example"}).is_success, "the name is known")
    finally:
        service.stop()


@pytest.mark.parametrize("origin", ["http://[", "http://][", "null", "", "nonsense", "https://elsewhere.example"])
def test_foreign_or_invalid_origin_is_rejected(service: Service, origin: str) -> None:
    assert "origin" in problem_detail(service.http.post("/api/jobs", json={}, headers={"Origin": origin}), 403)
    with pytest.raises(InvalidStatus) as refused:
        connect(f"ws://127.0.0.1:{service.port}/api/jobs/x/live", additional_headers={"Origin": origin})
    assert refused.value.response.status_code == 403
    assert b"origin" in refused.value.response.body


def test_websocket_with_foreign_host_gets_error(service: Service) -> None:
    upgrade = (
        "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA=="
    )
    for host, status in (("evil.com", 421), ("[", 400)):
        with socket.create_connection(("127.0.0.1", service.port), timeout=5) as connection:
            connection.sendall(f"GET /api/jobs/x/live HTTP/1.1\r\nHost: {host}\r\n{upgrade}\r\n\r\n".encode())
            assert connection.recv(65536).startswith(f"HTTP/1.1 {status}".encode())


@pytest.mark.parametrize(
    ("path", "methods"),
    [
        ("/api/jobs", "GET, HEAD, POST, OPTIONS"),
        ("/api/jobs/x", "GET, HEAD, PATCH, DELETE, OPTIONS"),
        ("/api/scenes/x", "GET, HEAD, DELETE, OPTIONS"),
        ("/api/examples/x", "POST, OPTIONS"),
        ("/api/events", "GET, OPTIONS"),
        ("/healthz", "GET, HEAD, OPTIONS"),
        ("/docs/", "GET, HEAD, OPTIONS"),
        ("/", "GET, HEAD, OPTIONS"),
    ],
)
def test_options_lists_methods_of_path(service: Service, path: str, methods: str) -> None:
    options = service.http.options(path)
    assert (options.status_code, options.headers["allow"], options.content) == (204, methods, b"")
    for method in {"GET", "POST", "PUT", "PATCH", "DELETE"} - set(methods.split(", ")):
        answer = service.http.request(method, path)
        assert method in problem_detail(answer, 405)
        assert answer.headers["allow"] == methods


def test_unknown_api_path_is_404_for_every_method(service: Service) -> None:
    for method in ("GET", "HEAD", "POST", "PUT", "DELETE", "OPTIONS"):
        assert service.http.request(method, "/api/nowhere").status_code == 404, method


@pytest.mark.parametrize("header", ["Via", "X-Forwarded-Proto", "X-Forwarded-Host", "X-Real-IP", "Forwarded", "CF-Connecting-IP"])
def test_proxied_loopback_request_needs_login(service: Service, header: str) -> None:
    assert service.http.get("/api/jobs").status_code == 200
    assert service.http.get("/api/jobs", headers={header: "1.1 proxy"}).status_code == 401


@pytest.mark.parametrize(
    ("scheme", "host", "is_sent"), [("https", "farm", True), ("https", "localhost", False), ("http", "farm", False)]
)
def test_https_sets_hsts(scheme: str, host: str, is_sent: bool) -> None:
    sent: list[dict] = []

    async def send(message: dict) -> None:
        sent.append(message)

    scope = {"type": "http", "scheme": scheme, "headers": [(b"host", f"{host}:8000".encode())]}
    asyncio.run(_with_headers(scope, send)({"type": "http.response.start", "status": 200, "headers": []}))
    assert (b"strict-transport-security" in dict(sent[0]["headers"])) == is_sent
