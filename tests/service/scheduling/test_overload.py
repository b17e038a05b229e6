"""Tests of a service that merges results more slowly than the slots render them.

It dispatches fewer and longer batches, and no batch twice.
"""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np
import pytest

from renderer.film import digest
from renderer.settings import Tile
from service.scheduling.dispatching.batch_outcomes import BatchOutcomes
from service.scheduling.dispatching.leases import MAX_UNSEEN_POLLS
from service.scheduling.dispatching.lost_batches import LossVerdict, LostLeaseFinder
from service.store.film_file import FilmFile
from tests.benchmarks.scale import slots as slots_module
from tests.benchmarks.scale.slots import Slots, of_one_sample
from tests.helpers import wait_until
from tests.service.conftest import TOKEN, Service
from tests.service.peer_worker import expected_sums

WIDTH, HEIGHT, TILE, SPP = 64, 48, 16, 1500
SLOTS = 200


@pytest.mark.long
@pytest.mark.timeout(300)
def test_no_batch_is_repeated_during_backlog(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    """Checks that no batch is rendered twice if the disk is slow and results wait longer than the timeout of their batches."""
    add = FilmFile.add

    def slowly(*arguments: Any) -> None:
        time.sleep(1.0)
        add(*arguments)

    monkeypatch.setattr(FilmFile, "add", slowly)
    sums = of_one_sample(expected_sums(Tile(0, 0, TILE, TILE), 0, 4, 0))
    slots = Slots(service.options["redis_url"], service.url, TOKEN, SLOTS, sums, 0.05)
    thread = threading.Thread(target=slots.run, args=(280.0,))
    thread.start()
    try:
        job = service.submit(service.ready_scene(), width=WIDTH, height=HEIGHT, tile_size=TILE, spp=SPP)
        service.wait_for(job, "finished", 240)
    finally:
        slots.stop_running()
        thread.join(20)
        slots.stop()
    tiles = (WIDTH // TILE) * (HEIGHT // TILE)
    assert service.digest(job) == digest(np.tile(sums * SPP, (1, HEIGHT // TILE, WIDTH // TILE)))
    assert service.farm.engine.snapshot.counts["lost"] == 0
    assert slots.samples == tiles * SPP, "each once"


@pytest.mark.long
def test_suspended_workers_keep_their_batches(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    """Checks that suspended workers keep their batches after their reports expired, since they are still connected to Redis."""
    monkeypatch.setattr(slots_module, "HEARTBEAT_TTL_S", 1)
    sums, samples = of_one_sample(expected_sums(Tile(0, 0, TILE, TILE), 0, 4, 0)), 40
    slots = Slots(service.options["redis_url"], service.url, TOKEN, 6, sums, 0.05)
    answer, starved, goes_on = slots._answer, threading.Event(), threading.Event()

    def when_there_is_time(now: float) -> bool:
        if starved.is_set():
            goes_on.wait(60)
        return answer(now)

    monkeypatch.setattr(slots, "_answer", when_there_is_time)
    thread = threading.Thread(target=slots.run, args=(150.0,))
    thread.start()
    leases = service.farm.engine._scheduler.leases
    try:
        job = service.submit(service.ready_scene(), width=WIDTH, height=HEIGHT, tile_size=TILE, spp=samples)
        wait_until(lambda: service.farm.engine.snapshot.counts.get("merged", 0) > 12, 60, "they are at work")
        starved.set()
        wait_until(lambda: any(lease.unseen > MAX_UNSEEN_POLLS for lease in leases), 60, "theirs are looked for again and again")
        assert not service.farm.engine.snapshot.roster.reports
        goes_on.set()
        service.wait_for(job, "finished", 60)
    finally:
        goes_on.set()
        slots.stop_running()
        thread.join(20)
        slots.stop()
    tiles = (WIDTH // TILE) * (HEIGHT // TILE)
    assert service.digest(job) == digest(np.tile(sums * samples, (1, HEIGHT // TILE, WIDTH // TILE)))
    assert service.farm.engine.snapshot.counts["lost"] == 0
    assert slots.samples == tiles * samples, "each once"


@pytest.mark.long
def test_stragglers_are_not_duplicated_while_work_remains(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(BatchOutcomes, "_has_idle_slots", lambda self, kind: True)
    monkeypatch.setattr(LostLeaseFinder, "_verdict", lambda self, lease, *_: None if lease.doubled else LossVerdict.LATE)
    slots = Slots(
        service.options["redis_url"], service.url, TOKEN, 4, of_one_sample(expected_sums(Tile(0, 0, TILE, TILE), 0, 4, 0)), 0.5
    )
    thread = threading.Thread(target=slots.run, args=(150.0,))
    thread.start()

    def counted(name: str) -> int:
        return service.farm.engine.snapshot.counts.get(name, 0)

    try:
        job = service.submit(service.ready_scene(), width=WIDTH, height=HEIGHT, tile_size=TILE, spp=1 << 16)
        wait_until(lambda: counted("merged") >= 4, 60, "it is known what a batch takes")
        before, merged = counted("doubled"), counted("merged")
        wait_until(lambda: counted("merged") >= merged + 12, 60, "they go on for some looks")
        assert counted("doubled") == before
        assert service.patch(job, state="cancelled")["state"] == "cancelled"
    finally:
        slots.stop_running()
        thread.join(20)
        slots.stop()
