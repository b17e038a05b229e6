"""Join the farm while the kernels are compiled: a thread of the starting worker, ended before Celery forks."""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable
from dataclasses import dataclass

import redis

from worker.contract import HEARTBEAT_EVERY_S, WorkerReport, worker_key
from worker.heartbeat import Reporter
from worker.link import FarmAnswer, Link, LinkError, RefusedError

__all__ = ["Joined", "Joining", "free_name"]


@dataclass(frozen=True)
class Joined:
    """What a worker knows once it has joined."""

    farm: FarmAnswer
    redis_url: str
    name: str


class Joining:
    """Asks the service until it answers, then reports `starting` until the worker takes over.

    redis_url: where it is known already; else the service tells. report: the worker of itself, by the name it got.
    """

    def __init__(
        self,
        link: Link,
        redis_url: str | None,
        name: str,
        host: str,
        report: Callable[[str], WorkerReport],
        say: Callable[[str], None],
    ) -> None:
        self._link = link
        self._redis_url = redis_url
        self._name = name
        self._host = host
        self._report = report
        self._say = say
        self._stop = threading.Event()
        self._answered = threading.Event()
        self._joined: Joined | None = None
        self._refused: RefusedError | None = None
        self._thread = threading.Thread(target=self._run, name="joining", daemon=True)

    def begin(self) -> None:
        """Start. Raises RefusedError where the service is there and says no."""
        with contextlib.suppress(LinkError):
            self._link.join()
        self._thread.start()

    def finish(self, stop: Callable[[], bool]) -> Joined | None:
        """Wait for the service's answer and end the thread; None where `stop` came first. Raises RefusedError."""
        while not stop() and not self._answered.wait(0.1):
            pass
        self._stop.set()
        self._thread.join()
        if self._refused is not None:
            raise self._refused
        return self._joined

    def _run(self) -> None:
        try:
            farm = self._link.join_patiently(self._say, self._stop.is_set)
        except RefusedError as error:
            self._refused = error
            farm = None
        if farm is not None:
            redis_url = self._redis_url or farm.redis_url
            self._joined = Joined(farm, redis_url, free_name(self._name, redis_url, self._host))
        self._answered.set()
        if self._joined is not None:
            self._beat(self._joined)

    def _beat(self, joined: Joined) -> None:
        reporter = Reporter(joined.redis_url)
        while True:
            reporter.beat(self._report(joined.name))
            if self._stop.wait(HEARTBEAT_EVERY_S):
                reporter.redis.close()
                return


def free_name(wanted: str, redis_url: str, host: str) -> str:
    """`wanted`, or with -2, -3 ... behind it where a living worker has that name."""
    with (
        contextlib.suppress(redis.RedisError),
        redis.Redis.from_url(redis_url, socket_timeout=2, socket_connect_timeout=2) as store,
    ):
        for name in (wanted, *(f"{wanted}-{n}" for n in range(2, 1000))):
            data = store.get(worker_key(name))
            if not isinstance(data, bytes) or _is_dead(WorkerReport.from_bytes(data), host):
                return name
    return wanted


def _is_dead(report: WorkerReport, host: str) -> bool:
    """Whether a report was left by a process of this host that has ended."""
    if report.host != host:
        return False
    try:
        os.kill(report.pid, 0)
    except ProcessLookupError:
        return True
    except PermissionError:
        return False
    return report.pid == os.getpid()
