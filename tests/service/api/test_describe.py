"""Tests of lists with a database row that this release cannot interpret: the row is listed with an error, others as usual."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from sqlalchemy import text

from tests.helpers import running_redis
from tests.service.conftest import OBJ, Service, until


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, redis_server: running_redis) -> Iterator[Service]:
    service = Service(tmp_path_factory.mktemp("describe") / "data", redis_server)
    with service.worker():
        yield service
    service.stop()


def write(service: Service, table: str, id: str, column: str, value: Any) -> None:
    with service.farm.sessions.begin() as session:
        session.execute(text(f"UPDATE {table} SET {column} = :value WHERE id = :id"), {"value": value, "id": id})


@pytest.mark.long
def test_unreadable_job_does_not_hide_others(service: Service) -> None:
    scene = service.ready_scene()
    good = service.submit(scene)
    spoilt = {
        service.submit(scene): written
        for written in (
            ("request", "[1, 2]"),
            ("request", "{broken"),
            ("settings", '"a text"'),
            ("settings", "{broken"),
            ("state", "resting"),
            ("spp", "many"),
        )
    }
    for job in (good, *spoilt):
        service.wait_for(job, "finished")
    for bad, (column, value) in spoilt.items():
        write(service, "jobs", bad, column, value)
        listed = {job["id"]: job for job in service.http.get("/api/jobs").raise_for_status().json()}
        assert listed[good]["state"] == "finished" and listed[good]["error"] is None
        assert {**listed[bad], "as_of": 0} == {**service.job(bad), "as_of": 0}
        if value not in ("[1, 2]", "{broken"):  # either of the request and the result replaces the other
            assert "another release" in listed[bad]["error"], value
            assert listed[bad]["samples"] == listed[good]["samples"]
        assert service.http.delete(f"/api/jobs/{bad}").status_code == 204
        assert service.http.get("/metrics").status_code == 200


@pytest.mark.long
def test_unreadable_scene_does_not_hide_others(service: Service) -> None:
    good = service.ready_scene()
    for column, value in (("info", '{"counts": 7}'), ("info", "[]"), ("files", "{broken"), ("notes", "7"), ("status", "resting")):
        bad = service.upload(OBJ + f"# {column} {len(value)}".encode())
        until(lambda bad=bad: service.scene(bad)["status"] == "ready", "the scene is prepared")
        write(service, "scenes", bad, column, value)
        listed = {scene["id"]: scene for scene in service.http.get("/api/scenes").raise_for_status().json()}
        assert listed[good]["status"] == "ready"
        if value != "[]":  # treated as empty
            assert "another release" in listed[bad]["error"]
