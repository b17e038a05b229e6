"""Serialization of a result, for files on a machine and for transport to a site's reducer."""

from __future__ import annotations

import json
import struct

from protocol.contract import Result

__all__ = ["result_bytes", "result_of"]

_LENGTH = struct.Struct("<I")  # of the event, which comes next; the rest are the sums


def result_bytes(result: Result) -> bytes:
    """Serializes a result; `result_of` reads it."""
    event = json.dumps(result.event).encode()
    return b"".join([_LENGTH.pack(len(event)), event, result.sums or b""])


def result_of(data: bytes) -> Result:
    """Parses the result that `result_bytes` wrote. Raises ValueError if it is malformed."""
    try:
        end = _LENGTH.size + _LENGTH.unpack_from(data)[0]
        event = json.loads(data[_LENGTH.size : end])
    except (struct.error, RecursionError) as error:
        raise ValueError(f"no result: {error}") from None
    if not isinstance(event, dict) or end > len(data):
        raise ValueError("no result: it has no event, or ends too soon")
    return Result(event, data[end:])
