"""Random ways to damage a file."""

from __future__ import annotations

import random
import re
from collections.abc import Callable

__all__ = ["WAYS", "damaged"]

_TOKEN = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?|[A-Za-z_][\w.-]*|[^\s\w]")
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")
_ODD = [b"-1", b"0", b"4294967295", b"2147483648", b"99999999999999999999", b"1e308", b"1e999", b"nan", b"-1e-320", b"1" * 400]
_ODD_BYTES = [b"\xff\xff\xff\xff", b"\x00\x00\x00\x80", b"\xff\xff\xff\x7f", b"\x00\x00\xc0\x7f", b"\x00\x00\x80\x7f", bytes(8)]


def _bits(data: bytes, dice: random.Random) -> bytes:
    found = bytearray(data)
    for _ in range(dice.choice([1, 1, 2, 4, 16])):
        found[dice.randrange(len(found))] ^= 1 << dice.randrange(8)
    return bytes(found)


def _cut(data: bytes, dice: random.Random) -> bytes:
    return data[: dice.randrange(len(data))]


def _swapped(data: bytes, dice: random.Random) -> bytes:
    """Returns the data with two of its tokens swapped, or two byte ranges in a binary file. dice: random number generator."""
    tokens = [m.span() for m in _TOKEN.finditer(data, 0, 200_000)]
    if len(tokens) > 8:
        (a, b), (c, d) = sorted(dice.sample(tokens, 2))
    else:
        size = max(min(len(data) // 4, dice.choice([1, 4, 16, 256])), 1)
        a, c = sorted((dice.randrange(len(data)), dice.randrange(len(data))))
        b, d = min(a + size, c), min(c + size, len(data))
    return data[:a] + data[c:d] + data[b:c] + data[a:b] + data[d:]


def _doubled(data: bytes, dice: random.Random) -> bytes:
    at = dice.randrange(len(data))
    part = data[at : at + dice.choice([1, 4, 12, 64, 1024])]
    to = dice.choice([at, dice.randrange(len(data))])
    return data[:to] + part * dice.choice([1, 1, 2, 50]) + data[to:]


def _dropped(data: bytes, dice: random.Random) -> bytes:
    at = dice.randrange(len(data))
    return data[:at] + data[at + dice.choice([1, 4, 12, 64, 1024]) :]


def _huge(data: bytes, dice: random.Random) -> bytes:
    """Returns the data with one number replaced by an invalid or far too large one.

    In a binary file, some bytes are overwritten with such a number instead. dice: random number generator.
    """
    numbers = [m.span() for m in _NUMBER.finditer(data, 0, 200_000)]
    if numbers and dice.random() < 0.8:
        a, b = dice.choice(numbers)
        return data[:a] + dice.choice(_ODD) + data[b:]
    odd = dice.choice(_ODD_BYTES)
    at = dice.randrange(max(len(data) - len(odd), 1))
    return data[:at] + odd + data[at + len(odd) :]


WAYS: dict[str, Callable[[bytes, random.Random], bytes]] = {
    "bits flipped": _bits,
    "cut off": _cut,
    "tokens swapped": _swapped,
    "parts doubled": _doubled,
    "parts dropped": _dropped,
    "huge numbers": _huge,
}


def damaged(data: bytes, dice: random.Random) -> tuple[bytes, str]:
    """Damages the data in one or two random ways; returns (damaged data, description of the damage).

    dice: random number generator.
    """
    ways = dice.sample(sorted(WAYS), dice.choice([1, 1, 1, 2]))
    for way in ways:
        data = WAYS[way](data, dice) if data else data
    return data, ", ".join(ways)
