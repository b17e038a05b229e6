"""Passwords: kept as Argon2id (RFC 9106), with what the library recommends.

A check takes 64 MB and a good part of a second of a core on purpose; so few are made at a time, and the rest wait.
"""

from __future__ import annotations

import threading
from functools import cache
from typing import TYPE_CHECKING

from service.errors import Invalid

if TYPE_CHECKING:
    from argon2 import PasswordHasher

__all__ = ["check_strength", "hashed", "is_right"]

SHORTEST = 10
LONGEST = 256
AT_ONCE = threading.BoundedSemaphore(2)


@cache
def _hasher() -> PasswordHasher:
    from argon2 import PasswordHasher  # only who logs in needs it

    return PasswordHasher(parallelism=1)


@cache
def _of_nobody() -> str:
    return _hasher().hash("of nobody")


def check_strength(password: str, name: str) -> None:
    """Raises Invalid where a password is too easily guessed, or too long."""
    if len(password) < SHORTEST:
        raise Invalid(f"The password has {len(password)} characters. Take at least {SHORTEST}: a few words are best.")
    if len(password) > LONGEST:
        raise Invalid(f"The password is longer than {LONGEST} characters. Take a shorter one.")
    if len(set(password)) < 4 or name.lower() in password.lower():
        raise Invalid("The password is too easily guessed. Take a few words that have nothing to do with the name.")


def hashed(password: str) -> str:
    """What is kept of a password."""
    with AT_ONCE:
        return _hasher().hash(password)


def is_right(password: str, kept: str | None) -> bool:
    """Whether this is the password. kept: None where there is none, which takes as long to find out."""
    from argon2.exceptions import InvalidHashError, VerificationError

    with AT_ONCE:
        try:
            _hasher().verify(kept or _of_nobody(), password[:LONGEST])
        except (VerificationError, InvalidHashError):
            return False
    return kept is not None
