"""Channels: the connections to Redis of workers that reach only the service (protocol/channel.py).

Each channel has a connection of its own, as the token's Redis user, so that revoking the token ends it. Replies are passed on as
they are; commands only once they are complete and permitted.
"""

from __future__ import annotations

import asyncio
import contextlib
import ssl
from collections import Counter
from collections.abc import AsyncIterator, Callable
from typing import Any

from redis.connection import parse_url

from protocol.channel import CHUNK_BYTES, name_suffix
from protocol.redis_commands import CommandError, CommandReader, too_large
from renderer.library_messages import library_message
from renderer.sentences import Sentence
from service.access.worker_commands import WorkerCommands
from service.errors import Unavailable

__all__ = ["WorkerChannel", "WorkerChannels"]

CONNECT_S = 5.0
MAX_CHANNELS = 1024  # of one token: a worker has two for each slot, and a few more
MAX_BUFFERED_BYTES = 256 << 20  # of commands that are incomplete or not sent yet, of all channels together
SHORT_BYTES = 64 << 10  # a command of this size is always accepted


class WorkerChannels:
    """Opens channels. Used only by the event loop's thread.

    address_for: returns Redis's address for a token's id and the service's address; may block, and raise Unavailable.
    """

    def __init__(self, redis_url: str, address_for: Callable[[str, str], str]) -> None:
        self._redis_url = redis_url
        self._address_for = address_for
        self._channels: Counter[str] = Counter()  # open ones, by token
        self._turns: dict[str, asyncio.Lock] = {}  # of tokens with open channels
        self.buffered = 0  # bytes of commands that are incomplete or not sent yet

    @contextlib.asynccontextmanager
    async def open(self, key: str | None) -> AsyncIterator[WorkerChannel]:
        """Context manager of a channel. key: id of the worker's token; None: the farm's own token.

        Raises Unavailable if Redis does not answer, or the token has too many channels.
        """
        token = key or ""
        if self._channels[token] >= MAX_CHANNELS:
            raise Unavailable(
                Sentence(
                    "channel-too-many",
                    "The workers with this token have {most} connections to the farm's queue. Give each machine a token "
                    "of its own.",
                    most=MAX_CHANNELS,
                )
            )
        self._channels[token] += 1
        try:
            url = self._redis_url if key is None else await asyncio.to_thread(self._address_for, key, self._redis_url)
            try:
                reader, writer = await asyncio.wait_for(_connect(url), CONNECT_S)
            except (OSError, TimeoutError, EOFError) as error:
                raise Unavailable(
                    Sentence(
                        "redis-silent-retrying",
                        "Redis does not answer ({error}). It will be retried.",
                        error=library_message(error),
                    )
                ) from None
            turn = self._turns.setdefault(token, asyncio.Lock())
            channel = WorkerChannel(self, WorkerCommands(name_suffix(key)), turn, reader, writer)
            try:
                yield channel
            finally:
                channel.close()
        finally:
            self._channels[token] -= 1
            if not self._channels[token]:
                del self._channels[token]
                self._turns.pop(token, None)


class WorkerChannel:
    """A worker's connection to Redis.

    turn: held while a message is parsed, so that all channels of a token parse one at a time, and other tasks run in between.
    """

    def __init__(
        self,
        channels: WorkerChannels,
        rules: WorkerCommands,
        turn: asyncio.Lock,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
    ) -> None:
        self._channels = channels
        self._rules = rules
        self._turn = turn
        self._reader = reader
        self._writer = writer
        self._commands = CommandReader()
        self._held = b""  # a command that names the connection, until the report that confirms the name
        self._counted = 0  # its part of `channels.buffered`

    async def send(self, data: bytes) -> None:
        """Sends the commands that are complete with `data` to Redis.

        data: at most CHUNK_BYTES. Raises CommandError if that or a command is too large, malformed or not permitted, and OSError
        if Redis has closed the connection.
        """
        if len(data) > CHUNK_BYTES:
            raise too_large(len(data), CHUNK_BYTES)
        async with self._turn:
            sent = 0
            for command in self._commands.feed(data):
                self._rules.check(command)
                self._held += command.encoded
                if not self._rules.has_unconfirmed_name:
                    self._writer.write(self._held)
                    sent += len(self._held)
                    self._held = b""
            self._count_buffered(self._commands.size + sent)
            await asyncio.sleep(0)
        await self._writer.drain()
        self._count_buffered(self._commands.size)

    async def receive(self) -> bytes:
        """Returns the next bytes of Redis's replies, and b"" once Redis has closed the connection. Raises OSError."""
        return await self._reader.read(CHUNK_BYTES)

    def close(self) -> None:
        """Closes the connection to Redis."""
        self._count_buffered(0)
        self._writer.close()

    def _count_buffered(self, size: int) -> None:
        self._channels.buffered += size - self._counted
        self._counted = size
        if size > SHORT_BYTES and self._channels.buffered > MAX_BUFFERED_BYTES:
            raise CommandError(
                Sentence("channel-busy", "Too many large results are being sent to the farm at once. They will be sent again.")
            )


async def _connect(url: str) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    """Opens a connection to Redis, authenticates and selects the database. Raises OSError or EOFError."""
    options: dict[str, Any] = parse_url(url)
    if path := options.get("path"):
        reader, writer = await asyncio.open_unix_connection(path)
    else:
        context = _tls(options) if url.startswith("rediss:") else None
        reader, writer = await asyncio.open_connection(options.get("host", "localhost"), options.get("port", 6379), ssl=context)
    try:
        if password := options.get("password"):
            user = [options["username"]] if options.get("username") else []
            await _call(reader, writer, "AUTH", *user, password)
        if database := options.get("db"):
            await _call(reader, writer, "SELECT", str(database))
    except BaseException:
        writer.close()
        raise
    return reader, writer


async def _call(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, *words: str) -> None:
    """Sends a command and reads its reply. Raises ConnectionError unless the reply is OK."""
    encoded = [word.encode() for word in words]
    writer.write(b"*%d\r\n" % len(encoded) + b"".join(b"$%d\r\n%s\r\n" % (len(word), word) for word in encoded))
    reply = await reader.readuntil(b"\r\n")
    if reply != b"+OK\r\n":
        raise ConnectionError(reply[1:-2].decode("utf-8", "replace"))


def _tls(options: dict[str, Any]) -> ssl.SSLContext:
    context = ssl.create_default_context(cafile=options.get("ssl_ca_certs"), capath=options.get("ssl_ca_path"))
    if str(options.get("ssl_cert_reqs", "required")).lower() == "none":
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    if certificate := options.get("ssl_certfile"):
        context.load_cert_chain(certificate, options.get("ssl_keyfile"))
    return context
