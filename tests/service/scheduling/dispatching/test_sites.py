"""Tests of a site, whose reducer adds up the workers' sums before they are sent. Each sample is in the film exactly once.

The reducer and the messages are real; the slots are simulated.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import redis

from protocol.contract import Result
from renderer.film import digest
from renderer.settings import Tile
from service.scheduling.incoming.messages import BatchDone, parse_message
from service.scheduling.incoming.results import Entry
from tests.benchmarks.scale.slots import Slots, of_one_sample
from tests.reducer import ReducerProcess
from tests.service.conftest import TOKEN, Service, until
from tests.service.peer_worker import expected_sums

WIDTH, HEIGHT, TILE, SPP = 64, 48, 16, 6000
SUMS = of_one_sample(expected_sums(Tile(0, 0, TILE, TILE), 0, 4, 0))


@contextmanager
def machines(service: Service, site: str) -> Iterator[Slots]:
    """Yields 64 simulated slots: eight on each of eight machines at a site."""
    made = Slots(service.options["redis_url"], service.url, TOKEN, 64, SUMS, 0.01, True, site, 8)
    made.report()
    thread = threading.Thread(target=made.run, args=(200.0,))
    thread.start()
    try:
        yield made
    finally:
        made.stop_running()
        thread.join(20)
        made.stop()


@pytest.fixture
def store(service: Service) -> Iterator[redis.Redis]:
    with redis.Redis.from_url(service.options["redis_url"]) as connection:
        yield connection


def start_reducer(service: Service, spp: int) -> str:
    return service.submit(service.ready_scene(), width=WIDTH, height=HEIGHT, tile_size=TILE, spp=spp)


def finish(service: Service, job: str, spp: int) -> None:
    service.wait_for(job, "finished", 120)
    assert service.digest(job) == digest(np.tile(SUMS * spp, (1, HEIGHT // TILE, WIDTH // TILE)))


def result_counts(service: Service, name: str) -> int:
    return service.farm.engine.snapshot.counts.get(name, 0)


@pytest.mark.long
@pytest.mark.timeout(300)
def test_site_sends_fewer_results_and_survives_killed_reducer(service: Service, store: redis.Redis, tmp_path: Path) -> None:
    reducing = ReducerProcess(store, service.url, TOKEN, tmp_path)
    with machines(service, "attic") as slots:
        job = start_reducer(service, SPP)
        until(
            lambda: (r := reducing.report()) is not None and r.sent >= 5,
            "the reducer sends",
            60,
            lambda: result_counts(service, "merged"),
        )
        report = reducing.report()
        assert report is not None
        assert report.results > report.sent, "it has added up what several machines sent"
        reducing.kill()
        before = slots.direct_bytes
        until(lambda: slots.direct_bytes > before, "machines send to the service themselves", 60)
        reducing = ReducerProcess(store, service.url, TOKEN, tmp_path)
        finish(service, job, SPP)
        assert result_counts(service, "merged") > 2 * result_counts(service, "results")
        film = service.farm.film(service.farm.records.job(job))
        assert film is not None
        assert film.has_sums_of(f"{slots.name}-0")
        assert not film.has_sums_of("site attic")
    assert reducing.stop() == 0


@pytest.mark.long
@pytest.mark.timeout(300)
def test_batches_of_lost_site_are_rendered_elsewhere(service: Service, store: redis.Redis, tmp_path: Path) -> None:
    reducing = ReducerProcess(store, service.url, TOKEN, tmp_path)
    with machines(service, "attic"):
        job = start_reducer(service, SPP // 2)
        until(lambda: (r := reducing.report()) is not None and r.results > 0, "its machines work", 60)
    reducing.kill()
    with machines(service, ""):
        finish(service, job, SPP // 2)


def test_worker_of_each_batch_is_recorded() -> None:
    event = {"type": "batches", "job": "j", "frame": 0, "tile": [0, 0, 8, 8], "first": 4, "count": 5, "worker": "site attic"}
    message = parse_message(
        Entry(b"1-0", Result(event | {"parts": [["a", 4, 2, 0.5, "one"], ["b", 6, 3, 0.25, "two"]]}, b"sums"))
    )
    assert isinstance(message, BatchDone)
    assert message.senders == ("one", "two")
    message = parse_message(Entry(b"1-0", Result(event | {"parts": [["a", 4, 2, 0.5], ["b", 6, 3, 0.25]]}, b"sums")))
    assert isinstance(message, BatchDone)
    assert message.senders == ("site attic",)
