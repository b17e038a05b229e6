"""A worker's heartbeat message to Redis: its report and its queries in one pipeline, whose replies are read asynchronously.

The heartbeat runs on the event loop that fetches the worker's tasks. On a connection with one second per reply, six sequential
queries would take longer than a report's TTL, and no task would be fetched meanwhile.
"""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass
from typing import Any

import redis
from redis.connection import ConnectionInterface

from protocol.contract import HEARTBEAT_TTL_S, WorkerReport, pause_key, prepare_queue, render_queue, worker_key
from protocol.joint import help_queue
from protocol.lifeline import lifeline
from protocol.terms import OFFER_TTL_S, Offer, offer_key, terms_key
from protocol.vitals import log_wanted_key

__all__ = ["HeartbeatConnection", "HeartbeatReply"]

ANSWER_S = 15.0  # timeout of a reply, after which the connection is closed
CONNECT_S = 5.0

_UNREACHABLE = (redis.RedisError, OSError)


@dataclass(frozen=True)
class HeartbeatReply:
    """Redis's replies to a heartbeat.

    is_stored: whether Redis stored the report. is_paused: whether the service has paused the worker. terms: the run-time
    settings that the service requires (protocol/terms.py), serialized; None if there are none. is_log_wanted: whether the
    service requests the log. is_help_queued: whether a help message (protocol/joint.py) waits in this worker's queue. waiting:
    number of queued tasks for workers of this kind.
    """

    is_stored: bool
    is_paused: bool = False
    terms: bytes | None = None
    is_log_wanted: bool = False
    is_help_queued: bool = True
    waiting: int = 0


class HeartbeatConnection:
    """A separate Redis connection for heartbeats. Methods do not raise if Redis is unreachable, so the worker continues."""

    def __init__(self, redis_url: str) -> None:
        self._redis = redis.Redis.from_url(redis_url, socket_timeout=CONNECT_S, socket_connect_timeout=CONNECT_S)
        self._connection: ConnectionInterface | None = None
        self._sent: deque[tuple[float, int]] = deque()  # pending messages: time sent, and number of commands

    def send(self, report: WorkerReport, offer: Offer | None, more_commands: list[tuple[Any, ...]]) -> None:
        """Sends a report, and the queries whose replies `receive` returns.

        offer: the worker's capabilities and settings (protocol/terms.py), or None. more_commands: further Redis commands, whose
        replies are ignored.
        """
        name, kind = report.name, report.kind
        commands: list[tuple[Any, ...]] = [
            ("CLIENT", "SETNAME", lifeline(name)),  # repeated, since the connection may be new
            ("SET", worker_key(name), report.to_bytes(), "EX", HEARTBEAT_TTL_S),
            ("EXISTS", pause_key(name)),
            ("GET", terms_key(name)),
            ("EXISTS", log_wanted_key(name)),
            ("EXISTS", help_queue(name)),
            ("LLEN", prepare_queue(kind)),
            ("LLEN", render_queue(kind)),
        ]
        if offer is not None:
            commands.append(("SET", offer_key(name), offer.to_bytes(), "EX", OFFER_TTL_S))
        commands += more_commands
        if self._sent and time.monotonic() - self._sent[0][0] > ANSWER_S:
            self.close()
        try:
            if self._connection is None:
                self._connection = self._redis.connection_pool.make_connection()
                self._connection.connect()
            connection = self._connection
            connection.send_packed_command(connection.pack_commands(commands), check_health=False)
            self._sent.append((time.monotonic(), len(commands)))
        except _UNREACHABLE:
            self.close()

    def receive(self, timeout_s: float = 0.0) -> HeartbeatReply | None:
        """Returns the latest reply received; None if there is none. timeout_s: seconds to wait for a pending reply."""
        reply: HeartbeatReply | None = None
        try:
            while self._connection is not None and self._sent and self._connection.can_read(0.0 if reply else timeout_s):
                answers = [self._read_answer(self._connection) for _ in range(self._sent[0][1])]
                self._sent.popleft()
                reply = _parse_reply(answers)
        except _UNREACHABLE:
            self.close()
        return reply

    def close(self) -> None:
        """Closes the connection and discards pending replies."""
        connection, self._connection = self._connection, None
        self._sent.clear()
        if connection is not None:
            connection.disconnect()

    @staticmethod
    def _read_answer(connection: ConnectionInterface) -> Any:
        try:
            return connection.read_response(disable_decoding=True)
        except redis.ResponseError as error:  # Redis is full, or a key has another type
            return error


def _parse_reply(answers: list[Any]) -> HeartbeatReply:
    _, taken, order, terms, log, asked, *waiting = answers[:8]
    return HeartbeatReply(
        is_stored=taken == b"OK",
        is_paused=order == 1,
        terms=terms if isinstance(terms, bytes) else None,
        is_log_wanted=log == 1,
        is_help_queued=asked != 0,
        waiting=sum(many for many in waiting if isinstance(many, int)),
    )
