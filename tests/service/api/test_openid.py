"""Tests of login through an OpenID provider: oidc-provider-mock, a real provider, runs on loopback."""

from __future__ import annotations

import base64
import contextlib
import dataclasses
import hashlib
import io
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import httpx
import pytest

from service.access.oidc import LOGIN_TIMEOUT_S, oidc_of
from service.access.roles import Role
from service.errors import StartupError
from service.routes.openid import MAX_PENDING_LOGINS
from service.settings import Settings
from tests.helpers import running_redis
from tests.service.api.test_access import caller
from tests.service.conftest import Service

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")

PEOPLE = {
    "1": {"preferred_username": "Anna", "groups": ["artists", "others"]},
    "2": {"preferred_username": "ben", "groups": ["nobodies"]},
    "3": {"preferred_username": "carl", "groups": ["artists"]},
    "4": {"preferred_username": "owner", "groups": ["artists"]},
    "5": {"preferred_username": "dora", "groups": "artists keepers"},
}


class Provider:
    """A running OpenID provider, and the requests that it received."""

    def __init__(self, server: Any) -> None:
        self.url = f"http://127.0.0.1:{server.server_port}"
        self.asked: list[tuple[str, dict[str, list[str]]]] = []
        application = server.app

        def listening(environ: dict[str, Any], start: Any) -> Any:
            body = environ["wsgi.input"].read(int(environ.get("CONTENT_LENGTH") or 0))
            environ["wsgi.input"] = io.BytesIO(body)
            self.asked.append((environ["PATH_INFO"], parse_qs(environ["QUERY_STRING"] or body.decode())))
            return application(environ, start)

        server.app = listening


@pytest.fixture(scope="module")
def provider() -> Iterator[Provider]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # names that the provider's library will rename
        import oidc_provider_mock  # imported here, since it takes half a second
    users = [oidc_provider_mock.User(sub=sub, claims=claims) for sub, claims in PEOPLE.items()]
    with oidc_provider_mock.run_server_in_thread(user_claims=users, require_nonce=True) as server:
        yield Provider(server)


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, redis_server: running_redis, provider: Provider) -> Iterator[Service]:
    service = Service(
        tmp_path_factory.mktemp("openid") / "data",
        redis_server,
        host="0.0.0.0",
        trusted_proxies="127.0.0.1",
        oidc_discovery=f"{provider.url}/.well-known/openid-configuration",
        oidc_client="rayfarm",
        oidc_secret="what the provider knows us by",
        oidc_name="Studio",
        oidc_roles={"artists": "submit", "keepers": "admin"},
        oidc_role="",
    )
    yield service
    service.stop()


@contextlib.contextmanager
def browser(service: Service) -> Iterator[httpx.Client]:
    with caller(service) as client:
        yield client


def complete_login(client: httpx.Client, sub: str) -> str:
    """Starts a login and completes it at the provider as subject `sub`; returns the URL of the redirect back to the service."""
    begun = client.get("/api/login/openid")
    assert begun.status_code == 302, begun.text
    answer = httpx.post(begun.headers["location"], data={"sub": sub}, verify=False)
    assert answer.status_code in (302, 303), answer.text
    return str(answer.headers["location"])


def log_in(client: httpx.Client, sub: str) -> httpx.Response:
    return client.get(complete_login(client, sub))


def refusal_reason(answer: httpx.Response) -> str:
    assert answer.status_code == 302, answer.text
    assert "rayfarm-session" not in answer.headers.get("set-cookie", "")
    return answer.headers["location"].partition("refused=")[2]


def test_login_and_logout(service: Service, provider: Provider) -> None:
    with browser(service) as client:
        assert client.get("/api/session").json()["provider"] == "Studio"
        answer = log_in(client, "1")
        assert (answer.status_code, answer.headers["location"]) == (302, "/#/")
        cookies = answer.headers.get_list("set-cookie")
        assert any("HttpOnly" in cookie and "SameSite=strict" in cookie and "rayfarm-session" in cookie for cookie in cookies)
        session = client.get("/api/session").json()
        assert (session["name"], session["role"], session["kind"]) == ("anna", "submit", "session")
        assert client.get("/api/jobs").status_code == 200
        out = client.post("/api/logout")
        assert (out.status_code, client.get("/api/jobs").status_code) == (200, 401)
        way = urlsplit(out.json()["provider"])
        asked = {name: values[0] for name, values in parse_qs(way.query).items()}
        assert (way.path, asked["client_id"], asked["id_token_hint"].count(".")) == ("/oauth2/end_session", "rayfarm", 2)
        form = httpx.get(out.json()["provider"])
        assert "Recommended parameter" not in form.text, "it has the hint that it wants"
        led = httpx.post(f"{provider.url}/oauth2/end_session/confirm", data={"redirect_uri": asked["post_logout_redirect_uri"]})
        assert led.headers["location"] == f"{service.url}/"
        assert client.post("/api/logout").status_code == 204, "nobody is logged in any more"
    begun = next(asked for path, asked in reversed(provider.asked) if path.endswith("authorize") and "nonce" in asked)
    token = next(asked for path, asked in reversed(provider.asked) if path.endswith("token"))
    proof = base64.urlsafe_b64encode(hashlib.sha256(token["code_verifier"][0].encode()).digest()).rstrip(b"=").decode()
    assert (begun["code_challenge"], begun["code_challenge_method"]) == ([proof], ["S256"])
    assert begun["redirect_uri"] == [f"{service.url}/api/login/openid/answer"]
    assert "openid" in begun["scope"][0]


