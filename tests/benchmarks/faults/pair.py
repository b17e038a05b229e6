"""A farm of two services on one folder: the owner and a standby, which are killed and suspended."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
from pathlib import Path

import httpx
import psutil

from rayfarm.local.farm import free_port
from renderer.child_processes import spawn_guard
from tests.benchmarks.faults.attack import Attack, kind
from tests.benchmarks.faults.ground import Ground
from tests.helpers import ROOT
from tests.service.store.postgres import PostgresServer, find_postgres

STANDBY_S = 60.0
ASK_S = 2.0


class PairGround(Ground):
    """A `Ground` with a second service, which is restarted like the first."""

    name = "two services"

    def __init__(self, folder: Path, environment: dict[str, str] | None = None) -> None:
        self._port = free_port("127.0.0.1")
        self._second: subprocess.Popen[bytes] | None = None
        self._latest = ""  # URL that last answered as the owner
        self._timers: list[threading.Timer] = []
        super().__init__(folder, environment)

    @property
    def _urls(self) -> list[str]:
        return [self.farm.url, f"http://127.0.0.1:{self._port}"]

    @property
    def url(self) -> str:
        """URL of the service that owns the farm; without an owner, URL of a service that may become the owner."""
        urls = sorted(self._urls, key=lambda url: url != self._latest)
        for url in urls:
            if not self._stands_still(url) and readiness_of(url) == "ready":
                self._latest = url
                return url
        self._latest = urls[-1]  # is tried first next time
        return urls[0]

    def _stands_still(self, url: str) -> bool:
        """Returns whether the service at `url` is suspended. The wait for a suspended service does not count as recovery time."""
        with contextlib.suppress(psutil.NoSuchProcess):
            process = self.part("service") if url == self.farm.url else psutil.Process(self._second.pid if self._second else -1)
            return process.status() == psutil.STATUS_STOPPED
        return False

    def look_after(self) -> None:
        super().look_after()
        if self._second is None or self._second.poll() is not None:
            self._second = self._start_second()

    def _start_second(self) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "service", "--no-access-log", f"--port={self._port}"]
        environment = {**os.environ, **self.environment, "RAYFARM_DATA": str(self.data), "RAYFARM_PORT": str(self._port)}
        environment |= {"RAYFARM_TOKEN": self.farm.token, "RAYFARM_REDIS_URL": self.redis_url, "RAYFARM_REUSE_FILMS": "false"}
        with (self.folder / "second.log").open("ab") as log:
            return subprocess.Popen(command, cwd=ROOT, env=environment, stdout=log, stderr=log, preexec_fn=spawn_guard())

    def services(self) -> tuple[psutil.Process, psutil.Process]:
        """Returns the processes (owner, standby). Raises UnrecoveredError if there is no such pair in time."""
        self.wait(
            lambda: sorted(map(readiness_of, self._urls)) in (["ready", "stands by"],), "one works and one stands by", STANDBY_S
        )
        assert self._second is not None
        own, second = self.part("service"), psutil.Process(self._second.pid)
        return (own, second) if readiness_of(self.farm.url) == "ready" else (second, own)

    def later(self, seconds: float, process: psutil.Process) -> None:
        """Resumes `process`, which is suspended, after this number of seconds, without blocking."""

        def resume() -> None:
            with contextlib.suppress(psutil.NoSuchProcess):
                process.resume()

        self._timers.append(threading.Timer(seconds, resume))
        self._timers[-1].start()

    def stop(self) -> None:
        for timer in self._timers:
            timer.join()
        if self._second is not None:
            self._second.kill()
            self._second.wait()
        super().stop()

    def logs(self) -> str:
        second = self.folder / "second.log"
        return super().logs() + (f"\n--- second.log\n{second.read_text(errors='replace')[-3000:]}" if second.exists() else "")


class PostgresPairGround(PairGround):
    """A `PairGround` with its own PostgreSQL server."""

    name = "two services on PostgreSQL"

    def __init__(self, folder: Path) -> None:
        binaries = find_postgres()
        assert binaries is not None
        self._server = PostgresServer(binaries)
        super().__init__(folder, {"RAYFARM_DATABASE_URL": self._server.new()})

    @classmethod
    def is_possible(cls) -> bool:
        return find_postgres() is not None

    def stop(self) -> None:
        super().stop()
        self._server.stop()


PAIRS = (PairGround.name, PostgresPairGround.name)


def readiness_of(url: str) -> str:
    """Returns the state in a service's /readyz: ready, standing by, or an error."""
    try:
        answer = httpx.get(f"{url}/readyz", timeout=ASK_S).json()
    except (httpx.HTTPError, ValueError) as error:
        return str(error)
    text = str(answer.get("detail", answer.get("status")))
    return "stands by" if "stands by" in text else text


def services(attack: Attack) -> tuple[psutil.Process, psutil.Process]:
    assert isinstance(attack.ground, PairGround)
    return attack.ground.services()


def kill(attack: Attack, *processes: psutil.Process) -> None:
    attack.over()
    for process in processes:
        with contextlib.suppress(psutil.NoSuchProcess):
            process.kill()


@kind("two services, and the owner is killed", grounds=PAIRS, weight=5)
def owner_killed(attack: Attack) -> None:
    kill(attack, services(attack)[0])


@kind("two services, and the owner stands still for longer than its lease", grounds=PAIRS, weight=5)
def owner_hangs(attack: Attack) -> None:
    """Suspends the owner, and resumes it 7 to 14 seconds later, while the standby takes over or shortly afterwards."""
    owner, _ = services(attack)
    attack.over()
    owner.suspend()
    assert isinstance(attack.ground, PairGround)
    attack.ground.later(attack.draw.uniform(7.0, 14.0), owner)


@kind("two services, and the owner stands still for a moment", grounds=PAIRS)
def owner_pauses(attack: Attack) -> None:
    owner, _ = services(attack)
    owner.suspend()
    try:
        attack.pause(0.3, 4.0)
    finally:
        owner.resume()
    attack.over()


@kind("two services, and the one that stands by is killed", grounds=PAIRS)
def standby_killed(attack: Attack) -> None:
    kill(attack, services(attack)[1])


@kind("two services, and both are killed", grounds=PAIRS)
def both_killed(attack: Attack) -> None:
    kill(attack, *services(attack))
