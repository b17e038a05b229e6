"""Tests of quotas: requests beyond a limit get an error that states the limit and what to do."""

from __future__ import annotations

import contextlib
import io
import zipfile
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import httpx
import pytest

from service.access.roles import Role
from service.store.models import Frame
from tests.helpers import running_redis
from tests.service.api.test_access import caller
from tests.service.conftest import OBJ, Service, until
from tests.service.peer_worker import PeerWorker

SIZE = {"width": 32, "height": 32, "tile_size": 16}
SAMPLES = 32 * 32 * 4  # size of a job with 4 samples per pixel
LARGE = 1_000_000  # bytes: more than a film's journal, which is deleted a moment after the film is finished


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, redis_server: running_redis) -> Iterator[Service]:
    service = Service(tmp_path_factory.mktemp("quotas") / "data", redis_server, host="0.0.0.0", quota_jobs=2)
    with PeerWorker(service.options["redis_url"], service.url, service.options["token"]):
        yield service
    service.stop()


@pytest.fixture(scope="module")
def chief(service: Service) -> Iterator[httpx.Client]:
    with caller(service, (service.options["data"] / "owner-token").read_text().strip()) as client:
        yield client


@contextlib.contextmanager
def new_user(service: Service, name: str) -> Iterator[httpx.Client]:
    access = service.farm.access
    access.users.add(name, Role.SUBMIT, None)
    with caller(service, access.keys.create("token", name, Role.SUBMIT, "test")[0]) as client:
        yield client


def scene_of(client: httpx.Client, content: bytes = OBJ) -> str:
    id = str(client.post("/api/scenes", files={"files": ("a.obj", content)}).raise_for_status().json()["id"])
    until(lambda: client.get(f"/api/scenes/{id}").json()["status"] == "ready", "it is prepared")
    return id


def submit(client: httpx.Client, scene: str, **more: Any) -> httpx.Response:
    return client.post("/api/jobs", json={"scene": scene, "spp": 4, "fresh": True, **SIZE, **more})


def set_limits(chief: httpx.Client, whose: str, **limits: int) -> None:
    assert chief.put(f"/api/quotas/{whose}", json=limits).status_code == 204


def used(client: httpx.Client) -> dict[str, int]:
    found: dict[str, int] = client.get("/api/quota").json()[0]["used"]
    return found


def test_concurrent_jobs_are_limited(service: Service, chief: httpx.Client) -> None:
    with new_user(service, "anna") as anna:
        scene = scene_of(anna)
        long = {"spp": 1_000_000}
        first, second = (submit(anna, scene, **long).raise_for_status().json()["id"] for _ in range(2))
        third = submit(anna, scene, **long)
        assert third.status_code == 429
        assert float(third.headers["retry-after"]) >= 1
        assert "number of unfinished jobs is 2; the limit is 2. Wait until one is finished" in third.json()["detail"]
        assert used(anna)["jobs"] == 2
        chief.patch(f"/api/jobs/{first}", json={"state": "cancelled"}).raise_for_status()
        third = submit(anna, scene, **long)
        assert third.status_code == 201
        again = anna.patch(f"/api/jobs/{first}", json={"state": "running"})
        assert (again.status_code, anna.get(f"/api/jobs/{first}").json()["state"]) == (429, "cancelled")
        many = anna.post("/api/jobs/changes", json={"jobs": [first], "state": "running"}).json()
        assert "the limit is 2" in many["refused"][0]["why"]
        set_limits(chief, "users/anna", jobs=3)
        assert anna.patch(f"/api/jobs/{first}", json={"state": "running"}).status_code == 200
        assert chief.delete("/api/quotas/users/anna").status_code == 204
        assert anna.get("/api/quota").json()[0]["limits"]["jobs"] == 2
        assert submit(chief, scene).status_code == 201, "who keeps the farm has no limits"
        for job in (first, second, third.json()["id"]):
            anna.delete(f"/api/jobs/{job}").raise_for_status()
        assert used(anna)["jobs"] == 0


