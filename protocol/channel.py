"""The farm's queue over HTTPS: a WebSocket at the service that stands for a worker's connection to Redis.

A worker without access to Redis runs a relay (worker/exchange/relay.py), which accepts its Redis connections on loopback and
opens a WebSocket at CHANNEL_PATH for each. Binary messages are the bytes of that connection: commands of the worker, replies of
Redis. The service passes on only permitted commands (service/access/worker_commands.py). Text messages are those of this module:
the service first sends `open` once its connection to Redis is open, and `refused` before it closes a channel for a reason.

The scheduler is not involved: queues, leases, reports and results are those of any worker.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import ClassVar, Literal

from protocol.websocket import FromService

__all__ = ["CHANNEL_MESSAGES", "CHANNEL_PATH", "CHUNK_BYTES", "HTTPS", "ChannelOpen", "ChannelRefused", "name_suffix", "token_of"]

CHANNEL_PATH = "/api/farm/channel"
CHUNK_BYTES = 64 << 10  # of a binary message, at most
_TOKEN = re.compile(r"\.([0-9a-f]{12})$")
HTTPS: Literal["https"] = "https"  # WorkerReport.transport of a worker that uses channels


@dataclass(frozen=True)
class ChannelOpen(FromService):
    """The service is connected to Redis, and passes on what follows."""

    TYPE: ClassVar[str] = "open"


@dataclass(frozen=True)
class ChannelRefused(FromService):
    """The service closes the channel. detail: a sentence. passing: whether the worker should try again later."""

    TYPE: ClassVar[str] = "refused"
    detail: str
    passing: bool = False


def name_suffix(key: str | None) -> str:
    """Returns what the names of workers over HTTPS end with, so that none can use the name of another token's worker.

    key: id of the worker's token, 12 hexadecimal digits; None for the farm's own token, whose workers may have any name.
    """
    return f".{key}" if key is not None else ""


def token_of(worker: str) -> str:
    """Returns the id of the token of a worker over HTTPS, from its name; for other workers the name."""
    found = _TOKEN.search(worker)
    return worker if found is None else found[1]


CHANNEL_MESSAGES: tuple[type[FromService], ...] = (ChannelOpen, ChannelRefused)
