"""Tests of joining a farm: a worker joins in the background, retries, and gets a name that no other worker has."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
import redis

from protocol.contract import WorkerReport, worker_key
from tests.foreign_server import HTML, foreign_server
from tests.helpers import running_redis, wait_until
from worker import __main__ as program
from worker.exchange.errors import LinkError, NotAFarmError, RefusedError, TokenError, WorkerError
from worker.exchange.link import FarmAnswer, Link
from worker.joining import FarmJoin, check_redis, free_name


def report(name: str, pid: int, host: str = "here") -> WorkerReport:
    return WorkerReport(name, host, pid, 2, "cpu", "kind", "starting", time.time())


class Service(Link):
    """A substitute for the link to the service. `join` returns or raises the given answers in turn, then repeats the last."""

    def __init__(self, *answers: FarmAnswer | Exception) -> None:
        super().__init__("http://service.invalid", "token")
        self.answers = list(answers)

    def join(self, over_https: bool = False) -> FarmAnswer:
        answer = self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]
        if isinstance(answer, Exception):
            raise answer
        return answer


def joining(service: Service, said: list[str], redis_url: str | None = None) -> FarmJoin:
    return FarmJoin(service, redis_url, "vm", "here", lambda name: report(name, os.getpid()), said.append)


def test_join_waits_for_service_then_reports_starting(redis_url: str, store: redis.Redis) -> None:
    said: list[str] = []
    answer = FarmAnswer(redis_url, "instance", "")
    begun = joining(Service(LinkError("no answer"), LinkError("no answer"), answer), said)
    begun.begin()
    wait_until(lambda: store.get(worker_key("vm")) is not None, 5, "the report is there")
    joined = begun.finish(lambda: False)
    assert joined is not None
    assert (joined.farm, joined.redis_url, joined.name) == (answer, redis_url, "vm")
    assert said == ["waiting: no answer"]


class Relay:
    """A substitute for the relay, at the address of a real Redis."""

    redis_url = ""

    def __init__(self, service: str, token: str) -> None:
        self.is_stopped = False

    def is_running(self) -> bool:
        return not self.is_stopped

    def stop(self) -> None:
        self.is_stopped = True


@pytest.mark.parametrize("reaches_redis", [True, False])
def test_worker_joins_over_https_where_redis_is_out_of_reach(
    redis_url: str, store: redis.Redis, monkeypatch: pytest.MonkeyPatch, reaches_redis: bool
) -> None:
    monkeypatch.setattr("worker.joining.RelayProcess", Relay)
    monkeypatch.setattr(Relay, "redis_url", redis_url)
    told = redis_url if reaches_redis else "redis://127.0.0.1:1/0"
    begun = joining(Service(FarmAnswer(told, "instance", "", has_channel=True, name_suffix=".key")), said := [])
    begun.begin()
    wait_until(lambda: store.get(worker_key("vm" if reaches_redis else "vm.key")) is not None, 5, "the report is there")
    joined = begun.finish(lambda: False)
    assert joined is not None
    assert (joined.name, joined.relay is None) == (("vm", True) if reaches_redis else ("vm.key", False))
    assert [line.partition(",")[0] for line in said] == ([] if reaches_redis else ["joining over HTTPS"])


def test_rejection_ends_join() -> None:
    with pytest.raises(RefusedError):
        joining(Service(RefusedError("wrong token")), []).begin()
    later = joining(Service(LinkError("no answer"), RefusedError("wrong token")), [])
    later.begin()
    with pytest.raises(RefusedError):
        later.finish(lambda: False)


def test_waiting_join_can_be_stopped() -> None:
    waiting = joining(Service(LinkError("no answer")), [])
    waiting.begin()
    assert waiting.finish(lambda: True) is None


def test_name_in_use_gets_suffix(redis_url: str, store: redis.Redis) -> None:
    assert free_name("vm", redis_url, "here") == "vm"
    store.set(worker_key("vm"), report("vm", 1).to_bytes())  # process 1 is always alive
    assert free_name("vm", redis_url, "here") == "vm-2"
    store.set(worker_key("vm-2"), report("vm-2", 12345, host="elsewhere").to_bytes())
    assert free_name("vm", redis_url, "here") == "vm-3"


def test_name_of_dead_worker_is_reused(redis_url: str, store: redis.Redis) -> None:
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    store.set(worker_key("vm"), report("vm", dead.pid).to_bytes())
    assert free_name("vm", redis_url, "here") == "vm"


@pytest.mark.parametrize("refusal", [TokenError("no"), NotAFarmError("no"), RefusedError("no"), ZeroDivisionError("a fault")])
def test_unexpected_error_ends_join(refusal: Exception) -> None:
    later = joining(Service(LinkError("no answer"), refusal), [])
    later.begin()
    with pytest.raises(WorkerError):
        later.finish(lambda: False)


@pytest.mark.parametrize(
    "held", [b"", b"\xff\x00", b"[]", b"null", b'{"name": "vm"}', b'{"name": "vm", "pid": "x"}', b"[" * 9000]
)
def test_unreadable_report_reserves_name(redis_url: str, store: redis.Redis, held: bytes) -> None:
    store.set(worker_key("vm"), held)
    assert free_name("vm", redis_url, "here") == "vm-2"
    store.delete(worker_key("vm"))
    store.rpush(worker_key("vm"), b"a list")
    assert free_name("vm", redis_url, "here") == "vm-2"


def test_unknown_report_fields_are_ignored(redis_url: str, store: redis.Redis) -> None:
    data = json.loads(report("vm", 1).to_bytes()) | {"gpu": "yes", "colour": [1, 2]}
    store.set(worker_key("vm"), json.dumps(data))
    assert free_name("vm", redis_url, "here") == "vm-2"
    assert WorkerReport.from_bytes(json.dumps(data).encode()).pid == 1


def test_unusable_redis_is_retried_with_advice(tmp_path: Path) -> None:
    server = running_redis(tmp_path)
    server.start()
    said: list[str] = []
    try:
        wrong = server.url.replace(server.password, "wrong")
        for url, hint in (
            (wrong, "requires another password"),
            (f"redis://127.0.0.1:{server.port}/0", "requires another password"),
            ("redis://127.0.0.1:9/0", "must be reachable"),
        ):
            with pytest.raises(LinkError, match=hint) as error:
                check_redis(url)
            assert "wrong@" not in str(error.value)
        with redis.Redis.from_url(server.url) as store:
            store.config_set("maxmemory", "1")
            with pytest.raises(LinkError, match="refuses reports"):
                check_redis(server.url)
            waiting = joining(Service(FarmAnswer(server.url, "instance", "")), said)
            waiting.begin()
            wait_until(lambda: bool(said), 5, "it says that it waits")
            store.config_set("maxmemory", "0")
        joined = waiting.finish(lambda: False)
        assert joined is not None
        assert joined.name == "vm"
    finally:
        server.stop()
    assert len(said) == 1, "said once, however often it is tried"


def test_http_server_in_place_of_redis_is_detected() -> None:
    with foreign_server(HTML) as port, pytest.raises(LinkError, match=r"not a Redis server|no Redis server"):
        check_redis(f"redis://127.0.0.1:{port}/0")
    with foreign_server(b"") as port, pytest.raises(LinkError, match=r"not a Redis server|no Redis server"):
        check_redis(f"redis://127.0.0.1:{port}/0")


def test_worker_of_a_site_joins_with_redis() -> None:
    for transport, site, used in (("auto", "attic", "redis"), ("auto", "", "auto"), ("https", "", "https")):
        assert program._transport(argparse.Namespace(transport=transport, site=site)) == used


def test_invalid_settings_are_rejected_at_start(monkeypatch: pytest.MonkeyPatch) -> None:
    def check(**changed: object) -> None:
        plain = {"redis": None, "tag": [], "hours": "", "idle": 0.0, "nice": None, "memory": 0.0, "site": "", "blender": None}
        plain |= {"transport": "auto"}
        program._check_settings(argparse.Namespace(**{**plain, **changed}))

    check()
    for name, value, sentence in (
        ("redis", "nonsense", "RAYFARM_REDIS_URL"),
        ("hours", "at noon", "noon"),
        ("tag", ["two words"], "--tag: 'two words' is not a tag"),
        ("memory", -1.0, "memory"),
        ("site", "Two Words", "--site: 'Two Words' is not a site name"),
        ("tag", ["blender"], "give --blender"),
    ):
        with pytest.raises(RefusedError, match=sentence):
            check(**{name: value})
    for name, value in (("redis", "redis://127.0.0.1/0"), ("site", "attic")):
        with pytest.raises(RefusedError, match="--transport https"):
            check(transport="https", **{name: value})
    monkeypatch.setenv("RAYFARM_PREPARE_MEMORY_MB", "much")
    with pytest.raises(RefusedError, match="RAYFARM_PREPARE_MEMORY_MB"):
        check(redis="redis://127.0.0.1/0")
