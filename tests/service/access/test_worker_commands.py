"""Tests of the Redis commands that a worker over HTTPS may send."""

from __future__ import annotations

import json
import time
from typing import Any

import pytest

from protocol.channel import name_suffix
from protocol.contract import RESULTS, WorkerReport, recall_key, worker_key
from protocol.lifeline import lifeline
from protocol.redis_commands import Command, CommandError
from protocol.view_parts import ANSWERS_TTL_S, MAX_ANSWERS, VIEW_ANSWERS
from service.access.worker_commands import WorkerCommands

KIND = "0.2.0-abc-x86-64-v3"
RENDER = f"rayfarm.render.{KIND}"
ME, OTHER = "attic.key1", "attic.key2"


def report(name: str = ME, **more: Any) -> bytes:
    return WorkerReport(name, "host", 1, 2, "cpu", KIND, "ready", time.time(), **{"transport": "https", **more}).to_bytes()


def result(**more: Any) -> bytes:
    return json.dumps({"type": "batch", "batch": "b", "worker": ME, **more}).encode()


def check(*arguments: str | bytes, rules: WorkerCommands | None = None) -> None:
    encoded = [each.encode() if isinstance(each, str) else each for each in arguments]
    (rules or WorkerCommands(name_suffix("key1"))).check(Command(encoded, b""))


@pytest.mark.parametrize(
    "command",
    [
        ("HELLO", "3"),
        ("CLIENT", "SETINFO", "LIB-NAME", "redis-py"),
        ("BRPOP", RENDER, f"{RENDER}.needs.12", f"rayfarm.help.{ME}", f"rayfarm.help.{ME}\x06\x163", "1"),
        ("BRPOP", *(f"{RENDER}.needs.{n}\x06\x163" for n in range(400)), "1"),
        ("SADD", f"_kombu.binding.{RENDER}", f"{RENDER}\x06\x16\x06\x16{RENDER}"),
        ("LPUSH", f"rayfarm.help.{ME}", "{}"),
        ("BRPOP", f"rayfarm.card-view.{ME}", "1"),
        ("SET", worker_key(ME), report(), "EX", "6"),
        ("GET", worker_key(ME)),
        ("EXISTS", f"rayfarm:order:{ME}"),
        ("EXISTS", recall_key("m")),
        ("DEL", worker_key(ME), f"rayfarm.help.{ME}"),
        ("XADD", RESULTS, "*", "event", result(), "sums", b"\x00" * 1000),
        ("XADD", RESULTS, "*", "event", '{"type": "wake"}'),
        ("RPUSH", VIEW_ANSWERS, b"\x00"),
        ("LTRIM", VIEW_ANSWERS, str(-MAX_ANSWERS), "-1"),
        ("EXPIRE", VIEW_ANSWERS, str(ANSWERS_TTL_S)),
    ],
)
def test_commands_of_workers_are_permitted(command: tuple[str | bytes, ...]) -> None:
    check(*command)


@pytest.mark.parametrize(
    "command",
    [
        ("HELLO", "3", "AUTH", "default", "guess"),
        ("AUTH", "guess"),
        ("CLIENT", "LIST"),
        ("CONFIG", "GET", "*"),
        ("EVAL", "return 1", "0"),
        ("KEYS", "*"),
        ("MONITOR",),
        ("FLUSHALL",),
        ("SUBSCRIBE", "x"),
        ("XREAD", "STREAMS", RESULTS, "0"),
        ("XADD", "rayfarm:other", "*", "event", result()),
        ("LRANGE", RENDER, "0", "-1"),
        ("LPUSH", RENDER, "{}"),  # a task for another worker
        ("RPUSH", f"rayfarm.help.{OTHER}", "{}"),
        ("BRPOP", f"rayfarm.help.{OTHER}", "1"),
        ("BRPOP", f"rayfarm.card.{OTHER}", "1"),
        ("BRPOP", f"rayfarm.card-view.{OTHER}", "1"),
        ("BRPOP", f"rayfarm.prepare.{KIND}.of.{OTHER}", "1"),
        ("BRPOP", RENDER, "0"),  # waits for ever
        ("SADD", f"_kombu.binding.{RENDER}", f"{RENDER}\x06\x16\x06\x16rayfarm.help.{ME}"),  # would redirect batches
        ("GET", worker_key(OTHER)),
        ("SET", worker_key(OTHER), report(OTHER), "EX", "6"),
        ("SET", worker_key(ME), report(OTHER), "EX", "6"),
        ("SET", worker_key(ME), report(transport=""), "EX", "6"),
        ("SET", worker_key(ME), report()),  # would remain for ever
        ("SET", worker_key(ME), b"[]", "EX", "6"),
        ("SET", f"rayfarm:order:{ME}", "x", "EX", "6"),
        ("SET", recall_key("m"), "1"),
        ("GET", worker_key("x" * 600 + ".key1")),
        ("DEL", worker_key(ME), worker_key(OTHER)),
        ("XADD", RESULTS, "*", "event", result(worker=OTHER)),
        ("XADD", RESULTS, "*", "event", result(worker=None)),
        ("XADD", RESULTS, "*", "event", result(parts=[["b", 0, 1, 0.1, OTHER]])),
        ("XADD", RESULTS, "*", "event", '{"type": "wake", "worker": 1}'),
        ("XADD", RESULTS, "*", "event", b"[" * 100_000),
        ("XADD", RESULTS, "1-1", "event", result()),
        ("EXPIRE", VIEW_ANSWERS, "100000"),
        ("EXPIRE", VIEW_ANSWERS, "1"),
        ("LTRIM", VIEW_ANSWERS, "1", "0"),
        ("XADD", RESULTS, "*", "event", b'{"worker": "attic.key1", "type": "' + b"x" * (9 << 20) + b'"}'),
    ],
)
def test_other_commands_are_refused_with_a_sentence(command: tuple[str | bytes, ...]) -> None:
    with pytest.raises(CommandError, match=r"^[A-Z].*\.$|lacks|object"):
        check(*command)


def test_farms_own_token_may_use_any_name() -> None:
    rules = WorkerCommands(name_suffix(None))
    check("SET", worker_key("cellar"), report("cellar"), "EX", "6", rules=rules)


def test_lifeline_must_be_of_the_worker_that_reports() -> None:
    rules = WorkerCommands(name_suffix("key1"))
    check("CLIENT", "SETNAME", lifeline(ME), rules=rules)
    check("SET", worker_key(ME), report(), "EX", "6", rules=rules)
    check("CLIENT", "SETNAME", lifeline(OTHER), rules=rules)
    with pytest.raises(CommandError):
        check("SET", worker_key(ME), report(), "EX", "6", rules=rules)
    check("CLIENT", "SETNAME", lifeline(OTHER), rules=(again := WorkerCommands(name_suffix("key1"))))
    with pytest.raises(CommandError):
        check("PING", rules=again)
