"""Tests of client addresses behind proxies, with real requests: on loopback, with and without RAYFARM_TRUSTED_PROXIES."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from typing import Any

import httpx
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from service.access import attempts
from service.errors import StartupError
from service.http.client_address import PASSED_ON
from service.settings import Settings
from tests.grids import grid
from tests.helpers import running_redis
from tests.service.conftest import Service

OWNER = "the owner's token"
FIELDS = ("X-Forwarded-For", "Forwarded", "X-Real-IP", PASSED_ON)


def started(folder: Any, redis_server: running_redis, **settings: Any) -> Iterator[Service]:
    service = Service(folder / "data", redis_server, owner_token=OWNER, **settings)
    yield service
    service.stop()


@pytest.fixture(scope="module")
def default_service(tmp_path_factory: pytest.TempPathFactory, redis_server: running_redis) -> Iterator[Service]:
    yield from started(tmp_path_factory.mktemp("untrusting"), redis_server, login="always")


@pytest.fixture(scope="module")
def service_with_proxies(tmp_path_factory: pytest.TempPathFactory, redis_server: running_redis) -> Iterator[Service]:
    yield from started(tmp_path_factory.mktemp("trusting"), redis_server, trusted_proxies="127.0.0.1 10.0.0.0/8")


@pytest.fixture(scope="module")
def service_without_login(tmp_path_factory: pytest.TempPathFactory, redis_server: running_redis) -> Iterator[Service]:
    yield from started(tmp_path_factory.mktemp("unasking"), redis_server)


def failed_login(service: Service, name: str, headers: list[tuple[str, str]]) -> httpx.Response:
    return httpx.post(f"{service.url}/api/login", json={"name": name, "password": "a guess"}, headers=headers)


def last_address(service: Service, headers: list[tuple[str, str]]) -> str:
    """Returns the client address that the audit log stores for a request with these headers."""
    answer = httpx.post(f"{service.url}/api/links", json={}, headers=[("Authorization", f"Bearer {OWNER}"), *headers])
    assert answer.status_code == 201, answer.text
    audit = httpx.get(f"{service.url}/api/audit", headers={"Authorization": f"Bearer {OWNER}"}).json()
    return str(max(audit, key=lambda line: line["at"])["from"])


@pytest.mark.long
def test_forwarded_address_is_ignored_without_setting(default_service: Service) -> None:
    for field in FIELDS:
        assert last_address(default_service, [(field, "203.0.113.9")]) == "127.0.0.1", field
    answers = [
        failed_login(default_service, "anna", [("X-Forwarded-For", f"203.0.113.{n}")])
        for n in range(attempts.MAX_PER_ADDRESS_AND_NAME + 1)
    ]
    assert [answer.status_code for answer in answers][-2:] == [401, 429]
    cookie = httpx.get(f"{default_service.url}/", headers={"X-Forwarded-Proto": "https", "Host": "127.0.0.1"})
    assert "strict-transport-security" not in cookie.headers


@pytest.mark.parametrize(
    ("fields", "address"),
    [
        ([("X-Forwarded-For", "203.0.113.9")], "203.0.113.9"),
        ([("X-Forwarded-For", "127.0.0.1, 198.51.100.1, 203.0.113.9")], "203.0.113.9"),
        ([("X-Forwarded-For", "198.51.100.1, 203.0.113.9, 10.1.2.3")], "203.0.113.9"),
        ([("X-Forwarded-For", "198.51.100.1"), ("X-Forwarded-For", "203.0.113.9:4711 ,10.1.2.3")], "203.0.113.9"),
        ([("X-Forwarded-For", "[2001:db8::7]:80")], "2001:db8::7"),
        ([("X-Forwarded-For", "::ffff:203.0.113.9")], "203.0.113.9"),
        ([("X-Forwarded-For", "203.0.113.9, unknown")], "127.0.0.1"),
        ([("X-Forwarded-For", "203.0.113.9,")], "127.0.0.1"),
        ([("X-Forwarded-For", "")], "127.0.0.1"),
        ([("Forwarded", "for=203.0.113.9")], "127.0.0.1"),
        ([("X-Real-IP", "203.0.113.9")], "127.0.0.1"),
        ([(PASSED_ON, "203.0.113.9 http 00")], "127.0.0.1"),
    ],
)
def test_rightmost_untrusted_address_is_client(
    service_with_proxies: Service, fields: list[tuple[str, str]], address: str
) -> None:
    assert last_address(service_with_proxies, fields) == address


@pytest.mark.long
def test_login_limits_use_forwarded_address(service_with_proxies: Service) -> None:
    answers = [
        failed_login(service_with_proxies, "berta", [("X-Forwarded-For", f"198.51.100.{n}, 203.0.113.20")])
        for n in range(attempts.MAX_PER_ADDRESS_AND_NAME + 1)
    ]
    assert [answer.status_code for answer in answers][-2:] == [401, 429]
    assert failed_login(service_with_proxies, "berta", [("X-Forwarded-For", "203.0.113.21")]).status_code == 401


def test_trusted_proxy_sets_https_scheme(service_with_proxies: Service) -> None:
    answer = httpx.get(f"{service_with_proxies.url}/", headers={"X-Forwarded-Proto": "https", "Host": "127.0.0.1"})
    assert answer.headers["strict-transport-security"]


def test_trusted_proxies_require_login(service_with_proxies: Service) -> None:
    assert service_with_proxies.http.get("/api/jobs").status_code == 401


@grid("host", ["127.0.0.1", "127.0.0.1:8000", "localhost", "localhost:9", "[::1]", "[::1]:8000"])
@pytest.mark.parametrize("path", ["/api/jobs", "/metrics", "/api/events", "/openapi.json"])
def test_proxied_requests_need_login_on_every_path(service_without_login: Service, host: str, path: str) -> None:
    answer = httpx.get(f"{service_without_login.url}{path}", headers={"Host": host, "X-Forwarded-For": "203.0.113.9"})
    assert answer.status_code == 401
    with pytest.raises(InvalidStatus) as refused:
        connect(
            f"ws://127.0.0.1:{service_without_login.port}/api/jobs/x/live",
            additional_headers={"X-Forwarded-For": "127.0.0.1", "Host": host},
        )
    assert refused.value.response.status_code in (400, 401)


@pytest.mark.parametrize("header", ["X-Forwarded-Ssl", "X-Original-Host", "CF-Ray", "Tailscale-User-Login", "X-Envoy-Decorator"])
def test_other_proxy_headers_need_login(service_without_login: Service, header: str) -> None:
    assert service_without_login.http.get("/api/jobs", headers={header: "x"}).status_code == 401


def test_http_1_0_needs_login(service_without_login: Service) -> None:
    for version, status in (("1.0", b"401"), ("1.1", b"200")):
        with socket.create_connection(("127.0.0.1", service_without_login.port), timeout=30) as wire:
            wire.sendall(f"GET /api/jobs HTTP/{version}\r\nHost: 127.0.0.1:8000\r\nConnection: close\r\n\r\n".encode())
            assert wire.recv(65536).split()[1] == status


@grid("host", ["evil.example", "127.0.0.1.nip.io", "localhost.evil.example", "10.0.0.1", "[::2]"])
def test_foreign_host_reaches_no_path(service_without_login: Service, host: str) -> None:
    for path in ("/api/jobs", "/metrics", "/healthz", "/"):
        assert httpx.get(f"{service_without_login.url}{path}", headers={"Host": host}).status_code == 421, path


@pytest.mark.parametrize("proxies", ["*", "farm.example", "10.0.0.0/40", "0.0.0.0/0", "::/0", "10.0.0.1/8"])
def test_invalid_trusted_proxies_are_rejected(proxies: str) -> None:
    with pytest.raises(StartupError, match="RAYFARM_TRUSTED_PROXIES"):
        Settings.read(trusted_proxies=proxies)
