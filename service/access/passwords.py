"""Passwords, stored as Argon2id hashes (RFC 9106) with the library's recommended parameters.

By design, one check takes 64 MB and a large part of a second of CPU time, so at most two run concurrently.
"""

from __future__ import annotations

import threading
from functools import cache
from typing import TYPE_CHECKING

from renderer.sentences import Sentence
from service.errors import Invalid

if TYPE_CHECKING:
    from argon2 import PasswordHasher

__all__ = ["check_strength", "hashed", "is_right"]

MIN_LENGTH = 10
MAX_LENGTH = 256
CONCURRENT_HASHES = threading.BoundedSemaphore(2)


@cache
def _hasher() -> PasswordHasher:
    from argon2 import PasswordHasher  # imported on demand: only password logins need it

    return PasswordHasher(parallelism=1)


@cache
def _placeholder_hash() -> str:
    return _hasher().hash("of nobody")


def check_strength(password: str, name: str) -> None:
    """Raises Invalid if the password is too short, too long or easy to guess.

    name: the user's name, which it must not resemble.
    """
    if len(password) < MIN_LENGTH:
        raise Invalid(
            Sentence(
                "password-too-short",
                "The password has {length} characters. Choose at least {least}: a few words are best.",
                length=len(password),
                least=MIN_LENGTH,
            )
        )
    if len(password) > MAX_LENGTH:
        raise Invalid(
            Sentence("password-too-long", "The password is longer than {most} characters. Choose a shorter one.", most=MAX_LENGTH)
        )
    if len(set(password)) < 4 or name.lower() in password.lower():
        raise Invalid(
            Sentence(
                "password-too-easy",
                "The password is too easy to guess. Choose a few words that have nothing to do with the name.",
            )
        )


def hashed(password: str) -> str:
    """Returns the Argon2id hash of a password."""
    with CONCURRENT_HASHES:
        return _hasher().hash(password)


def is_right(password: str, stored_hash: str | None) -> bool:
    """Returns True if `password` matches `stored_hash`.

    stored_hash: None for a user without a password: returns False, after the same computing time.
    """
    from argon2.exceptions import InvalidHashError, VerificationError

    with CONCURRENT_HASHES:
        try:
            _hasher().verify(stored_hash or _placeholder_hash(), password[:MAX_LENGTH])
        except (VerificationError, InvalidHashError):
            return False
    return stored_hash is not None
