"""A farm of three hosts with separate networks: the service with Redis, and two workers that share no folder with it."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import psutil
import redis

from renderer.child_processes import spawn_guard
from tests.benchmarks.faults.attack import Attack, kind
from tests.benchmarks.faults.ground import Ground
from tests.benchmarks.faults.link import Network
from tests.helpers import ROOT, Farm, farm_of

WORKERS = ("a", "b")
PORT = 8000
NETWORK = ("three hosts",)


class HostsGround(Ground):
    """A `Ground` over simulated networks: the farm's worker runs on host a, the joined worker on host b."""

    name = "three hosts"

    def __init__(self, folder: Path, environment: dict[str, str] | None = None) -> None:
        self.network = Network(f"rf{os.getpid() % 10000}", ["s", *WORKERS])
        self.network.__enter__()
        self._hosts: dict[str, subprocess.Popen[bytes]] = {}
        try:
            super().__init__(folder, {"RAYFARM_LOGIN": "never"} | (environment or {}))
        except BaseException:
            self.network.__exit__()
            raise

    @classmethod
    def is_possible(cls) -> bool:
        return os.geteuid() == 0 and shutil.which("ip") is not None and Path("/dev/net/tun").exists()

    def start(self) -> Farm:
        command = [*self.network.inside("s"), sys.executable, "-m", "rayfarm", "up", "--workers=0", f"--data={self.data}"]
        command += [f"--host={self.network.addresses['s']}", f"--port={PORT}", "--no-browser"]
        return farm_of(command, self.data, ROOT, **self.environment)

    def store(self) -> redis.Redis:
        url = json.loads((self.data / "farm.json").read_text())["redis_url"]
        return redis.Redis.from_url(
            url.replace("127.0.0.1", self.network.addresses["s"]), socket_timeout=5, socket_connect_timeout=5
        )

    def part(self, name: str) -> psutil.Process:
        return psutil.Process(self._hosts["a"].pid) if name == "worker" else super().part(name)

    @property
    def guest(self) -> psutil.Process:
        return psutil.Process(self._hosts["b"].pid)

    def slots(self) -> list[psutil.Process]:
        found = []
        for process in self._hosts.values():
            with contextlib.suppress(psutil.NoSuchProcess):
                found += psutil.Process(process.pid).children()
        return found

    def join(self) -> None:
        for host in WORKERS:
            if host not in self._hosts or self._hosts[host].poll() is not None:
                self._hosts[host] = self._start_worker(host)

    def leave(self) -> None:
        for process in self._hosts.values():
            process.kill()
            process.wait()
        self._hosts.clear()

    def _start_worker(self, host: str) -> subprocess.Popen[bytes]:
        """Starts a worker for which the service's data folder appears empty, so that it fetches files over the network."""
        cache = self.folder / f"cache-{host}"
        worker = f"exec {sys.executable} -m worker --service http://{self.network.addresses['s']}:{PORT} --slots 1"
        script = f"mount -t tmpfs hidden {self.data} && {worker} --name {host} --cache {cache}"
        with (self.folder / f"{host}.log").open("ab") as log:
            return subprocess.Popen(
                [*self.network.inside(host), "sh", "-c", script],
                cwd=ROOT,
                env={**os.environ, **self.environment, "RAYFARM_TOKEN": self.farm.token},
                stdout=log,
                stderr=log,
                start_new_session=True,
                preexec_fn=spawn_guard(),
            )

    def stop(self) -> None:
        try:
            super().stop()
        finally:
            self.network.__exit__()


@contextlib.contextmanager
def bad(attack: Attack, hosts: list[str], **how: float | bool) -> Iterator[None]:
    """Degrades or cuts the network cables of these hosts during the `with` block. how: new values of the cables' attributes."""
    assert isinstance(attack.ground, HostsGround)
    cables = [attack.ground.network.cables[host] for host in hosts]
    before = [dict(vars(cable)) for cable in cables]
    for cable in cables:
        vars(cable).update(how)
    try:
        yield
    finally:
        for cable, was in zip(cables, before, strict=True):
            vars(cable).update(was)


@kind("a worker's host is cut off, and back", grounds=NETWORK, weight=6)
def one_cut(attack: Attack) -> None:
    with bad(attack, [attack.draw.choice(WORKERS)], is_cut=True):
        attack.pause(0.5, 15.0)
    attack.over()


@kind("both workers' hosts are cut off, and back", grounds=NETWORK, weight=3)
def both_cut(attack: Attack) -> None:
    with bad(attack, list(WORKERS), is_cut=True):
        attack.pause(0.5, 12.0)
    attack.over()


@kind("the service's host is cut off, and back", grounds=NETWORK, weight=4)
def service_cut(attack: Attack) -> None:
    with bad(attack, ["s"], is_cut=True):
        attack.pause(0.5, 12.0)
    attack.over()


@kind("a slow cable: 100 to 500 kB a second", grounds=NETWORK, weight=3)
def slow(attack: Attack) -> None:
    with bad(attack, [attack.draw.choice(("s", *WORKERS))], rate=attack.draw.uniform(1e5, 5e5)):
        attack.pause(3.0, 8.0)
    attack.over()


@kind("a cable that loses 5 to 30 % of all frames", grounds=NETWORK, weight=4)
def lossy(attack: Attack) -> None:
    with bad(attack, [attack.draw.choice(("s", *WORKERS))], loss=attack.draw.uniform(0.05, 0.3)):
        attack.pause(3.0, 8.0)
    attack.over()


@kind("a late and uneven cable: 100 to 400 ms", grounds=NETWORK, weight=3)
def late(attack: Attack) -> None:
    with bad(attack, [attack.draw.choice(("s", *WORKERS))], delay_s=0.1, uneven_s=0.3):
        attack.pause(3.0, 8.0)
    attack.over()
