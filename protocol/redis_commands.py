"""Redis commands as clients send them (RESP arrays of bulk strings), parsed from a stream of bytes."""

from __future__ import annotations

from typing import NamedTuple

from renderer.sentences import Sentence

__all__ = ["MAX_COMMAND_BYTES", "Command", "CommandError", "CommandReader", "too_large"]

MAX_COMMAND_BYTES = 32 << 20  # a result with the sums of a tile has up to a few megabytes
MAX_ARGUMENTS = 4096
MAX_LINE = 16  # characters of a length, with its type and the end of the line


class CommandError(ValueError):
    """Raised for bytes that are not a Redis command, or not a permitted one. The text is a sentence."""


class Command(NamedTuple):
    """A command: its arguments, the first of which is its name, and the bytes that encode it."""

    arguments: list[bytes]
    encoded: bytes

    @property
    def name(self) -> str:
        """Returns the command's name in upper case."""
        return self.arguments[0].decode("ascii", "replace").upper()


class CommandReader:
    """Parses the commands of one connection. Bytes of an incomplete command are kept until the rest arrives."""

    def __init__(self, max_bytes: int = MAX_COMMAND_BYTES) -> None:
        self._max_bytes = max_bytes
        self._buffer = bytearray()
        self._arguments: list[bytes] = []  # of an incomplete command
        self._missing: int | None = None  # number of its missing arguments; None: unknown
        self._at = 0  # bytes of it that are parsed

    @property
    def unparsed(self) -> bytes:
        """The bytes received of an incomplete command."""
        return bytes(self._buffer)

    @property
    def size(self) -> int:
        """The number of bytes received of an incomplete command."""
        return len(self._buffer)

    def feed(self, data: bytes) -> list[Command]:
        """Returns the commands that are complete with `data`. Raises CommandError if the bytes are not a command."""
        self._buffer += data
        found = []
        while (command := self._next()) is not None:
            found.append(command)
        return found

    def _next(self) -> Command | None:
        if self._missing is None:
            if (count := self._length(b"*", 1, MAX_ARGUMENTS)) is None:
                return None
            self._missing = count
        while self._missing:
            begin = self._at
            if (size := self._length(b"$", 0, self._max_bytes - self._at)) is None:
                return None
            end = self._at + size
            if len(self._buffer) < end + 2:
                self._at = begin
                return None
            if self._buffer[end : end + 2] != b"\r\n":
                raise _malformed()
            self._arguments.append(bytes(self._buffer[self._at : end]))
            self._at = end + 2
            self._missing -= 1
        command = Command(self._arguments, bytes(self._buffer[: self._at]))
        del self._buffer[: self._at]
        self._arguments, self._missing, self._at = [], None, 0
        return command

    def _length(self, mark: bytes, least: int, most: int) -> int | None:
        """Parses a line with a length, and moves behind it. Returns None if the line is incomplete.

        mark: the line's first byte. least, most: range of the length. Raises CommandError.
        """
        line = bytes(self._buffer[self._at : self._at + MAX_LINE])
        end = line.find(b"\r\n")
        if line[:1] not in (b"", mark) or (end < 0 and len(line) == MAX_LINE):
            raise _malformed()
        if end < 0:
            return None
        digits = line[1:end]
        if not digits.isdigit():
            raise _malformed()
        if not least <= int(digits) <= most:
            raise too_large(int(digits), MAX_ARGUMENTS if mark == b"*" else self._max_bytes)
        self._at += end + 2
        return int(digits)


def too_large(size: int, most: int) -> CommandError:
    """Returns the error for a message of `size` bytes or arguments, of which at most `most` are permitted."""
    return CommandError(
        Sentence(
            "channel-command-too-large",
            "A message to the farm's queue has {size} bytes or parts, but may have at most {most}.",
            size=size,
            most=most,
        )
    )


def _malformed() -> CommandError:
    return CommandError(Sentence("channel-command-malformed", "The bytes sent to the farm's queue are not a Redis command."))
