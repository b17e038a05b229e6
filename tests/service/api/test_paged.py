"""Tests that lists with ten thousand entries are paginated, and that a page costs only as much as its entries."""

from __future__ import annotations

import time
from collections.abc import Iterator

import httpx
import pytest

from service.store.models import Environment, Key, Project, Reference, User
from tests.helpers import running_redis
from tests.service.api.test_access import caller
from tests.service.conftest import Service

MANY = 230
LISTS = (
    "/api/users",
    "/api/tokens?all=true",
    "/api/quotas",
    "/api/projects",
    "/api/shares",
    "/api/environments",
    "/api/references",
)


@pytest.fixture(scope="module")
def owner(tmp_path_factory: pytest.TempPathFactory, redis_server: running_redis) -> Iterator[httpx.Client]:
    service = Service(tmp_path_factory.mktemp("paged") / "data", redis_server, host="0.0.0.0")
    create_items(service, MANY)
    with caller(service, (service.options["data"] / "owner-token").read_text().strip()) as client:
        yield client
    service.stop()


def create_items(service: Service, many: int) -> None:
    now = time.time()
    file = {"path": "a.exr", "sha256": "0" * 64, "size": 5, "parts": []}
    with service.farm.sessions.begin() as session:
        for n in range(many):
            name = f"user{n:05}"
            session.add(User(name=name, role="submit", created=now))
            for kind in ("token", "session"):
                row = Key(id=f"{kind[0]}{n}", hash=f"{kind} {n}", kind=kind, user=name, name="", role="submit", created=now + n)
                session.add(row)
            session.add(Project(name=f"project{n:05}", created=now))
            session.add(Environment(id=f"e{n}", name="a.exr", created=now + n, file=file, thumbnail="0" * 64))
            session.add(
                Reference(
                    id=f"r{n}",
                    name="a.exr",
                    created=now + n,
                    file=file,
                    film=file,
                    width=1,
                    height=1,
                    clipped=0,
                    is_display=False,
                )
            )


@pytest.mark.parametrize("path", LISTS)
def test_pages_make_up_the_whole_list(owner: httpx.Client, path: str) -> None:
    def page(**asked: int) -> httpx.Response:
        return owner.get(path.partition("?")[0], params={**dict(httpx.QueryParams(path.partition("?")[2])), **asked})

    whole = page(limit=1000).raise_for_status()
    total = int(whole.headers["X-Total-Count"])
    assert total == len(whole.json()) >= MANY
    assert page().json() == whole.json()[:100]
    assert page(limit=7, offset=3).json() == whole.json()[3:10], "a page that begins among the first, which may lie in no table"
    found = [each for offset in range(0, total, 50) for each in page(limit=50, offset=offset).json()]
    assert found == whole.json()
    assert page(offset=total).json() == []
    assert page(limit=1001).status_code == 422


def test_users_are_listed_with_session_counts(owner: httpx.Client) -> None:
    assert {user["sessions"] for user in owner.get("/api/users?limit=1000").json()} == {1}
