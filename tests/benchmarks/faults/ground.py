"""A test farm for faults: its processes, the progress of its job, and helpers for faults."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import httpx
import psutil
import redis

from rayfarm.client import Client, ClientError
from renderer.child_processes import spawn_guard
from tests.benchmarks.faults.patience import Patience, children
from tests.helpers import ROOT, Farm, start_farm, stop_farm

__all__ = ["OVER", "Ground", "UnrecoveredError", "disk_of"]

PATIENCE_S = 240.0
DISK_MIB = 192
OVER = 1 << 62  # stands for all samples of a finished job
GUEST = "guest"  # the worker that joined
# Short timeouts and small batches, so that each fault affects running work.
SETTINGS = {"RAYFARM_BATCH_SECONDS": "0.25", "RAYFARM_BATCH_DEADLINE": "5", "RAYFARM_MIN_FREE_BYTES": "1000000"}


class UnrecoveredError(Exception):
    """Raised if an awaited condition does not occur in time."""


class Ground:
    """A test farm: a service with a worker of two slots, and a worker of one slot that joins over the network.

    The farm and the joined worker each have an empty data folder, on a separate disk if this user may mount one.
    """

    name = "one machine"

    def __init__(self, folder: Path, environment: dict[str, str] | None = None) -> None:
        self.folder = folder
        self.environment = SETTINGS | (environment or {})
        self.data = folder / "data"
        self.data.mkdir(parents=True)
        self.has_disk = disk_of(self.data, DISK_MIB)
        self._guest: subprocess.Popen[bytes] | None = None
        self._asks: tuple[str, Client] | None = None
        self.farm = self.start()
        self.look_after()

    @classmethod
    def is_possible(cls) -> bool:
        """Returns whether this machine and user support this test farm."""
        return True

    # --- state for attacks

    @property
    def url(self) -> str:
        return self.farm.url

    def client(self) -> Client:
        return Client(self.url)

    @property
    def redis_url(self) -> str:
        """Current URL of the farm's Redis."""
        return str(json.loads((self.data / "farm.json").read_text())["redis_url"])

    def store(self) -> redis.Redis:
        """Returns a new connection to the farm's Redis."""
        return redis.Redis.from_url(self.redis_url, socket_timeout=5, socket_connect_timeout=5)

    def part(self, name: str) -> psutil.Process:
        """Returns the current process of a part of the farm, such as "service".

        Raises psutil.NoSuchProcess if it has just ended.
        """
        return psutil.Process(self.farm.pids()[name])

    def spares(self) -> list[psutil.Process]:
        """Returns the spare processes: preloaded services that wait to replace the running one."""
        known = self.farm.pids()["service"]
        return [p for p in psutil.Process(self.farm.process.pid).children() if p.pid != known and "service.standby" in line(p)]

    def slots(self) -> list[psutil.Process]:
        """Returns the processes that render."""
        owners = [self.part("worker")]
        if self._guest is not None:
            owners.append(psutil.Process(self._guest.pid))
        found = []
        for owner in owners:
            with contextlib.suppress(psutil.NoSuchProcess):
                found += owner.children()
        return found

    def film(self, job: str) -> Path:
        return self.data / "films" / f"{job}.sqlite"

    # --- actions for attacks

    def look_after(self) -> None:
        """Restarts those processes that no supervisor restarts: the joined worker, and `rayfarm up` itself."""
        if self.farm.process.poll() is not None:
            self.farm.log.replace(self.farm.log.with_suffix(".old.log"))  # later, only the new log is read
            self.farm = self.start()
            self.leave()  # the new farm may have another port
        self.join()

    def start(self) -> Farm:
        """Starts the farm and returns it."""
        return start_farm(self.data, 2, **self.environment)

    def join(self) -> None:
        """Starts those of the workers that join over the network which are not running."""
        if self._guest is None or self._guest.poll() is not None:
            self._guest = self._start_guest()

    def _start_guest(self) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "worker", "--service", self.url, "--slots", "1", "--name", GUEST]
        with (self.folder / "guest.log").open("ab") as log:
            environment = {**os.environ, **self.environment, "RAYFARM_TOKEN": self.farm.token}
            return subprocess.Popen(
                command, cwd=ROOT, env=environment, stdout=log, stderr=log, start_new_session=True, preexec_fn=spawn_guard()
            )

    @property
    def guest(self) -> psutil.Process:
        assert self._guest is not None
        return psutil.Process(self._guest.pid)

    def leave(self) -> None:
        """Ends the workers that joined over the network."""
        if self._guest is not None:
            self._guest.kill()
            self._guest.wait()

    def stop(self) -> None:
        self.leave()
        stop_farm(self.farm)
        if self.has_disk:
            subprocess.run(["umount", "-l", str(self.data)], check=False)

    # --- progress

    def ready(self) -> bool:
        try:
            return httpx.get(f"{self.url}/readyz", timeout=2.0, verify=False).is_success
        except httpx.HTTPError:
            return False

    def samples(self, job: str) -> int:
        """Returns the job's number of samples; a very large number if the job has ended; -1 if the service does not answer."""
        if self._asks is None or self._asks[0] != self.url:
            self._asks = self.url, self.client()  # creating a client takes longer than a request
        try:
            now = self._asks[1].job(job)
            return OVER if now.is_over else now.samples
        except (ClientError, OSError):
            return -1

    def wait(self, true: Callable[[], bool], what: str, patience_s: float = PATIENCE_S) -> float:
        """Waits until the function `true` returns True, restarting processes if needed; returns the time at which it did.

        patience_s: timeout in seconds, of which only idle time counts. Raises UnrecoveredError with `what` after the timeout.
        """
        patience = Patience(patience_s, children)
        while not true():
            if patience.is_over:
                raise UnrecoveredError(f"waited {patience_s:g} idle seconds until {what}\n{self.logs()}")
            self.look_after()
            time.sleep(0.03)
        return time.monotonic()

    def logs(self) -> str:
        return Farm.logs(self.farm)


def line(process: psutil.Process) -> str:
    """Returns a process' command line, or '' if the process has ended."""
    try:
        return " ".join(process.cmdline())
    except psutil.Error:
        return ""


def disk_of(folder: Path, mib: int) -> bool:
    """Mounts a small disk on a folder; returns False if this user may not."""
    if os.geteuid() != 0:
        return False
    return subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={mib}m", "rayfarm", str(folder)], check=False).returncode == 0


@contextlib.contextmanager
def stopped(processes: list[psutil.Process]) -> Iterator[None]:
    """Suspends processes during the `with` block."""
    for process in processes:
        with contextlib.suppress(psutil.NoSuchProcess):
            process.suspend()
    try:
        yield
    finally:
        for process in processes:
            with contextlib.suppress(psutil.NoSuchProcess):
                process.resume()
