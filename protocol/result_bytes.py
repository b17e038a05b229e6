"""Serialization of a result, for files on a machine and for transport to a site's reducer."""

from __future__ import annotations

from protocol import json_head
from protocol.contract import Result

__all__ = ["result_bytes", "result_of"]


def result_bytes(result: Result) -> bytes:
    """Serializes a result; `result_of` reads it."""
    return json_head.encode(result.event, result.sums or b"")


def result_of(data: bytes) -> Result:
    """Parses the result that `result_bytes` wrote. Raises ValueError if it is malformed."""
    try:
        return Result(*json_head.decode(data))
    except ValueError as error:
        raise ValueError(f"no result: {error}") from None
