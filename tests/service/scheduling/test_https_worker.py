"""Tests of a real worker process that reaches only the service, which has a real Redis: its digests, and its sudden end."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import psutil
import pytest

from renderer.film import digest
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.load import read
from renderer.settings import RenderSettings, View
from tests.helpers import ROOT, running_redis
from tests.service.conftest import TOKEN, Service, until
from tests.service.started import Started

pytestmark = pytest.mark.long

VIEW = View((0, 0, 3.9), (0, 0, 0), (0, 1, 0), 39.3077)
SIZE, SPP, DEPTH = (80, 64), 256, 5


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, redis_server: running_redis) -> Iterator[Service]:
    service = Service(tmp_path_factory.mktemp("https") / "data", redis_server)
    yield service
    service.stop()


@pytest.fixture(scope="module")
def expected() -> str:
    scene = compile_scene(read(ROOT / "scenes", "cornell-box.yaml"))
    return digest(render_frame(scene, RenderSettings(*SIZE, VIEW, max_depth=DEPTH), SPP, threads=2))


def worker_token(service: Service) -> str:
    owner = {"Authorization": f"Bearer {(service.options['data'] / 'owner-token').read_text().strip()}"}
    made = service.http.post("/api/tokens", json={"name": "home", "role": "worker"}, headers=owner).raise_for_status()
    return str(made.json()["secret"])


@contextmanager
def https_worker(url: str, token: str, folder: Path, name: str, slots: int = 2) -> Iterator[subprocess.Popen[bytes]]:
    """Starts a worker that has no address of Redis; kills it at the end."""
    environment = {key: value for key, value in os.environ.items() if "REDIS" not in key} | {"RAYFARM_TOKEN": token}
    command = [sys.executable, "-m", "worker", "--service", url, "--transport", "https", "--slots", str(slots), "--name", name]
    with (folder / f"{name}.log").open("wb") as log:
        worker = subprocess.Popen(
            [*command, "--cache", str(folder / name)], cwd=ROOT, env=environment, stdout=log, stderr=subprocess.STDOUT
        )
    try:
        yield worker
    finally:
        worker.kill()
        worker.wait()


def submit(http: httpx.Client) -> str:
    scene = (ROOT / "scenes" / "cornell-box.yaml").read_bytes()
    uploaded = http.post("/api/scenes", files={"files": ("cornell-box.yaml", scene)}).raise_for_status().json()["id"]
    until(lambda: http.get(f"/api/scenes/{uploaded}").json()["status"] == "ready", "the scene is prepared", 120)
    view = {"eye": VIEW.eye, "target": VIEW.target, "up": VIEW.up, "fov": VIEW.fov}
    request = {"scene": uploaded, "view": view, "width": SIZE[0], "height": SIZE[1], "spp": SPP, "max_depth": DEPTH}
    return str(http.post("/api/jobs", json=request).raise_for_status().json()["id"])


def finish(http: httpx.Client, job: str) -> str:
    until(lambda: http.get(f"/api/jobs/{job}").json()["state"] == "finished", "the job is finished", 120)
    return str(http.get(f"/api/jobs/{job}/frames/0/digest").json()["digest"])


def slots_of(worker: subprocess.Popen[bytes]) -> list[psutil.Process]:
    return [each for each in psutil.Process(worker.pid).children() if each.cmdline()[1:3] == ["-m", "worker"]]


def test_worker_renders_without_a_connection_to_redis(service: Service, expected: str, tmp_path: Path) -> None:
    with https_worker(service.url, worker_token(service), tmp_path, "home") as worker:
        job = submit(service.http)
        until(lambda: service.job(job)["samples"] > 0, "the job is under way", 60)
        processes = [psutil.Process(worker.pid), *psutil.Process(worker.pid).children(recursive=True)]
        ports = {each.raddr.port for process in processes for each in process.net_connections() if each.raddr}
        assert service.port in ports
        assert int(service.options["redis_url"].rpartition(":")[2].partition("/")[0]) not in ports
        assert finish(service.http, job) == expected


def test_killed_slots_and_workers_leave_the_digest_as_it_is(service: Service, expected: str, tmp_path: Path) -> None:
    token = worker_token(service)
    with https_worker(service.url, token, tmp_path, "one") as worker:
        job = submit(service.http)
        until(lambda: service.job(job)["progress"] > 0.1, "the job is under way", 60)
        max(slots_of(worker), key=lambda slot: sum(slot.cpu_times()[:2])).kill()
        until(lambda: service.job(job)["progress"] > 0.3, "it goes on", 60)
        worker.kill()
        with https_worker(service.url, token, tmp_path, "other"):
            assert finish(service.http, job) == expected


@pytest.fixture
def two_services(tmp_path: Path) -> Iterator[tuple[Started, Started]]:
    """Yields (owner, standby) with a Redis of their own, since the other tests' service reads from that of the module."""
    (tmp_path / "redis").mkdir()
    with running_redis(tmp_path / "redis") as redis_url:
        both = [Started(tmp_path / "data", name, redis_url=redis_url) for name in ("one", "two")]

        def logs() -> str:
            return "\n".join(each.log.read_text()[-2000:] for each in both)

        try:
            until(lambda: sorted(each.says() for each in both) == ["ready", "stands by"], "both are there", 90, logs)
            owner, standby = sorted(both, key=Started.says)
            yield owner, standby
        finally:
            for each in both:
                each.end()


def test_worker_behind_a_standby_survives_the_end_of_the_owner(
    tmp_path: Path, two_services: tuple[Started, Started], expected: str
) -> None:
    owner, standby = two_services
    with https_worker(standby.url, TOKEN, tmp_path, "behind", 1):
        job = submit(standby.http)
        until(lambda: standby.job(job)["samples"] > 0, "the job is under way", 60)
        owner.process.kill()
        until(lambda: standby.is_ready(), "the standby takes over", 60)
        assert finish(standby.http, job) == expected
