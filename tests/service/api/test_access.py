"""Tests of authentication and authorization: roles, credentials, expiry, and known attacks."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from service.access import attempts
from service.access.roles import Role
from service.errors import StartupError
from service.farm import Farm
from service.http import gate
from service.http.access_requirements import NEEDS, WORKER, Need
from service.settings import Settings
from tests.helpers import running_redis
from tests.service.conftest import TOKEN, Service, place_database, until

PASSWORD = "four quiet words here"
NOBODY = {"login": True, "name": None, "role": None, "kind": None, "provider": None}


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, redis_server: running_redis) -> Iterator[Service]:
    """Yields a service whose settings say that all machines can reach it, so that it requires a login."""
    service = Service(tmp_path_factory.mktemp("access") / "data", redis_server, host="0.0.0.0", trusted_proxies="127.0.0.1")
    yield service
    service.stop()


@pytest.fixture(autouse=True)
def no_tries_yet(service: Service) -> None:
    service.farm.access.attempts = attempts.Attempts()


@pytest.fixture(scope="module")
def owner(service: Service) -> Iterator[httpx.Client]:
    """Yields a client that authenticates with the owner's token, which is stored in the data folder."""
    path = service.options["data"] / "owner-token"
    assert path.stat().st_mode & 0o777 == 0o600
    with caller(service, path.read_text().strip()) as client:
        yield client


def caller(service: Service, token: str | None = None, **headers: str) -> httpx.Client:
    headers |= {} if token is None else {"Authorization": f"Bearer {token}"}
    return httpx.Client(base_url=service.url, headers=headers, timeout=20, verify=False)


@contextlib.contextmanager
def logged_in(service: Service, name: str, password: str = PASSWORD) -> Iterator[httpx.Client]:
    with caller(service) as client:
        answer = client.post("/api/login", json={"name": name, "password": password})
        assert answer.status_code == 200, answer.text
        yield client


def user(owner: httpx.Client, name: str, role: str) -> str:
    owner.delete(f"/api/users/{name}")
    answer = owner.post("/api/users", json={"name": name, "role": role, "password": PASSWORD})
    assert answer.status_code == 201, answer.text
    return name


def audit(owner: httpx.Client) -> list[dict[str, Any]]:
    lines: list[dict[str, Any]] = owner.get("/api/audit", params={"limit": 1000}).raise_for_status().json()
    return lines


def example_of(pattern: str) -> str:
    return pattern.replace("{extension}", "png").replace("{n}", "0").replace("{frame}", "0").replace("{", "").replace("}", "")


def shape(need: Need) -> str:
    return "workers" if need == WORKER else "anyone" if need.role is Role.NOBODY else "people"


def ask(client: httpx.Client, method: str, pattern: str) -> int:
    """Sends a request to a route, with example ids in place of the pattern's parameters; returns the response's status.

    Does not wait for the response's body. method: an HTTP method, or WS for a WebSocket, whose status is 101 if it is accepted.
    """
    if method == "WS":
        url = f"{str(client.base_url).replace('http', 'ws', 1).rstrip('/')}{example_of(pattern)}"
        try:
            with connect(url, additional_headers={k: v for k, v in client.headers.items() if k == "authorization"}):
                return 101
        except InvalidStatus as error:
            return error.response.status_code
    with client.stream(method, example_of(pattern), json={} if method in ("POST", "PUT", "PATCH") else None) as answer:
        return answer.status_code


def test_without_login_only_the_page_is_served(service: Service) -> None:
    with caller(service) as nobody, caller(service, "rayfarm-token-guessed") as guesser, caller(service, TOKEN) as worker:
        for (method, pattern), need in NEEDS.items():
            for client in (nobody, guesser):
                status = ask(client, method, pattern)
                assert (status == 401) == (shape(need) != "anyone") or pattern == "/api/login", (method, pattern, status)
            if shape(need) == "people" and not need.workers:
                assert ask(worker, method, pattern) == 403, (method, pattern)
        assert ask(nobody, "GET", "/api/nowhere") == 401
        assert nobody.get("/").status_code == 200
        assert nobody.get("/api/session").json() == NOBODY
        assert worker.get("/api/farm/join").json()["instance"]
        assert worker.get("/api/nowhere").status_code == 404
        answer = nobody.get("/api/jobs")
        assert answer.headers["www-authenticate"] == "Bearer"
        assert "link" in answer.json()["detail"]


