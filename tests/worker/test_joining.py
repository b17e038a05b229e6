"""Joining the farm: in the background, with patience, by a name of its own."""

from __future__ import annotations

import os
import subprocess
import sys
import time

import pytest
import redis

from tests.helpers import wait_until
from worker.contract import WorkerReport, worker_key
from worker.joining import Joining, free_name
from worker.errors import LinkError, RefusedError
from worker.link import FarmAnswer, Link


def report(name: str, pid: int, host: str = "here") -> WorkerReport:
    return WorkerReport(name, host, pid, 2, "cpu", "kind", "starting", time.time())


class Service(Link):
    """A service that answers as it is told to, one answer after the other."""

    def __init__(self, *answers: FarmAnswer | Exception) -> None:
        super().__init__("http://service.invalid", "token")
        self.answers = list(answers)

    def join(self) -> FarmAnswer:
        answer = self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]
        if isinstance(answer, Exception):
            raise answer
        return answer


def joining(service: Service, said: list[str]) -> Joining:
    return Joining(service, None, "vm", "here", lambda name: report(name, os.getpid()), said.append)


def test_it_waits_for_the_service_and_then_reports_starting(redis_url: str, store: redis.Redis) -> None:
    said: list[str] = []
    answer = FarmAnswer(redis_url, "instance", "")
    begun = joining(Service(LinkError("no answer"), LinkError("no answer"), answer), said)
    begun.begin()
    wait_until(lambda: store.get(worker_key("vm")) is not None, 5, "the report is there")
    joined = begun.finish(lambda: False)
    assert joined is not None
    assert (joined.farm, joined.redis_url, joined.name) == (answer, redis_url, "vm")
    assert said == ["waiting for the service: no answer"]


def test_a_refusal_is_told_at_once_or_when_it_comes() -> None:
    with pytest.raises(RefusedError):
        joining(Service(RefusedError("wrong token")), []).begin()
    later = joining(Service(LinkError("no answer"), RefusedError("wrong token")), [])
    later.begin()
    with pytest.raises(RefusedError):
        later.finish(lambda: False)


def test_it_can_be_stopped_while_it_waits() -> None:
    waiting = joining(Service(LinkError("no answer")), [])
    waiting.begin()
    assert waiting.finish(lambda: True) is None


def test_a_name_in_use_gets_a_number(redis_url: str, store: redis.Redis) -> None:
    assert free_name("vm", redis_url, "here") == "vm"
    store.set(worker_key("vm"), report("vm", 1).to_bytes())  # process 1 lives
    assert free_name("vm", redis_url, "here") == "vm-2"
    store.set(worker_key("vm-2"), report("vm-2", 12345, host="elsewhere").to_bytes())
    assert free_name("vm", redis_url, "here") == "vm-3"


def test_the_name_of_a_dead_worker_of_this_host_is_taken_again(redis_url: str, store: redis.Redis) -> None:
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    store.set(worker_key("vm"), report("vm", dead.pid).to_bytes())
    assert free_name("vm", redis_url, "here") == "vm"
