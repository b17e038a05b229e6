"""Tests of detecting whether Redis or Valkey has a release with the security fixes that a farm relies on."""

from __future__ import annotations

import pytest

from service.access.redis_release import parse_version_output, release_of


@pytest.mark.parametrize(
    ("told", "flawed"),
    [
        ("Redis server v=6.2.14 sha=0:0 malloc=jemalloc", True),
        ("Redis server v=6.2.20 sha=0:0", False),
        ("Redis server v=7.0.15 sha=0:0", True),
        ("Redis server v=7.4.6 sha=0:0", False),
        ("Redis server v=8.2.1 sha=0:0", True),
        ("Redis server v=8.2.3 sha=0:0", False),
        ("Redis server v=8.4.0 sha=0:0", False),
        ("Redis server v=8.10.0 sha=0:0", False),
        ("Valkey server v=8.1.3 sha=0:0", True),
        ("Valkey server v=8.1.10 sha=0:0", False),
        ("Valkey server v=9.0.0 sha=0:0", True),
        ("Valkey server v=9.1.2 sha=0:0", False),
        ("", True),
    ],
)
def test_releases_without_security_fixes_are_reported(told: str, flawed: bool) -> None:
    found = parse_version_output(told)
    assert (found.flaw is not None) == flawed
    if told and flawed:
        assert str(found) in str(found.flaw)


def test_valkey_release_is_read_from_its_own_field() -> None:
    assert str(release_of({"redis_version": "7.2.4", "server_name": "valkey", "valkey_version": "9.1.2"})) == "Valkey 9.1.2"
    assert str(release_of({"redis_version": "6.2.14"})) == "Redis 6.2.14"


def test_too_old_releases_are_detected() -> None:
    assert parse_version_output("Redis server v=6.0.16").is_too_old
    assert not parse_version_output("Valkey server v=7.2.4").is_too_old
