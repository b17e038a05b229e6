"""Tests of a list of ten thousand jobs: searched, counted, paginated, and changed in bulk."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from sqlalchemy import event

from service.farm import Farm
from service.settings import Settings
from tests.grids import grid
from tests.helpers import running_redis
from tests.many_jobs import many_jobs
from tests.service.conftest import Databases, Service, place_database

N = 3_000


@pytest.fixture(scope="module", params=["sqlite", pytest.param("postgresql", marks=pytest.mark.long)])
def service(
    tmp_path_factory: pytest.TempPathFactory, redis_server: running_redis, databases: Databases, request: pytest.FixtureRequest
) -> Iterator[Service]:
    data = tmp_path_factory.mktemp("many") / "data"
    data.mkdir()
    with databases.new(request.param) as url:
        place_database(data)
        farm = Farm(Settings(data=data, redis_url=redis_server.url, token="token", database_url=url))
        many_jobs(farm.sessions, N)
        farm.stop()
        service = Service(data, redis_server, film_check_days=0, database_url=url)  # its jobs have no films to check
        yield service
        service.stop()


@contextmanager
def statements(service: Service) -> Iterator[list[str]]:
    """Yields a list to which each SQL statement that the service executes for a request is added, in the `with` block."""
    said: list[str] = []

    def note(_: Any, __: Any, statement: str, *___: Any) -> None:
        if threading.current_thread().name.startswith("AnyIO worker thread"):
            said.append(statement)

    event.listen(service.farm.database, "before_cursor_execute", note)
    try:
        yield said
    finally:
        event.remove(service.farm.database, "before_cursor_execute", note)


def get(service: Service, path: str = "", **query: Any) -> Any:
    return service.http.get(f"/api/jobs{path}", params=query).raise_for_status().json()


@pytest.mark.long
def test_job_pages_need_few_queries(service: Service) -> None:
    with statements(service) as said:
        answer = service.http.get("/api/jobs", params={"limit": 1000, "offset": 500})
    page = answer.json()
    assert answer.headers["X-Total-Count"] == str(N)
    assert [job["id"] for job in page] == [f"{N - 1 - i:020x}" for i in range(500, 1500)]
    assert 0 < len(said) < 16, said
    still = next(job for job in page if job["error"] and not job["shot"])
    one = next(job for job in page if job["shot"])
    alone = [get(service, f"/{job['id']}") for job in (still, one)]
    assert [{**still, "as_of": 0}, {**one, "as_of": 0}] == [{**job, "as_of": 0} for job in alone]
    assert one["shot"]["count"] == 3 and one["progress"] in (0.25, 1.0)


def test_jobs_are_filtered_by_words_state_scene_and_kind(service: Service) -> None:
    assert [job["name"] for job in get(service, search="TRUCK 2321")] == ["Milk truck take 2321"]
    assert [job["id"] for job in get(service, search=f"{77:020x}")] == [f"{77:020x}"]
    for none in ("100%_", "\0", "truck\0"):  # pattern characters are matched literally
        assert get(service, search=none) == []
    stopped = get(service, state=["failed", "paused"], scene="scene1", limit=1000)
    assert {job["state"] for job in stopped} == {"failed", "paused"} and {job["scene"] for job in stopped} == {"scene1"}
    assert len(get(service, "/ids", shot=True)) == N // 10
    assert get(service, "/ids", ids=f"nobody,{3:020x}") == [f"{3:020x}"]


def test_names_and_notes_are_set_searched_and_cleared(service: Service) -> None:
    job = f"{5:020x}"
    was = service.job(job)["name"]
    given = service.patch(job, name=" The cover ", note="Warmer LAMP,\r\nsays Anna ")
    assert (given["name"], given["note"]) == ("The cover", "Warmer LAMP,\nsays Anna")
    assert get(service, "/ids", search="cover anna") == get(service, "/ids", search="lamp") == [job]
    assert service.patch(job, note="")["note"] is None and get(service, "/ids", search="anna") == []
    scene = service.http.get(f"/api/scenes/{given['scene']}").json()["name"]
    assert service.patch(job, name="")["name"] == scene
    assert service.patch(job, name=was)["name"] == was
    for wrong in ({"name": "two\nlines"}, {"note": "a\0b"}, {"note": "x" * 2001}):
        assert service.http.patch(f"/api/jobs/{job}", json=wrong).status_code == 422


def test_scenes_are_searched_by_name(service: Service) -> None:
    def found(search: str) -> list[str]:
        return [scene["id"] for scene in service.http.get("/api/scenes", params={"search": search}).raise_for_status().json()]

    all = service.http.get("/api/scenes").json()
    name = all[0]["name"]
    assert found("") == [scene["id"] for scene in all]
    assert all[0]["id"] in found(name.upper()) and all[0]["id"] in found(all[0]["id"])
    assert found(f"{name} nowhere") == found("\0") == []


def test_tallies_ignore_state_filter(service: Service) -> None:
    tallies = get(service, "/tallies", state="failed")
    assert sum(tallies.values()) == N and tallies["running"] == 0 and tallies["paused"] == N // 500
    kitchens = get(service, "/tallies", search="kitchen")
    assert sum(kitchens.values()) == N // 4
    assert kitchens["failed"] == len(get(service, "/ids", search="kitchen", state="failed"))


@grid(
    ("sort", "key"),
    [
        ("oldest", lambda job: job["created"]),
        ("name", lambda job: job["name"].lower()),
        ("priority", lambda job: (-job["priority"], -job["created"])),
        (
            "state",
            lambda job: (["running", "queued", "paused", "failed", "cancelled", "finished"].index(job["state"]), -job["created"]),
        ),
    ],
    ordinary=("priority",),
)
def test_job_list_orders(service: Service, sort: str, key: Any) -> None:
    page = get(service, sort=sort, limit=1000)
    assert page == sorted(page, key=key)
    assert [job["id"] for job in page] == get(service, "/ids", sort=sort)[:1000]


@pytest.mark.long
def test_bulk_change_returns_previous_values(service: Service) -> None:
    paused = get(service, "/ids", state="paused")[:3]
    finished = get(service, "/ids", state="finished")[:110]

    def change(jobs: list[str], **what: Any) -> Any:
        return service.http.post("/api/jobs/changes", json={"jobs": jobs, **what}).raise_for_status().json()

    answer = change([*paused, *finished, "nobody"], state="cancelled")
    assert {each["id"]: each["state"] for each in answer["changed"]} == dict.fromkeys(paused, "paused")
    refused = {each["id"]: each["why"] for each in answer["refused"]}
    assert set(refused) == {*finished, "nobody"} and "finished" in refused[finished[0]] and "no job" in refused["nobody"]
    assert {job["state"] for job in get(service, ids=",".join(paused))} == {"cancelled"}

    assert len(change(paused, state="running")["changed"]) == 3
    assert len(change(paused, state="paused", priority=7)["changed"]) == 3
    assert {(job["state"], job["priority"]) for job in get(service, ids=",".join(paused))} == {("paused", 7)}

    gone = change(finished, state="deleted")
    assert len(gone["changed"]) == 110 and get(service, "/ids", ids=",".join(finished)) == []
    assert get(service, f"/{paused[0]}/frames") and service.http.get(f"/api/jobs/{finished[0]}/frames").status_code == 404


@pytest.mark.parametrize(
    "body",
    [
        {"jobs": ["a"]},
        {"jobs": []},
        {"jobs": ["a"] * 1001, "priority": 1},
        {"jobs": ["a"], "priority": 101},
        {"jobs": ["\ud800"], "priority": 1},
    ],
)
def test_invalid_bulk_change_is_rejected(service: Service, body: dict[str, Any]) -> None:
    assert service.http.post("/api/jobs/changes", content=json.dumps(body)).status_code == 422
