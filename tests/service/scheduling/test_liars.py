"""Tests that workers cannot affect pictures with false sums, times or blobs, or by answering batches of other workers."""

from __future__ import annotations

import hashlib
import threading
import time
from typing import Any

import numpy as np
import pytest

from protocol.contract import DenoiseFrame, RenderBatch
from protocol.sums import pack_sums
from renderer.film import SAMPLES
from service.jobs.lookup import find_film
from tests.grids import grid
from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker, expected_digest, expected_sums

LONG_S = 120.0


def damaged_sums(batch: RenderBatch, how: str) -> bytes:
    sums = expected_sums(batch.tile, batch.first, batch.count, batch.settings.seed)
    if how == "too heavy":
        sums[SAMPLES] += 1
    elif how == "below nothing":
        sums[SAMPLES, 0, 0] = -1
    packed = pack_sums(np.ascontiguousarray(sums))
    return {"cut off": packed[:-7], "nothing": b"", "of another tile": packed + b"more"}.get(how, packed)


@grid("how", ["too heavy", "below nothing", "cut off"], ordinary=("cut off",))
def test_worker_with_invalid_sums_is_quarantined(service: Service, how: str) -> None:
    with service.worker(name="good") as good, service.worker(name="bad") as bad:

        def lie(batch: RenderBatch) -> bool:
            event = {"type": "batch", **bad._about(batch), "seconds": 0.01, "bad": [], "bad_count": 0}
            bad.send(event, damaged_sums(batch, how))
            return False

        bad.on_batch = lie
        good.on_batch = lambda batch: time.sleep(0.02)
        until(lambda: len(service.http.get("/api/workers").json()) == 2, "both are seen")
        job = service.submit(service.ready_scene(), spp=40)

        def told() -> str:
            return str(next(w for w in service.http.get("/api/workers").json() if w["name"] == "bad")["message"])

        until(
            lambda: "of its batches failed while others rendered theirs. Check its log, then resume it" in told(),
            "it is set aside",
            LONG_S,
        )
        service.wait_for(job, "finished", LONG_S)
        assert service.digest(job) == expected_digest(spp=40)
        log = service.http.get(f"/api/jobs/{job}/log").text
        assert "A message of bad about it cannot be used (damaged sums" in log


@pytest.mark.long
def test_only_worker_with_invalid_sums_fails_job(service: Service, worker: PeerWorker) -> None:
    def lie(batch: RenderBatch) -> bool:
        event = {"type": "batch", **worker._about(batch), "seconds": 0.01, "bad": [], "bad_count": 0}
        worker.send(event, damaged_sums(batch, "nothing"))
        return False

    worker.on_batch = lie
    job = service.submit(service.ready_scene())
    assert "A message of peer about it cannot be used" in service.wait_for(job, "failed")["error"]
    worker.on_batch = lambda batch: None
    service.patch(job, state="running")
    service.wait_for(job, "finished")
    assert service.digest(job) == expected_digest()


@pytest.mark.long
def test_answers_with_foreign_batch_ids_delay_no_job(service: Service, worker: PeerWorker) -> None:
    types = ["batch", "batch-failed", "batch-returned"]
    held: list[RenderBatch] = []

    def lie(batch: RenderBatch) -> bool | None:
        time.sleep(0.003)
        if batch.job == other and len(held) < len(types):
            held.append(batch)
            return False  # leaves the batch unanswered
        if batch.job == other or not held or not types:
            return None
        type, mine = types.pop(), worker._about(batch)
        for said in ({**mine, "batch": held.pop().batch}, {**mine, "tile": [0, 0, 16, 16], "first": 3, "count": 2}):
            more: dict[str, Any] = {"seconds": 0.1} if type == "batch" else {"error": "it is not so"}
            worker.send({"type": type, **said, **more}, b"no sums" if type == "batch" else None)
        return False

    other = ""
    scene = service.ready_scene()
    worker.on_batch = lie
    jobs = [service.submit(scene, seed=1, spp=64)]
    jobs.append(other := service.submit(scene, seed=2, spp=64))
    for seed, job in enumerate(jobs, 1):
        service.wait_for(job, "finished", LONG_S)
        assert service.digest(job) == expected_digest(seed=seed, spp=64)
    assert not types, "all was said"


