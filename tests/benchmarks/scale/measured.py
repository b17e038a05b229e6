"""Measures a service under the load of simulated slots: its cost, and whether its film has exactly the sent sums."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import re
import secrets
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import psutil
import redis

from protocol.contract import RESULTS, WORKER_KEYS
from protocol.site import site_key
from rayfarm.local.farm import free_port
from renderer.child_processes import spawn_guard
from renderer.film import Sums
from service.store.films import Film
from service.store.tile_cache import TileCache
from tests.benchmarks.scale.processors import Processors, Share, family_s, tree, written_bytes
from tests.helpers import ROOT, running_redis, wait_until
from tests.reducer import ReducerProcess

__all__ = ["FULL_BATCH_S", "Load", "Served", "Taken", "run"]

OBJ = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
EXPONENT = 24
SETTLES_S = 150.0
SITE_NAME = "simulated"
IDLE_S = 15.0
FULL_BATCH_S = 10.0  # duration to which the batches of a large farm grow (RAYFARM_BATCH_SECONDS_MOST)
MANY = 1 << 20  # more samples than any run renders


@dataclass(frozen=True)
class Load:
    """The load of a measurement: slots, tile and frame size, viewers, and requests for pictures."""

    slots: int
    tile: int = 128
    width: int = 1920
    height: int = 1024
    sample_s: float = 1 / 16  # time of a sample of a 128 x 128 tile on one slot
    seconds: float = 30.0
    warm_s: float = 8.0
    watchers: int = 0
    pictures: int = 0  # clients that repeatedly request pictures
    alone: bool = False  # slots send their own sums instead of a machine's
    per_worker: int = 32  # slots per machine
    site: bool = False  # machines share a site with a reducer
    simulators: int = 1  # processes that simulate the slots
    batches: int = 0  # measure until that many are merged, all of FULL_BATCH_S, and the idle service before; 0: by time


@dataclass
class Taken:
    """The measurements of one table row; rates are per second of wall time."""

    seconds: float = 0.0
    merged: int = 0
    results: int = 0  # each of one or more batches
    result_bytes: int = 0  # size of their sums
    lost: int = 0
    dropped: int = 0
    samples: int = 0  # tile samples in the film at the end
    sample_rate: float = 0.0  # tile samples per second
    service_s: float = 0.0  # processor time
    redis_s: float = 0.0
    stream: list[int] = field(default_factory=list)
    redis_bytes: list[int] = field(default_factory=list)
    service_bytes: list[int] = field(default_factory=list)
    health_s: list[float] = field(default_factory=list)
    own_health_s: list[float] = field(default_factory=list)  # latency at the separate health port
    is_exact: bool = False
    unread: int = 0  # unread results at the end
    in_all: dict[str, int] = field(default_factory=dict)  # the service's counters over its whole run
    repeated: int = 0  # tile samples that were rendered twice or are in no film
    rounds_s: list[float] = field(default_factory=list)  # intervals between rounds of a watcher
    packets: int = 0  # received by all watchers
    pictures: Counter[int] = field(default_factory=Counter)  # number of answers by status
    unfed_s: float = 0.0  # slot time without work
    held_up_s: float = 0.0  # slot time spent waiting for the simulator
    shares: dict[str, Share] = field(default_factory=dict)  # processor time by process
    postgres_s: float = 0.0  # processor time of all processes of PostgreSQL, for all cells
    written: dict[str, int] = field(default_factory=dict)  # bytes written to disk, by process
    idle: dict[str, float] = field(default_factory=dict)  # cores that are used without a job, by process


class Served:
    """A Redis server and a service that run in a folder for one measurement."""

    def __init__(self, folder: Path, **environment: str) -> None:
        self.folder = folder
        self.redis = running_redis(folder)
        self.token = secrets.token_hex(8)
        self.port = free_port("127.0.0.1")
        self.health_port = free_port("127.0.0.1")
        self.url = f"http://127.0.0.1:{self.port}"
        self._more = environment

    def __enter__(self) -> Served:
        self.redis.start()
        self.store = redis.Redis.from_url(self.redis.url)
        told = {
            "DATA": str(self.folder / "data"),
            "REDIS_URL": self.redis.url,
            "TOKEN": self.token,
            "PORT": str(self.port),
            "HEALTH_PORT": str(self.health_port),
            "REUSE_FILMS": "false",
        }
        environment = os.environ | {f"RAYFARM_{name}": value for name, value in told.items()} | self._more
        uvicorn = [sys.executable, "-m", "service", "--no-access-log"]
        uvicorn += ["--port", str(self.port), "--timeout-graceful-shutdown", "2", "--ws-per-message-deflate", "false"]
        with (self.folder / "service.log").open("ab") as log:
            self.process = subprocess.Popen(uvicorn, cwd=ROOT, env=environment, stdout=log, stderr=log, preexec_fn=spawn_guard())
        self.http = httpx.Client(base_url=self.url, timeout=30)
        wait_until(self._answers, 60, "the service answers")
        self.service = psutil.Process(self.process.pid)
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
        self.redis.stop()

    def stop(self) -> None:
        """Ends the service."""
        if self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(30)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()

    def _answers(self) -> bool:
        with contextlib.suppress(httpx.HTTPError):
            return self.http.get("/healthz").is_success
        return False

    def scene(self) -> str:
        """Uploads the test scene, and returns its id.

        Each slot prepares the scene when it starts.
        """
        return str(self.http.post("/api/scenes", files={"files": ("scene.obj", OBJ)}).raise_for_status().json()["id"])

    def job(self, scene: str, load: Load, spp: int = MANY) -> str:
        """Submits a job of that scene and returns its id."""
        request = {"scene": scene, "width": load.width, "height": load.height, "spp": spp, "tile_size": load.tile}
        return str(self.http.post("/api/jobs", json=request).raise_for_status().json()["id"])

    def counts(self) -> dict[str, int]:
        """Returns the service's counters of batches by name."""
        text = self.http.get("/metrics").raise_for_status().text
        found = re.findall(r"^rayfarm_(?:batches_)?(\w+?)(?:_total)? ([\d.e+]+)$", text, re.M)
        return {name: int(float(value)) for name, value in found}

    def samples(self, job: str) -> int:
        """Returns the number of samples that a job has so far, summed over all pixels."""
        return int(self.http.get(f"/api/jobs/{job}").raise_for_status().json()["samples"])

    def processor_s(self) -> tuple[float, float]:
        """Returns the processor seconds of the service, and of Redis."""
        assert self.redis.process is not None
        service, store = self.service.cpu_times(), psutil.Process(self.redis.process.pid).cpu_times()
        return service.user + service.system, store.user + store.system

    def film(self, job: str, load: Load) -> Film:
        """Opens a job's film, after the service has ended."""
        path = self.folder / "data" / "films" / f"{job}.sqlite"
        return Film(path, load.width, load.height, load.tile, EXPONENT, TileCache(1 << 20))


