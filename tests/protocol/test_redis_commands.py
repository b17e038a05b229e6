"""Tests of parsing Redis commands from a stream of bytes."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.redis_commands import MAX_ARGUMENTS, CommandError, CommandReader


def encode(arguments: list[bytes]) -> bytes:
    return b"*%d\r\n" % len(arguments) + b"".join(b"$%d\r\n%s\r\n" % (len(each), each) for each in arguments)


@given(st.lists(st.lists(st.binary(max_size=40), min_size=1, max_size=5), max_size=6), st.integers(1, 17))
def test_commands_are_the_same_however_the_stream_is_cut(commands: list[list[bytes]], step: int) -> None:
    stream = b"".join(map(encode, commands))
    reader = CommandReader()
    found = [command for at in range(0, len(stream), step) for command in reader.feed(stream[at : at + step])]
    assert [command.arguments for command in found] == commands
    assert b"".join(command.encoded for command in found) == stream
    assert reader.size == 0


@pytest.mark.parametrize(
    "stream",
    [
        b"PING\r\n",  # inline commands are not used by clients
        b"*1\r\n+PING\r\n",
        b"*0\r\n",
        b"*-1\r\n",
        b"*1\r\n$-1\r\n",
        b"*1\r\n$4\r\nPING\n\n",
        b"*1\r\n$" + b"9" * 30,
        b"*" + b"1" * 16,
        b"*%d\r\n" % (MAX_ARGUMENTS + 1),
        b"GET / HTTP/1.1\r\n",
    ],
)
def test_other_bytes_are_refused(stream: bytes) -> None:
    with pytest.raises(CommandError):
        CommandReader().feed(stream)


def test_too_large_command_is_refused_before_it_arrives() -> None:
    reader = CommandReader(1000)
    reader.feed(encode([b"XADD", b"x" * 900]))
    with pytest.raises(CommandError, match="at most 1000"):
        reader.feed(b"*2\r\n$4\r\nXADD\r\n$1001\r\n")
