"""What the machines of a site say to its reducer, which adds up their sums of a tile before they travel on.

    worker --- HTTP POST /sums ----------> reducer    a Result of type `batch` or `batches` with `run` (joint.Run), as
                                                      result_bytes.py packs it, signed; 204: the reducer has it.
                                                      Its size is signed too, so that room is kept for who belongs here
    reducer -- stream RESULTS -----------> service    Result of type `batches`: each part ends with its worker's name
    reducer -- key site_key(name) -------> service    SiteReport, expires after HEARTBEAT_TTL_S; and workers: where it is
    reducer -- key secret_key(name) -----> worker     what sums are signed with

Whoever is let into the farm's Redis by a token of its own can read the secret, and nobody else: so a token that is withdrawn
ends that too. It is another one every SECRET_S seconds. What is acknowledged and lost with the reducer is handed out again by
its lease; what comes twice the film drops.
"""

from __future__ import annotations

import hmac
import json
import math
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

__all__ = [
    "ANNOUNCED_HEADER",
    "SECRET_S",
    "SIGNATURE_HEADER",
    "SITE",
    "SITE_NAME",
    "SUMS_PATH",
    "SiteReport",
    "announced",
    "secret_key",
    "signature",
    "site_key",
]

SITE = "site:"  # before its name: the tag of a worker that belongs to it
SITE_NAME = re.compile(r"[a-z0-9][a-z0-9._-]{0,40}")
SUMS_PATH = "/sums"
SIGNATURE_HEADER = "X-Rayfarm-Signature"
ANNOUNCED_HEADER = "X-Rayfarm-Announced"
SECRET_S = 600.0
LARGEST = 1 << 60  # of its counts


def site_key(name: str) -> str:
    """The Redis key under which a site's reducer reports itself."""
    return f"rayfarm:site:{name}"


def secret_key(name: str) -> str:
    """The Redis key of what its workers sign with."""
    return f"rayfarm:site-secret:{name}"


def signature(secret: bytes, body: bytes) -> str:
    """By which the reducer knows that a body comes from a worker of the farm, as it was sent."""
    return hmac.digest(secret, body, "sha256").hex()


def announced(secret: bytes, size: int) -> str:
    """By which the reducer knows that, before the body has come: whoever only says that much comes is not waited for."""
    return signature(secret, b"size %d" % size)


@dataclass(frozen=True)
class SiteReport:
    """A site's reducer of itself."""

    name: str
    host: str
    pid: int
    address: str  # that its workers reach
    port: int
    started: float  # unix time
    in_hand: list[str] = field(default_factory=list)  # batches whose sums it has and has not sent
    results: int = 0  # that it has taken
    sent: int = 0  # that became of them
    bytes_in: int = 0
    bytes_out: int = 0

    def to_bytes(self) -> bytes:
        """JSON for its key."""
        return json.dumps(asdict(self)).encode()

    @classmethod
    def from_bytes(cls, data: bytes) -> SiteReport:
        """The report that `to_bytes` wrote, here or in another release. Raises ValueError where it is none."""
        try:
            found = json.loads(data)
            if not isinstance(found, Mapping):
                raise ValueError("no report of a site")
            report = cls(**{f.name: found[f.name] for f in fields(cls) if f.name in found})
        except (TypeError, RecursionError) as error:
            raise ValueError(f"no report of a site: {error}") from None
        texts: list[Any] = [report.name, report.host, report.address]
        numbers: list[Any] = [report.pid, report.port, report.results, report.sent, report.bytes_in, report.bytes_out]
        if not (
            all(isinstance(text, str) for text in texts)
            and all(isinstance(number, int) and 0 <= number <= LARGEST for number in numbers)
            and isinstance(report.started, int | float)
            and math.isfinite(report.started)
            and isinstance(report.in_hand, list)
            and all(isinstance(batch, str) for batch in report.in_hand)
            and 0 < report.port < 1 << 16
        ):
            raise ValueError("no report of a site: its fields are of other types")
        return report