def test_each_role_reaches_routes_in_table(service: Service, owner: httpx.Client) -> None:
    for role in ("view", "submit", "admin"):
        token = owner.post("/api/tokens", json={"name": role, "role": role}).json()["secret"]
        with caller(service, token) as client:
            for (method, pattern), need in NEEDS.items():
                if pattern == "/api/events" or shape(need) == "anyone" or (method != "GET" and pattern.startswith("/api/tokens")):
                    continue  # token permissions on tokens are tested in test_tokens.py
                expected = {"workers": 401}.get(shape(need)) or (None if Role.from_name(role) >= (need.role or 9) else 403)
                status = ask(client, method, pattern)
                assert status == expected if expected else status not in (401, 403), (role, method, pattern, status)


def test_login_link_works_once(service: Service, owner: httpx.Client) -> None:
    link = owner.post("/api/links", json={"user": user(owner, "lena", "submit")}).json()
    assert link["expires"] - time.time() == pytest.approx(86400, abs=60)
    with caller(service) as browser, caller(service) as thief:
        assert browser.get("/api/jobs", headers={"Authorization": f"Bearer {link['code']}"}).status_code == 401
        answer = browser.post("/api/login", json={"link": link["code"]})
        assert answer.json() | {"login": True} == {**NOBODY, "name": "lena", "role": "submit", "kind": "session"}
        cookie = answer.headers["set-cookie"]
        assert all(part in cookie for part in ("HttpOnly", "SameSite=strict", "Path=/", "Max-Age=2592000"))
        assert "Secure" not in cookie
        assert "Domain" not in cookie
        assert browser.get("/api/jobs").status_code == 200
        assert "already used" in thief.post("/api/login", json={"link": link["code"]}).json()["detail"]


def test_cookie_over_tls_is_secure(service: Service, owner: httpx.Client) -> None:
    code = owner.post("/api/links", json={}).json()["code"]
    with caller(service, **{"X-Forwarded-Proto": "https"}) as browser:  # header of a trusted proxy
        cookie = browser.post("/api/login", json={"link": code}).headers["set-cookie"]
    assert cookie.startswith("__Host-rayfarm-")
    assert "Secure" in cookie


def test_new_login_replaces_session(service: Service, owner: httpx.Client) -> None:
    user(owner, "anna", "submit")
    planted = "rayfarm-session-chosen-by-another"
    with caller(service, Cookie=f"{service.farm.access.cookie}={planted}") as browser:
        answer = browser.post("/api/login", json={"name": "anna", "password": PASSWORD})
        first = answer.cookies[service.farm.access.cookie]
        assert first != planted
    with caller(service, Cookie=f"{service.farm.access.cookie}={first}") as browser:
        assert browser.get("/api/session").json()["name"] == "anna"
        assert browser.post("/api/login", json={"name": "anna", "password": PASSWORD}).status_code == 200
        assert browser.get("/api/jobs").status_code == 401


def test_logout_invalidates_session_cookie(service: Service, owner: httpx.Client) -> None:
    with logged_in(service, user(owner, "anna", "submit")) as browser:
        kept = dict(browser.cookies)
        assert browser.post("/api/logout", headers={"Origin": "https://elsewhere.example"}).status_code == 403
        assert browser.get("/api/jobs").status_code == 200
        assert browser.post("/api/logout").status_code == 204
        assert not browser.cookies
    assert httpx.get(f"{service.url}/api/jobs", cookies=kept, verify=False).status_code == 401


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "https://elsewhere.example"},
        {"Origin": "null"},
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site"},
    ],
)
def test_cross_site_request_with_cookie_is_rejected(service: Service, owner: httpx.Client, headers: dict[str, str]) -> None:
    with logged_in(service, user(owner, "anna", "admin")) as browser:
        assert "another origin" in browser.post("/api/jobs", json={}, headers=headers).json()["detail"]
        assert browser.post("/api/jobs", json={}, headers={"Sec-Fetch-Site": "same-origin"}).status_code == 422


