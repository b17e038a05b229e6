"""Tests of a whole farm on each Redis and Valkey server at hand.

RAYFARM_TEST_BROKERS names server programs, separated by colons, besides the one that a farm uses by default.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

import psutil
import pytest
import redis

from rayfarm.local import broker
from service.access.redis_release import release_of
from tests.chaos.test_digest import SPP, digest_without_farm, finish, half_way, kill_part, submit
from tests.helpers import start_farm, stop_farm, wait_until

PROGRAMS = [broker.find_server(), *map(Path, filter(None, os.environ.get("RAYFARM_TEST_BROKERS", "").split(os.pathsep)))]


@pytest.fixture(scope="module")
def expected() -> str:
    return digest_without_farm(SPP)


@pytest.mark.long
@pytest.mark.parametrize("program", PROGRAMS, ids=lambda program: str(broker.server_release(program)).replace(" ", "-"))
def test_farm_renders_the_same_bits_on_every_broker(tmp_path: Path, expected: str, program: Path) -> None:
    """A farm prepares a scene, renders it, loses its broker half way and finishes with the digest of one process."""
    farm = start_farm(tmp_path / "data", 2, module="tests.without_spares", RAYFARM_REDIS_SERVER=str(program))
    try:
        assert Path(psutil.Process(farm.pids()["redis"]).exe()) == program.resolve()
        with redis.Redis.from_url(json.loads((farm.data / "farm.json").read_text())["redis_url"]) as store:
            assert release_of(store.info("server")) == broker.server_release(program)
        job = submit(farm)
        half_way(farm, job)
        kill_part("redis")(farm)
        assert finish(farm, job) == expected
        with farm.client() as client:
            wait_until(lambda: all(worker.state == "ready" for worker in client.workers()), 20, "the worker is connected again")
    finally:
        stop_farm(farm)
