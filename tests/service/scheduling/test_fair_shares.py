"""Tests of shares and slot limits of users with the real service, measured by the work that workers get."""

from __future__ import annotations

import time
from collections import Counter

import httpx
import pytest

from protocol.contract import RenderBatch, render_queue
from service.access.roles import Role
from tests.service.conftest import OBJ, Service, until
from tests.service.peer_worker import PeerWorker


def submit_as(service: Service, user: str, scene: str, **request: object) -> str:
    """Submits a job as this user, with a new access token. Returns the job's id."""
    if not any(each.name == user for each in service.farm.access.users.listed()):
        service.farm.access.users.add(user, Role.SUBMIT, None)
    secret, _ = service.farm.access.keys.create("token", user, Role.SUBMIT)
    with httpx.Client(base_url=service.url, headers={"Authorization": f"Bearer {secret}"}, verify=False) as http:
        asked = {"scene": scene, "width": 64, "height": 48, "tile_size": 16, "spp": 100_000, **request}
        answer = http.post("/api/jobs", json=asked)
    assert answer.status_code == 201, answer.text
    return str(answer.json()["id"])


@pytest.mark.long
def test_users_get_slot_seconds_by_their_weights(service: Service, worker: PeerWorker) -> None:
    scene = service.ready_scene()
    refused = service.http.put("/api/shares/somebody", json={})
    assert (refused.status_code, "everybody, user:NAME and project:NAME" in refused.json()["detail"]) == (422, True)
    endless = service.http.put(
        "/api/shares/user:anna", json={"weight": 1e-320}
    )  # the smallest weights, by which a slot-second would last for ever
    assert endless.status_code == 422
    service.http.put("/api/shares/user:anna", json={"weight": 3}).raise_for_status()
    worker.on_batch = lambda batch: time.sleep(0.002)
    anna = submit_as(service, "anna", scene)
    bens = [submit_as(service, "ben", scene) for _ in range(3)]
    assert service.job(anna)["user"] == "anna"
    had: Counter[str] = Counter()

    def update_slot_seconds() -> float:
        """Stores the slot-seconds of each user's batches in `had`. Returns the sum over both users.

        Counting starts 100 batches after every job has had its first batch.
        """
        had.clear()
        batches = list(worker.batches)
        begun = max(next((i for i, batch in enumerate(batches) if batch.job == job), 1 << 30) for job in (anna, *bens))
        for batch in batches[begun + 100 :]:
            had["anna" if batch.job == anna else "ben"] += 0.001 * batch.count
        return sum(had.values())

    until(lambda: update_slot_seconds() > 30, "each has had its share", 60, lambda: had)
    assert had["anna"] / had["ben"] == pytest.approx(3, rel=0.2)
    rows = {row["share"]: row for row in service.http.get("/api/shares").raise_for_status().json()}
    assert {name: (row["weight"], row["jobs"]) for name, row in rows.items()} == {"user:anna": (3, 1), "user:ben": (1, 3)}
    assert service.http.delete("/api/shares/user:anna").raise_for_status().json()["weight"] == 1
    for job in (anna, *bens):
        service.patch(job, state="cancelled")


@pytest.mark.long
def test_slot_limits_of_jobs_and_shares_are_respected(service: Service) -> None:
    waiting: list[int] = []
    with service.worker(slots=8) as worker:

        def record_waiting(batch: RenderBatch) -> None:
            """Records the number of messages that wait in the queue when a batch is rendered.

            Without a limit on the slots of a job there would be 16: two for each of the worker's 8 slots.
            """
            waiting.append(worker.redis.llen(render_queue(worker.kind)))  # type: ignore[arg-type]

        scene = service.ready_scene()
        worker.on_batch = record_waiting
        service.wait_for(service.submit(scene, spp=64, max_slots=2), "finished")
        assert max(waiting) == 1, "the second"
        waiting.clear()
        service.http.put("/api/shares/user:anna", json={"max_slots": 3}).raise_for_status()
        jobs = [submit_as(service, "anna", scene, spp=64) for _ in range(3)]
        for job in jobs:
            service.wait_for(job, "finished")
        assert max(waiting) == 2
        access = service.farm.access
        access.projects.add("film")
        film = service.http.post("/api/scenes", params={"project": "film"}, files={"files": ("film.obj", OBJ)}).json()["id"]
        until(lambda: service.http.get(f"/api/scenes/{film}").json()["status"] == "ready", "it is prepared")
        service.http.put("/api/shares/project:film", json={"max_slots": 2}).raise_for_status()
        waiting.clear()
        access.users.add("ben", Role.SUBMIT, None)
        for user in ("anna", "ben"):
            access.projects.add_member("film", user)
        for job in [submit_as(service, user, film, spp=64) for user in ("anna", "ben")]:
            service.wait_for(job, "finished")
        assert max(waiting) == 1, "whose they are, they are of one share"
        waiting.clear()
        job = submit_as(service, "ben", scene, max_slots=1)
        until(lambda: len(waiting) > 20, "it is under way with one slot")
        assert max(waiting) == 0
        service.patch(job, max_slots=None)
        until(lambda: max(waiting) > 8, "all slots take part")
        service.patch(job, state="cancelled")