def test_failed_logins_are_limited(service: Service, owner: httpx.Client) -> None:
    user(owner, "anna", "submit")
    with caller(service) as guesser:
        answers = [
            guesser.post("/api/login", json={"name": "anna", "password": f"guess {n}"})
            for n in range(attempts.MAX_PER_ADDRESS_AND_NAME)
        ]
        unknown = guesser.post("/api/login", json={"name": "nobody-of-this-name", "password": "guess"})
        assert {answer.json()["detail"] for answer in (*answers, unknown)} == {
            "The name or the password is wrong. Check both and try again."
        }
        answer = guesser.post("/api/login", json={"name": "anna", "password": PASSWORD})
        assert answer.status_code == 429
        assert 0 < int(answer.headers["retry-after"]) <= attempts.WINDOW_S
    with caller(service, **{"X-Forwarded-For": "192.0.2.7"}) as anna:  # header of a trusted proxy: another address
        assert anna.post("/api/login", json={"name": "anna", "password": PASSWORD}).status_code == 200


def test_unknown_user_takes_as_long_as_wrong_password(service: Service, owner: httpx.Client) -> None:
    user(owner, "anna", "submit")

    def seconds(name: str) -> float:
        begun = time.thread_time()
        assert service.farm.access.users.log_in(name, "wrong") is None
        return time.thread_time() - begun

    seconds("anna")
    known, unknown = min(seconds("anna") for _ in range(3)), min(seconds("nobody") for _ in range(3))
    assert unknown > known / 3


@pytest.mark.parametrize(
    ("name", "password", "word"),
    [
        ("owner", PASSWORD, "cannot be a user's name"),
        ("Anna", PASSWORD, "cannot be a user's name"),
        ("a/b", PASSWORD, "cannot be a user's name"),
        ("berta", "short", "10"),
        ("berta", "aaaaaaaaaaaa", "guess"),
        ("berta", "i am berta now", "guess"),
    ],
)
def test_weak_name_or_password_is_rejected(owner: httpx.Client, name: str, password: str, word: str) -> None:
    answer = owner.post("/api/users", json={"name": name, "password": password})
    assert answer.status_code == 422
    assert word in answer.json()["detail"]


def test_token_role_is_limited_by_user_role(service: Service, owner: httpx.Client) -> None:
    with logged_in(service, user(owner, "anna", "submit")) as anna:
        for refused in (
            anna.patch("/api/users/anna", json={"role": "admin"}),
            anna.post("/api/users", json={"name": "mine", "role": "admin", "password": PASSWORD}),
            anna.post("/api/links", json={}),
            anna.post("/api/tokens", json={"name": "x", "role": "admin"}),
            anna.post("/api/tokens", json={"name": "x", "role": "worker"}),
            anna.get("/api/tokens?all=true"),
            anna.patch("/api/workers/peer", json={"state": "paused"}),
        ):
            assert refused.status_code == 403, refused.text
        secret = anna.post("/api/tokens", json={"name": "script", "role": "submit"}).json()["secret"]
        with caller(service, secret) as script:
            assert script.post("/api/jobs", json={}).status_code == 422
            assert script.post("/api/tokens", json={"name": "more"}).status_code == 409
            owner.patch("/api/users/anna", json={"role": "view"}).raise_for_status()
            assert script.post("/api/jobs", json={}).status_code == 403
            assert anna.post("/api/jobs", json={}).status_code == 403
            owner.delete("/api/users/anna").raise_for_status()
            assert {script.get("/api/jobs").status_code, anna.get("/api/jobs").status_code} == {401}


