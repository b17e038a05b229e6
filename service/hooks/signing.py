"""Message signatures as defined by the Standard Webhooks specification 1.0. Receivers use them to verify a message's origin.

https://github.com/standard-webhooks/standard-webhooks lists verification libraries for most languages.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import hmac
import secrets

from renderer.sentences import Sentence

__all__ = ["headers", "new_secret", "secret_bytes"]

PREFIX = "whsec_"
LEAST_BYTES, MOST_BYTES = 24, 64


def new_secret() -> str:
    """Returns a new signing secret of 32 random bytes, encoded as text."""
    return PREFIX + base64.b64encode(secrets.token_bytes(32)).decode()


def secret_bytes(secret: str) -> bytes:
    """Decodes a signing secret to bytes. Raises ValueError if it is malformed."""
    try:
        key = base64.b64decode(secret.removeprefix(PREFIX), validate=True)
    except binascii.Error:
        key = b""
    if not secret.startswith(PREFIX) or not LEAST_BYTES <= len(key) <= MOST_BYTES:
        raise ValueError(
            Sentence(
                "webhook-secret-form",
                "the secret of a webhook is {prefix} followed by {least} to {most} random bytes in base64",
                prefix=PREFIX,
                least=LEAST_BYTES,
                most=MOST_BYTES,
            )
        )
    return key


def headers(secret: str, id: str, timestamp: int, body: bytes) -> dict[str, str]:
    """Returns the HTTP headers that sign a message. id: of the message. timestamp: Unix time of this attempt, in seconds."""
    signed = hmac.new(secret_bytes(secret), f"{id}.{timestamp}.".encode() + body, hashlib.sha256).digest()
    return {
        "webhook-id": id,
        "webhook-timestamp": str(timestamp),
        "webhook-signature": f"v1,{base64.b64encode(signed).decode()}",
    }
