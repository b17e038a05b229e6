"""JSON messages of WebSockets, and the codes with which the service closes one.

A client's message is recognised by its key, a message of the service by its `type`. Unknown keys and types are ignored, so that
clients and services of different releases work together.

To add a message, declare it in live.py (a job's channel) or viewport.py (a view's), send or handle it in the route of the same
name in service/routes/, and on the page in the handler of the same name, which is called for messages of this type.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, ClassVar, TypeVar

__all__ = ["CLOSED", "GONE", "NOT_FOUND", "Acknowledge", "FromClient", "FromService", "read_client", "read_service"]

NOT_FOUND = 4404
GONE = 4410  # the job was deleted
CLOSED = (NOT_FOUND, GONE)  # for good: a client does not connect again


@dataclass(frozen=True)
class FromClient:
    """Base class of client messages: a JSON object that contains KEY."""

    KEY: ClassVar[str]

    @classmethod
    def of(cls, message: Mapping[str, Any]) -> Any:
        """Parses the message. Raises ValueError, TypeError or OverflowError if it is malformed."""
        return cls(message[cls.KEY])  # type: ignore[call-arg]  # a message of one value

    def to_json(self) -> dict[str, Any]:
        """Returns the message as JSON data."""
        (value,) = vars(self).values()
        return {self.KEY: value}

    def to_text(self) -> str:
        """Encodes the message."""
        return json.dumps(self.to_json())


@dataclass(frozen=True)
class Acknowledge(FromClient):
    """Client message {"ack": seq}: the client has received the picture or tile with this number, and all before it."""

    KEY: ClassVar[str] = "ack"
    seq: int

    @classmethod
    def of(cls, message: Mapping[str, Any]) -> Acknowledge:
        """Parses the message. Raises ValueError, TypeError or OverflowError if it is malformed."""
        return cls(int(message[cls.KEY]))


@dataclass(frozen=True)
class FromService:
    """Base class of service messages: a JSON object with `type` and the fields of the dataclass."""

    TYPE: ClassVar[str]

    def to_text(self) -> str:
        """Encodes the message."""
        return json.dumps({"type": self.TYPE, **vars(self)})


C = TypeVar("C", bound=FromClient)
S = TypeVar("S", bound=FromService)


def read_client(text: str, kinds: tuple[type[C], ...]) -> C | None:
    """Decodes a client's message as one of `kinds`; None if it contains none of their keys.

    Raises ValueError, TypeError, OverflowError or RecursionError if it is malformed.
    """
    said = json.loads(text)
    if not isinstance(said, Mapping):
        raise TypeError("a message must be a JSON object")
    return next((kind.of(said) for kind in kinds if kind.KEY in said), None)


def read_service(text: str | bytes, kinds: tuple[type[S], ...]) -> S | None:
    """Decodes a message of the service as one of `kinds`; None if its type is unknown. Raises ValueError if it is malformed."""
    said = json.loads(text)
    for kind in kinds:
        if said.get("type") == kind.TYPE:
            try:
                return kind(**{field.name: said[field.name] for field in fields(kind) if field.name in said})
            except TypeError as error:
                raise ValueError(f"a message {kind.TYPE!r} is incomplete: {error}") from None
    return None