@contextlib.contextmanager
def slots_of(served: Served, load: Load, sums: Path) -> Iterator[list[subprocess.Popen[str]]]:
    """Runs the processes of simulated slots during the `with` block."""
    sample_s = load.sample_s * (load.tile / 128) ** 2
    machines = -(-load.slots // load.per_worker)
    ends = [min(load.slots, machines * i // load.simulators * load.per_worker) for i in range(load.simulators + 1)]
    with contextlib.ExitStack() as running:
        processes = []
        for number, (begin, end) in enumerate(itertools.pairwise(ends)):
            command = ["nice", sys.executable, "-m", "tests.benchmarks.scale.slots", f"--redis={served.redis.url}"]
            command += [f"--service={served.url}", f"--token={served.token}", f"--sums={sums}", f"--slots={end - begin}"]
            command += [f"--tile-sample-s={sample_s}", f"--per-worker={load.per_worker}", *["--alone"] * load.alone]
            command += [*[f"--site={SITE_NAME}"] * load.site, f"--name=machine-{number}"]
            processes.append(subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, preexec_fn=spawn_guard()))
            running.callback(_ended, processes[-1])
        yield processes


def _ended(process: subprocess.Popen[str]) -> None:
    if process.poll() is None:
        process.kill()
    process.wait()


@contextlib.contextmanager
def reducer_of(served: Served, load: Load) -> Iterator[None]:
    """Runs the site's reducer during the `with` block, if the load has one."""
    if not load.site:
        yield
        return
    reducing = ReducerProcess(served.store, served.url, served.token, served.folder, SITE_NAME)
    try:
        yield
    finally:
        reducing.stop()


def run(load: Load, sums: Sums, folder: Path, postgres: int | None = None, **environment: str) -> Taken:
    """Measures one table row: slots render an endless job for a while, and the job's film is compared with the sent sums.

    postgres: process id of the PostgreSQL server, if the service uses one.
    """
    if load.batches:
        environment |= dict.fromkeys(("RAYFARM_BATCH_SECONDS", "RAYFARM_BATCH_SECONDS_MOST"), str(FULL_BATCH_S))
    kept = folder / "sums.npy"
    np.save(kept, sums[:, : load.tile, : load.tile])
    taken = Taken()
    with (
        Served(folder, **environment) as served,
        reducer_of(served, load),
        slots_of(served, load, kept) as slots,
    ):
        assert served.redis.process is not None
        simulators = {f"slots {number}": process.pid for number, process in enumerate(slots)}
        scene = served.scene()
        if load.batches:
            taken.idle = _idle_costs(served, postgres)
        job = served.job(scene, load)
        wait_until(lambda: served.counts().get("merged", 0) > 0, 180, "a batch is merged")
        watching = _watching(served, job, load)
        time.sleep(load.warm_s)
        at_first = served.samples(job)
        before, begun, (service_s, redis_s) = served.counts(), time.monotonic(), served.processor_s()
        servers = {"service": served.process.pid, "Redis": served.redis.process.pid}
        processors, written = Processors(servers | simulators), {name: written_bytes([pid]) for name, pid in servers.items()}
        of_postgres = tree(postgres)
        postgres_s, written["PostgreSQL"] = family_s(of_postgres), written_bytes(of_postgres)
        with _pictures(served, job, load.pictures, taken.pictures):
            while time.monotonic() - begun < load.seconds or _merged(served) - before["merged"] < load.batches:
                _look(served, taken)
                time.sleep(0.5)
        after, ended = served.counts(), served.processor_s()
        taken.seconds = time.monotonic() - begun
        taken.service_s, taken.redis_s = ended[0] - service_s, ended[1] - redis_s
        taken.shares = processors.shares()
        taken.postgres_s = family_s(tree(postgres)) - postgres_s
        taken.written = {name: written_bytes([pid]) - written[name] for name, pid in servers.items()}
        taken.written["PostgreSQL"] = written_bytes(of_postgres) - written["PostgreSQL"]
        of_job = served.samples(job)
        for name in ("merged", "results", "result_bytes", "lost", "dropped"):
            setattr(taken, name, after[name] - before[name])
        if watching is not None:
            seen = json.loads(watching.communicate(timeout=60)[0].splitlines()[-1])
            taken.rounds_s, taken.packets = seen["rounds_s"], seen["packets"]
        served.http.patch(f"/api/jobs/{job}", json={"state": "paused"}).raise_for_status()
        time.sleep(2.0)  # until all workers have reported after the pause
        said = _wait_until_merged(served, slots, taken, (begun, begun + taken.seconds))
        taken.in_all = served.counts()
        served.stop()
        film = served.film(job, load)
        has = _covered(film)
        taken.samples = sum(has)
        taken.sample_rate = (of_job - at_first) / load.tile**2 / taken.seconds
        taken.repeated = said["samples"] - taken.samples
        taken.unread = said["unread"]
        taken.is_exact = _is_exact(film, np.load(kept), has)
        film.close()
    return taken


def _merged(served: Served) -> int:
    return served.counts()["merged"]


def _idle_costs(served: Served, postgres: int | None) -> dict[str, float]:
    """Returns how many cores each server uses while workers report and there is no job.

    `engine` is the busiest thread of the service.
    """
    assert served.redis.process is not None
    time.sleep(3.0)  # until the workers are known
    processors = Processors({"service": served.process.pid, "Redis": served.redis.process.pid})
    begun, postgres_s = time.monotonic(), family_s(tree(postgres))
    time.sleep(IDLE_S)
    shares, seconds = processors.shares(), time.monotonic() - begun
    cores = {name: share.used for name, share in shares.items()}
    return {**cores, "engine": shares["service"].thread_used, "PostgreSQL": (family_s(tree(postgres)) - postgres_s) / seconds}


def _look(served: Served, taken: Taken) -> None:
    begun = time.perf_counter()
    served.http.get("/healthz").raise_for_status()
    taken.health_s.append(time.perf_counter() - begun)
    begun = time.perf_counter()
    asking = HTTPConnection("127.0.0.1", served.health_port, timeout=30)
    asking.request("GET", "/healthz")
    assert asking.getresponse().status == 200
    asking.close()
    taken.own_health_s.append(time.perf_counter() - begun)
    taken.stream.append(int(served.store.xlen(RESULTS)))
    about: Any = served.store.info("memory")
    taken.redis_bytes.append(int(about["used_memory"]))
    taken.service_bytes.append(served.service.memory_info().rss)


def _watching(served: Served, job: str, load: Load) -> subprocess.Popen[str] | None:
    if not load.watchers:
        return None
    command = ["nice", sys.executable, "-m", "tests.benchmarks.scale.watchers", f"--warm={load.warm_s}"]
    command += [f"--url=ws://127.0.0.1:{served.port}/api/jobs/{job}/live", f"--watchers={load.watchers}"]
    command += [f"--seconds={load.seconds}"]
    return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, preexec_fn=spawn_guard())


@contextlib.contextmanager
def _pictures(served: Served, job: str, many: int, answers: Counter[int]) -> Iterator[None]:
    """Runs `many` clients that request pictures of the job during the `with` block.

    The number of answers by HTTP status is added to `answers`. The clients run in a separate process, so that their processor
    time is not attributed to the service.
    """
    if not many:
        yield
        return
    command = ["nice", sys.executable, "-m", "tests.benchmarks.scale.readers", f"--url={served.url}", f"--job={job}"]
    command.append(f"--readers={many}")
    reading = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, preexec_fn=spawn_guard())
    try:
        yield
    finally:
        reading.terminate()
        said = json.loads(reading.communicate(timeout=60)[0].splitlines()[-1])
        answers.update({int(status): count for status, count in said.items()})


