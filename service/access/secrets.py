"""Secrets of programs and browsers: 256 random bits, of which the service stores only a hash.

A plain hash is sufficient for these, since they cannot be guessed; for passwords see service.access.passwords.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets

__all__ = ["fingerprint", "is_same", "new_secret"]

MOST = 512  # characters of a secret that are hashed


def new_secret(kind: str) -> str:
    """Returns a new secret. Its prefix names its kind, so that a leaked one is recognised."""
    return f"rayfarm-{kind}-{secrets.token_urlsafe(32)}"


def fingerprint(secret: str) -> str:
    """Returns the SHA-256 of a secret in hexadecimal, which is stored in its place."""
    return hashlib.sha256(secret[:MOST].encode("utf-8", "surrogatepass")).hexdigest()


def is_same(shown: str, known: str) -> bool:
    """Compares two secrets in constant time."""
    return hmac.compare_digest(fingerprint(shown), fingerprint(known))
