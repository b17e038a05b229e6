"""Tests of two services of one farm: one stands by, and takes over when the owner is killed or hangs.

Later writes of the former owner are refused. The film has each sample exactly once, whenever the takeover happens.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from service.store.films import Film
from tests.helpers import running_redis
from tests.service.conftest import OBJ, TOKEN, Service, until
from tests.service.peer_worker import PeerWorker, expected_digest
from tests.service.started import LEASE_S, Started

PICTURE = {"width": 64, "height": 48, "tile_size": 16}
SPP = 3000


@pytest.fixture
def two_services(tmp_path: Path, redis_server: running_redis, database: str) -> Iterator[tuple[Started, Started]]:
    """Yields (owner, standby); both are started at the same time, and the faster one becomes the owner."""
    both = [Started(tmp_path / "data", name, redis_url=redis_server.url, database_url=database) for name in ("one", "other")]

    def are_there() -> bool:
        assert all(each.process.poll() is None for each in both), states_and_logs(both)
        return sorted(each.says() for each in both) == ["ready", "stands by"]

    try:
        until(are_there, "both are there", 90, lambda: states_and_logs(both))
        first, second = sorted(both, key=Started.says)
        yield first, second
    finally:
        for each in both:
            each.end()


def states_and_logs(services: list[Started]) -> str:
    return "\n".join(f"{each.says()}\n{each.log.read_text()[-2000:]}" for each in services)


@contextmanager
def open_viewer(service: Started, job: str) -> Iterator[ClientConnection]:
    """Opens a viewer's WebSocket to a job, and receives its state and some tiles."""
    url = f"{service.url.replace('http', 'ws')}/api/jobs/{job}/live"
    with connect(url, max_size=None, open_timeout=30) as watcher:
        kinds = {type(watcher.recv(timeout=30)) for _ in range(3)}
        assert kinds == {str, bytes}, "its state, and tiles"
        yield watcher


def code_of(watcher: ClientConnection) -> int:
    """Reads a WebSocket until it is closed, and returns its close code."""
    with pytest.raises(ConnectionClosed) as closed:
        while True:
            watcher.recv(timeout=30)
    return closed.value.rcvd.code if closed.value.rcvd is not None else 0


def start_slow_job(service: Started, worker: PeerWorker) -> str:
    """Starts a job that renders slowly; returns its id."""
    worker.on_batch = lambda batch: time.sleep(0.002 * batch.count)  # 72 s for all 12 tiles
    scene = service.http.post("/api/scenes", files={"files": ("scene.obj", OBJ)}).raise_for_status().json()["id"]
    job = service.http.post("/api/jobs", json={"scene": scene, "spp": SPP, **PICTURE}).raise_for_status().json()["id"]
    until(lambda: service.job(job)["samples"] > 0, "the job is under way", 60, lambda: service.job(job))
    return str(job)


@pytest.mark.long
def test_hanging_and_killed_owners_are_replaced(two_services: tuple[Started, Started], redis_server: running_redis) -> None:
    """The farm moves from a suspended service to the standby, and back when the new owner is killed.

    The first service, once resumed, stands by until then. A job renders throughout.
    """
    first, second = two_services
    assert second.says("/healthz") == "stands by"
    assert "rayfarm_owner 0" in second.http.get("/metrics").text
    with PeerWorker(redis_server.url, second.url, TOKEN) as worker:
        job = start_slow_job(second, worker)  # the standby forwards the request
        assert second.job(job)["samples"] <= first.job(job)["samples"]
        with open_viewer(second, job) as watcher:
            first.process.send_signal(signal.SIGSTOP)
            assert second.http.get(f"/api/jobs/{job}").status_code == 200, "who asks waits for whoever takes over"
            assert code_of(watcher) == 1012, "who watched is told to come again"
        until(second.is_ready, "the second is ready", 60, second.says)
        renders_on(second, job)
        first.process.send_signal(signal.SIGCONT)
        # If it was suspended during a write to SQLite, it blocked the database and was killed.
        until(lambda: first.process.poll() is not None or first.stands_by(), "the first stands by", 60, first.says)
        numbers = second.http.get("/metrics", headers={"Authorization": f"Bearer {TOKEN}"}).text
        assert "rayfarm_owner 1.0" in numbers
        assert "rayfarm_takeovers_total 1.0" in numbers
        last = second
        if first.process.poll() is None:
            second.process.kill()
            until(first.is_ready, "the first is the farm again", 60, first.says)
            renders_on(first, job)
            last = first
        worker.on_batch = lambda batch: None
        until(lambda: last.job(job)["state"] == "finished", "it is finished", 60, lambda: last.job(job))
    assert last.http.get(f"/api/jobs/{job}/frames/0/digest").json()["digest"] == expected_digest(spp=SPP)
    assert last.job(job)["samples"] == SPP * PICTURE["width"] * PICTURE["height"]


def renders_on(service: Started, job: str) -> None:
    known = service.job(job)["samples"]
    until(lambda: service.job(job)["samples"] > known, "it renders on", 60, lambda: service.job(job))


@pytest.mark.long
def test_owner_lost_during_merge_adds_nothing(
    service: Service, redis_server: running_redis, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A service that loses the farm between the film's check and its write adds nothing.

    Both services run in one process, so that the test can choose that moment.
    """
    standby = Service.__new__(Service)
    standby.options = {**service.options, "lease_s": LEASE_S}
    standby.start()
    in_the_middle, go_on = threading.Event(), threading.Event()
    merge = Film.merge

    def held(film: Film, parts: Any) -> list[bool]:
        if threading.current_thread() is engine:
            in_the_middle.set()
            go_on.wait(60)
        return merge(film, parts)

    old, engine = service.farm.owning, service.farm.engine._thread
    monkeypatch.setattr(Film, "merge", held)
    try:
        with service.worker() as worker:
            job = service.submit(service.ready_scene(), spp=64)
            assert in_the_middle.wait(60)
            old._moves = lambda: False  # the old owner counts as hanging
            until(lambda: standby.http.get("/readyz").json().get("status") == "ready", "the other takes over", 60)
            standby.wait_for(job, "finished", 60)
            expected = standby.digest(job)
            go_on.set()
            until(lambda: "stands by" in service.http.get("/readyz").text, "the first stands by", 60)
            assert worker.batches
        assert expected == expected_digest(spp=64)
        assert standby.digest(job) == expected
        assert standby.job(job)["samples"] == 64 * 64 * 48
    finally:
        go_on.set()
        standby.stop()
