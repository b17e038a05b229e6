"""How a worker's machine is doing, and the end of its log, in keys beside its report that older workers do without.

worker ---- key vitals_key(name) -----> service    Vitals, expires
service --- key log_wanted_key(name) -> worker     somebody reads its log; expires
worker ---- key log_key(name) --------> service    the last lines of it as a JSON list, expires
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

__all__ = ["LOG_TTL_S", "VITALS_TTL_S", "Vitals", "log_key", "log_wanted_key", "look", "vitals_key"]

VITALS_TTL_S = 30
LOG_TTL_S = 10
_MOST = 1 << 60


@dataclass(frozen=True)
class Vitals:
    """Of the worker's machine, in bytes."""

    memory_used: int
    memory_total: int

    def to_bytes(self) -> bytes:
        """JSON for the worker's key."""
        return json.dumps(asdict(self)).encode()

    @classmethod
    def from_bytes(cls, data: bytes) -> Vitals:
        """What `to_bytes` wrote, here or in another release. Raises ValueError where it is something else."""
        try:
            found = json.loads(data)
            used, total = found["memory_used"], found["memory_total"]
        except (KeyError, TypeError, RecursionError) as error:
            raise ValueError(f"no vitals: {error}") from None
        if not (type(used) is int and type(total) is int and 0 <= used <= _MOST and 0 < total <= _MOST):
            raise ValueError("no vitals: memory is a number of bytes")
        return cls(used, total)


def look() -> Vitals | None:
    """The machine as it is now; None where the system does not tell."""
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        sizes = {name: int(rest.split()[0]) * 1024 for name, _, rest in (line.partition(":") for line in lines)}
        return Vitals(sizes["MemTotal"] - sizes["MemAvailable"], sizes["MemTotal"])
    except (OSError, KeyError, ValueError, IndexError):
        return None


def vitals_key(name: str) -> str:
    """The Redis key under which a worker tells how its machine is."""
    return f"rayfarm:vitals:{name}"


def log_wanted_key(name: str) -> str:
    """The Redis key that is there while somebody wants to read a worker's log."""
    return f"rayfarm:log-wanted:{name}"


def log_key(name: str) -> str:
    """The Redis key under which a worker then tells its log's last lines."""
    return f"rayfarm:log:{name}"
