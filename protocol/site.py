"""Messages from the machines of a site to its reducer, which adds up their sums of a tile before sending them to the service.

worker --- HTTP POST /sums ----------> reducer    a Result of type `batch` or `batches` with `run` (joint.Run), as
                                                  result_bytes.py packs it, signed; 204: the reducer has it.
                                                  Its size is signed too, so that memory is reserved for members only
reducer -- stream RESULTS -----------> service    Result of type `batches`: each part ends with its worker's name
reducer -- key site_key(name) -------> service    SiteReport, expires after HEARTBEAT_TTL_S; workers read its address
reducer -- key secret_key(name) -----> worker     the secret that signs sums

Only clients with a token for the farm's Redis can read the secret, so revoking a token also revokes access to the reducer. The
secret changes every SECRET_S seconds. Sums that are acknowledged and then lost with the reducer are rendered again when their
lease expires; the film drops duplicates.
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
    "secret_key",
    "signature",
    "site_key",
    "size_signature",
]

SITE = "site:"  # before its name: the tag of a worker that belongs to it
SITE_NAME = re.compile(r"[a-z0-9][a-z0-9._-]{0,40}")
SUMS_PATH = "/sums"
SIGNATURE_HEADER = "X-Rayfarm-Signature"
ANNOUNCED_HEADER = "X-Rayfarm-Announced"
SECRET_S = 600.0
MAX_COUNT = 1 << 60  # upper limit on its counts


def site_key(name: str) -> str:
    """Returns the Redis key of the report of a site's reducer."""
    return f"rayfarm:site:{name}"


def secret_key(name: str) -> str:
    """Returns the Redis key of the secret with which a site's workers sign their messages."""
    return f"rayfarm:site-secret:{name}"


def signature(secret: bytes, body: bytes) -> str:
    """Returns the signature of a message's body, which proves that a worker of the farm sent exactly this body."""
    return hmac.digest(secret, body, "sha256").hex()


def size_signature(secret: bytes, size: int) -> str:
    """Returns the signature of a body's size. The reducer rejects a body whose size is not signed before it reads the body."""
    return signature(secret, b"size %d" % size)


@dataclass(frozen=True)
class SiteReport:
    """Heartbeat report of a site's reducer."""

    name: str
    host: str
    pid: int
    address: str  # that its workers reach
    port: int
    started: float  # unix time
    in_hand: list[str] = field(default_factory=list)  # batches whose sums it holds unsent
    results: int = 0  # number of results received
    sent: int = 0  # that became of them
    bytes_in: int = 0
    bytes_out: int = 0

    def to_bytes(self) -> bytes:
        """Serializes the report as JSON."""
        return json.dumps(asdict(self)).encode()

    @classmethod
    def from_bytes(cls, data: bytes) -> SiteReport:
        """Parses a report from `to_bytes` of this or another release. Raises ValueError if it is malformed."""
        try:
            found = json.loads(data)
            if not isinstance(found, Mapping):
                raise ValueError("invalid site report")
            report = cls(**{f.name: found[f.name] for f in fields(cls) if f.name in found})
        except (TypeError, RecursionError) as error:
            raise ValueError(f"invalid site report: {error}") from None
        texts: list[Any] = [report.name, report.host, report.address]
        numbers: list[Any] = [report.pid, report.port, report.results, report.sent, report.bytes_in, report.bytes_out]
        if not (
            all(isinstance(text, str) for text in texts)
            and all(isinstance(number, int) and 0 <= number <= MAX_COUNT for number in numbers)
            and isinstance(report.started, int | float)
            and math.isfinite(report.started)
            and isinstance(report.in_hand, list)
            and all(isinstance(batch, str) for batch in report.in_hand)
            and 0 < report.port < 1 << 16
        ):
            raise ValueError("invalid site report: its fields are of other types")
        return report
