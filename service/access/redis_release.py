"""The release of a Redis or Valkey server, and checks whether it has the security fixes that a farm relies on."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

__all__ = ["MIN_VERSION", "RedisRelease", "parse_version_output", "release_of"]

MIN_VERSION = (6, 2)  # Celery's queues need LMPOP and ZRANGE BYSCORE
# The first patch release of each series with the fixes of CVE-2025-49844 (code execution by a Lua script) and CVE-2025-21605
# (output buffers that grow without a login); of Valkey 9.0 also of CVE-2026-27623 (a crash without a login).
FIXED: dict[str, dict[tuple[int, ...], int]] = {
    "Redis": {(6, 2): 20, (7, 2): 11, (7, 4): 6, (8, 0): 4, (8, 2): 2},
    "Valkey": {(7, 2): 11, (8, 0): 6, (8, 1): 4, (9, 0): 3},
}


@dataclass(frozen=True)
class RedisRelease:
    """Name and version of a server. name: "Redis" or "Valkey". numbers: of the version; () if it is unknown."""

    name: str
    numbers: tuple[int, ...]

    def __str__(self) -> str:
        return f"{self.name} {'.'.join(map(str, self.numbers)) or 'of an unknown version'}"

    @property
    def is_too_old(self) -> bool:
        """Returns True if the release lacks commands that the farm needs."""
        return self.name == "Redis" and self.numbers[:2] < MIN_VERSION

    @property
    def flaw(self) -> str | None:
        """A warning sentence if the release lacks security fixes; None if it has them.

        The check uses the version number only. A distribution may have backported the fixes without changing the number.
        """
        fixed = FIXED[self.name]
        series = self.numbers[:2]
        if series > max(fixed) or self.numbers[2:3] >= (fixed.get(series, 1 << 30),):
            return None
        wanted = ", ".join(f"{'.'.join(map(str, (*each, patch)))}" for each, patch in sorted(fixed.items()) if each >= series)
        return (
            f"{self} has known security flaws (CVE-2025-49844, CVE-2025-21605) unless its distribution has fixed them. "
            f"Use {self.name} {wanted} or a newer one."
        )


def release_of(info: Mapping[str, Any]) -> RedisRelease:
    """Returns the release of the server that sent this INFO reply.

    Valkey is recognised, although for old clients it also reports a version of Redis.
    """
    if "valkey_version" in info:
        return RedisRelease("Valkey", _numbers(str(info["valkey_version"])))
    return RedisRelease("Redis", _numbers(str(info.get("redis_version", ""))))


def parse_version_output(text: str) -> RedisRelease:
    """Returns the release in the output of `--version`, such as "Valkey server v=9.1.2 sha=..."."""
    found = re.search(r"(Redis|Valkey) server v=(\d+(?:\.\d+)*)", text)
    return RedisRelease(found[1], _numbers(found[2])) if found else RedisRelease("Redis", ())


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d+", version)[:3])
