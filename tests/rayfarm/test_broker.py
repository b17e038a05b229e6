"""Tests of the farm's own Redis: which server is used, where it listens, and what clients can do without the password."""

from __future__ import annotations

import socket
import time
from pathlib import Path

import pytest
import redis

from rayfarm.errors import CommandError
from rayfarm.local import broker
from service.access.redis_release import parse_version_output
from tests.helpers import running_redis


def program(folder: Path, name: str, version: str) -> Path:
    made = folder / name
    made.write_text(f"#!/bin/sh\necho '{version} sha=0:0'\n")
    made.chmod(0o755)
    return made


def test_wheel_is_preferred_to_flawed_servers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program(tmp_path, "redis-server", "Redis server v=6.2.14")
    monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
    found = broker.find_server()
    assert found.parent != tmp_path
    assert broker.server_release(found).flaw is None
    newer = program(tmp_path, "valkey-server", "Valkey server v=9.9.9")
    assert broker.find_server() == newer


def test_flawed_server_is_used_if_there_is_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    old = program(tmp_path, "redis-server", "Redis server v=7.0.15")
    monkeypatch.setattr(broker, "_programs", lambda: iter([old]))
    assert broker.find_server() == old
    assert parse_version_output("Redis server v=7.0.15").flaw is not None


def test_server_can_be_chosen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RAYFARM_REDIS_SERVER", str(flawed := program(tmp_path, "my-redis", "Redis server v=7.0.15")))
    assert broker.find_server() == flawed
    for version, said in (
        ("Redis server v=6.0.16", r"is Redis 6.0.16; a farm needs Redis 6.2"),
        ("Dragonfly", "not a Redis or Valkey"),
    ):
        wrong = program(tmp_path, f"server-{len(version)}", version)
        monkeypatch.setenv("RAYFARM_REDIS_SERVER", str(wrong))
        with pytest.raises(CommandError, match=said):
            broker.find_server()


@pytest.mark.parametrize(
    ("host", "bound"),
    [
        ("127.0.0.1", "127.0.0.1"),
        ("localhost", "127.0.0.1"),
        ("::1", "127.0.0.1 -::1"),
        ("10.1.2.3", "127.0.0.1 10.1.2.3"),
        ("fd00::7", "127.0.0.1 fd00::7"),
        ("0.0.0.0", "0.0.0.0"),
        ("::", "0.0.0.0 -::"),
    ],
)
def test_redis_listens_on_farm_addresses_only(tmp_path: Path, host: str, bound: str) -> None:
    broker.write_config(tmp_path / "redis.conf", host, 1, "secret")
    assert f"bind {bound}" in (tmp_path / "redis.conf").read_text().splitlines()


def test_unauthenticated_client_cannot_fill_memory(tmp_path: Path) -> None:
    server = running_redis(tmp_path)
    with server, redis.Redis.from_url(server.url) as store:
        before = store.info("memory")["used_memory"]
        floods = (b"PING\r\n" * 20_000, b"*3\r\n$4\r\nAUTH\r\n$400000000\r\n" + bytes(1 << 20), b"x" * (1 << 20))
        clients = [(socket.create_connection(("127.0.0.1", server.port), timeout=1), flood) for flood in floods for _ in range(2)]
        until = time.monotonic() + 3
        while clients and time.monotonic() < until:
            for each in list(clients):
                try:
                    each[0].sendall(each[1])
                except OSError:
                    each[0].close()
                    clients.remove(each)
        assert store.info("memory")["used_memory"] - before < 20 << 20
        for client, _ in clients:
            client.close()
        assert store.set("works", b"1")


def test_data_folder_may_have_any_name(tmp_path: Path) -> None:
    """Data folders with spaces in their path work, such as ~/My Projects or ~/Library/Application Support."""
    folder = tmp_path / 'Application Support "ü" \\n'
    folder.mkdir()
    server = running_redis(folder)
    server.start()
    try:
        with redis.Redis.from_url(server.url) as store:
            assert store.config_get("dir") == {"dir": str(folder)}
    finally:
        server.stop()


def test_oversized_value_is_rejected_before_transfer(tmp_path: Path) -> None:
    server = running_redis(tmp_path)
    with server, redis.Redis.from_url(server.url) as store:
        connection = store.connection_pool.get_connection()
        connection.send_packed_command([b"*3\r\n$3\r\nSET\r\n$1\r\na\r\n$%d\r\n" % (broker.LARGEST_VALUE + 1)])
        with pytest.raises(redis.ResponseError, match="invalid bulk length"):
            connection.read_response()
        connection.disconnect()
        assert store.set("works", bytes(1 << 20))
