"""Secrets kept by programs and browsers: made of 256 random bits, and known to the service by their hash alone.

A plain hash is enough for these, as nobody can try them all; passwords are another matter (service.access.passwords).
"""

from __future__ import annotations

import hashlib
import hmac
import secrets

__all__ = ["fingerprint", "is_same", "new_secret"]

MOST = 512  # characters of anything that may be one


def new_secret(kind: str) -> str:
    """A new one. Its beginning says what it is, so that one which lies somewhere in the open is recognised."""
    return f"rayfarm-{kind}-{secrets.token_urlsafe(32)}"


def fingerprint(secret: str) -> str:
    """What is kept of a secret: its SHA-256 in hexadecimal."""
    return hashlib.sha256(secret[:MOST].encode("utf-8", "surrogatepass")).hexdigest()


def is_same(shown: str, known: str) -> bool:
    """Whether what is shown is what is known, in a time that says nothing about how much of it is right."""
    return hmac.compare_digest(fingerprint(shown), fingerprint(known))
