"""Joins the farm while the kernel is loaded, in a thread of the starting worker that ends before Celery forks."""

from __future__ import annotations

import contextlib
import logging
import os
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from urllib.parse import urlsplit

import redis

from protocol.channel import HTTPS
from protocol.contract import HEARTBEAT_EVERY_S, HEARTBEAT_TTL_S, WorkerReport, worker_key
from protocol.redis_tls import with_certificate_authority
from renderer.library_messages import library_message
from renderer.sentences import Sentence
from worker.exchange.errors import LinkError, NotAFarmError, RefusedError, TokenError, WorkerError
from worker.exchange.foreign_server import is_loopback
from worker.exchange.link import FarmAnswer, Link
from worker.exchange.relay_process import RelayProcess
from worker.heartbeat import Reporter

__all__ = ["TRANSPORTS", "FarmJoin", "Joined", "check_redis", "free_name"]

# Errors that a retry does not resolve: the address or the token must change.
PERMANENT_ERRORS = (RefusedError, TokenError, NotAFarmError)
TRANSPORTS = ("auto", "redis", "https")  # auto: Redis if this machine reaches it
FIRST_PAUSE_S = 0.05
MAX_PAUSE_S = 3.0
PAUSE_GROWTH = 1.02  # growth per retry; small, since a service started together with this worker answers within seconds

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Joined:
    """Result of joining a farm: the service's response, the address of Redis, and the worker's name.

    relay: the relay that this address belongs to, if the worker reaches Redis through the service; None: without one.
    """

    farm: FarmAnswer
    redis_url: str
    name: str
    relay: RelayProcess | None = None


class FarmJoin:
    """Joins the farm in a thread that retries until the service responds.

    Then reports the worker as `starting`, until its own heartbeat starts. redis_url: address of Redis; None: the one that the
    service gives. report: returns the worker's report for a given name. say: logs a message. transport: how to reach the queue,
    one of TRANSPORTS.
    """

    def __init__(
        self,
        link: Link,
        redis_url: str | None,
        name: str,
        host: str,
        report: Callable[[str], WorkerReport],
        say: Callable[[str], None],
        transport: str = "auto",
    ) -> None:
        self._link = link
        self._redis_url = redis_url
        self._name = name
        self._host = host
        self._report = report
        self._say = say
        self._over_https = transport == "https"
        # On the farm's own machine an unreachable Redis is one that is starting.
        self._may_use_https = self._over_https or (transport == "auto" and redis_url is None and not is_loopback(link.service))
        self._relay: RelayProcess | None = None
        self._stop = threading.Event()
        self._answered = threading.Event()
        self._joined: Joined | None = None
        self._refused: WorkerError | None = None
        self._thread = threading.Thread(target=self._run, name="joining", daemon=True)

    def begin(self) -> None:
        """Starts joining. Raises WorkerError if a retry does not help: there is no farm, or it rejects the worker."""
        with contextlib.suppress(LinkError):
            self._ask_service()
        self._thread.start()

    def finish(self, stop: Callable[[], bool]) -> Joined | None:
        """Waits until the farm is joined, and ends the thread. Returns None if `stop` returned true first.

        Raises WorkerError as `begin` does.
        """
        while not stop() and not self._answered.wait(0.1):
            pass
        self._stop.set()
        self._thread.join()
        if self._joined is None:
            self._stop_relay()
        if self._refused is not None:
            raise self._refused
        return self._joined

    def _run(self) -> None:
        try:
            self._joined = self._join_with_retries()
        except PERMANENT_ERRORS as error:
            self._refused = error
        except Exception as error:  # `finish` waits for an answer, so any error must end the wait
            log.exception("joining failed")
            self._refused = RefusedError(f"joining {self._link.service} failed ({type(error).__name__}: {error})")
        finally:
            self._answered.set()
        if self._joined is not None:
            self._report_until_stopped(self._joined)

    def _join_with_retries(self) -> Joined | None:
        """Joins once service and Redis are reachable; returns None if `finish` ends the wait. Logs each new reason to wait."""
        said = ""
        pause = FIRST_PAUSE_S
        while not self._stop.is_set():
            try:
                return self._join_once()
            except LinkError as error:
                if str(error) != said:
                    said = str(error)
                    self._say(f"waiting: {said}")
                self._stop.wait(pause)
                pause = min(pause * PAUSE_GROWTH, MAX_PAUSE_S)
        return None

    def _ask_service(self) -> FarmAnswer:
        return self._link.join(over_https=True) if self._over_https else self._link.join()

    def _join_once(self) -> Joined:
        farm = self._ask_service()
        if self._over_https:
            return self._join_through_service(farm)
        try:
            return self._join_with_redis(farm)
        except LinkError as error:
            if not (self._may_use_https and farm.has_channel):
                raise
            joined = self._join_through_service(farm)
            with contextlib.suppress(LinkError):  # both may have started only now
                return self._join_with_redis(farm)
            self._say(f"joining over HTTPS, since Redis cannot be reached: {error}")
            return joined

    def _join_with_redis(self, farm: FarmAnswer) -> Joined:
        redis_url = with_certificate_authority(self._redis_url or farm.redis_url)
        check_redis(redis_url)
        self._stop_relay()
        return Joined(farm, redis_url, free_name(self._name, redis_url, self._host))

    def _join_through_service(self, farm: FarmAnswer) -> Joined:
        """Joins through the service instead of Redis. Raises LinkError if that is impossible at present."""
        if self._relay is None or not self._relay.is_running():
            self._relay = RelayProcess(self._link.service, self._link.token)
        try:
            with _connection(self._relay.redis_url) as store:
                store.set("rayfarm:joining", b"", ex=HEARTBEAT_TTL_S)
        except (redis.RedisError, OSError) as error:
            raise LinkError(
                Sentence(
                    "join-channel-unavailable",
                    "{service} does not pass this worker on to its queue ({error})",
                    service=self._link.service,
                    error=library_message(error),
                )
            ) from error
        name = free_name(self._name, self._relay.redis_url, self._host, farm.name_suffix)
        return Joined(farm, self._relay.redis_url, name, self._relay)

    def _stop_relay(self) -> None:
        relay, self._relay = self._relay, None
        if relay is not None:
            relay.stop()

    def _report_until_stopped(self, joined: Joined) -> None:
        reporter = Reporter(joined.redis_url)
        while True:
            report = self._report(joined.name)
            reporter.write_report(report if joined.relay is None else replace(report, transport=HTTPS))
            if self._stop.wait(HEARTBEAT_EVERY_S):
                reporter.redis.close()
                return


