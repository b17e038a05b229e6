"""Test of four users with quotas who create, change and delete shots, while workers start, stop and change their settings.

The service is restarted meanwhile. At the end every picture has its expected samples.
"""

from __future__ import annotations

import contextlib
import random
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from service.access.roles import Role
from tests.helpers import running_redis
from tests.service.api.test_access import caller
from tests.service.conftest import OBJ, Service, until
from tests.service.peer_worker import PeerWorker, expected_digest

SIZE = {"width": 32, "height": 24, "tile_size": 16}
PIXELS = 32 * 24
PEOPLE = ("anna", "ben", "cleo", "dan")
ACTS_S = 12.0
ENDS_S = 180.0
LOOKED_AT = 8  # frames compared per shot
FRAMES = ("0-5", "0-29", "1-9x2", "0,3,7.5", "0-99")
CHANGES: tuple[dict[str, Any], ...] = (
    *({"state": state} for state in ("paused", "running", "cancelled")),
    *({"more": 1}, {"more": 3}, {"spp": 8}, {"frames": "0-3", "more": 2}, {"extend": "200-205"}, {"again": "0-2"}),
    *({"priority": 5}, {"priority": -5}, {"first": 3}, {"order": "every-nth"}, {"after": []}, {"needs": []}, {"pinned": True}),
    *({"max_slots": 1}, {"max_slots": None}),
)
TERMS: tuple[dict[str, Any], ...] = (
    *({"state": "paused"}, {"state": "running"}, {"slots": 1}, {"slots": None}),
    *({"hours": "Mon 00:00-00:01"}, {"hours": None}),
)
EXPECTED = {200, 201, 204, 304, 404, 409, 422, 429, 503}  # statuses of conflicts between users, none of them a bug


class Crowd:
    """The clients and workers of the test, the number of responses by status, and the faults found."""

    def __init__(self, service: Service, chief: httpx.Client, scene: str) -> None:
        self.service = service
        self.chief = chief
        self.scene = scene
        self.answers: Counter[int] = Counter()
        self.faults: list[str] = []
        self.workers: list[PeerWorker] = []
        self.over = threading.Event()
        self._made = 0

    def start_worker(self) -> None:
        """Starts another worker, which sometimes loses a batch. Every second worker has the tag `gpu`."""
        draw = random.Random(self._made)
        options = self.service.options
        worker = PeerWorker(
            *(options["redis_url"], self.service.url, options["token"]),
            name=f"w{self._made}",
            slots=draw.choice([1, 2, 4]),
            tags=("gpu",) if self._made % 2 else (),
        )
        worker.on_batch = lambda batch: (time.sleep(0.02 * draw.random()), draw.random() > 0.02)[1]
        self.workers.append(worker.__enter__())
        self._made += 1

    def send(self, http: httpx.Client, method: str, path: str, **more: Any) -> httpx.Response | None:
        """Sends a request and counts the response by its status. Returns None if the service is restarting."""
        http.base_url = httpx.URL(self.service.url)
        try:
            answer = http.request(method, path, **more)
        except httpx.HTTPError:
            time.sleep(0.2)
            return None
        self.answers[answer.status_code] += 1
        if answer.status_code not in EXPECTED:
            self.faults.append(f"{method} {path} {more}: {answer.status_code} {answer.text[:200]}")
        return answer

    def act_as_user(self, secret: str, seed: int) -> None:
        """Acts as one user, who creates, changes, views and deletes jobs until the test ends.

        secret: the user's token. seed: of the random actions.
        """
        draw, mine = random.Random(seed), list[str]()
        with caller(self.service, secret) as http:
            while not self.over.is_set():
                deed = draw.random()
                job = draw.choice(mine) if mine else ""
                if deed < 0.3 or not job:
                    wish: dict[str, Any] = {"scene": self.scene, "spp": draw.choice([1, 4, 16]), "fresh": True, **SIZE}
                    rare = {"frames": draw.choice(FRAMES), "after": mine[-1:], "needs": ["gpu"], "verify": 0.5, "max_slots": 1}
                    wish |= {name: value for name, value in rare.items() if draw.random() < (0.7 if name == "frames" else 0.15)}
                    answer = self.send(http, "POST", "/api/jobs", json=wish)
                    if answer is not None and answer.status_code == 201:
                        mine.append(answer.json()["id"])
                    elif answer is not None and answer.status_code == 429 and job:
                        self.send(http, "PATCH", f"/api/jobs/{job}", json={"state": "cancelled"})
                elif deed < 0.75:
                    self.send(http, "PATCH", f"/api/jobs/{job}", json=draw.choice(CHANGES))
                elif deed < 0.85:
                    mine.remove(job)
                    self.send(http, "DELETE", f"/api/jobs/{job}")
                else:
                    for path in (f"/{job}", f"/{job}/frames", f"/{job}/frames/0/image.png", ""):
                        self.send(http, "GET", f"/api/jobs{path}")
                time.sleep(0.1 * draw.random())

    def act_as_administrator(self, seed: int) -> None:
        """Acts as the administrator, who changes quotas and workers' settings, and starts and stops workers."""
        draw = random.Random(seed)
        while not self.over.is_set():
            deed, who = draw.random(), draw.choice(PEOPLE)
            if deed < 0.15 and len(self.workers) < 4:
                self.start_worker()
            elif deed < 0.25 and len(self.workers) > 1:
                self.workers.pop(draw.randrange(len(self.workers))).__exit__(None, None, None)
            elif deed < 0.5:
                self.send(self.chief, "PATCH", f"/api/workers/{draw.choice(self.workers).name}", json=draw.choice(TERMS))
            elif deed < 0.7:
                limits = draw.choice([{"jobs": 3}, {"jobs": 40}, {"samples_day": 3_000_000}])
                self.send(self.chief, "PUT", f"/api/quotas/users/{who}", json=limits)
            else:
                share = {"weight": draw.choice([1, 5]), "max_slots": draw.choice([None, 1, 2])}
                self.send(self.chief, "PUT", f"/api/shares/user:{who}", json=share)
            time.sleep(0.15)


