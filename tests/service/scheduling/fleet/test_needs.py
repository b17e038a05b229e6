"""Tests of a job's requirements: which workers get the job, and the message if no worker meets them."""

from __future__ import annotations

from typing import Any

import pytest

from protocol.terms import Offer, Terms
from service.scheduling.fleet.needs import Needs
from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker, expected_digest


def offer(*tags: str, memory_gb: float = 8.0) -> Offer:
    return Offer(tags, round(memory_gb * 1e9), 2, "")


def test_needs_round_trip() -> None:
    needs = Needs.parse(["gpu", "memory_gb=16", "bigmem", "gpu", "memory_gb=8"])
    assert needs == Needs(("bigmem", "gpu"), 16.0)
    assert needs.texts == ["bigmem", "gpu", "memory_gb=16"]
    assert Needs.from_json(needs.to_json()) == Needs.parse(needs.texts) == needs
    assert needs.queue("kind") == Needs(("bigmem", "gpu"), 16.0).queue("kind") != needs.queue("other")
    assert Needs.parse([]) is None
    for wrong in ("GPU", "a b", "memory_gb=-1", "", "memory_gb=1e9"):
        with pytest.raises(ValueError, match="is not a requirement; give a tag in small letters, or memory_gb=32"):
            Needs.parse([wrong])


@pytest.mark.parametrize(
    ("needs", "offers", "sentence"),
    [
        (["gpu"], [offer("gpu")], None),
        (["gpu"], [offer("big"), None, offer("gpu", "big")], None),
        (["gpu"], [], "Waits for a worker with the tag gpu: none is connected."),
        (["gpu"], [None], "Waits for a worker with the tag gpu: none is connected."),
        (["gpu", "big"], [offer("x")], "Waits for a worker with the tags big, gpu: none is connected."),
        (["memory_gb=16"], [offer()], "Waits for a worker with 16 GB of memory: the largest has 8.0 GB."),
        (
            ["gpu", "big"],
            [offer("gpu"), offer("big")],
            "Waits for a worker with all of big, gpu: none is connected.",
        ),
        (["gpu", "memory_gb=16"], [offer("gpu"), offer(memory_gb=32)], "all of gpu, memory_gb=16: none"),
    ],
)
def test_unmet_need_is_named(needs: list[str], offers: list[Any], sentence: str | None) -> None:
    wanted = Needs.parse(needs)
    assert wanted is not None
    found = wanted.unmet_reason(offers)
    assert (found is None) == (sentence is None)
    assert (sentence or "") in (found or "")


@pytest.mark.long
def test_job_goes_to_workers_that_meet_its_needs(service: Service) -> None:
    with service.worker(name="old") as old, service.worker(name="plain", tags=()) as plain:
        scene = service.ready_scene()
        job = service.submit(scene, needs=["gpu", "memory_gb=4"])
        lacking = "Waits for a worker with the tag gpu: none is connected."
        until(lambda: service.job(job)["message"] == lacking, "it is said", say=lambda: service.job(job))
        service.wait_for(service.submit(scene, seed=2), "finished")
        assert service.job(job)["state"] == "queued"
        assert service.job(job)["needs"] == ["gpu", "memory_gb=4"]
        with service.worker(name="gpus", tags=("gpu",)) as gpus:
            service.wait_for(job, "finished")
            assert service.digest(job) == expected_digest()
            rendered = [{batch.job for batch in worker.batches} for worker in (old, plain, gpus)]
            assert [job in jobs for jobs in rendered] == [False, False, True]
            until(lambda: gpus.terms.queues == (), "it need not look there any more")
        free = service.submit(scene, seed=3, needs=["gpu"])
        until(lambda: service.job(free)["message"] == lacking, "it is gone", say=lambda: service.job(free))
        service.patch(free, needs=[])
        service.wait_for(free, "finished")
    refused = service.http.post("/api/jobs", json={"scene": scene, "needs": ["GPU"]})
    assert (refused.status_code, "need-malformed" in refused.text) == (422, True)


@pytest.mark.long
def test_worker_terms_are_sent_and_stored(service: Service) -> None:
    def tags(worker: PeerWorker) -> dict[str, Any]:
        return next(row for row in service.http.get("/api/workers").json() if row["name"] == worker.name)

    with service.worker(name="old"), service.worker(name="new", tags=("gpu",)) as new:
        until(lambda: len(service.http.get("/api/workers").json()) == 2, "both are there")
        assert tags(new)["offer"]["tags"] == ["gpu"]
        refused = service.http.patch("/api/workers/old", json={"slots": 1})
        assert (
            refused.status_code,
            "is of an older release and can only be paused. Run this release there" in refused.json()["detail"],
        ) == (409, True)
        asked = {"hours": "Sat-Sun", "slots": 1, "nice": 5, "memory_gb": 2, "idle_minutes": 10}
        service.http.patch("/api/workers/new", json=asked).raise_for_status()
        until(lambda: new.terms == Terms("Sat-Sun", 10, 5, 1, 2_000_000_000), "it is told")
        new.redis.flushall()
        until(lambda: new.terms.slots == 1, "told again, after Redis forgot all")
        service.restart()
        until(lambda: len(service.http.get("/api/workers").json()) == 2, "both are seen again")
        service.http.patch("/api/workers/new", json={"slots": None, "hours": ""}).raise_for_status()
        until(lambda: (new.terms.slots, new.terms.hours) == (None, ""), "told", say=lambda: new.terms)
        assert new.terms.nice == 5
    wrong = service.http.patch("/api/workers/new", json={"hours": "Mondays"})
    assert (wrong.status_code, "give hours as Mon-Fri 19:00-07:00, Sat-Sun" in wrong.text) == (422, True)
