"""Tests of applying the run-time settings ("terms") that the service requires of a worker."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from datetime import datetime
from types import SimpleNamespace
from typing import Any

import pytest
import redis

from protocol.contract import WorkerReport, pause_key
from protocol.terms import Offer, Terms, offer_key, terms_key
from tests.helpers import wait_until
from worker.heartbeat import Heartbeat
from worker.machine.process_tree import process_times
from worker.process import apply_terms, context
from worker.process.apply_terms import TermsKeeper, memory_limit
from worker.work.files import memory_budget

MONDAY_NOON = datetime(2026, 3, 2, 12, 0)


class Queues:
    """A substitute for Celery's consumer. It records the queues that are read, and how many messages may be fetched ahead."""

    def __init__(self, slots: int) -> None:
        self.taken = ["render", "prepare"]
        self.qos = SimpleNamespace(value=slots, increment_eventually=self._more, decrement_eventually=self._fewer)
        self.add_task_queue = self.taken.append
        self.cancel_task_queue = self.taken.remove

    def _more(self, n: int) -> None:
        self.qos.value += n

    def _fewer(self, n: int) -> None:
        self.qos.value -= n


@pytest.fixture(autouse=True)
def no_limit() -> Iterator[None]:
    yield
    TermsKeeper(1).refresh()
    assert memory_limit() == 0


@pytest.fixture
def heartbeat(redis_url: str, store: redis.Redis, monkeypatch: pytest.MonkeyPatch) -> Heartbeat:
    kept = TermsKeeper(4, ("gpu",), clock=lambda: MONDAY_NOON)
    worker = SimpleNamespace(redis_url=redis_url, name="w", kind="k", queues=["render", "prepare"], keeping=kept)
    monkeypatch.setattr(context, "_current", worker)
    return Heartbeat(Queues(4))


def ask(store: redis.Redis, heartbeat: Heartbeat, terms: Terms | bytes) -> Any:
    store.set(terms_key("w"), terms if isinstance(terms, bytes) else terms.to_bytes())
    return beat(heartbeat)


def beat(heartbeat: Heartbeat) -> Any:
    kept = heartbeat.worker.keeping
    assert kept is not None
    heartbeat.connection.send(WorkerReport("w", "host", 1, 4, "cpu", "k", "ready", 0.0), kept.offer(), [])
    heard = heartbeat.connection.receive(5.0)
    assert heard is not None
    heartbeat.latest = heard
    heartbeat._apply_terms()
    heartbeat._apply_pause()
    return heartbeat.consumer


def test_terms_are_applied_at_next_heartbeat(store: redis.Redis, heartbeat: Heartbeat) -> None:
    kept = heartbeat.worker.keeping
    assert kept is not None
    consumer = ask(store, heartbeat, Terms(slots=1, queues=("needs-a", "needs-b")))
    assert (consumer.qos.value, consumer.taken) == (1, ["render", "prepare", "needs-a", "needs-b"])
    assert kept.offer().queues == ("needs-a", "needs-b")
    ask(store, heartbeat, Terms(slots=9, queues=("needs-b",), hours="Mon 11:00-13:00"))
    assert (consumer.qos.value, consumer.taken, heartbeat.is_paused) == (4, ["render", "prepare", "needs-b"], False)
    ask(store, heartbeat, Terms(queues=("needs-b",), hours="Tue"))
    assert (consumer.taken, heartbeat.is_paused, kept.why) == ([], True, "Outside its hours: Tue.")
    assert kept.offer().queues == (), "it takes from nobody"
    store.set(pause_key("w"), "Paused by a user.")
    ask(store, heartbeat, Terms(queues=("needs-b",)))
    assert heartbeat.is_paused, "still by a person"
    store.delete(pause_key("w"))
    ask(store, heartbeat, Terms(queues=("needs-b",)))
    assert sorted(consumer.taken) == ["needs-b", "prepare", "render"]
    store.delete(terms_key("w"))
    beat(heartbeat)
    assert (kept.asked, consumer.taken) == (Terms(), ["render", "prepare"])


