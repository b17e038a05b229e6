"""Tests of uploads whose token is revoked, or whose project is deleted, during the transfer: nothing is stored."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator

import httpx
import pytest

from service.access.projects import lock_project
from service.access.roles import Role
from service.errors import NotFound
from service.store.models import Project
from tests.helpers import running_redis
from tests.service.api.test_access import PASSWORD, caller
from tests.service.conftest import OBJ, Service

BOUNDARY = b'--b\r\nContent-Disposition: form-data; name="%s"; filename="%s"\r\n\r\n'


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, redis_server: running_redis) -> Iterator[Service]:
    service = Service(tmp_path_factory.mktemp("withdrawn") / "data", redis_server, host="0.0.0.0")
    yield service
    service.stop()


@pytest.fixture(scope="module")
def owner(service: Service) -> Iterator[httpx.Client]:
    with caller(service, (service.options["data"] / "owner-token").read_text().strip()) as client:
        yield client


def token_of(service: Service, owner: httpx.Client, name: str) -> str:
    owner.post("/api/users", json={"name": name, "role": "submit", "password": PASSWORD}).raise_for_status()
    return service.farm.access.keys.create("token", name, Role.SUBMIT, "test")[0]


def upload_and_interrupt(
    service: Service, token: str, meanwhile: Callable[[], object], path: str, field: bytes = b"files"
) -> tuple[int, bytes]:
    """Sends an upload to `path`, and calls `meanwhile` after the first part of it; returns (status, response).

    field: the name of the form's field with the file.
    """
    name = b"a.obj" if field == b"files" else b"a.png"
    body = BOUNDARY % (field, name) + OBJ + path.encode() + b"#" * 9000 + b"\r\n--b--\r\n"
    head = f"POST {path} HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {token}\r\nContent-Length: {len(body)}\r\n"
    with socket.create_connection(("127.0.0.1", service.port), timeout=30) as client:
        client.sendall(f"{head}Content-Type: multipart/form-data; boundary=b\r\nConnection: close\r\n\r\n".encode())
        client.sendall(body[:4000])
        meanwhile()
        client.sendall(body[4000:])
        answer = b""
        while piece := client.recv(1 << 16):
            answer += piece
    return int(answer.split()[1]), answer


@pytest.mark.parametrize(
    ("path", "field"), [("/api/scenes", b"files"), ("/api/references", b"file"), ("/api/environments", b"file")]
)
@pytest.mark.parametrize("how", ["the user", "the token", "the role"])
def test_upload_with_revoked_token_is_discarded(service: Service, owner: httpx.Client, path: str, field: bytes, how: str) -> None:
    name = f"{how[4:]}{path[5:]}"
    token = token_of(service, owner, name)
    with caller(service, token) as client:
        id = client.get("/api/tokens").json()[0]["id"]

    def put_out() -> None:
        if how == "the user":
            owner.delete(f"/api/users/{name}").raise_for_status()
        elif how == "the token":
            owner.delete(f"/api/tokens/{id}").raise_for_status()
        else:
            owner.patch(f"/api/users/{name}", json={"role": "view"}).raise_for_status()

    status, answer = upload_and_interrupt(service, token, put_out, path, field)
    assert status == 401, answer
    assert owner.get("/api/scenes").json() == []


def test_upload_into_lost_project_is_discarded(service: Service, owner: httpx.Client) -> None:
    token = token_of(service, owner, "member")
    for name, close in (
        ("left", lambda: owner.delete("/api/projects/left/members/member")),
        ("looks", lambda: owner.put("/api/projects/looks/members/member", json={"role": "view"})),
        ("gone", lambda: owner.delete("/api/projects/gone")),
    ):
        owner.post("/api/projects", json={"name": name}).raise_for_status()
        owner.put(f"/api/projects/{name}/members/member", json={"role": "submit"}).raise_for_status()
        status, answer = upload_and_interrupt(
            service, token, lambda close=close: close().raise_for_status(), f"/api/scenes?project={name}"
        )  # type: ignore[misc]
        assert status in (403, 404), answer
    assert owner.get("/api/scenes").json() == []


def test_upload_prevents_project_deletion(service: Service, owner: httpx.Client) -> None:
    owner.post("/api/projects", json={"name": "held"}).raise_for_status()
    with service.farm.sessions.begin() as session:
        lock_project("held", session)
        lock_project("", session)
        with pytest.raises(NotFound):
            lock_project("nowhere", session)
        assert session.get(Project, "held") is not None


def test_no_key_for_concurrently_deleted_user(service: Service) -> None:
    with pytest.raises(NotFound):
        service.farm.access.keys.create("token", "nobody-at-all", Role.SUBMIT, "test")