def test_tokens_of_other_users_are_hidden(service: Service, owner: httpx.Client) -> None:
    with logged_in(service, user(owner, "anna", "submit")) as anna, logged_in(service, user(owner, "ben", "submit")) as ben:
        made = anna.post("/api/tokens", json={"name": "script"}).json()
        assert [row["name"] for row in anna.get("/api/tokens").json()] == ["script"]
        assert "secret" not in anna.get("/api/tokens").text
        assert ben.get("/api/tokens").json() == []
        assert ben.delete(f"/api/tokens/{made['id']}").status_code == 404
        with caller(service, made["secret"]) as script:
            assert script.get("/api/jobs").status_code == 200
            assert anna.delete(f"/api/tokens/{made['id']}").status_code == 204
            assert script.get("/api/jobs").status_code == 401


def test_token_expires(service: Service, owner: httpx.Client) -> None:
    made = owner.post("/api/tokens", json={"name": "brief", "days": 1.5 / 86400}).json()
    with caller(service, made["secret"]) as script:
        assert script.get("/api/jobs").status_code == 200
        until(lambda: script.get("/api/jobs").status_code == 401, "the token is over")


def test_worker_joins_with_own_token_until_revoked(service: Service, owner: httpx.Client) -> None:
    made = owner.post("/api/tokens", json={"name": "attic", "role": "worker", "days": None}).json()
    with caller(service, made["secret"]) as attic:
        assert attic.get("/api/farm/join").status_code == 200
        assert attic.get("/api/workers").status_code == 200
        assert {attic.get(path).status_code for path in ("/api/jobs", "/api/users", "/api/tokens")} == {403}
        assert owner.delete(f"/api/tokens/{made['id']}").status_code == 204
        assert attic.get("/api/farm/join").status_code == 401


def test_password_change_ends_other_sessions(service: Service, owner: httpx.Client) -> None:
    user(owner, "anna", "submit")
    with logged_in(service, "anna") as here, logged_in(service, "anna") as elsewhere:
        wrong = here.put("/api/session/password", json={"old": "wrong", "new": "other quiet words"})
        assert wrong.status_code == 401
        assert here.put("/api/session/password", json={"old": PASSWORD, "new": "other quiet words"}).status_code == 204
        assert (here.get("/api/jobs").status_code, elsewhere.get("/api/jobs").status_code) == (200, 401)
    with logged_in(service, "anna", "other quiet words"):
        pass


def test_open_connections_end_with_session(service: Service, owner: httpx.Client, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gate, "REAUTHORIZE_EVERY_S", 0.2)
    with logged_in(service, user(owner, "anna", "submit")) as anna, service.worker():
        job = scene_and_job(anna)
        cookie = "; ".join(f"{name}={value}" for name, value in anna.cookies.items())
        with connect(f"ws://127.0.0.1:{service.port}/api/jobs/{job}/live", additional_headers={"Cookie": cookie}) as live:
            assert "state" in str(live.recv(timeout=20))
            with anna.stream("GET", "/api/events") as events:
                assert events.status_code == 200
                owner.delete("/api/users/anna").raise_for_status()
                for _ in events.iter_raw():
                    pass  # it ends
            with pytest.raises(ConnectionClosed) as ended:
                while True:
                    live.recv(timeout=30)
    assert ended.value.rcvd is not None
    assert ended.value.rcvd.code == 4401


def scene_and_job(client: httpx.Client) -> str:
    sent = client.post("/api/scenes", files={"files": ("scene.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")})
    scene = sent.raise_for_status().json()["id"]
    job = client.post("/api/jobs", json={"scene": scene, "width": 32, "height": 32, "spp": 4})
    return str(job.raise_for_status().json()["id"])