def test_invalid_terms_are_ignored_and_reported(store: redis.Redis, heartbeat: Heartbeat) -> None:
    kept = heartbeat.worker.keeping
    assert kept is not None
    ask(store, heartbeat, Terms(slots=2))
    for wrong in (b"[]", b"{", b'{"slots": 0}', b'{"hours": "Mondays"}', b'{"nice": "x"}'):
        ask(store, heartbeat, wrong)
        assert kept.trouble
        assert kept.slots_now == 2, "as before"
    beat(heartbeat)
    assert Offer.from_bytes(store.get(offer_key("w"))) == kept.offer()  # type: ignore[arg-type]
    ask(store, heartbeat, b'{"slots": 3, "of_another_release": 1}')
    assert (kept.slots_now, kept.trouble) == (3, None)


def test_start_settings_apply_without_terms() -> None:
    kept = TermsKeeper(4, own=Terms(hours="Mon", idle_minutes=5.0))
    kept.request(Terms(hours="").to_bytes())
    assert (kept.terms.hours, kept.terms.idle_minutes) == ("", 5.0)


def test_worker_pauses_while_user_is_present() -> None:
    kept = TermsKeeper(1)
    there = {"idle_s": 0.0}
    kept.presence = SimpleNamespace(idle_s=lambda: there["idle_s"], by=("load",))  # type: ignore[assignment]
    kept.request(Terms(idle_minutes=2.0).to_bytes())
    kept.refresh()
    assert kept.why == "Somebody is using this machine; it begins after 2 minutes without use."
    there["idle_s"] = 121.0
    kept.refresh()
    assert (kept.why, kept.offer().idle_by) == (None, ("load",))


def test_user_presence_is_known_at_start_of_hours() -> None:
    kept = TermsKeeper(1, clock=lambda: MONDAY_NOON)
    looked = []
    kept.presence = SimpleNamespace(idle_s=lambda: looked.append(1) or 0.0, by=("load",))  # type: ignore[assignment, func-returns-value]
    kept.request(Terms(hours="Tue", idle_minutes=2.0).to_bytes())
    kept.refresh()
    assert (kept.why, looked) == ("Outside its hours: Tue.", [1])


def test_worker_pauses_above_memory_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    used = {"bytes": 900}
    monkeypatch.setattr(apply_terms, "_memory_of_processes", lambda: used["bytes"])
    kept = TermsKeeper(1)
    kept.request(Terms(memory=1000).to_bytes())
    kept.refresh()
    assert (kept.why, memory_limit(), memory_budget()) == (None, 1000, 1000)
    kept._beats = 0
    used["bytes"] = 1001
    kept.refresh()
    assert "more memory than its limit" in str(kept.why)
    used["bytes"] = 950
    kept.refresh()
    assert kept.why is not None, "not well below yet"
    used["bytes"] = 899
    kept.refresh()
    assert kept.why is None
    assert apply_terms._memory_of_processes() == 899


def test_nice_level_applies_to_all_processes() -> None:
    program = "import subprocess, sys, time; subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)']).wait()"
    code = (
        "import os, subprocess, sys, time\n"
        "from worker.machine.process_tree import process_times\n"
        "from worker.process.apply_terms import TermsKeeper\nfrom protocol.terms import Terms\n"
        f"child = subprocess.Popen([sys.executable, '-c', {program!r}])\n"
        "while len(process_times()) < 3: time.sleep(0.05)\n"
        "kept = TermsKeeper(1)\nfirst = os.getpriority(os.PRIO_PROCESS, 0)\n"
        "kept.request(Terms(nice=first + 3).to_bytes())\nkept.refresh()\n"
        "levels = {os.getpriority(os.PRIO_PROCESS, pid) - first for pid in process_times()}\n"
        "print(sorted(levels), kept.offer().nice - first, kept.trouble)\n"
        "for pid in process_times().keys() - {os.getpid()}: os.kill(pid, 9)\n"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert ran.stdout == "[3] 3 None\n", ran.stderr


def test_process_times_covers_descendants() -> None:
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    try:
        wait_until(lambda: child.pid in process_times(), 20, "the child is seen")
        assert os.getpid() in process_times()
        assert os.getppid() not in process_times()
    finally:
        child.kill()
        child.wait()
    time.sleep(0)
    assert child.pid not in process_times()