def test_logout_without_provider_endpoint(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    oidc = service.farm.access.oidc
    assert oidc is not None
    back = "https://farm.example/"
    about, _ = oidc._provider()
    assert "id_token_hint" not in str(oidc.logout_url("", back)), "a login of which the token is not known any more"
    for end in ("javascript:alert(1)", "/oauth2/end_session", None):
        monkeypatch.setitem(about, "end_session_endpoint", end)
        assert oidc.logout_url("a.b.c", back) is None
    monkeypatch.undo()
    monkeypatch.setattr(oidc, "_logs_out", False)
    assert oidc.logout_url("a.b.c", back) is None
    monkeypatch.undo()
    with browser(service) as client:
        log_in(client, "1")
        secret, _ = service.farm.access.keys.create("link", "anna", Role.ADMIN, lasts_s=60)
        assert client.post("/api/login", json={"link": secret}).json()["name"] == "anna"
        assert client.post("/api/logout").status_code == 204, "this one came by a link"


def test_role_claim_is_applied_at_each_login(service: Service) -> None:
    with browser(service) as client:
        assert log_in(client, "5").status_code == 302
        assert client.get("/api/session").json()["role"] == "admin", "groups as words"
    with browser(service) as client:
        assert refusal_reason(log_in(client, "2")) == "role"
        assert client.get("/api/session").json()["name"] is None
    users = service.farm.access.users
    users.set_role("anna", Role.VIEW)
    with browser(service) as client:
        log_in(client, "1")
        assert client.get("/api/session").json()["role"] == "submit"
    assert [user.name for user in users.listed()].count("anna") == 1


def test_existing_user_name_is_not_reassigned(service: Service) -> None:
    service.farm.access.users.add("carl", Role.ADMIN, None)
    for sub in ("3", "4"):
        with browser(service) as client:
            assert refusal_reason(log_in(client, sub)) == "name"


def test_login_response_is_valid_once_for_its_browser(service: Service) -> None:
    with browser(service) as client, browser(service) as other:
        back = complete_login(client, "1")
        other.get("/api/login/openid")
        assert refusal_reason(other.get(back)) == "late", "a stolen state without its cookie (login CSRF)"
        assert client.get(back).headers["location"] == "/#/", "the other browser's attempt changes nothing"
        assert refusal_reason(client.get(back)) == "late"
        back = complete_login(client, "1")
        forged = back.replace("state=", "state=x")
        assert refusal_reason(client.get(forged)) == "late"
        kept = dict(client.cookies)
        assert client.get(back).headers["location"] == "/#/"
        client.cookies.update(kept)
        assert refusal_reason(client.get(back)) == "provider", "the provider accepts the code once, even if the cookie was copied"


def test_modified_or_expired_cookie_is_rejected(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    with browser(service) as client:
        begun = client.get("/api/login/openid")
        state = parse_qs(urlsplit(begun.headers["location"]).query)["state"][0]
        (header,) = begun.headers.get_list("set-cookie")
        assert all(part in header for part in ("HttpOnly", "SameSite=lax", "Path=/", "Max-Age=600")) and "Domain" not in header
        name, _, sealed = header.partition(";")[0].partition("=")
        assert state.encode() not in base64.urlsafe_b64decode(sealed.split(".")[3] + "=="), "it is encrypted"
        middle = len(sealed) // 2
        nested = base64.urlsafe_b64encode(b"[" * 20_000).decode().rstrip("=")
        other = "B" if sealed[middle] == "A" else "A"
        for forged in ("", "x", f"{sealed[:middle]}{other}{sealed[middle + 1 :]}", f"{nested}.{'.'.join(sealed.split('.')[1:])}"):
            answer = httpx.get(
                f"{service.url}/api/login/openid/answer",
                params={"state": state, "code": "x"},
                headers={"cookie": f"{name}={forged}"},
                verify=False,
            )
            assert refusal_reason(answer) == "late", forged[:60]
        back = complete_login(client, "1")
        with monkeypatch.context() as later:
            later.setattr("service.access.oidc.time.time", lambda now=time.time: now() + LOGIN_TIMEOUT_S + 1)
            assert refusal_reason(client.get(back)) == "late"


def test_several_tabs_can_log_in_at_once(service: Service) -> None:
    with browser(service) as client:
        first, second = complete_login(client, "1"), complete_login(client, "1")
        for back in (first, second):
            assert client.get(back).headers["location"] == "/#/"
        backs = [complete_login(client, "1") for _ in range(MAX_PENDING_LOGINS + 2)]
        assert sum("-login-" in name for name in client.cookies) == MAX_PENDING_LOGINS
        assert [refusal_reason(client.get(back)) for back in backs[:2]] == ["late", "late"]
        assert client.get(backs[2]).headers["location"] == "/#/"
        assert client.get(backs[-1]).headers["location"] == "/#/"


def test_cookie_over_tls_has_host_prefix(service: Service) -> None:
    with caller(service, **{"X-Forwarded-Proto": "https"}) as client:  # header of a trusted proxy
        (header,) = client.get("/api/login/openid").headers.get_list("set-cookie")
    assert header.startswith("__Host-") and "Secure" in header and "Path=/" in header and "Domain" not in header


def test_login_survives_service_restart(service: Service) -> None:
    with browser(service) as client:
        back = urlsplit(complete_login(client, "1"))
        service.restart()
    with browser(service) as again:
        again.cookies.update(client.cookies)
        assert again.get(f"{service.url}{back.path}?{back.query}").headers["location"] == "/#/"


@pytest.mark.long
def test_anonymous_requests_displace_no_login(service: Service) -> None:
    oidc = service.farm.access.oidc
    assert oidc is not None
    with browser(service) as client:
        back = complete_login(client, "1")
        for _ in range(20_000):
            oidc.begin("http://127.0.0.1/api/login/openid/answer")
        assert client.get(back).headers["location"] == "/#/"


def test_cancelled_provider_login_is_rejected(service: Service) -> None:
    with browser(service) as client:
        state = parse_qs(urlsplit(client.get("/api/login/openid").headers["location"]).query)["state"][0]
        assert (
            refusal_reason(client.get("/api/login/openid/answer", params={"state": state, "error": "access_denied"}))
            == "cancelled"
        )


def test_id_token_with_wrong_nonce_is_rejected(service: Service) -> None:
    oidc = service.farm.access.oidc
    assert oidc is not None
    with browser(service) as client:
        back = complete_login(client, "1")
        ((name, sealed),) = client.cookies.items()
        pending = oidc._decrypted(sealed)
        assert pending is not None
        client.cookies.update({name: oidc._encrypted(dataclasses.replace(pending, nonce="another"))})
        assert refusal_reason(client.get(back)) == "provider"
    oidc._client = ("another client", oidc._client[1])
    try:
        with browser(service) as client:
            back = complete_login(client, "1")
            oidc._client = ("rayfarm", oidc._client[1])
            assert refusal_reason(client.get(back)) == "provider", "its audience is another, or the code is not for us"
    finally:
        oidc._client = ("rayfarm", oidc._client[1])


def test_unreachable_provider_rejects_login_with_message(service: Service) -> None:
    oidc = service.farm.access.oidc
    assert oidc is not None
    known, oidc._known, discovery, oidc._discovery = oidc._known, None, oidc._discovery, "http://127.0.0.1:9/none"
    try:
        with browser(service) as client:
            assert refusal_reason(client.get("/api/login/openid")) == "provider"
    finally:
        oidc._known, oidc._discovery = known, discovery


def test_invalid_openid_settings_are_rejected_at_start(tmp_path: Path, service: Service) -> None:
    url = "https://login.example/.well-known/openid-configuration"
    for wrong, said in (
        ({"oidc_discovery": url}, "OIDC_CLIENT"),
        ({"oidc_discovery": "http://login.example/", "oidc_client": "x"}, "https://"),
        ({"oidc_discovery": url, "oidc_client": "x", "oidc_roles": {"a": "king"}}, "king"),
    ):
        with pytest.raises(StartupError, match=said):
            oidc_of(Settings(data=tmp_path, **wrong), service.farm.sessions)  # type: ignore[arg-type]
    assert oidc_of(Settings(data=tmp_path), service.farm.sessions) is None
