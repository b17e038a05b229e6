"""Tests that a worker with wrong results is detected, and that its samples are removed from all pictures."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack

import numpy as np
import pytest

from protocol.contract import RenderBatch
from protocol.sums import pack_sums
from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker, expected_digest, expected_sums

LONG_S = 120.0


def falsify_results(worker: PeerWorker, lies: Callable[[RenderBatch], bool]) -> list[RenderBatch]:
    """Makes a worker flip one bit in the sums of each batch for which `lies` returns True.

    Returns a list to which these batches are added as they are rendered.
    """
    lied: list[RenderBatch] = []

    def answer(batch: RenderBatch) -> bool | None:
        if not lies(batch):
            return None
        lied.append(batch)
        sums = expected_sums(batch.tile, batch.first, batch.count, batch.settings.seed)
        sums[0, 0, 0] ^= 1 << 7
        event = {"type": "batch", **worker._about(batch), "seconds": 0.001 * batch.count, "bad": [], "bad_count": 0}
        worker.send(event, pack_sums(np.ascontiguousarray(sums)))
        return False

    worker.on_batch = answer
    return lied


def workers_of(service: Service, *names: str) -> tuple[ExitStack, list[PeerWorker]]:
    ends = ExitStack()
    made = [ends.enter_context(service.worker(name=name)) for name in names]
    until(lambda: {w["name"] for w in service.http.get("/api/workers").json()} == set(names), "all are seen", LONG_S)
    return ends, made


def state_of(service: Service, name: str) -> tuple[str, str | None]:
    found = next(w for w in service.http.get("/api/workers").json() if w["name"] == name)
    return found["state"], found["message"]


def count(service: Service, name: str) -> float:
    lines = service.http.get("/metrics").text.splitlines()
    return next(float(line.split()[1]) for line in lines if line.startswith(f"rayfarm_{name}_total "))


def slow(batch: RenderBatch) -> None:
    time.sleep(0.002)


@pytest.mark.long
def test_wrong_worker_is_quarantined_and_its_samples_rendered_again(service: Service) -> None:
    ends, (good, bad, third) = workers_of(service, "good", "bad", "third")
    with ends:
        good.on_batch = third.on_batch = slow
        scene = service.ready_scene()
        turns = iter(range(1 << 30))
        lied = falsify_results(bad, lambda batch: next(turns) % 5 == 2)
        other = service.submit(scene, spp=600, seed=1, verify=0, priority=-1)  # not verified, and gets some of the false sums
        job = service.submit(scene, spp=150, verify=1)
        until(lambda: state_of(service, "bad")[0] == "paused", "it is found out", LONG_S)
        assert "Quarantined: its results differ from those of other workers (samples" in str(state_of(service, "bad")[1])
        service.wait_for(job, "finished", LONG_S)
        service.patch(other, priority=10)
        service.wait_for(other, "finished", LONG_S)
        assert lied
        assert service.digest(job) == expected_digest(spp=150)
        assert service.digest(other) == expected_digest(spp=600, seed=1)
        events = service.http.get(f"/api/jobs/{job}/history").json()["events"]
        assert ("distrusted", "bad") in [(event["kind"], event["words"]) for event in events]
        assert count(service, "workers_distrusted") == 1
        assert count(service, "batches_differed") >= 1
        assert "Quarantined: its results differ from those of other workers" not in str(state_of(service, "good")[1])
        assert service.http.patch("/api/workers/bad", json={"state": "running"}).json()["state"] == "ready"
        bad.on_batch = lambda batch: None
        before = len(bad.batches)
        good.on_batch = third.on_batch = lambda batch: time.sleep(0.2)
        again = service.submit(scene, seed=2, spp=16)
        service.wait_for(again, "finished", LONG_S)
        assert len(bad.batches) > before, "and takes part again"
        assert service.digest(again) == expected_digest(spp=16, seed=2)


@pytest.mark.long
def test_finished_jobs_with_distrusted_samples_are_marked(service: Service) -> None:
    ends, (good, bad, third) = workers_of(service, "good", "bad", "third")
    with ends:
        good.on_batch = third.on_batch = slow
        scene = service.ready_scene()
        lied = falsify_results(bad, lambda batch: True)
        old = service.submit(scene, spp=300, seed=1, verify=0)
        service.wait_for(old, "finished", LONG_S)
        assert lied
        clean = service.submit(scene, spp=1, seed=2, verify=0, tile_size=64)  # one batch, which may be from the liar
        service.wait_for(clean, "finished", LONG_S)
        service.wait_for(service.submit(scene, spp=150, verify=1), "finished", LONG_S)
        until(lambda: service.job(old)["doubted"] == ["bad"], "it is marked", LONG_S)
        is_his = any(batch.job == clean for batch in lied)
        until(lambda: service.job(clean)["doubted"] == ["bad"] * is_his, "as are others of his alone", LONG_S)
        assert service.digest(old) != expected_digest(spp=300, seed=1), "it stays as it was delivered"
        again = service.submit(scene, spp=300, seed=1)
        assert service.job(again)["taken"] is None, "and nothing is taken from it"
        service.patch(again, state="cancelled")
        service.http.patch("/api/workers/bad", json={"state": "running"}).raise_for_status()  # a user resumes the worker
        bad.on_batch = lambda batch: None
        service.patch(old, state="running")
        service.wait_for(old, "finished", LONG_S)
        assert (service.job(old)["doubted"], service.digest(old)) == ([], expected_digest(spp=300, seed=1))


@pytest.mark.long
def test_two_different_results_wait_for_third(service: Service) -> None:
    ends, (_, bad) = workers_of(service, "good", "bad")
    with ends:
        lied = falsify_results(bad, lambda batch: True)
        job = service.submit(service.ready_scene(), spp=20, verify=1)
        until(lambda: "decide" in str(service.job(job)["message"]), "they differ", LONG_S)
        assert "bad and good rendered the same batch differently" in service.job(job)["message"]
        until(lambda: service.job(job)["samples"] == 64 * 48 * 20, "all is rendered", LONG_S)
        assert service.job(job)["state"] == "running", "and it does not end"
        assert lied
        with service.worker(name="third"):
            service.wait_for(job, "finished", LONG_S)
            assert state_of(service, "bad")[0] == "paused"
            assert state_of(service, "good")[0] == state_of(service, "third")[0] == "ready"
            assert service.digest(job) == expected_digest(spp=20)


@pytest.mark.long
def test_pausing_a_worker_decides_verification(service: Service) -> None:
    ends, (_, bad) = workers_of(service, "good", "bad")
    with ends:
        falsify_results(bad, lambda batch: True)
        job = service.submit(service.ready_scene(), spp=20, verify=1)
        until(lambda: "pause the one" in str(service.job(job)["message"]), "they differ", LONG_S)
        service.http.patch("/api/workers/bad", json={"state": "paused"}).raise_for_status()
        service.wait_for(job, "finished", LONG_S)
        assert service.digest(job) == expected_digest(spp=20)


@pytest.mark.long
def test_single_worker_is_not_verified(service: Service) -> None:
    with service.worker(name="alone") as alone:
        scene = service.ready_scene()
        service.wait_for(service.submit(scene, verify=1), "finished", LONG_S)
        assert sum(b.count * b.tile.w * b.tile.h for b in alone.batches) == 64 * 48 * 8
    ends, _ = workers_of(service, "one", "two")
    with ends:
        job = service.submit(scene, spp=40, seed=3, verify=0.5)
        service.wait_for(job, "finished", LONG_S)
        assert service.digest(job) == expected_digest(spp=40, seed=3)
        assert count(service, "batches_verified") > 0
        assert count(service, "batches_differed") == count(service, "workers_distrusted") == 0


@pytest.mark.long
def test_distrust_persists_after_restart(service: Service) -> None:
    ends, (good, bad, third) = workers_of(service, "good", "bad", "third")
    with ends:
        good.on_batch = third.on_batch = slow
        scene = service.ready_scene()
        falsify_results(bad, lambda batch: True)
        job = service.submit(scene, spp=400, verify=0.3)
        until(lambda: state_of(service, "bad")[0] == "paused", "it is found out", LONG_S)
        service.stop()
    service.start()
    with service.worker(name="good"):
        service.wait_for(job, "finished", LONG_S)
        assert service.digest(job) == expected_digest(spp=400)


@pytest.mark.parametrize("verify", [-0.1, 1.5, True])
def test_invalid_verify_fraction_is_rejected(service: Service, verify: object) -> None:
    answer = service.http.post("/api/jobs", json={"scene": "x", "verify": verify})
    assert answer.status_code == 422
    assert "verify" in answer.text
