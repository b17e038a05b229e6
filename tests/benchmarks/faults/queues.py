"""Faults of the messages in Redis: lost, duplicated, forged, or from another release."""

from __future__ import annotations

import base64
import json
import time
from typing import Any

from protocol.contract import HEARTBEAT_TTL_S, WORKER_KEYS, worker_key
from tests.benchmarks.faults.attack import Attack, kind
from tests.helpers import ROOT

OLD = json.loads((ROOT / "tests" / "data" / "release-0.1.0.json").read_text())


def lists(attack: Attack) -> list[bytes]:
    """Returns the names of Redis queues that hold messages."""
    store = attack.ground.store()
    return [key for key in store.scan_iter("rayfarm.*") if store.type(key) == b"list"]


@kind("Redis loses all it has (FLUSHALL)")
def flush(attack: Attack) -> None:
    attack.ground.store().flushall()
    attack.over()


@kind("answers come again")
def answers_again(attack: Attack) -> None:
    store = attack.ground.store()
    for _ in range(attack.draw.randint(1, 4)):
        for fields in list(attack.stream.latest):
            attack.stream.forge(store, fields)
        attack.pause(0.0, 0.3)
    attack.over()


@kind("batches are in the queue twice")
def batches_again(attack: Attack) -> None:
    store = attack.ground.store()
    for _ in range(4):
        for key in lists(attack):
            for message in store.lrange(key, 0, -1):  # type: ignore[union-attr]
                store.rpush(key, message)
        attack.pause(0.05, 0.3)
    attack.over()


@kind("queues are deleted")
def queues_deleted(attack: Attack) -> None:
    store = attack.ground.store()
    for _ in range(attack.draw.randint(1, 3)):
        store.delete("unacked", "unacked_index", *lists(attack))
        attack.pause(0.0, 0.5)
    attack.over()


@kind("workers' reports are deleted")
def reports_deleted(attack: Attack) -> None:
    store = attack.ground.store()
    store.delete("nobody", *store.scan_iter(WORKER_KEYS))
    attack.over()


@kind("garbage among the answers")
def garbage_in_stream(attack: Attack) -> None:
    store, draw = attack.ground.store(), attack.draw
    made: list[dict[bytes, bytes]] = [
        {b"event": draw.randbytes(200)},
        {b"event": b"{"},
        {b"event": b"[" * 5000},
        {b"other": b"1"},
        {b"event": json.dumps({"type": "batch", "job": attack.job}).encode(), b"sums": draw.randbytes(1000)},
    ]
    for fields in list(attack.stream.latest)[-8:]:
        event: dict[str, Any] = json.loads(fields[b"event"])
        other = [name for name in fields if name != b"event"]
        made += [fields | {name: fields[name][: len(fields[name]) // 2] for name in other}]
        made += [fields | {name: draw.randbytes(len(fields[name])) for name in other}]
        for wrong in (
            {"tile": [1, 1, 3, 3]},
            {"frame": 12},
            {"first": -4},
            {"count": 1 << 40},
            {"job": "gone"},
            {"seconds": "x"},
        ):
            made.append(fields | {b"event": json.dumps(event | wrong).encode()})
    for fields in made:
        attack.stream.forge(store, fields)
    attack.over()


@kind("garbage in the queues")
def garbage_in_queue(attack: Attack) -> None:
    store, draw = attack.ground.store(), attack.draw
    kinds = {json.loads(store.get(key))["kind"] for key in store.scan_iter(WORKER_KEYS) if store.type(key) == b"string"}  # type: ignore[arg-type]
    empty = json.dumps({"body": "e30=", "headers": {}, "properties": {}}).encode()
    for kind_of_worker in kinds:
        key = f"rayfarm.render.{kind_of_worker}"
        held = list(store.lrange(key, 0, 0))  # type: ignore[arg-type]
        for message in (draw.randbytes(100), b"{}", b"[1, 2]", empty, *(m[: len(m) // 2] for m in held)):
            store.lpush(key, message)
    attack.over()


@kind("a worker of an older release, and what it says")
def version_skew(attack: Attack) -> None:
    store, draw = attack.ground.store(), attack.draw
    until = time.monotonic() + draw.uniform(1.0, 6.0)
    while time.monotonic() < until:
        said = OLD["report"] | {"name": "attic", "started": time.time()}
        store.set(worker_key("attic"), json.dumps(said), ex=HEARTBEAT_TTL_S)
        newer = said | {"name": "newer", "kind": "9.9.9-ffffffff-x86-64-v3", "gpus": [1], "mood": {"good": True}}
        store.set(worker_key("newer"), json.dumps(newer), ex=HEARTBEAT_TTL_S)
        for event in OLD["events"].values():
            # For this job only non-batch events are sent: an old batch was never requested, but its sums could be accepted.
            is_batch = event["type"] == "batch"
            fields = {b"event": json.dumps(event if is_batch else event | {"job": attack.job}).encode()}
            if is_batch:
                fields[b"sums"] = base64.b64decode(OLD["sums"])
            attack.stream.forge(store, fields)
        attack.stream.forge(store, {b"event": json.dumps({"type": "of a newer release", "job": attack.job}).encode()})
        time.sleep(0.5)
    attack.over()


@kind("Redis is full, then not")
def full(attack: Attack) -> None:
    store = attack.ground.store()
    before = store.config_get("maxmemory")["maxmemory"]  # type: ignore[index]
    store.config_set("maxmemory", 1)
    try:
        attack.pause(0.5, 8.0)
    finally:
        store.config_set("maxmemory", before)
    attack.over()
