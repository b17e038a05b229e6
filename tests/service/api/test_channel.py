"""Tests of workers that reach only the service: its channel, and the worker's relay, with a real Redis behind the service."""

from __future__ import annotations

import random
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
import redis
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from protocol.channel import CHANNEL_MESSAGES, CHANNEL_PATH, CHUNK_BYTES, ChannelOpen, ChannelRefused
from protocol.contract import RESULTS, Result, worker_key
from protocol.lifeline import connected, lifeline
from protocol.websocket import read_service
from tests.helpers import running_redis
from tests.service.conftest import TOKEN, Service, until
from tests.service.peer_worker import PeerWorker, expected_digest
from tests.slow_line import held_up
from worker.exchange.relay_process import RelayProcess
from worker.exchange.results import ResultStream

PING = b"*1\r\n$4\r\nPING\r\n"


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, redis_server: running_redis) -> Iterator[Service]:
    service = Service(tmp_path_factory.mktemp("channel") / "data", redis_server)
    yield service
    service.stop()


@pytest.fixture(scope="module")
def relay(service: Service) -> Iterator[RelayProcess]:
    relay = RelayProcess(service.url, TOKEN)
    yield relay
    relay.stop()


def worker_token(service: Service) -> dict[str, str]:
    owner = {"Authorization": f"Bearer {(service.options['data'] / 'owner-token').read_text().strip()}"}
    return dict(
        service.http.post("/api/tokens", json={"name": "home", "role": "worker"}, headers=owner).raise_for_status().json()
    )


def join(service: Service, token: str) -> dict[str, Any]:
    answer = httpx.get(f"{service.url}/api/farm/join?transport=https", headers={"Authorization": f"Bearer {token}"})
    return dict(answer.raise_for_status().json())


@contextmanager
def channel(service: Service, token: str = TOKEN) -> Iterator[ClientConnection]:
    url = f"{service.url.replace('http', 'ws')}{CHANNEL_PATH}"
    with connect(url, additional_headers={"Authorization": f"Bearer {token}"}, compression=None) as opened:
        yield opened


def refusal(opened: ClientConnection) -> ChannelRefused:
    """Returns the last message before the service closes the channel."""
    message = None
    with pytest.raises(ConnectionClosed):
        while True:
            received = opened.recv(timeout=20)
            message = read_service(received, CHANNEL_MESSAGES) if isinstance(received, str) else message
    assert isinstance(message, ChannelRefused)
    return message


def test_job_has_the_same_digest_over_https(service: Service, relay: RelayProcess) -> None:
    with PeerWorker(relay.redis_url, service.url, TOKEN, "home", transport="https") as worker:
        job = service.submit(service.ready_scene())
        until(lambda: service.job(job)["state"] == "finished", "the job is finished")
        assert service.digest(job) == expected_digest()
        assert worker.batches
        (listed,) = service.http.get("/api/workers").json()
    assert listed["transport"] == "https"


def test_relay_needs_its_password(service: Service, relay: RelayProcess) -> None:
    with (
        redis.Redis.from_url(f"redis://:wrong@{relay.redis_url.rpartition('@')[2]}", retry=None) as store,
        pytest.raises(redis.ResponseError, match="Only the worker that started it"),
    ):
        store.ping()


def test_worker_without_redis_gets_no_address_of_it(service: Service) -> None:
    token = worker_token(service)
    answer = join(service, token["secret"])
    assert (answer["redis_url"], answer["data_dir"], answer["name_suffix"]) == ("", "", f".{token['id']}")


def test_wrong_token_is_refused(service: Service) -> None:
    wrong = RelayProcess(service.url, "wrong")
    try:
        with redis.Redis.from_url(wrong.redis_url, retry=None) as store, pytest.raises(redis.RedisError, match="this token"):
            store.ping()
    finally:
        wrong.stop()