def _between(spent: list[list[float]], column: int, begin: float, end: float) -> float:
    """Returns by how much a growing value increased between two times, by linear interpolation.

    spent: rows that begin with their time. column: the value's index in a row.
    """
    times = [row[0] for row in spent]
    return float(np.interp(end, times, values := [row[column] for row in spent]) - np.interp(begin, times, values))


def _wait_until_merged(
    served: Served, slots: list[subprocess.Popen[str]], taken: Taken, measured: tuple[float, float]
) -> dict[str, int]:
    """Waits until the service has merged all batches that were sent, then ends the slots; returns the sums of their counts.

    measured: interval (begin, end) of which the slots' time without work, and their lost time, are added to `taken`.
    """
    deadline = time.monotonic() + SETTLES_S
    while time.monotonic() < deadline and (_held_batches(served) or served.store.xlen(RESULTS)):
        time.sleep(0.5)
    said = Counter[str]()
    for process in slots:
        process.terminate()
        one = json.loads(process.communicate(timeout=60)[0].splitlines()[-1])
        spent = one.pop("spent")
        said.update(one)
        unfed, held_up = (_between(spent, column, *measured) for column in (1, 2))
        taken.unfed_s += unfed
        taken.held_up_s += held_up
    while time.monotonic() < deadline and served.store.xlen(RESULTS):
        time.sleep(0.2)
    return said | {"unread": int(served.store.xlen(RESULTS))}


def _held_batches(served: Served) -> int:
    """Returns the number of batches and messages that workers and sites hold, according to their latest reports in Redis."""
    keys = [*served.store.scan_iter(WORKER_KEYS), *served.store.scan_iter(site_key("*"))]
    found = 0
    for value in served.store.mget(keys) if keys else ():  # type: ignore[union-attr]
        said = json.loads(value or "{}")
        found += len(said.get("in_hand", ())) + sum(map(bool, said.get("current", ())))
    return found


def _covered(film: Film) -> list[int]:
    return [film.coverage(0, tile).total for tile in range(len(film.tiles))]


def _is_exact(film: Film, sums: Sums, has: list[int]) -> bool:
    for tile, samples in enumerate(has):
        found = film.tile_sums(0, tile)
        if samples and (found is None or not np.array_equal(found, sums * samples)):
            return False
    return True