@pytest.mark.long
def test_false_rendering_times_starve_no_job(service: Service, worker: PeerWorker) -> None:
    def lie(batch: RenderBatch) -> bool:
        seconds = 80000.0 if batch.first % 2 else 1e-12
        event = {"type": "batch", **worker._about(batch), "seconds": seconds, "bad": [], "bad_count": 0}
        worker.send(event, pack_sums(expected_sums(batch.tile, batch.first, batch.count, batch.settings.seed)))
        return False

    worker.on_batch = lie
    job = service.submit(service.ready_scene(), spp=64)
    service.wait_for(job, "finished", LONG_S)
    assert service.digest(job) == expected_digest(spp=64)
    measured = service.farm.records.scene(service.job(job)["scene"])
    assert measured is not None
    assert (measured.measured or {}).get("sample_s", 0.0) < 1.0, "and nothing is foretold by them"


@pytest.mark.long
def test_false_denoised_blob_is_rejected_and_not_deleted(service: Service, worker: PeerWorker) -> None:
    """Checks that an upload is not deleted if a worker names it as its denoised picture.

    A blob that does not have the size of the picture is refused.
    """
    upload = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".ljust(64 * 48 * 12)
    scene = service.upload(upload)
    until(lambda: service.scene(scene)["status"] == "ready", "the scene is prepared")
    job = service.submit(scene)
    service.wait_for(job, "finished")
    honest = worker._denoise
    short = hashlib.sha256(upload[:64]).hexdigest()
    worker.http.put(f"/api/farm/blobs/{short}", content=upload[:64]).raise_for_status()
    named = [short, hashlib.sha256(upload).hexdigest()]

    def lie(work: DenoiseFrame) -> None:
        event = {
            "type": "denoised",
            "work": work.work,
            "worker": worker.name,
            "sha256": named.pop(0),
            "version": "v",
            "samples": 1,
        }
        worker.send(event)
        worker.denoised.append(work.job)

    worker._denoise = lie  # type: ignore[method-assign]
    picture = f"/api/jobs/{job}/frames/0/image.png?denoise=true"
    refused = service.http.get(picture)
    assert (refused.status_code, "another size" in refused.json()["detail"]) == (502, True)
    assert service.http.get(picture).status_code == 200  # a picture of the right size is shown, whatever it contains
    worker._denoise = honest  # type: ignore[method-assign]
    service.patch(job, spp=16)
    service.wait_for(job, "finished")
    assert service.http.get(picture).status_code == 200
    assert service.http.delete(f"/api/jobs/{job}").status_code == 204
    handled = threading.Event()
    service.farm.events.subscribe(threading.Event, lambda event: event.set(), in_background=True)
    service.farm.events.publish(handled)  # published after the blob was released, in the same thread
    assert handled.wait(20)
    assert service.farm.blobs.exists(hashlib.sha256(upload).hexdigest())


@pytest.mark.long
def test_verified_job_needs_exactly_one_sender(service: Service) -> None:
    """Checks that a job with verification refuses samples of several or unknown senders, which could not be removed later."""
    with service.worker(name="good") as good, service.worker(name="bad") as bad:

        def lie(batch: RenderBatch) -> bool:
            sums = expected_sums(batch.tile, batch.first, batch.count, batch.settings.seed)
            sums[0, 0, 0] ^= 1 << 7
            about = {name: value for name, value in bad._about(batch).items() if name != "batch"}
            parts = [[batch.batch, batch.first, batch.count, 0.001, ""]]
            event = {"type": "batches", **about, "worker": "" if batch.tile[0] else "bad", "parts": parts}
            if batch.count > 1 and not batch.tile[0]:
                parts[0][2] = 1
                parts.append(["other", batch.first + 1, batch.count - 1, 0.001, "somebody"])
            bad.send({**event, "bad": [], "bad_count": 0}, pack_sums(np.ascontiguousarray(sums)))
            return False

        bad.on_batch = lie
        good.on_batch = lambda batch: time.sleep(0.005)
        until(lambda: len(service.http.get("/api/workers").json()) == 2, "both are seen")
        job = service.submit(service.ready_scene(), spp=20, verify=0.001)
        until(lambda: len(bad.batches) > 8, "it has lied")
        bad.on_batch = lambda batch: None
        service.wait_for(job, "finished", LONG_S)
        assert "somebody" not in str(service.http.get(f"/api/jobs/{job}/history").json())
        film = find_film(job, 0, service.farm)
        assert not film.has_sums_of("somebody")
        assert all(row.workers for rows in film._contents._rows.values() for row in rows), "nobody's is not in it either"