def check_redis(url: str) -> None:
    """Raises LinkError, with advice, if a worker cannot write to the Redis at `url`."""
    where = urlsplit(url)._replace(netloc=urlsplit(url).netloc.rpartition("@")[2]).geturl()
    try:
        with _connection(url) as store:
            store.set("rayfarm:joining", b"", ex=HEARTBEAT_TTL_S)
    except redis.AuthenticationError as error:
        raise LinkError(
            Sentence(
                "join-redis-password",
                "the Redis at {address} requires another password ({error}). The farm gives its workers the password; if "
                "--redis or RAYFARM_REDIS_URL names the Redis, the password must be part of that address.",
                address=where,
                error=library_message(error),
            )
        ) from error
    except redis.ResponseError as error:
        raise LinkError(
            Sentence(
                "join-redis-refused",
                "the Redis at {address} refuses reports of workers ({error}). Look into its log.",
                address=where,
                error=library_message(error),
            )
        ) from error
    except redis.InvalidResponse as error:
        raise LinkError(
            Sentence(
                "join-not-redis",
                "the server at {address} is not a Redis server. Give the address of the Redis that the service of the farm uses.",
                address=where,
            )
        ) from error
    except (redis.RedisError, OSError) as error:
        raise LinkError(
            Sentence(
                "join-redis-not-reachable",
                "no Redis server answers at {address} ({error}). It must be reachable from this machine: start the farm with "
                "`rayfarm up --host 0.0.0.0`, and open the port in its firewall.",
                address=where,
                error=library_message(error),
            )
        ) from error


def free_name(wanted_name: str, redis_url: str, host: str, suffix: str = "") -> str:
    """Returns `wanted_name`, with -2, -3 ... appended if a live worker already has that name, and then `suffix`."""
    with contextlib.suppress(redis.RedisError), _connection(redis_url) as store:
        for name in (wanted_name, *(f"{wanted_name}-{n}" for n in range(2, 1000))):
            if not _is_taken(store, name + suffix, host):
                return name + suffix
    return wanted_name + suffix


def _connection(url: str) -> redis.Redis:
    return redis.Redis.from_url(url, socket_timeout=5, socket_connect_timeout=5)


def _is_taken(store: redis.Redis, name: str, host: str) -> bool:
    """Returns True if a live worker has this name. A report that this release cannot parse counts as live until it expires."""
    try:
        data = store.get(worker_key(name))
        return isinstance(data, bytes) and not _has_ended(WorkerReport.from_bytes(data), host)
    except (ValueError, redis.ResponseError):
        return True


def _has_ended(report: WorkerReport, host: str) -> bool:
    """Returns True if a report is from a process on this host that has ended."""
    if report.host != host or report.pid <= 0:
        return False
    try:
        os.kill(report.pid, 0)
    except ProcessLookupError:
        return True
    except (PermissionError, OverflowError):
        return False
    return report.pid == os.getpid()
