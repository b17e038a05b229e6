"""Encoding of a JSON object followed by bytes, for workers' results and for their answers about live views."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

from protocol.layout import U32, Layout
from renderer.sentences import decoded, encoded

__all__ = ["decode", "encode"]


class Head(NamedTuple):
    """Binary head of a message, with the length of the JSON object. The JSON object follows, then the bytes."""

    length: Annotated[int, U32, "bytes of the JSON object"]


HEAD = Layout("message", Head)


def encode(about: Mapping[str, Any], data: bytes) -> bytes:
    """Encodes a JSON object and bytes as one message."""
    text = json.dumps(encoded(about)).encode()
    return b"".join([HEAD.pack(Head(len(text))), text, data])


def decode(message: bytes) -> tuple[dict[str, Any], bytes]:
    """Decodes a message to its JSON object and bytes. Raises ValueError if it is malformed."""
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
