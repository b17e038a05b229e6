"""A JSON object and bytes behind it: how a result and an answer about a view travel."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

from protocol.layout import U32, Layout
from renderer.sentences import decoded, encoded

__all__ = ["decode", "encode"]


class Head(NamedTuple):
    """The head: the JSON object follows, then the bytes."""

    length: Annotated[int, U32, "bytes of the JSON object"]


HEAD = Layout("message", Head)


def encode(about: Mapping[str, Any], data: bytes) -> bytes:
    """Encodes an object and bytes."""
    text = json.dumps(encoded(about)).encode()
    return b"".join([HEAD.pack(Head(len(text))), text, data])


def decode(message: bytes) -> tuple[dict[str, Any], bytes]:
    """Decodes the object and the bytes. Raises ValueError."""
    end = HEAD.size + HEAD.unpack(message).length
    if end > len(message):
        raise ValueError(f"a message of {len(message)} bytes is cut off")
    try:
        about = json.loads(message[HEAD.size : end])
    except RecursionError as error:
        raise ValueError(str(error)) from None
    if not isinstance(about, dict):
        raise ValueError("a message has no JSON object")
    return decoded(about), message[end:]
