"""Signatures by the Standard Webhooks specification, version 1.0, with which receivers verify that a message is from the farm.

https://github.com/standard-webhooks/standard-webhooks has libraries for verification in most languages.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import hmac
import secrets

__all__ = ["headers", "key_of", "new_secret"]

PREFIX = "whsec_"
LEAST_BYTES, MOST_BYTES = 24, 64


def new_secret() -> str:
    """Returns a new secret of 32 random bytes."""
    return PREFIX + base64.b64encode(secrets.token_bytes(32)).decode()


def key_of(secret: str) -> bytes:
    """Returns the bytes of a secret. Raises ValueError if it is malformed."""
    try:
        key = base64.b64decode(secret.removeprefix(PREFIX), validate=True)
    except binascii.Error:
        key = b""
    if not secret.startswith(PREFIX) or not LEAST_BYTES <= len(key) <= MOST_BYTES:
        raise ValueError(f"a webhook's secret is {PREFIX} and {LEAST_BYTES} to {MOST_BYTES} random bytes in base64")
    return key


def headers(secret: str, id: str, timestamp: int, body: bytes) -> dict[str, str]:
    """Returns the headers of a signed message. timestamp: Unix time in seconds of this attempt."""
    signed = hmac.new(key_of(secret), f"{id}.{timestamp}.".encode() + body, hashlib.sha256).digest()
    return {
        "webhook-id": id,
        "webhook-timestamp": str(timestamp),
        "webhook-signature": f"v1,{base64.b64encode(signed).decode()}",
    }
