"""Tests of shots with very many frames while the service is killed during changes, or several clients make changes at once."""

from __future__ import annotations

import contextlib
import itertools
import os
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from sqlalchemy import create_engine, text

from service.locations import sqlite_url
from tests.helpers import running_redis
from tests.service.conftest import OBJ, TOKEN, until
from tests.service.peer_worker import PeerWorker
from tests.service.started import Started

FRAMES = int(os.environ.get("RAYFARM_TEST_FRAMES", "20000"))
SIZE = {"width": 16, "height": 16, "tile_size": 16}
PIXELS = 16 * 16
MOMENTS = (0.0, 0.3, 0.8)  # fractions of the work after which the service is killed
PATIENCE_S = 240.0
pytestmark = [pytest.mark.long, pytest.mark.timeout(1800)]


class DatabaseReader:
    """Reads the service's database through its own connection, without the service."""

    def __init__(self, data: Path, url: str) -> None:
        self._engine = create_engine(url or sqlite_url(data / "rayfarm.sqlite"))

    def close(self) -> None:
        self._engine.dispose()

    def all(self, query: str, **values: Any) -> list[Any]:
        with self._engine.connect() as connection:
            return list(connection.execute(text(query), values))

    def one(self, query: str, **values: Any) -> Any:
        found = self.all(query, **values)
        return found[0][0] if found else None

    def frames(self, job: str) -> int:
        return int(self.one("SELECT count(*) FROM frames WHERE job = :job", job=job))

    def targets(self, job: str) -> dict[int, int]:
        """Returns the number of frames of a job for each target in samples per pixel."""
        rows = self.all("SELECT target, count(*) FROM frames WHERE job = :job GROUP BY target", job=job)
        return {target // PIXELS: count for target, count in rows}

    def is_at_rest(self) -> bool:
        return self.one("SELECT count(*) FROM frame_changes") == 0


class KillableService:
    """A service that tests can kill and restart."""

    def __init__(self, data: Path, redis_url: str, database: str) -> None:
        self._arguments = data, redis_url, database
        self.database_reader: DatabaseReader
        self.start()
        self.database_reader = DatabaseReader(data, database)

    def start(self) -> None:
        data, redis_url, database = self._arguments
        self.service = Started(data, "one", redis_url=redis_url, database_url=database)
        self.service.http.timeout = httpx.Timeout(PATIENCE_S)
        until(self.service.is_ready, "the service is ready", PATIENCE_S, lambda: self.service.log.read_text()[-2000:])

    def scene(self) -> str:
        http = self.service.http
        with PeerWorker(self._arguments[1], self.service.url, TOKEN):
            scene = http.post("/api/scenes", files={"files": ("scene.obj", OBJ)}).raise_for_status().json()["id"]
            until(lambda: http.get(f"/api/scenes/{scene}").json()["status"] == "ready", "the scene is prepared", PATIENCE_S)
        return str(scene)

    def shoot(self, scene: str, key: str = "", spp: int = 4) -> httpx.Response:
        body = {"scene": scene, "frames": f"0-{FRAMES - 1}", "spp": spp, **SIZE}
        return self.service.http.post("/api/jobs", json=body, headers={"Idempotency-Key": key} if key else {})

    def killed_during(self, request: Callable[[], Any], is_time: Callable[[], bool]) -> bool:
        """Kills the service during a request as soon as `is_time` returns True, and restarts it.

        Returns True if the request had no response yet when the service was killed.
        """
        answered: list[int] = []

        def ask() -> None:
            with contextlib.suppress(httpx.HTTPError):
                answered.append(request().status_code)

        asking = threading.Thread(target=ask)
        asking.start()
        until(lambda: bool(answered) or is_time(), "its moment comes", PATIENCE_S, rarely=0.005)
        in_the_midst = not answered
        self.service.process.kill()
        asking.join()
        self.service.end()
        self.start()
        return in_the_midst

    def wait_until_idle(self, job: str) -> dict[str, Any]:
        """Waits until all changes of a job are carried out and the engine has loaded it. Returns the job's description."""
        until(self.database_reader.is_at_rest, "what was accepted is done", PATIENCE_S)
        until(lambda: self.told(job)["count"] == self.database_reader.frames(job), "it is taken up", PATIENCE_S)
        return self.told(job)

    def told(self, job: str) -> dict[str, Any]:
        shot: dict[str, Any] = self.service.http.get(f"/api/jobs/{job}").raise_for_status().json()["shot"]
        return shot


@pytest.fixture
def killable(tmp_path: Path, redis_server: running_redis, database: str) -> Iterator[KillableService]:
    farm = KillableService(tmp_path / "data", redis_server.url, database)
    yield farm
    farm.service.end()
    farm.database_reader.close()


def test_accepted_change_is_completed_after_kill(killable: KillableService) -> None:
    farm = killable
    scene, database_reader = farm.scene(), farm.database_reader
    in_the_midst = 0

    def done(job: str | None, share: float) -> bool:
        """Returns whether a change of a job (None: of any job) has been carried out for at least this share of all frames."""
        row = database_reader.all("SELECT job, done FROM frame_changes")
        return any((job is None or id == job) and count >= share * FRAMES for id, count in row)

    jobs = []
    for number, share in enumerate(MOMENTS):
        key = f"shot {number}"
        in_the_midst += farm.killed_during(lambda key=key: farm.shoot(scene, key), lambda share=share: done(None, share))
        jobs.append(farm.shoot(scene, key).raise_for_status().json()["id"])
        assert farm.wait_until_idle(jobs[-1])["states"] == {"queued": FRAMES}
        assert database_reader.targets(jobs[-1]) == {4: FRAMES}
        assert database_reader.one("SELECT count(*) FROM jobs") == number + 1, "a request that is repeated makes no other job"
    job = jobs[0]
    for number, share in enumerate(MOMENTS):
        spp = 8 + number
        url = f"/api/jobs/{job}"
        before = database_reader.targets(job)
        in_the_midst += farm.killed_during(
            lambda url=url, spp=spp: farm.service.http.patch(url, json={"spp": spp, "extend": f"{FRAMES + spp}"}),
            lambda share=share: done(job, share),
        )
        farm.wait_until_idle(job)
        targets = database_reader.targets(job)
        assert targets == {spp: sum(before.values()) + 1}, "all of it is done, or none"
    for share, gone in zip(MOMENTS, jobs, strict=True):
        left = (1 - share) * database_reader.frames(gone)

        def is_time(gone: str = gone, left: float = left) -> bool:
            return (
                database_reader.one("SELECT count(*) FROM frame_changes WHERE job = :job", job=gone) > 0
                and database_reader.frames(gone) <= left
            )

        in_the_midst += farm.killed_during(lambda gone=gone: farm.service.http.delete(f"/api/jobs/{gone}"), is_time)
        until(
            lambda gone=gone: database_reader.one("SELECT count(*) FROM jobs WHERE id = :job", job=gone) == 0,
            "it is gone",
            PATIENCE_S,
        )
        assert database_reader.frames(gone) == 0
        assert database_reader.is_at_rest()
        assert farm.service.http.get(f"/api/jobs/{gone}").status_code == 404
    assert in_the_midst >= 6, "most of the nine kills came while the request was under way"


def test_concurrent_clients_keep_shots_consistent(killable: KillableService) -> None:
    """Checks that concurrent changes by several clients leave both shots in a consistent state.

    The clients add samples, render frames again, set priorities, cancel, resume and delete.
    """
    farm = killable
    scene, database_reader = farm.scene(), farm.database_reader
    kept, gone = (farm.shoot(scene).raise_for_status().json()["id"] for _ in range(2))
    counter = itertools.count(5)
    deleted = threading.Event()
    answers: list[tuple[str, int]] = []

    def is_deleted(http: httpx.Client) -> bool:
        """Requests a deletion; returns whether it was accepted.

        If other clients' changes hold the rows, the service may ask for a retry.
        """
        status = http.delete(f"/api/jobs/{gone}").status_code
        answers.append(("delete", status))
        return status != 503

    def client(number: int) -> None:
        with httpx.Client(base_url=farm.service.url, timeout=PATIENCE_S) as http:
            for turn in range(6):
                changes: list[dict[str, Any]] = [
                    {"spp": next(counter)},
                    {"again": f"0-{FRAMES // 2}"},
                    {"priority": turn},
                    {"state": "cancelled"},
                    {"state": "running"},
                    {"more": 1, "frames": f"0-{FRAMES // 4}"},
                ]
                change = changes[(turn + number) % len(changes)]
                for job in (kept, gone):
                    answers.append((str(change), http.patch(f"/api/jobs/{job}", json=change).status_code))
                if number == 0 and turn == 2:
                    until(lambda: is_deleted(http), "the deletion is accepted", PATIENCE_S)
                    deleted.set()

    with ThreadPoolExecutor(4) as clients:
        list(clients.map(client, range(4)))
    assert deleted.is_set()
    assert {status for _, status in answers} <= {200, 204, 404, 409, 503}, answers
    assert sum(status == 200 for _, status in answers) >= 12, answers
    http = farm.service.http
    until(database_reader.is_at_rest, "what was accepted is done", PATIENCE_S)
    until(
        lambda: database_reader.one("SELECT count(*) FROM jobs WHERE id = :job", job=gone) == 0,
        "it is gone",
        PATIENCE_S,
        lambda: answers,
    )
    assert database_reader.frames(gone) == 0
    final = 1000
    http.patch(f"/api/jobs/{kept}", json={"spp": final, "state": "running"}).raise_for_status()
    assert farm.wait_until_idle(kept)["states"] == {"queued": FRAMES}
    assert database_reader.targets(kept) == {final: FRAMES}
    assert farm.service.process.poll() is None


def test_highest_priority_shot_is_rendered_first(killable: KillableService, redis_server: running_redis) -> None:
    farm = killable
    scene = farm.scene()
    shots = [farm.shoot(scene, spp=1).raise_for_status().json()["id"] for _ in range(3)]
    for shot in shots:
        farm.wait_until_idle(shot)
    rendered: list[str] = []
    with rendering(farm, redis_server, rendered):
        until(lambda: len(rendered) > 20, "they are rendered", 60)
        for shot in reversed(shots):
            begun = time.monotonic()
            farm.service.http.patch(f"/api/jobs/{shot}", json={"priority": len(shots) - shots.index(shot)}).raise_for_status()
            until(lambda shot=shot: set(rendered[-20:]) == {shot}, "it has all slots", 60, lambda: rendered[-20:])
            assert time.monotonic() - begun < 20


@contextmanager
def rendering(killable: KillableService, redis_server: running_redis, rendered: list[str]) -> Iterator[None]:
    with PeerWorker(redis_server.url, killable.service.url, TOKEN) as worker:
        worker.on_batch = lambda batch: rendered.append(batch.job)
        yield