@pytest.fixture
def crowd(tmp_path: Path, redis_server: running_redis, database: str) -> Iterator[Crowd]:
    service = Service(tmp_path / "data", redis_server, host="0.0.0.0", quota_jobs=12, database_url=database)
    with contextlib.ExitStack() as leaving:
        leaving.callback(service.stop)
        secret = (tmp_path / "data" / "owner-token").read_text().strip()
        chief = leaving.enter_context(caller(service, secret))
        scene = chief.post("/api/scenes", files={"files": ("a.obj", OBJ)}).raise_for_status().json()["id"]
        crowd = Crowd(service, chief, scene)
        leaving.callback(lambda: [worker.__exit__(None, None, None) for worker in crowd.workers])
        crowd.start_worker()
        until(lambda: chief.get(f"/api/scenes/{scene}").json()["status"] == "ready", "the scene is prepared")
        yield crowd


@pytest.mark.long
def test_concurrent_users_get_correct_pictures(crowd: Crowd) -> None:
    service, access = crowd.service, crowd.service.farm.access
    acting = [threading.Thread(target=crowd.act_as_administrator, args=[0])]
    for number, name in enumerate(PEOPLE, 1):
        access.users.add(name, Role.SUBMIT, None)
        secret = access.keys.create("token", name, Role.SUBMIT, "test")[0]
        acting.append(threading.Thread(target=crowd.act_as_user, args=[secret, number]))
    for thread in acting:
        thread.start()
    for _ in range(2):
        crowd.over.wait(ACTS_S / 2)
        service.restart()
        for worker in crowd.workers:
            worker.http.base_url = service.url
    crowd.over.wait(ACTS_S / 2)
    crowd.over.set()
    for thread in acting:
        thread.join(60)
    assert not crowd.faults
    assert min(crowd.answers[code] for code in (200, 201, 204, 429)) > 0, "quotas, too, had a say"
    _let_all_end(crowd)
    looked_at = sum(_compare_frames(crowd, job) for job in _jobs(crowd) if job["state"] == "finished")
    assert looked_at > 20


def _jobs(crowd: Crowd) -> list[dict[str, Any]]:
    crowd.chief.base_url = httpx.URL(crowd.service.url)
    jobs: list[dict[str, Any]] = crowd.chief.get("/api/jobs", params={"limit": 1000}).raise_for_status().json()
    return jobs


def _let_all_end(crowd: Crowd) -> None:
    """Removes all limits and pauses, so that the jobs can finish."""
    while len(crowd.workers) < 3:
        crowd.start_worker()
    jobs = _jobs(crowd)
    for name in PEOPLE:
        crowd.chief.put(f"/api/quotas/users/{name}", json={"jobs": 1000}).raise_for_status()
        crowd.chief.put(f"/api/shares/user:{name}", json={"weight": 1}).raise_for_status()
    for worker in crowd.workers:
        worker.on_batch = lambda batch: None
        freed = {"state": "running", "hours": None, "slots": None}
        until(
            lambda name=worker.name, freed=freed: crowd.chief.patch(f"/api/workers/{name}", json=freed).is_success,  # type: ignore[misc]
            f"{worker.name} is known",
        )
    for job in jobs:
        changes: list[dict[str, Any]] = [{"needs": [], "max_slots": None}]
        changes += [{"state": "running"}] if job["state"] == "paused" else []
        for change in changes if job["state"] not in ("finished", "failed", "cancelled") else []:
            crowd.chief.patch(f"/api/jobs/{job['id']}", json=change)

    def left() -> list[Any]:
        return [
            (job["id"], job["state"], job["message"]) for job in _jobs(crowd) if job["state"] in ("queued", "running", "paused")
        ]

    until(lambda: not left(), "every job has ended", ENDS_S, left, rarely=1.0)
    assert all(
        "before it was finished. Set this job to running to render it anyway" in job["error"]
        for job in _jobs(crowd)
        if job["state"] == "failed"
    )


def _compare_frames(crowd: Crowd, job: dict[str, Any]) -> int:
    """Checks that some frames of a job are finished and have the expected samples. Returns the number of checked frames."""
    path = f"/api/jobs/{job['id']}/frames"
    frames = crowd.chief.get(path).raise_for_status().json()
    some = random.Random(1).sample(frames, min(len(frames), LOOKED_AT))
    for frame in some:
        number = frame["number"]
        found = crowd.chief.get(f"{path}/{number}/digest").raise_for_status().json()
        seed = round(2000 * number) if job["shot"] is not None else 0
        spp, rest = divmod(found["samples"], PIXELS)
        assert (frame["state"], rest, found["digest"]) == ("finished", 0, expected_digest(32, 24, spp, seed)), (job["id"], frame)
    return len(some)