@pytest.mark.long
def test_daily_samples_include_deleted_jobs(service: Service, chief: httpx.Client) -> None:
    with new_user(service, "bea") as bea:
        scene = scene_of(bea)
        set_limits(chief, "users/bea", samples_day=2 * SAMPLES + 1)
        job = submit(bea, scene).raise_for_status().json()["id"]
        until(lambda: bea.get(f"/api/jobs/{job}").json()["state"] == "finished", "it is rendered")
        assert used(bea)["samples_day"] == SAMPLES
        assert bea.patch(f"/api/jobs/{job}", json={"more": 8}).status_code == 429
        assert bea.delete(f"/api/jobs/{job}").status_code == 204
        assert used(bea)["samples_day"] == SAMPLES
        refused = submit(bea, scene, spp=8)
        assert (refused.status_code, f"{2 * SAMPLES:,} more" in refused.json()["detail"]) == (429, True)
        assert submit(bea, scene).status_code == 201


@pytest.mark.long
def test_samples_count_from_submission(service: Service, chief: httpx.Client) -> None:
    with new_user(service, "hal") as hal:
        scene = scene_of(hal)
        set_limits(chief, "users/hal", samples_day=1 << 40)
        first = submit(hal, scene, spp=1 << 20, frames="0-1").raise_for_status().json()["id"]
        waits = submit(hal, scene, after=[first]).raise_for_status().json()["id"]  # stays waiting until the first has ended
        assert used(hal)["samples_day"] == (2 << 30) + SAMPLES
        set_limits(chief, "users/hal", samples_day=(2 << 30) + 2 * SAMPLES - 1)
        assert submit(hal, scene, after=[first]).status_code == 429
        with service.farm.sessions.begin() as session:
            session.add_all(Frame(job=waits, number=n, target=1 << 62) for n in (2, 4, 6))
        assert used(hal)["samples_day"] == (1 << 63) - 1, "more than a database adds up"
        assert hal.delete(f"/api/jobs/{waits}").status_code == hal.delete(f"/api/jobs/{first}").status_code == 204


@pytest.mark.long
def test_stored_bytes_are_limited(service: Service, chief: httpx.Client) -> None:
    with new_user(service, "cleo") as cleo:
        scene = scene_of(cleo, OBJ + b"# cleo")
        mine = used(cleo)["bytes"]
        assert mine == len(OBJ) + 6
        job = submit(cleo, scene).raise_for_status().json()["id"]
        until(lambda: cleo.get(f"/api/jobs/{job}").json()["state"] == "finished", "it is rendered")
        assert used(cleo)["bytes"] > mine + 1000, "its film"
        set_limits(chief, "users/cleo", bytes=used(cleo)["bytes"] + 20_000)
        large = cleo.post("/api/scenes", files={"files": ("b.obj", OBJ + b"#" * LARGE)})
        assert (large.status_code, "Delete jobs or scenes" in large.json()["detail"]) == (507, True)
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("c.obj", OBJ + b"#" * LARGE)
        assert len(packed.getvalue()) < 2000
        assert cleo.post("/api/scenes", files={"files": ("c.zip", packed.getvalue())}).status_code == 507
        for kind in ("references", "environments"):
            assert cleo.post(f"/api/{kind}", files={"file": ("b.png", b"#" * LARGE)}).status_code == 507
        set_limits(chief, "users/cleo", bytes=0)
        assert submit(cleo, scene).status_code == 507
        assert cleo.delete(f"/api/jobs/{job}").status_code == 204, "what helps is never refused"
        assert cleo.delete(f"/api/scenes/{scene}").status_code == 204


def test_token_limits_are_below_user_limits(service: Service, chief: httpx.Client) -> None:
    with new_user(service, "dora") as dora:
        secret, row = service.farm.access.keys.create("token", "dora", Role.SUBMIT, "nightly")
        set_limits(chief, f"tokens/{row.id}", jobs=0)
        scene = scene_of(dora)
        with caller(service, secret) as nightly:
            refused = submit(nightly, scene)
            assert (refused.status_code, "This token's" in refused.json()["detail"]) == (429, True)
            assert [found["whose"] for found in nightly.get("/api/quota").json()] == ["user:dora", f"token:{row.id}"]
        assert submit(dora, scene).status_code == 201


