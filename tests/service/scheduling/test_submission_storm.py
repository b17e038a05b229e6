"""Tests of many jobs submitted at once: each database write of the engine waits for at most one submission's transaction."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import httpx
import pytest

from service.store.writer_queue import WriterQueue
from tests.service.conftest import Service
from tests.service.peer_worker import PeerWorker

CLIENTS, EACH = 5, 5
SIZE = {"width": 32, "height": 24, "tile_size": 16}


def test_running_job_continues_during_many_submissions(
    service: Service, worker: PeerWorker, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[bool] = []  # whether each transaction was the engine's
    passed: list[int] = []  # number of other transactions that began while each of the engine's waited
    taken = WriterQueue.wait_for_turn

    @contextmanager
    def counted(self: WriterQueue, patience_s: float, is_urgent: bool = False) -> Iterator[None]:
        before = len(begun)
        with taken(self, patience_s, is_urgent):
            if is_urgent:
                passed.append(begun[before:].count(False))
            begun.append(is_urgent)
            yield

    monkeypatch.setattr(WriterQueue, "wait_for_turn", counted)
    worker.on_batch = lambda _: (time.sleep(0.02), True)[1]
    scene = service.ready_scene()
    running = service.submit(scene, spp=100_000, priority=10, **SIZE)
    service.wait_for(running, "running")
    begun.clear()
    passed.clear()
    codes: list[int] = []

    def submit() -> None:
        with httpx.Client(base_url=service.url, headers=dict(service.http.headers), timeout=60) as http:
            for _ in range(EACH):
                asked = {"scene": scene, "spp": 1, "fresh": True, **SIZE}
                while (answer := http.post("/api/jobs", json=asked)).status_code == 503:  # 503 on a busy machine
                    time.sleep(float(answer.headers["Retry-After"]))
                codes.append(answer.status_code)

    samples = service.job(running)["samples"]
    while not passed:  # until the engine has written while others submit
        threads = [threading.Thread(target=submit) for _ in range(CLIENTS)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert set(codes) == {201}
    assert max(passed) <= 1, "others began to write before the engine, which had waited longer"
    assert begun.count(False) >= CLIENTS * EACH
    assert service.job(running)["samples"] > samples