def test_audit_log_contains_no_secret(service: Service, owner: httpx.Client) -> None:
    with logged_in(service, user(owner, "anna", "submit")) as anna:
        secrets = [PASSWORD, *anna.cookies.values(), anna.post("/api/tokens", json={"name": "mine"}).json()["secret"]]
        anna.delete("/api/jobs/not-there")
        anna.get("/api/users")
    secrets += [TOKEN, owner.headers["authorization"].partition(" ")[2], owner.post("/api/links", json={}).json()["code"]]
    with caller(service) as guesser:
        guesser.post("/api/login", json={"name": "anna", "password": "a wrong one"})
    lines = audit(owner)
    seen = {(line["who"], line["what"], line["status"]) for line in lines}
    assert {
        ("anna", "login", 200),
        ("anna", "POST /api/tokens", 201),
        ("anna", "DELETE /api/jobs/{id}", 404),
        ("anna", "GET /api/users", 403),
        ("anna", "login refused", 401),
        ("owner", "POST /api/users", 201),
    } <= seen
    assert lines == sorted(lines, key=lambda line: line["at"], reverse=True)
    files = [path for path in Path(service.options["data"]).iterdir() if path.suffix in (".jsonl", ".sqlite", ".sqlite-wal")]
    kept = b"".join(path.read_bytes() for path in files)
    assert b"anna" in kept
    assert not [secret for secret in secrets if secret.encode() in kept]


def test_loopback_needs_no_login_and_manages_users(tmp_path: Path, redis_server: running_redis) -> None:
    service = Service(tmp_path / "data", redis_server)
    try:
        http = service.http
        assert http.get("/api/session").json() == {
            **NOBODY,
            "login": False,
            "name": "this machine",
            "role": "admin",
            "kind": "open",
        }
        assert http.get("/api/jobs").status_code == 200
        assert http.get("/api/jobs", headers={"Authorization": "Bearer of-another-service"}).status_code == 200
        assert http.get("/api/jobs", headers={"Authorization": f"Bearer {TOKEN}"}).status_code == 200
        for method, path in (("GET", "/api/users"), ("POST", "/api/tokens"), ("GET", "/api/audit"), ("POST", "/api/links")):
            answer = http.request(method, path, json={"name": "x"} if method == "POST" else None)
            assert answer.status_code == 401
            assert "owner-token" in answer.json()["detail"]
        owner_token = (tmp_path / "data" / "owner-token").read_text().strip()
        assert http.get("/api/users", headers={"Authorization": f"Bearer {owner_token}"}).json() == []
        for header in ("X-Forwarded-For", "Forwarded", "X-Real-IP"):  # without a trusted proxy these headers count for nothing
            assert http.get("/api/jobs", headers={header: "203.0.113.9"}).status_code == 401, header
        assert not (tmp_path / "data" / "audit.jsonl").exists()
    finally:
        service.stop()


@pytest.mark.parametrize(
    ("host", "published", "login", "needed"),
    [
        ("127.0.0.1", "", "auto", False),
        ("::1", "", "auto", False),
        ("0.0.0.0", "", "auto", True),
        ("192.168.1.7", "", "auto", True),
        ("", "", "auto", True),
        ("0.0.0.0", "127.0.0.1", "auto", False),
        ("0.0.0.0", " 127.0.0.1 0.0.0.0", "auto", True),
        ("127.0.0.1", "", "always", True),
        ("0.0.0.0", "", "never", False),
    ],
)
def test_login_requirement_by_host_and_setting(tmp_path: Path, host: str, published: str, login: Any, needed: bool) -> None:
    settings = Settings(data=tmp_path, host=host, published=published, login=login)
    assert settings.needs_login is needed


def test_default_token_is_rejected_on_public_address(tmp_path: Path) -> None:
    with pytest.raises(StartupError, match="RAYFARM_TOKEN"):
        Farm(Settings(data=tmp_path, host="0.0.0.0", token="this-machine-only"))
    place_database(tmp_path)
    Farm(Settings(data=tmp_path, host="0.0.0.0", published="127.0.0.1", token="this-machine-only")).stop()
