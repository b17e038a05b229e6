"""A result as bytes: in files of a machine, and on its way to a site's reducer."""

from __future__ import annotations

import json
import struct

from worker.protocol.contract import Result

__all__ = ["result_bytes", "result_of"]

_LENGTH = struct.Struct("<I")  # of the event, which comes next; the rest are the sums


def result_bytes(result: Result) -> bytes:
    """What `result_of` reads."""
    event = json.dumps(result.event).encode()
    return b"".join([_LENGTH.pack(len(event)), event, result.sums or b""])


def result_of(data: bytes) -> Result:
    """The result that `result_bytes` wrote. Raises ValueError where it is none."""
    try:
        end = _LENGTH.size + _LENGTH.unpack_from(data)[0]
        event = json.loads(data[_LENGTH.size : end])
    except (struct.error, RecursionError) as error:
        raise ValueError(f"no result: {error}") from None
    if not isinstance(event, dict) or end > len(data):
        raise ValueError("no result: it has no event, or ends too soon")
    return Result(event, data[end:])