def test_limits_of_unknown_users_are_rejected(service: Service, chief: httpx.Client) -> None:
    assert chief.put("/api/quotas/users/nobody", json={"jobs": 1}).status_code == 404
    assert chief.put("/api/quotas/tokens/nothing", json={"jobs": 1}).status_code == 404
    assert chief.put("/api/quotas/users/anna", json={"jobs": -1}).status_code == 422
    assert chief.put("/api/quotas/users/anna", json={"cores": 1}).status_code == 422
    assert chief.get("/api/quota").json() == []


def test_usage_list_equals_individual_usage(service: Service, chief: httpx.Client, monkeypatch: pytest.MonkeyPatch) -> None:
    """The list of all users' usage equals each user's own, and reads every table once, not once per user."""
    monkeypatch.setattr(
        service.farm.quotas, "_size_of", len
    )  # length of a job's id: real films settle and become smaller during the test

    def listed() -> dict[str, Any]:
        return {found["whose"]: found["used"] for found in chief.get("/api/quotas").raise_for_status().json()}

    def each() -> dict[str, Any]:
        with service.farm.sessions() as session:
            return {whose: asdict(service.farm.quotas._usage_of(whose, session)) for whose in listed()}

    assert len(listed()) >= 3
    assert any(used["bytes"] for used in listed().values())
    until(lambda: listed() == each(), "both say the same, once what earlier tests have left is at rest", say=each)


def test_usage_page_reads_only_films_of_its_users(service: Service, chief: httpx.Client, monkeypatch: pytest.MonkeyPatch) -> None:
    with new_user(service, "hugo") as hugo, new_user(service, "ida") as ida:
        scene = scene_of(hugo)
        jobs = [submit(client, scene).raise_for_status().json()["id"] for client in (hugo, ida)]
        looked_at: list[str] = []
        monkeypatch.setattr(service.farm.quotas, "_size_of", lambda job: looked_at.append(job) or 0)
        offset = [found["whose"] for found in chief.get("/api/quotas").json()].index("user:hugo")
        looked_at.clear()
        (found,) = chief.get(f"/api/quotas?limit=1&offset={offset}").raise_for_status().json()
        assert (found["whose"], looked_at) == ("user:hugo", jobs[:1])


@pytest.mark.long
def test_added_samples_of_shot_count_per_frame(service: Service, chief: httpx.Client) -> None:
    with new_user(service, "frida") as frida:
        scene = scene_of(frida)
        set_limits(chief, "users/frida", samples_day=10 * SAMPLES)
        shot = submit(frida, scene, frames="0-1").raise_for_status().json()["id"]

        def change(**wish: Any) -> int:
            return frida.patch(f"/api/jobs/{shot}", json=wish).status_code

        assert change(extend="2-10") == 429, "nine frames more are one too many"
        assert change(extend="2-4") == 200
        assert used(frida)["samples_day"] == 5 * SAMPLES, "they count before any of them is rendered"
        assert change(spp=9) == 429, "twice as many samples of each, and one"
        assert change(spp=8) == 200
        assert used(frida)["samples_day"] == 10 * SAMPLES
        assert change(more=1, frames="0") == 429


@pytest.mark.long
def test_repeated_rendering_counts_each_time(service: Service, chief: httpx.Client) -> None:
    with new_user(service, "greta") as greta:
        scene = scene_of(greta)
        set_limits(chief, "users/greta", samples_day=5 * SAMPLES)
        shot = submit(greta, scene, frames="0-1").raise_for_status().json()["id"]
        for times in (2, 3):
            until(lambda: greta.get(f"/api/jobs/{shot}").json()["state"] == "finished", "it is finished")
            assert greta.patch(f"/api/jobs/{shot}", json={"again": "0"}).status_code == 200
            until(lambda times=times: used(greta)["samples_day"] == (1 + times) * SAMPLES, "it counts", say=lambda: used(greta))  # type: ignore[misc]
        until(lambda: greta.get(f"/api/jobs/{shot}").json()["state"] == "finished", "it is finished")
        assert greta.patch(f"/api/jobs/{shot}", json={"again": "0-1"}).status_code == 429
