"""Secrets of programs and browsers: 256 random bits each. The service stores only their hashes.

A fast hash suffices because these secrets cannot be guessed; passwords need a slow one (service.access.passwords).
"""

from __future__ import annotations

import hashlib
import hmac
import secrets

__all__ = ["fingerprint", "is_same", "new_secret"]

MAX_SECRET_LENGTH = 512  # characters of a secret that are hashed


def new_secret(kind: str) -> str:
    """Returns a new random secret. Its prefix is its kind, so that a leaked one can be recognised."""
    return f"rayfarm-{kind}-{secrets.token_urlsafe(32)}"


def fingerprint(secret: str) -> str:
    """Returns the SHA-256 of a secret in hexadecimal; it is stored instead of the secret."""
    return hashlib.sha256(secret[:MAX_SECRET_LENGTH].encode("utf-8", "surrogatepass")).hexdigest()


def is_same(given: str, expected: str) -> bool:
    """Returns True if two secrets are equal, compared in constant time."""
    return hmac.compare_digest(fingerprint(given), fingerprint(expected))