def test_revoked_token_ends_open_channels(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.http.gate.REAUTHORIZE_EVERY_S", 0.0)
    token = worker_token(service)
    with channel(service, token["secret"]) as opened:
        assert isinstance(read_service(opened.recv(timeout=20), CHANNEL_MESSAGES), ChannelOpen)
        owner = {"Authorization": f"Bearer {(service.options['data'] / 'owner-token').read_text().strip()}"}
        service.http.delete(f"/api/tokens/{token['id']}", headers=owner).raise_for_status()
        with pytest.raises(ConnectionClosed):
            for _ in range(1000):
                opened.send(PING)
                opened.recv(timeout=20)


def test_commands_of_others_are_refused_and_not_executed(service: Service) -> None:
    token = worker_token(service)
    relay = RelayProcess(service.url, token["secret"])
    mine = f"home.{token['id']}"
    try:
        for command in (
            ("GET", worker_key("peer")),
            ("LPUSH", "rayfarm.render.test-kind", "{}"),
            ("XADD", RESULTS, "*", "event", '{"type": "batch", "worker": "peer"}'),
            ("FLUSHALL",),
        ):
            with redis.Redis.from_url(relay.redis_url, retry=None) as store:
                assert store.get(worker_key(mine)) is None
                with pytest.raises(redis.RedisError, match=r"HTTPS|name of the worker"):
                    store.execute_command(*command)
        with redis.Redis.from_url(service.options["redis_url"]) as store:
            assert store.llen("rayfarm.render.test-kind") == 0
    finally:
        relay.stop()


@pytest.mark.parametrize(
    ("sent", "sentence"),
    [
        (b"GET / HTTP/1.1\r\n\r\n", "not a Redis command"),
        (b"*2\r\n$4\r\nXADD\r\n$99999999\r\n", "at most"),
        (b"*1\r\n$7\r\nMONITOR\r\n", "may not send Redis's command MONITOR"),
        (PING * (CHUNK_BYTES // len(PING) + 1), "at most 65536"),  # parsing megabytes at once would delay all other requests
    ],
)
def test_odd_bytes_end_the_channel_with_a_sentence(service: Service, sent: bytes, sentence: str) -> None:
    with channel(service) as opened:
        assert isinstance(read_service(opened.recv(timeout=20), CHANNEL_MESSAGES), ChannelOpen)
        opened.send(PING)
        assert opened.recv(timeout=20) == b"+PONG\r\n"
        opened.send(sent)
        assert sentence in refusal(opened).detail


def test_incomplete_commands_have_limited_memory(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.access.worker_channels.MAX_BUFFERED_BYTES", 100_000)
    with channel(service) as opened:
        opened.send(b"*2\r\n$4\r\nXADD\r\n$200000\r\n" + bytes(50_000))
        opened.send(bytes(50_000))  # above the limit with the first; another could meet a closed connection
        assert "sent again" in refusal(opened).detail
        until(lambda: service.farm.channels.buffered == 0, "its memory is free again")


def test_farm_may_refuse_workers_over_https(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service.farm.settings, "https_workers", False)
    assert "channel" not in join(service, TOKEN)
    with channel(service) as opened:
        assert "RAYFARM_HTTPS_WORKERS" in refusal(opened).detail


def test_channel_ends_with_its_connection_to_redis(service: Service) -> None:
    with channel(service) as opened, redis.Redis.from_url(service.options["redis_url"]) as store:
        assert isinstance(read_service(opened.recv(timeout=20), CHANNEL_MESSAGES), ChannelOpen)
        opened.send(b"*3\r\n$6\r\nCLIENT\r\n$7\r\nSETNAME\r\n$4\r\nmine\r\n")
        assert opened.recv(timeout=20) == b"+OK\r\n"
        (client,) = (each for each in store.client_list() if each["name"] == "mine")
        store.client_kill_filter(_id=client["id"])
        with pytest.raises(ConnectionClosed):
            opened.recv(timeout=20)


def test_connection_has_the_name_of_a_worker_only_with_its_report(service: Service) -> None:
    peer = lifeline("peer").encode()
    with channel(service) as opened, redis.Redis.from_url(service.options["redis_url"]) as store:
        opened.send(b"*3\r\n$6\r\nCLIENT\r\n$7\r\nSETNAME\r\n$%d\r\n%s\r\n" % (len(peer), peer))
        opened.send(PING)
        assert "may not send" in refusal(opened).detail
        opened.close()
    with channel(service) as opened, redis.Redis.from_url(service.options["redis_url"]) as store:
        opened.send(b"*3\r\n$6\r\nCLIENT\r\n$7\r\nSETNAME\r\n$%d\r\n%s\r\n" % (len(peer), peer))
        for _ in range(5):
            assert connected(store, ["peer"]) == set()  # a worker that has ended would seem to be slow, and keep its batches
            time.sleep(0.05)


def test_silent_redis_is_reported(service: Service, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(service.farm.channels, "_redis_url", f"unix://{tmp_path}/none.sock")
    with channel(service) as opened:
        said = refusal(opened)
    assert said.passing and "Redis does not answer" in said.detail


@pytest.mark.long  # half a minute of waiting
def test_large_results_arrive_over_a_slow_line(service: Service) -> None:
    with held_up(service.url, late_s=0.2, rate=100e3) as slow:
        relay = RelayProcess(slow, TOKEN)
        try:
            stream = ResultStream(relay.redis_url, piece_timeout_s=10.0)
            sums = random.Random(1).randbytes(2_000_000)  # takes twice the timeout
            assert stream.send(Result({"type": "batch-failed", "worker": "home", "batch": "none"}, sums), timeout_s=0.0)
            stream.redis.close()
        finally:
            relay.stop()


def test_relay_reconnects_after_a_restart(service: Service, relay: RelayProcess) -> None:
    with redis.Redis.from_url(relay.redis_url) as store:
        assert store.ping()
        port = service.port
        service.stop()
        with pytest.raises(redis.RedisError):
            store.ping()
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("tests.service.conftest.free_port", lambda host: port)
            service.start()
        deadline = time.monotonic() + 20
        while True:
            try:
                assert store.ping()
                return
            except redis.RedisError:
                assert time.monotonic() < deadline
                time.sleep(0.1)
