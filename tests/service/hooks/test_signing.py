"""Tests of webhook signatures, against the specification's example."""

from __future__ import annotations

import base64

import pytest

from service.hooks.signing import headers, new_secret, secret_bytes

# The test vector of the specification's libraries.
SECRET = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw"
ID, TIMESTAMP, BODY = "msg_p5jXN8AQM9LWM0D4loKWxJek", 1614265330, b'{"test": 2432232314}'


def test_specification_example() -> None:
    told = headers(SECRET, ID, TIMESTAMP, BODY)
    assert told["webhook-signature"] == "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE="
    assert (told["webhook-id"], told["webhook-timestamp"]) == (ID, str(TIMESTAMP))


@pytest.mark.parametrize("changed", [(ID + "x", TIMESTAMP, BODY), (ID, TIMESTAMP + 1, BODY), (ID, TIMESTAMP, BODY + b" ")])
def test_signature_covers_all_fields(changed: tuple[str, int, bytes]) -> None:
    assert headers(SECRET, *changed)["webhook-signature"] != headers(SECRET, ID, TIMESTAMP, BODY)["webhook-signature"]


def test_new_secrets_are_valid() -> None:
    assert len(secret_bytes(new_secret())) == 32
    assert new_secret() != new_secret()


@pytest.mark.parametrize("secret", ["", "abc", "whsec_", "whsec_!!", "whsec_" + base64.b64encode(b"short").decode(), SECRET[6:]])
def test_invalid_secrets_are_rejected(secret: str) -> None:
    with pytest.raises(ValueError, match="whsec_"):
        secret_bytes(secret)
