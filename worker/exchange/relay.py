"""`python -m worker.exchange.relay`: passes a worker's Redis connections on to the service, over HTTPS (protocol/channel.py).

A process of its own, so that it goes on while the worker's event loop is busy, and since a process that forks must not have
threads. It reads its settings from the first line of standard input, and prints the port on which it listens; it ends when
standard input does, which is when the worker ends.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import signal
import socket
import ssl
import sys
import time
from dataclasses import asdict, dataclass
from typing import Literal
from urllib.parse import urlsplit

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidStatus, WebSocketException

from protocol.channel import CHANNEL_MESSAGES, CHANNEL_PATH, CHUNK_BYTES, ChannelOpen, ChannelRefused
from protocol.redis_commands import Command, CommandError, CommandReader
from protocol.websocket import read_service
from renderer.sentences import Sentence
from telemetry.log_lines import as_json, uses_json
from worker.exchange.errors import answered_status, not_reachable, token_unknown
from worker.exchange.foreign_server import is_loopback
from worker.exchange.trust import verify_option, verify_option_for

__all__ = ["RelaySettings", "main"]

OPEN_S = 10.0
END_S = 2.0  # for which the rest of a refused connection is read
BUFFER_BYTES = 32 << 10  # of what waits to be sent, at each place
REPEAT_S = 60.0  # after which the same reason is logged again
MAX_MESSAGE_BYTES = 1 << 20  # of a message from the service
MAX_FIRST_BYTES = 1 << 16  # of the command that authenticates a connection
AUTHENTICATION_CLOSED = 4401  # close code after the token was revoked
UNKNOWN_TOKEN, HTTP_SERVER_ERROR = (401, 403), 500  # HTTP status
log = logging.getLogger("worker")


@dataclass(frozen=True)
class RelaySettings:
    """What a relay needs: the service's address, the worker's token, and the password of its own connections."""

    service: str
    token: str
    password: str

    def to_line(self) -> bytes:
        """Encodes the settings as the line that the relay reads."""
        return json.dumps(asdict(self)).encode() + b"\n"


class _UnavailableError(Exception):
    """The channel cannot be opened. The text is a sentence."""


class _Relay:
    def __init__(self, settings: RelaySettings) -> None:
        self._settings = settings
        self._said: dict[str, float] = {}  # reasons that were logged, and when
        where = urlsplit(settings.service)
        self._url = where._replace(scheme="wss" if where.scheme == "https" else "ws", path=f"{where.path}{CHANNEL_PATH}").geturl()
        verify = verify_option_for(verify_option(), settings.service)
        self._tls = None if verify is False else ssl.create_default_context() if verify is True else verify
        self._proxy: Literal[True] | None = None if is_loopback(settings.service) else True

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Handles one Redis connection of the worker."""
        # Cancelled: the relay ends.
        with contextlib.suppress(OSError, EOFError, ConnectionClosed, TimeoutError, asyncio.CancelledError):
            try:
                await self._relay(reader, writer)
            except _UnavailableError as error:
                self._log_once(str(error))
                await _end_with_error(reader, writer, "LOADING", str(error))  # after which Redis's clients try again
            except CommandError as error:
                self._log_once(str(error))
                await _end_with_error(reader, writer, "NOPERM", str(error))
        writer.close()

    async def _relay(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        first, rest = await _first_command(reader)
        greeting = _without_password(first, self._settings.password)
        async with await self._open() as channel:
            if greeting:
                await channel.send(greeting)
            else:
                writer.write(b"+OK\r\n")
            if rest:
                await channel.send(rest)
            up = asyncio.create_task(_send_up(reader, channel))
            down = asyncio.create_task(_send_down(channel, writer))
            try:
                await asyncio.wait((up, down), return_when=asyncio.FIRST_COMPLETED)
            finally:
                for task in (up, down):
                    task.cancel()
                ends = await asyncio.gather(up, down, return_exceptions=True)
        if refusal := next((each for each in ends if isinstance(each, CommandError)), None):
            raise refusal
        if channel.close_code == AUTHENTICATION_CLOSED:
            self._log_once(token_unknown(self._settings.service))

    async def _open(self) -> ClientConnection:
        """Opens a channel, and waits until the service is connected to Redis. Raises _UnavailableError."""
        try:
            channel = await connect(
                self._url,
                additional_headers={"Authorization": f"Bearer {self._settings.token}"},
                ssl=self._tls,
                proxy=self._proxy,
                compression=None,
                max_size=MAX_MESSAGE_BYTES,
                open_timeout=OPEN_S,
            )
        except InvalidStatus as error:
            status = error.response.status_code
            if status in UNKNOWN_TOKEN:
                raise _UnavailableError(token_unknown(self._settings.service)) from None
            if status >= HTTP_SERVER_ERROR:
                raise _UnavailableError(answered_status(self._settings.service, status, CHANNEL_PATH)) from None
            raise _UnavailableError(
                Sentence(
                    "channel-status",
                    "{service} answers {status} where the farm's queue should be. A proxy in front of the farm must let "
                    "WebSockets through.",
                    service=self._settings.service,
                    status=status,
                )
            ) from None
        except (OSError, TimeoutError, InvalidHandshake, WebSocketException) as error:
            raise _UnavailableError(not_reachable(self._settings.service, error)) from None
        try:
            message = read_service(await asyncio.wait_for(channel.recv(), OPEN_S), CHANNEL_MESSAGES)
        except (ConnectionClosed, TimeoutError, ValueError, AttributeError) as error:
            channel.transport.abort()
            raise _UnavailableError(not_reachable(self._settings.service, error)) from None
        match message:
            case ChannelOpen():
                _limit_unsent_bytes(channel)
                return channel
            case ChannelRefused(detail):
                await channel.close()
                raise _UnavailableError(detail)
        channel.transport.abort()
        raise _UnavailableError(
            Sentence(
                "channel-foreign",
                "{service} is not a farm's queue. Give the address that `rayfarm up` shows.",
                service=self._settings.service,
            )
        )

    def _log_once(self, reason: str) -> None:
        now = time.monotonic()
        if now - self._said.get(reason, -REPEAT_S) >= REPEAT_S:
            self._said = {each: at for each, at in self._said.items() if now - at < REPEAT_S} | {reason: now}
            log.warning("%s", reason)


async def _first_command(reader: asyncio.StreamReader) -> tuple[Command, bytes]:
    """Returns the first command of a connection, and the bytes received after it. Raises CommandError and EOFError."""
    commands = CommandReader(MAX_FIRST_BYTES)
    while data := await reader.read(CHUNK_BYTES):
        if found := commands.feed(data):
            return found[0], b"".join(each.encoded for each in found[1:]) + commands.unparsed
    raise EOFError


def _without_password(command: Command, password: str) -> bytes:
    """Returns the command without the password of local connections, encoded; b"" if nothing is left of it.

    Raises CommandError if the password is missing or wrong, as it would be of another program on this machine.
    """
    arguments = command.arguments
    if command.name == "AUTH" and arguments[-1] == password.encode():
        return b""
    if command.name == "HELLO" and len(arguments) == 5 and arguments[2].upper() == b"AUTH" and arguments[4] == password.encode():
        return b"*2\r\n$5\r\nHELLO\r\n$%d\r\n%s\r\n" % (len(arguments[1]), arguments[1])
    raise CommandError(Sentence("relay-password-wrong", "Only the worker that started it may use its connection to the farm."))


def _limit_unsent_bytes(channel: ClientConnection) -> None:
    """Makes the system accept little that it cannot send yet, so that a sender waits as it would for Redis itself.

    Otherwise megabytes would wait here on a slow line, and their sender would get the reply too late.
    """
    connected = channel.transport.get_extra_info("socket")
    if connected is not None and (mark := getattr(socket, "TCP_NOTSENT_LOWAT", None)) is not None:
        connected.setsockopt(socket.IPPROTO_TCP, mark, BUFFER_BYTES)


async def _send_up(reader: asyncio.StreamReader, channel: ClientConnection) -> None:
    while data := await reader.read(CHUNK_BYTES):
        await channel.send(data)


async def _send_down(channel: ClientConnection, writer: asyncio.StreamWriter) -> None:
    """Passes replies on until the service closes the channel. Raises CommandError if it does so for a reason."""
    async for message in channel:
        if isinstance(message, bytes):
            writer.write(message)
            await writer.drain()
        elif isinstance(said := read_service(message, CHANNEL_MESSAGES), ChannelRefused):
            raise CommandError(said.detail)


async def _end_with_error(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, kind: str, sentence: str) -> None:
    """Sends an error of Redis's protocol, and reads what still arrives: closing at once would discard the error.

    Raises OSError and TimeoutError.
    """
    text = " ".join(sentence.split())
    writer.write(f"-{kind} {text}\r\n".encode())
    writer.write_eof()
    async with asyncio.timeout(END_S):
        while await reader.read(CHUNK_BYTES):
            pass


async def _run(settings: RelaySettings) -> None:
    relay = _Relay(settings)
    listening = socket.create_server(("127.0.0.1", 0))
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
    server = await asyncio.start_server(relay.serve, sock=listening, limit=BUFFER_BYTES)
    print(json.dumps(server.sockets[0].getsockname()[1]), flush=True)
    async with server:
        await asyncio.to_thread(sys.stdin.buffer.read)  # until the worker ends


def main() -> int:
    """Runs the relay until standard input ends. Returns the exit code."""
    if uses_json():
        as_json("worker")
    else:
        logging.basicConfig(format="%(asctime)s %(levelname)s %(message)s", level=logging.WARNING)
    logging.getLogger("websockets").setLevel(logging.ERROR)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # the worker that is stopping still sends its last results
    try:
        settings = RelaySettings(**json.loads(sys.stdin.buffer.readline()))
    except (ValueError, TypeError):
        print("the relay reads its settings from standard input; `rayfarm worker --transport https` starts it", file=sys.stderr)
        return 2
    asyncio.run(_run(settings))
    return 0


if __name__ == "__main__":
    sys.exit(main())
