"""Serialization of a worker's result, for files on its machine and for sending it to a site's reducer."""

from __future__ import annotations

from protocol import json_head
from protocol.contract import Result

__all__ = ["result_bytes", "result_of"]


def result_bytes(result: Result) -> bytes:
    """Serializes a result. The inverse is `result_of`."""
    return json_head.encode(result.event, result.sums or b"")


def result_of(data: bytes) -> Result:
    """Parses the bytes from `result_bytes`. Raises ValueError if they are malformed."""
    try:
        return Result(*json_head.decode(data))
    except ValueError as error:
        raise ValueError(f"invalid result: {error}") from None
