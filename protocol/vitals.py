"""Memory use of a worker's machine and the end of its log, in Redis keys in addition to its report. Older workers ignore them.

worker ---- key vitals_key(name) -----> service    Vitals, expires
service --- key log_wanted_key(name) -> worker     exists while a client reads the log; expires
worker ---- key log_key(name) --------> service    the last log lines as a JSON list, expires
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

__all__ = ["LOG_TTL_S", "VITALS_TTL_S", "Vitals", "log_key", "log_wanted_key", "read_vitals", "vitals_key"]

VITALS_TTL_S = 30
LOG_TTL_S = 10
_MAX_BYTES = 1 << 60


@dataclass(frozen=True)
class Vitals:
    """Memory of a worker's machine, in bytes."""

    memory_used: int
    memory_total: int

    def to_bytes(self) -> bytes:
        """Serializes the values as JSON for the worker's key."""
        return json.dumps(asdict(self)).encode()

    @classmethod
    def from_bytes(cls, data: bytes) -> Vitals:
        """Parses the values from `to_bytes` of this or another release. Raises ValueError if they are malformed."""
        try:
            found = json.loads(data)
            used, total = found["memory_used"], found["memory_total"]
        except (KeyError, TypeError, RecursionError) as error:
            raise ValueError(f"invalid vitals: {error}") from None
        if not (type(used) is int and type(total) is int and 0 <= used <= _MAX_BYTES and 0 < total <= _MAX_BYTES):
            raise ValueError("invalid vitals: memory is a number of bytes")
        return cls(used, total)


def read_vitals() -> Vitals | None:
    """Returns the memory of this machine that is in use and in total; None if the system does not provide it."""
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        sizes = {name: int(rest.split()[0]) * 1024 for name, _, rest in (line.partition(":") for line in lines)}
        return Vitals(sizes["MemTotal"] - sizes["MemAvailable"], sizes["MemTotal"])
    except (OSError, KeyError, ValueError, IndexError):
        return None


def vitals_key(name: str) -> str:
    """Returns the Redis key of the memory in use on a worker's machine. name: the worker's."""
    return f"rayfarm:vitals:{name}"


def log_wanted_key(name: str) -> str:
    """Returns the Redis key that exists while a client reads a worker's log."""
    return f"rayfarm:log-wanted:{name}"


def log_key(name: str) -> str:
    """Returns the Redis key of the last lines of a worker's log."""
    return f"rayfarm:log:{name}"
