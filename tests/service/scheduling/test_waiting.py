"""Tests of jobs that wait for other jobs, with the real service."""

from __future__ import annotations

import pytest

from protocol.contract import RenderBatch
from tests.service.conftest import Service
from tests.service.peer_worker import PeerWorker, expected_digest


def submit_paused(service: Service, scene: str, **request: object) -> str:
    """Submits a job that stays unfinished until it is resumed. Returns its id."""
    service.http.patch("/api/workers/peer", json={"state": "paused"}).raise_for_status()
    job = service.submit(scene, **request)
    service.patch(job, state="paused")
    service.http.patch("/api/workers/peer", json={"state": "running"}).raise_for_status()
    return job


@pytest.mark.long
def test_job_starts_after_its_dependencies(service: Service, worker: PeerWorker) -> None:
    scene = service.ready_scene()
    over = service.submit(scene, seed=3)
    service.wait_for(over, "finished")
    first = submit_paused(service, scene, seed=1, name="the first")
    second = service.submit(scene, seed=2, after=[first, over])
    third = service.submit(scene, seed=4, after=[second])
    asked = service.job(second)
    assert asked["after"] == [first, over]
    assert asked["waits_for"] == [{"id": first, "name": "the first", "state": "paused"}], "one is finished"
    assert asked["message"] == 'Waits until "the first" is finished.'
    service.restart()
    service.wait_for(service.submit(scene, seed=5), "finished")
    assert service.job(second)["state"] == service.job(third)["state"] == "queued"
    service.patch(first, state="running")
    done = service.wait_for(third, "finished")
    assert done["waits_for"] == []
    assert service.job(first)["finished"] <= service.job(second)["started"]
    assert service.job(second)["finished"] <= done["started"]
    assert [service.digest(job) for job in (second, third)] == [expected_digest(seed=2), expected_digest(seed=4)]
    service.http.delete(f"/api/jobs/{first}").raise_for_status()
    assert service.job(second)["state"] == "finished", "what was waited for may go"


@pytest.mark.long
@pytest.mark.parametrize("end", ["cancelled", *(pytest.param(end, marks=pytest.mark.long) for end in ("failed", "deleted"))])
def test_failed_dependency_fails_dependent_jobs(service: Service, worker: PeerWorker, end: str) -> None:
    scene = service.ready_scene()
    first = submit_paused(service, scene, seed=1, name="the first")
    second = service.submit(scene, seed=2, after=[first], name="the second")
    third = service.submit(scene, seed=4, after=[second])
    if end == "deleted":
        service.http.delete(f"/api/jobs/{first}").raise_for_status()
    elif end == "cancelled":
        service.patch(first, state="cancelled")
    else:
        worker.on_batch = _fails_with_seed_1
        service.patch(first, state="running")
        service.wait_for(first, "failed")
    failed = service.wait_for(second, "failed")
    called = first if end == "deleted" else f"the first ({first})"
    ended = end if end == "failed" else f"was {end}"
    assert failed["error"].startswith(f"It depends on the job {called}, which {ended} before it was finished.")
    assert f"the second ({second})" in service.wait_for(third, "failed")["error"]
    if end != "deleted":
        refused = service.http.post("/api/jobs", json={"scene": scene, "after": [first]})
        assert (refused.status_code, ". Choose an unfinished job" in refused.json()["detail"]) == (409, True)

    worker.on_batch = lambda batch: None
    service.http.post("/api/jobs/changes", json={"jobs": [third, second], "state": "running"}).raise_for_status()
    service.wait_for(third, "finished")
    assert service.digest(second) == expected_digest(seed=2), "all the same"
    assert service.job(second)["finished"] <= service.job(third)["started"], "and still one after the other"


@pytest.mark.long
def test_failure_propagates_through_long_chain(service: Service, worker: PeerWorker) -> None:
    scene = service.ready_scene()
    first = last = submit_paused(service, scene, seed=1)
    for _ in range(60):
        last = service.submit(scene, after=[last])
    service.patch(first, state="cancelled")
    service.wait_for(last, "failed", 30.0)  # at one per second this would take a minute


@pytest.mark.long
def test_dependencies_can_be_removed(service: Service, worker: PeerWorker) -> None:
    scene = service.ready_scene()
    first, other = submit_paused(service, scene, seed=1), submit_paused(service, scene, seed=1)
    second = service.submit(scene, seed=2, after=[first, other])
    assert service.http.patch(f"/api/jobs/{first}", json={"after": [second]}).status_code == 409, "in a circle"
    assert [wait["id"] for wait in service.patch(second, after=[other])["waits_for"]] == [other]
    assert service.patch(second, after=[])["waits_for"] == []
    service.wait_for(second, "finished")
    missing = service.http.post("/api/jobs", json={"scene": scene, "after": ["none"]})
    assert (missing.status_code, missing.json()["detail"][:31]) == (404, "after: there is no job 'none'. ")


def _fails_with_seed_1(batch: RenderBatch) -> None:
    if batch.settings.seed == 1:
        raise ValueError("this cannot be rendered")
